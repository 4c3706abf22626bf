"""How people move beside the arm.

A motion owns its state and draws only from the generator it is given: same seed, same bits. The velocities in a
returned :class:`~jssa_gym.types.CapsuleSet` are those of the step to come, so that start + velocity · dt is exactly
where the capsule will be. Motions that react get the robot's capsules in every step.

People keep their root at least :data:`CLEARANCE` from the robot's base axis (the world's z axis).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import Body, nobody, together
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import positive_number, real_array

Point = tuple[float, float]

_STILL: Point = (0.0, 0.0)

_ARRIVED = 0.1
"""Distance from which a wandering person picks the next place to go to [m]."""

CLEARANCE = 0.6
"""Smallest distance of a person's root from the base axis [m]."""


class HumanMotion(ABC):
    """The people in a scene, one step after the other."""

    people: int = 1
    """How many."""
    speed_bound: float
    """No point of a body moves faster [m/s]."""
    reacts: bool = True
    """Whether :meth:`step` looks at the robot; if not, it is spared the work and given an empty set."""

    @abstractmethod
    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        """Begin an episode.

        Args:
            rng: The only source of randomness.
            start: Root to begin at, shape (2,) [m]; None lets the motion draw it.
            person: Id of the (first) person.
        """

    @abstractmethod
    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        """Move on by ``dt`` [s]; ``robot`` is the arm at the beginning of the step."""

    def check_start(self, start: Array) -> None:  # noqa: B027  # a motion may take any start
        """Refuse a start that :meth:`reset` could not take, with a ParameterError; (2,) [m]."""


class Nobody(HumanMotion):
    """Nobody is there."""

    people = 0
    speed_bound = 0.0
    reacts = False

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        return nobody()

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        return nobody()


class Walk(HumanMotion):
    """A rigid body that walks at piecewise-constant velocity; subclasses say where to and how fast."""

    reacts = False

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        if start is not None:
            self.check_start(start)
        root, heading = self._begin(rng, start)
        self._time, self._root = 0.0, (float(root[0]), float(root[1]))
        self._body = Body.facing(heading, person)
        self._velocity = self._next_velocity(0.0)
        return self._body.at(self._root, self._velocity)

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        (x, y), (vx, vy) = self._root, self._velocity
        self._root = (x + vx * dt, y + vy * dt)
        self._time += dt
        self._velocity = self._next_velocity(dt)
        return self._body.at(self._root, self._velocity)

    def check_start(self, start: Array) -> None:
        if not np.hypot(*start) >= CLEARANCE:
            raise ParameterError(f"a person's root keeps {CLEARANCE} m from the base axis; start is {start.tolist()}")

    @abstractmethod
    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        """Draw an episode: the root's start (2,) [m] and the body's heading [rad]."""

    @abstractmethod
    def _next_velocity(self, dt: float) -> Point:
        """Velocity of the step to come [m/s], which lasts about ``dt`` [s]; 0 before the first."""


def _range(name: str, low_high: Sequence[float], least: float = 0.0) -> tuple[float, float]:
    low, high = real_array(name, low_high, (2,), "(low, high)").tolist()
    if not least <= low <= high:
        raise ParameterError(f"{name} has to be (low, high) with {least} <= low <= high, got {low_high!r}")
    return low, high


class ConstantVelocity(Walk):
    """A straight walk through the workspace or past it: side, heading, speed and moment are drawn.

    Args:
        speed: Range of the walking speed [m/s].
        offset: Range of the root's smallest distance from the base axis [m]. The arms of the body reach 0.6 m to its
            sides, so that below 0.8 m one of them brushes the robot's base.
        passing: Range of the time of the closest approach [s].
    """

    def __init__(
        self,
        speed: Sequence[float] = (0.3, 1.6),
        offset: Sequence[float] = (0.85, 1.3),
        passing: Sequence[float] = (1.5, 5.0),
    ) -> None:
        self.speed = _range("speed", speed)
        self.offset = _range("offset", offset, CLEARANCE)
        self.passing = _range("passing", passing)
        self.speed_bound = self.speed[1]

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        heading = rng.uniform(-np.pi, np.pi)
        side = rng.choice([-1.0, 1.0])
        speed, offset, passing = (rng.uniform(*r) for r in (self.speed, self.offset, self.passing))
        if start is not None:
            # from there, past the base axis at the drawn offset or, too near for that, straight across
            distance = np.hypot(*start)
            heading = np.arctan2(-start[1], -start[0]) + side * np.arcsin(min(offset / distance, 1.0))
        direction = np.array([np.cos(heading), np.sin(heading)])
        closest = side * offset * np.array([-direction[1], direction[0]])
        walking = speed * direction
        self._walking = (float(walking[0]), float(walking[1]))
        root = closest - walking * passing if start is None else start
        return root, heading

    def _next_velocity(self, dt: float) -> Point:
        return self._walking


class ApproachRetreat(Walk):
    """The paper's Fig. 5: walks up in front of the arm, slows down, stops, steps back.

    Args:
        start: Root at the beginning [m]; x is in front of the arm.
        nearest: Range of the root's x where the person stops [m].
        side: Range of the root's y [m].
        speed: Range of the walking speed [m/s]; the last third of the way is walked at half of it.
        wait: Range of the time before the person starts [s].
        stay: Range of the time the person stays [s].
    """

    def __init__(
        self,
        start: float = 1.8,
        nearest: Sequence[float] = (0.62, 0.85),
        side: Sequence[float] = (-0.2, 0.2),
        speed: Sequence[float] = (0.4, 0.8),
        wait: Sequence[float] = (0.2, 1.0),
        stay: Sequence[float] = (0.5, 1.5),
    ) -> None:
        self.nearest = _range("nearest", nearest, CLEARANCE)
        self.start = positive_number("start", start)
        if not self.nearest[1] < self.start:
            raise ParameterError(f"start has to be beyond nearest {self.nearest}, got {start!r}")
        self.side = _range("side", side, -np.inf)
        self.speed, self.wait, self.stay = (
            _range(n, r) for n, r in zip(("speed", "wait", "stay"), (speed, wait, stay), strict=True)
        )
        self.speed_bound = self.speed[1]

    def check_start(self, start: Array) -> None:
        super().check_start(start)
        if not start[0] >= self.nearest[1]:
            raise ParameterError(
                f"the person comes from in front: start needs x >= {self.nearest[1]}, got {start.tolist()}"
            )

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        nearest, side, speed, wait, stay = (
            rng.uniform(*r) for r in (self.nearest, self.side, self.speed, self.wait, self.stay)
        )
        root = np.array([self.start, side]) if start is None else start
        way = np.array([nearest, root[1]]) - root
        length = float(np.hypot(*way))
        self._stop = nearest
        x, y = (float(c) for c in (way / length * speed if length > 0.0 else np.zeros(2)))
        # (end of the segment [s], velocity); the last one lasts for ever
        fast, slow = 2.0 / 3.0 * length / max(speed, 1e-9), 2.0 / 3.0 * length / max(speed, 1e-9)
        moments = np.cumsum([wait, fast, slow, stay, length / max(speed, 1e-9)])
        velocities = (_STILL, (x, y), (x / 2.0, y / 2.0), _STILL, (-x, -y))
        self._segments = list(zip(moments.tolist(), velocities, strict=True))
        return root, np.pi

    def _next_velocity(self, dt: float) -> Point:
        for end, velocity in self._segments:
            if self._time + dt <= end + 1e-9:
                return self._short_of_stop(velocity, dt)
        return _STILL

    def _short_of_stop(self, velocity: Point, dt: float) -> Point:
        """Cut the step that would lead beyond the place to stop at: segments end between steps."""
        if dt > 0.0 and self._root[0] + velocity[0] * dt < self._stop:
            return (self._stop - self._root[0]) / dt, 0.0
        return velocity


class RandomWalk(Walk):
    """Wanders in front of the arm from one random place to the next, speed and change of velocity bounded.

    Args:
        speed: Largest speed [m/s].
        change: Largest change of velocity from one segment to the next [m/s].
        period: Duration of a segment [s].
        region: ((x_low, x_high), (y_low, y_high)) that the root stays in [m].
    """

    def __init__(
        self,
        speed: float = 1.0,
        change: float = 0.4,
        period: float = 0.2,
        region: Sequence[Sequence[float]] = ((0.65, 2.0), (-1.2, 1.2)),
    ) -> None:
        self.speed_bound = positive_number("speed", speed)
        self.change, self.period = positive_number("change", change), positive_number("period", period)
        self._low, self._high = real_array("region", region, (2, 2), "((x_low, x_high), (y_low, y_high))").T
        if np.any(self._low >= self._high):
            raise ParameterError(f"region has to be ((x_low, x_high), (y_low, y_high)), got {region!r}")
        if np.hypot(*(self._high - self._low)) < 4.0 * _ARRIVED:
            raise ParameterError(f"region has to be at least {4.0 * _ARRIVED} m across, got {region!r}")
        nearest = np.hypot(*np.clip(np.zeros(2), self._low, self._high))
        if nearest < CLEARANCE:
            raise ParameterError(
                f"region has to keep {CLEARANCE} m from the base axis, it comes within {nearest:.2f} m"
            )

    def check_start(self, start: Array) -> None:
        super().check_start(start)
        if np.any(start < self._low) or np.any(start > self._high):
            raise ParameterError(f"start {start.tolist()} is outside the region of this motion")

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        self._rng = rng
        if start is None:
            # not within the arm's reach at once: the far half
            low = np.array([(self._low[0] + self._high[0]) / 2.0, self._low[1]])
            start = rng.uniform(low, self._high)
        self._goal, self._segment_end = start, 0.0
        self._velocity = _STILL
        return start, np.pi

    def _next_velocity(self, dt: float) -> Point:
        if self._time + dt <= self._segment_end + 1e-9 and self._segment_end > 0.0:
            return self._velocity
        self._segment_end = self._time + self.period
        root = np.array(self._root)
        way = self._goal - root
        while np.hypot(*way) < _ARRIVED:
            self._goal = self._rng.uniform(self._low, self._high)
            self._pace = self._rng.uniform(0.3, 1.0) * self.speed_bound
            way = self._goal - root
        wanted = way * min(self._pace / np.hypot(*way), 0.5 / self.period)
        # every bound a coordinate at a time, so that one never undoes another
        fastest, drop, before = (
            self.speed_bound / math.sqrt(2.0),
            self.change / math.sqrt(2.0),
            np.array(self._velocity),
        )
        velocity = before + np.clip(np.clip(wanted, -fastest, fastest) - before, -drop, drop)
        # slow down in time for the border
        velocity = np.clip(velocity, -self._speed_towards(root - self._low), self._speed_towards(self._high - root))
        return float(velocity[0]), float(velocity[1])

    def _speed_towards(self, gap: Array) -> Array:
        """Largest speed from which segments of falling speed end within ``gap`` (2,) [m]."""
        drop = self.change / math.sqrt(2.0)
        # after v the speeds v - drop, v - 2 drop, ... follow: period (v²/(2 drop) + v/2 + drop/8) is enough
        room = np.maximum(gap / self.period - drop / 8.0, 0.0)
        return drop * (np.sqrt(0.25 + 2.0 * room / drop) - 0.5)


class Crowd(HumanMotion):
    """Several motions at once, each with its own people."""

    def __init__(self, motions: Sequence[HumanMotion]) -> None:
        if not motions:
            raise ParameterError("a crowd needs at least one motion")
        self.motions = tuple(motions)
        self.people = sum(motion.people for motion in motions)
        self.speed_bound = max(motion.speed_bound for motion in motions)
        self.reacts = any(motion.reacts for motion in motions)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        people = []
        for motion in self.motions:
            people.append(motion.reset(rng, start, person))
            person += motion.people
            start = None
        return together(people)

    def check_start(self, start: Array) -> None:
        self.motions[0].check_start(start)

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        return together([motion.step(dt, robot) for motion in self.motions])
