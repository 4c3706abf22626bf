"""People beside many arms: each arm's move as they would beside a single one."""

import copy
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS, Crowd, HumanMotion, Nobody, Paced, Steered, make_human, nobody
from jssa_gym.humans.hand import Gesturer
from jssa_gym.humans.walker import Walker
from jssa_gym.kernels.limbs import GESTURE, LIMB, go_on
from jssa_gym.kernels.records import records
from jssa_gym.kernels.walkers import AHEAD, WALKER, choose
from jssa_gym.tick.walks import gesture_all, place_gesture, place_walker, walk_all
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.vectors import Mask

_OURS = (*HUMANS.values(), Steered)


def refuse_foreign(motion: HumanMotion) -> None:
    """Refuse people who move as a user's own code says.

    Raises:
        ParameterError: They do.
    """
    if isinstance(motion, Crowd) and type(motion) is Crowd:
        for one in motion.motions:
            refuse_foreign(one)
    elif motion.comers is not None:
        raise ParameterError(
            f"{type(motion).__name__} come and go, and a vector has the same people throughout: take "
            "vectorization_mode='sync'"
        )
    elif type(motion) is Paced:
        refuse_foreign(motion.motion)
    elif type(motion) not in _OURS:
        raise ParameterError(
            f"people of the kind {type(motion).__name__} are moved by Python of your own: vectors take "
            f"{', '.join(HUMANS)}, files of recordings, and crowds of these; for others take vectorization_mode='sync'"
        )


class Beside:
    """People beside many arms; subclasses say how they move. Whoever keeps still, as nobody does, needs none.

    Args:
        motions: Who is beside each arm; the same object may be it for all, if nothing of it is kept.
        parts: How many capsules are beside each.
    """

    def __init__(self, motions: list[HumanMotion], parts: int) -> None:
        self.motions = motions
        self.ends = np.zeros((len(motions), 4, parts, 3))
        """Starts, ends and their velocities of human capsules, shape (E, 4, k, 3) [m, m/s]."""
        self.radius = np.zeros((len(motions), parts))
        """Shape (E, k) [m]."""

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        """An episode of arm ``e`` begins, with people as ``motions[e]`` and ``people`` have them now."""
        self.ends[e], self.radius[e] = people[:4], people.radius

    def settle(self, e: int) -> None:
        """The generator of arm ``e`` is about to be used by somebody else."""

    def step(self, live: Mask, dt: float, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        """Move on by ``dt`` [s] beside those arms that are ``live``; their capsules are of shape (E, m) or (E, 0)."""


class OneByOne(Beside):
    """People who are moved in Python, an object for each arm."""

    def step(self, live: Mask, dt: float, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        for e in np.flatnonzero(live):
            robot = _capsules(segments[e], names) if segments.shape[1] else nobody()
            people = self.motions[e].step(dt, robot)
            self.ends[e], self.radius[e] = people[:4], people.radius


class DrawnAhead(Beside):
    """People who move as kernels say; subclasses say which.

    What they need of random numbers is drawn ahead, in blocks, from a copy of each arm's generator, which is moved on
    by as many as they used before anybody else uses it: one after the other they are those of a single environment.
    """

    layout: ClassVar[np.dtype[Any]]
    """Of what is known of each arm's people."""

    def __init__(self, motions: list[HumanMotion], parts: int) -> None:
        super().__init__(motions, parts)
        count = len(motions)
        self._records, self._stuck = records(count, self.layout), np.zeros(count, np.int64)
        self._start, self._end = np.zeros((2, count, parts, 3))
        self._rngs: list[np.random.Generator | None] = [None] * count
        self._ahead: dict[int, np.random.Generator] = {}
        self._given = np.zeros(count, np.int64)

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        motion: Any = self.motions[e]
        self._records[e : e + 1] = motion.record
        self._records[e]["drawn"] = self._records[e]["used"] = 0
        self._start[e], self._end[e] = motion.body.start, motion.body.end
        self._rngs[e], self._given[e] = rng, 0
        self._ahead.pop(e, None)

    def settle(self, e: int) -> None:
        record, rng = self._records[e], self._rngs[e]
        used = int(self._given[e] - (record["drawn"] - record["used"]))
        if rng is not None and used:
            rng.random(used)
            self._given[e] -= used

    def _draw_ahead(self, e: int) -> None:
        """Fill up what arm ``e``'s people have of random numbers."""
        if e not in self._ahead:
            self._ahead[e] = copy.deepcopy(self._rngs[e])  # ty: ignore[invalid-assignment]  # who moves has one
        record = self._records[e]
        left = record["ahead"][record["used"] : record["drawn"]].copy()
        fresh = self._ahead[e].random(AHEAD - len(left))
        record["ahead"], record["drawn"], record["used"] = np.concatenate([left, fresh]), AHEAD, 0
        self._given[e] += len(fresh)


class Walkers(DrawnAhead):
    """People who walk."""

    layout = WALKER

    def step(self, live: Mask, dt: float, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        walkers, start, end = self._records, self._start, self._end
        stuck = walk_all(walkers, start, end, self.radius[0], live, dt, segments, (self.ends, self._stuck))
        for e in self._stuck[:stuck].tolist():
            self._draw_ahead(e)
            while not choose(walkers[e : e + 1], dt):
                self._draw_ahead(e)
            place_walker(walkers, start, end, e, self.ends)


class Gesturers(DrawnAhead):
    """People who stand and move their hands."""

    layout = GESTURE

    def __init__(self, motions: list[HumanMotion], parts: int) -> None:
        super().__init__(motions, parts)
        self._limbs = records((len(motions), 2), LIMB)

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        motion: Any = self.motions[e]
        self._limbs[e] = motion.limbs

    def step(self, live: Mask, dt: float, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        people, limbs, start, end = self._records, self._limbs, self._start, self._end
        stuck = gesture_all(people, limbs, start, end, live, dt, segments, (self.ends, self._stuck))
        for e in self._stuck[:stuck].tolist():
            robot = _capsules(segments[e], names) if segments.shape[1] else nobody()
            self._draw_ahead(e)
            while not go_on(people[e : e + 1], limbs[e], dt, robot.start, robot.end, robot.radius):
                self._draw_ahead(e)
            place_gesture(people, limbs, start, end, e, self.ends)


def beside(motion: HumanMotion, count: int, parts: int) -> Beside:
    """People as ``motion`` has them beside so many arms; ``parts`` are their capsules."""
    if isinstance(motion, Nobody):
        return Beside([motion] * count, parts)
    if isinstance(motion, Walker):
        return Walkers([motion] * count, parts)
    if isinstance(motion, Gesturer):
        return Gesturers([motion] * count, parts)
    return OneByOne([make_human(motion) for _ in range(count)], parts)


def _capsules(segments: NDArray[Any], names: tuple[str, ...]) -> CapsuleSet:
    """An arm's capsules as reacting people see them; as of ``Surroundings.robot_capsules``."""
    ends: list[Array] = [
        segments[field].copy() for field in ("start", "end", "start_velocity", "end_velocity", "radius")
    ]
    return CapsuleSet(*ends, names, np.zeros(len(segments), np.int64))
