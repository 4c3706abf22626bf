"""One arm's records, and the pointer to them that a control step takes."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.tick import layout
from jssa_gym.tick.layout import ArmRecord, StepSettings
from jssa_gym.tick.structs import arms
from jssa_gym.types import Array

ONE = np.ones(1, np.bool_)
"""The single arm is asked."""


class View(NamedTuple):
    """One arm's entries of its records; fields as of :mod:`jssa_gym.tick.layout`."""

    arms: Any
    """What :func:`~jssa_gym.tick.loop.decide_all` takes."""
    nominal: Array
    """Shape (1, n) [rad/s³]: for the same."""
    now: NDArray
    joints: Array
    position: Array
    velocity: Array
    acceleration: Array
    start: Array
    end: Array
    start_velocity: Array
    end_velocity: Array
    radius: Array
    age: Array
    valid: NDArray[np.bool_]
    person: NDArray[np.int64]
    normal: Array
    offset: Array
    told: NDArray
    jerk: Array
    state: Array


class Records:
    """All that one arm's control step reads, remembers and answers.

    Copies and pickles hold the arrays; the pointer, and the views of one arm's entries, are made anew where they are
    used next.

    Args:
        robot: The arm.
        settings: How it is looked after.
        proposal: The parameters of whoever proposes, of a type in :data:`~jssa_gym.tick.propose.KINDS`, or ``Foreign``.
    """

    def __init__(self, robot: ArmRecord, settings: StepSettings, proposal: Any) -> None:
        self.robot, self.settings, self.proposal = robot, settings, proposal
        n = len(robot.links)
        self.memory = layout.memory(1, n, 0, 0, 0)
        self.scene, self.answer = layout.scene_record(1, n, 0, 0, 0), layout.answer(1, n)
        self._rooms: dict[tuple[int, ...], tuple[Any, ...]] = {}
        self._allocate(0, 0, 0)

    def make_room(self, people: int | None = None, statics: int | None = None, planes: int | None = None) -> None:
        """Make room for other numbers of capsules and half-spaces; what is remembered of those before is lost."""
        wanted = zip((people, statics, planes), self.sizes, strict=True)
        sizes = tuple(old if new is None else new for new, old in wanted)
        if sizes != self.sizes:
            self._rooms.clear()
            self._allocate(*sizes)

    def rearrange(self, source: Sequence[int]) -> None:
        """Make room for other people's capsules: for each the number of the one before whose track it is, -1 for none.

        What was made for as many before is used again.
        """
        none = layout.memory(1, len(self.robot.links), 1, 0, 0).tracks[0]
        tracks = np.concatenate([self.memory.tracks[0], none])[np.array(source, np.int64)]
        sizes = (len(source), *self.sizes[1:])
        if sizes != self.sizes:
            self._rooms[self.sizes] = self.memory, self.scene, self.work, self._view
            if sizes in self._rooms:
                self.memory, self.scene, self.work, self._view = self._rooms[sizes]
                self.sizes = sizes
            else:
                self._allocate(*sizes)
        self.memory.tracks[0] = tracks

    def _allocate(self, people: int, statics: int, planes: int) -> None:
        n = len(self.robot.links)
        self.memory = _kept(self.memory, layout.memory(1, n, people, statics, planes))
        self.scene = _kept(self.scene, layout.scene_record(1, n, people, statics, planes))
        self.work = layout.work(self.robot, people, statics, planes, static_rows=self.settings.static_rows)
        self.sizes = people, statics, planes
        self._view: View | None = None

    @property
    def view(self) -> View:
        """The arm's entries; not to be kept: other numbers of people and copies make others."""
        if self._view is None:
            scene, answer = self.scene, self.answer
            self._view = View(
                arms(self.robot, self.settings, self.proposal, self.memory, scene, self.work, answer),
                np.zeros((1, len(self.robot.links))),
                scene.now,
                scene.joints[0],
                *scene.joints[0],
                *scene.ends[0],
                *(part[0] for part in (scene.radius, scene.age, scene.valid, scene.person)),
                *(scene.normal[0], scene.offset[0]),
                answer.told,
                answer.jerk[0],
                self.memory.state[0],
            )
        return self._view

    def release(self) -> None:
        """Let go of pointer and views, so that nothing shares memory."""
        self._view = None
        self._rooms.clear()


def _kept(old: Any, new: Any) -> Any:
    """The arrays of ``old`` where they have the shape of those of ``new``."""
    return type(new)(*(had if had.shape == made.shape else made for had, made in zip(old, new, strict=True)))
