"""How people move beside the arm: the interface, rigid walkers, nobody and crowds.

A motion owns its state and draws only from the generator it is given: same seed, same bits. The velocities in a
returned :class:`~jssa_gym.types.CapsuleSet` are those of the step to come, so that start + velocity · dt is exactly
where the capsule will be. Motions that react get the robot's capsules in every step.

People keep their root at least :data:`CLEARANCE` from the robot's base axis (the world's z axis), unless their
:attr:`~HumanMotion.clearance` says otherwise.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from numbers import Real

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import Body, nobody, together
from jssa_gym.types import Array, CapsuleSet

Point = tuple[float, float]

STILL: Point = (0.0, 0.0)

CLEARANCE = 0.6
"""Smallest distance of a person's root from the base axis [m]."""


def check_clearance(start: Array) -> None:
    """Refuse a start, shape (2,) [m], within :data:`CLEARANCE` of the base axis, with a ParameterError."""
    if not np.hypot(*start) >= CLEARANCE:
        raise ParameterError(f"a person's root starts {CLEARANCE} m or more from the base axis, got {start.tolist()}")


class HumanMotion(ABC):
    """The people in a scene, one step after the other."""

    people: int = 1
    """How many."""
    speed_bound: float
    """No point of a body moves faster [m/s]."""
    clearance: float = CLEARANCE
    """No person's root comes nearer to the base axis [m]; 0 for somebody who is out for contact."""
    reacts: bool = True
    """Whether :meth:`step` looks at the robot; if not, it is spared the work and given an empty set."""
    comers: tuple[str, ...] | None = None
    """Names of each person's capsules, if people come and go, :attr:`people` at most; None: whoever is there stays."""

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

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        """Start and end of the capsules of that name move no faster [m/s]; unless a motion says more, as any point."""
        return self.speed_bound, self.speed_bound

    def acceleration_of(self, part: str) -> float | None:
        """Neither end of the capsules of that name changes its velocity faster [m/s²]; None if it says none."""
        most = getattr(self, "acceleration", None)
        return float(most) if isinstance(most, Real) else None

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
        check_clearance(start)

    @abstractmethod
    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        """Draw an episode: the root's start (2,) [m] and the body's heading [rad]."""

    @abstractmethod
    def _next_velocity(self, dt: float) -> Point:
        """Velocity of the step to come [m/s], which lasts about ``dt`` [s]; 0 before the first."""


class Crowd(HumanMotion):
    """Several motions at once, each with its own people."""

    def __init__(self, motions: Sequence[HumanMotion]) -> None:
        if not motions:
            raise ParameterError("a crowd needs at least one motion")
        if comes := [type(motion).__name__ for motion in motions if motion.comers is not None]:
            raise ParameterError(f"a crowd is of people who stay; {comes[0]} come and go, several at once")
        self.motions = tuple(motions)
        self.people = sum(motion.people for motion in motions)
        self.speed_bound = max(motion.speed_bound for motion in motions)
        self.clearance = min(motion.clearance for motion in motions)
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
