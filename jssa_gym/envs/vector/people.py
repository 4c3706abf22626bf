"""People beside many arms: each arm's move as they would beside a single one."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.surroundings import capsules_of
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS, Crowd, HumanMotion, Nobody, Paced, Recorded, Steered, make_human, nobody
from jssa_gym.humans.hand import Gesturer
from jssa_gym.humans.walker import Walker
from jssa_gym.kernels.limbs import GESTURE, LIMB
from jssa_gym.kernels.playing import PLAYER
from jssa_gym.kernels.records import records
from jssa_gym.kernels.walkers import WALKER
from jssa_gym.tick.walks import gesture_all, play_all, walk_all
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
        motion: Who is beside each arm.
        count: How many arms.
        parts: How many capsules are beside each.
    """

    def __init__(self, motion: HumanMotion, count: int, parts: int) -> None:
        self._motion: Any = motion
        self.ends = np.zeros((count, 4, parts, 3))
        """Starts, ends and their velocities of human capsules, shape (E, 4, k, 3) [m, m/s]."""
        self.radius = np.zeros((count, parts))
        """Shape (E, k) [m]."""

    def motion_of(self, e: int) -> HumanMotion:
        """What begins the episodes of arm ``e``; the same for all, if it keeps nothing of them."""
        return self._motion

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        """An episode of arm ``e`` begins, with people as :meth:`motion_of` and ``people`` have them now."""
        self.ends[e], self.radius[e] = people[:4], people.radius

    def step(self, live: Mask, dt: Array, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        """Move on beside those arms that are ``live``.

        Args:
            live: Shape (E,).
            dt: For how long, shape (E,) [s].
            segments: The arms' capsules, shape (E, m), or (E, 0) if nobody looks.
            names: Of these capsules.
        """


class OneByOne(Beside):
    """People who are moved in Python, an object for each arm."""

    def __init__(self, motion: HumanMotion, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._motions = [make_human(motion) for _ in range(count)]

    def motion_of(self, e: int) -> HumanMotion:
        return self._motions[e]

    def step(self, live: Mask, dt: Array, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        for e in np.flatnonzero(live):
            robot = capsules_of(segments[e], names) if segments.shape[1] else nobody()
            people = self._motions[e].step(float(dt[e]), robot)
            self.ends[e], self.radius[e] = people[:4], people.radius


class Compiled(Beside, ABC):
    """People who move as kernels say; subclasses say which.

    Everybody moves in one call. Who waits for something in the middle of a step is supplied with it, and goes on in
    another.
    """

    layout: ClassVar[np.dtype[Any]]
    """Layout of what is known of each arm's people."""

    def __init__(self, motion: HumanMotion, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._records, self._waits = records(count, self.layout), np.zeros(count, np.bool_)

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        self._records[e : e + 1] = self._motion.record

    def step(self, live: Mask, dt: Array, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        waiting = self._move(live, dt, segments, False)
        while waiting:
            self._supply(np.flatnonzero(self._waits))
            waiting = self._move(self._waits, dt, segments, True)

    @abstractmethod
    def _move(self, live: Mask, dt: Array, segments: NDArray[Any], again: bool) -> int:
        """Move those who are ``live``; how many wait. Arguments as of :func:`~jssa_gym.tick.walks.walk_all`."""

    @abstractmethod
    def _supply(self, who: NDArray[np.intp]) -> None:
        """Give those who wait, by number, what they lack."""


class Drawing(Compiled):
    """People who draw as they go, each from the generator of their own arm, as many numbers as they need."""

    def __init__(self, motion: HumanMotion, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._start, self._end = np.zeros((2, count, parts, 3))
        self._rngs: list[np.random.Generator | None] = [None] * count

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        self._start[e], self._end[e] = self._motion.body.start, self._motion.body.end
        self._rngs[e] = rng

    @property
    def _body(self) -> tuple[Array, Array, Array]:
        return self._start, self._end, self.radius[0]

    def _supply(self, who: NDArray[np.intp]) -> None:
        ahead, counts = self._records["ahead"], self._asked(who)
        for e, count in zip(who.tolist(), counts.tolist(), strict=True):
            ahead[e, :count] = self._rngs[e].random(count)  # who draws has one
        self._records["drawn"][who], self._records["used"][who] = counts, 0

    @abstractmethod
    def _asked(self, who: NDArray[np.intp]) -> NDArray[np.int64]:
        """How many random numbers each of them needs."""


class Walkers(Drawing):
    """People who walk."""

    layout = WALKER

    def _move(self, live: Mask, dt: Array, segments: NDArray[Any], again: bool) -> int:
        return walk_all(self._records, self._body, live, dt, segments, self.ends, self._waits, again)

    def _asked(self, who: NDArray[np.intp]) -> NDArray[np.int64]:
        return np.full(len(who), self._motion.draws)


class Gesturers(Drawing):
    """People who stand and move their hands."""

    layout = GESTURE

    def __init__(self, motion: HumanMotion, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._limbs = records((count, 2), LIMB)

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        self._limbs[e] = self._motion.limbs

    def _move(self, live: Mask, dt: Array, segments: NDArray[Any], again: bool) -> int:
        gestures = (self._records, self._limbs)
        return gesture_all(gestures, self._body, live, dt, segments, self.ends, self._waits, again)

    def _asked(self, who: NDArray[np.intp]) -> NDArray[np.int64]:
        return self._records["asks"][who]


class RecordedPeople(Compiled):
    """People who play one recording, each placed elsewhere: all read the one, and have two samples of it placed."""

    layout = PLAYER

    def __init__(self, motion: Recorded, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._samples = np.zeros((count, 2, 2, parts, 3))
        self._turn, self._way = np.zeros((count, 3, 3)), np.zeros((count, 3))

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        one = self._motion
        self.ends[e], self._samples[e] = one.ends, one.samples
        self._turn[e], self._way[e] = one.placement

    def _move(self, live: Mask, dt: Array, segments: NDArray[Any], again: bool) -> int:
        times = self._motion.times
        return play_all(self._records, times, self._samples, live, dt, self.ends, self._waits, again)

    def _supply(self, who: NDArray[np.intp]) -> None:
        wanted = self._records["sample"][who]
        self._samples[who] = self._motion.recording.ends_at(wanted, self._turn[who], self._way[who])
        self._records["placed"][who] = wanted


class Crowds(Beside):
    """Several motions at once: each moves beside all arms, one after the other, as in a single crowd."""

    def __init__(self, motion: Crowd, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._members: list[tuple[Beside, slice]] = []
        first = 0
        for one in motion.motions:
            last = first + len(make_human(one).reset(np.random.default_rng(0)).radius)
            self._members.append((beside(one, count, last - first), slice(first, last)))
            first = last

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        for member, own in self._members:
            member.begin(e, CapsuleSet._make(field[own] for field in people), rng)

    def step(self, live: Mask, dt: Array, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        for member, own in self._members:
            member.step(live, dt, segments, names)
            self.ends[:, :, own] = member.ends


class Slowed(Beside):
    """People in slow motion, each at the pace of their own episode."""

    def __init__(self, motion: Paced, count: int, parts: int) -> None:
        super().__init__(motion, count, parts)
        self._paced, self._pace = motion, np.zeros(count)
        self._others = beside(motion.motion, count, parts)

    def begin(self, e: int, people: CapsuleSet, rng: np.random.Generator | None) -> None:
        super().begin(e, people, rng)
        self._others.begin(e, people, rng)
        self._pace[e] = self._paced.now

    def step(self, live: Mask, dt: Array, segments: NDArray[Any], names: tuple[str, ...]) -> None:
        moves = live & (self._pace > 0.0)
        self._others.step(moves, self._pace * dt, segments, names)
        self.ends[moves] = self._others.ends[moves]
        self.ends[moves, 2:] *= self._pace[moves, None, None, None]


def beside(motion: HumanMotion, count: int, parts: int) -> Beside:
    """People as ``motion`` has them beside so many arms; ``parts`` are their capsules.

    What begins their episodes is ``motion`` itself, unless they are moved :class:`OneByOne`.
    """
    if _in_python(motion):
        return OneByOne(motion, count, parts)
    if isinstance(motion, Crowd):
        return Crowds(motion, count, parts)
    if isinstance(motion, Paced):
        return Slowed(motion, count, parts)
    if isinstance(motion, Recorded):
        return RecordedPeople(motion, count, parts)
    if isinstance(motion, Walker):
        return Walkers(motion, count, parts)
    if isinstance(motion, Gesturer):
        return Gesturers(motion, count, parts)
    return Beside(motion, count, parts)  # nobody


def _in_python(motion: HumanMotion) -> bool:
    """Whether anybody is moved in Python: whoever is steered, and of whom no kernel is known."""
    if isinstance(motion, Crowd):
        return any(_in_python(one) for one in motion.motions)
    if isinstance(motion, Paced):
        return _in_python(motion.motion)
    return not isinstance(motion, (Nobody, Recorded, Walker, Gesturer))
