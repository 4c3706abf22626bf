"""Many arms at once: each decides as a filter of its own would, bit for bit, in one compiled call."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.tick import layout, loop
from jssa_gym.tick.assumed import assume
from jssa_gym.tick.structs import arms
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer
from jssa_gym.vectors import Mask


class Batch:
    """The control steps of arms that one filter would look after, each with people of its own.

    Whoever makes one fills :attr:`scene`, calls :meth:`start` where episodes begin and :meth:`decide` once a control
    step, and reads :attr:`answer`. What is filled in has to be sound in shape and type; whether it is to be believed
    is decided here, as for a single arm.

    Args:
        filter: Says how all of them are looked after; it is not used itself.
        count: How many arms.
        people: Names of every arm's human capsules.
        statics: Number of static capsules.
        planes: Number of half-spaces.

    Raises:
        ParameterError: The filter proposes in Python: then every arm needs one of its own.
    """

    def __init__(
        self, filter: SafetyFilter, count: int, people: Sequence[str], *, statics: int = 0, planes: int = 0
    ) -> None:
        if not filter.compiled:
            raise ParameterError(
                f"{type(filter).__name__} proposes in Python, one arm at a time: give each arm a filter of its own "
                "(compiled are all that have a name, with the exact projector)"
            )
        if filter.failsafe is not None and filter.failsafe.watched is not None:
            raise ParameterError(
                "many arms at once have the same people throughout: watched has to be None for them, "
                "or each arm has a shield of its own"
            )
        count = positive_integer("count", count)
        robot, sizes, settings = filter.records.robot, (len(people), statics, planes), filter.settings()
        n = len(robot.links)
        self.memory = layout.memory(count, n, *sizes)
        """What each arm's shield remembers, shapes (E, ...)."""
        self.scene = layout.scene_record(count, n, *sizes)
        """What each is shown."""
        self.answer = layout.answer(count, n)
        """What was decided for each; codes become words in :mod:`jssa_gym.shields.words`."""
        self.scene.now[["timed", "joints", "people", "seen", "fixtures"]] = True
        assume(self.memory, filter.assumed(people))
        self._work = layout.work(robot, *sizes, static_rows=settings.static_rows)
        self._robot, self._settings, self._proposal = robot, settings, filter.proposal
        self._arms: Any = None
        self._all = np.ones(count, np.bool_)
        filter.compile_ahead()

    @property
    def arms(self) -> Any:
        """What the compiled loop takes."""
        if self._arms is None:
            self._arms = arms(
                self._robot, self._settings, self._proposal, self.memory, self.scene, self._work, self.answer
            )  # fmt: skip
        return self._arms

    def __getstate__(self) -> dict[str, Any]:
        """Without the pointer, which is none elsewhere."""
        return {**self.__dict__, "_arms": None}

    def start(self, asked: Mask | None = None) -> None:
        """Forget the past of every arm, or of those ``asked``, shape (E,): episodes begin with what is shown."""
        which = self._all if asked is None else asked
        loop.start(self.arms, which)
        self.answer.told["margin"][which] = np.inf

    @property
    def present(self) -> Array:
        """Where the arms are taken to be: with a verified stop where the applied jerks have led, shape (E, 3, n)."""
        return self.memory.expected if self._settings.guarded else self.scene.joints

    @property
    def margin(self) -> Array:
        """Room that the last nominals' stops left to people, shape (E,) [m]; inf without a verified stop."""
        told = self.answer.told["margin"]
        return told.copy() if self._settings.guarded else np.full_like(told, np.inf)

    def decide(self, nominal: Array, asked: Mask | None = None) -> layout.Answer:
        """Decide for every arm.

        Args:
            nominal: The policies' jerks, shape (E, n) [rad/s³]; need not be finite.
            asked: Which arms decide, shape (E,); what is remembered of the others, and their answers, stay. None: all.

        Raises:
            ParameterError: They have another shape or type.
        """
        shape = self.answer.jerk.shape
        if not (isinstance(nominal, np.ndarray) and nominal.shape == shape and nominal.dtype == np.float64):
            raise ParameterError(f"nominal has to be a float64 array of shape {shape}")
        loop.decide_all(self.arms, np.ascontiguousarray(nominal), self._all if asked is None else asked)
        return self.answer
