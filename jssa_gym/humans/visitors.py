"""People who come and go."""

from collections.abc import Sequence

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.acceleration import WALKER, acceleration_bound
from jssa_gym.humans.body import NAMES, nobody, together
from jssa_gym.humans.motion import HumanMotion, check_clearance
from jssa_gym.humans.walks import WalkBy
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high, positive_integer, positive_number, real_array

LOW, HIGH = (-1.8, -1.8, 0.0), (1.8, 1.8, 2.5)
"""Opposite corners of where visitors are seen unless told otherwise [m]."""

GONE = 0.5
"""How far outside somebody has to be to be there no more [m]: for long enough to be measured there once more."""

_EXTENT = 0.65
"""No point of a body is farther from its root, along the floor [m]."""


class Visitors(HumanMotion):
    """A stream of visitors, without end: each comes in at the edge of a box, walks past the arm and leaves.

    They come one by one, independently of each other (a Poisson process), and while there are as many as may be, nobody
    comes. Each is a person of their own, with the next number, and walks as :class:`WalkBy` does, from where all of the
    body is outside of the box to half a metre beyond it. So the people of a scene change their number: a shield has to
    know where they come and go, ``watched``; around this package's environments it asks for that box.

    Args:
        rate: Mean number who would come in a second [1/s].
        most: As many may be there at once.
        speed: Range of the walking speed [m/s].
        offset: Range of the root's smallest distance from the base axis [m].
        low, high: Opposite corners of the box, shape (3,) [m].
        acceleration: Largest acceleration [m/s²]; None for none: the pace changes at once.

    Raises:
        ParameterError: A value is out of range, or the way past the arm lies outside of the box.
    """

    comers = NAMES
    reacts = False

    def __init__(
        self,
        rate: float = 0.3,
        most: int = 3,
        speed: Sequence[float] = (0.4, 1.2),
        offset: Sequence[float] = (0.85, 1.1),
        low: Sequence[float] = LOW,
        high: Sequence[float] = HIGH,
        acceleration: float | None = WALKER,
    ) -> None:
        self.rate, self.most = positive_number("rate", rate), positive_integer("most", most)
        self.speed, self.offset = low_high("speed", speed), low_high("offset", offset, self.clearance)
        if not self.speed[0] > 0.0:
            raise ParameterError(f"speed has to be above 0: who stands does not leave, got {speed!r}")
        lowest, highest = (real_array(name, at, (3,), "a point [m]") for name, at in (("low", low), ("high", high)))
        if not (np.all(lowest < highest) and np.all(np.append(-lowest[:2], highest[:2]) > self.offset[1])):
            raise ParameterError(f"the box has to reach beyond offset {offset!r} on all sides, got {low!r} to {high!r}")
        self.low, self.high = tuple(lowest.tolist()), tuple(highest.tolist())
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.people, self.speed_bound = self.most, self.speed[1]

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        if start is not None:
            self.check_start(start)
        self._rng, self._next, self._there = rng, person, []
        self._wait = float(rng.exponential(1.0 / self.rate))
        if start is not None:
            self._come(start)
        return together([people for _, people in self._there])

    def check_start(self, start: Array) -> None:
        check_clearance(start)

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        self._there = [(walk, walk.step(dt, robot)) for walk, _ in self._there]
        self._there = [(walk, people) for walk, people in self._there if not self._gone(people)]
        self._wait -= dt
        if self._wait <= 0.0:
            self._wait += float(self._rng.exponential(1.0 / self.rate))
            if len(self._there) < self.most:
                self._come(self._entrance())
        return together([people for _, people in self._there]) if self._there else nobody()

    def visitor(self) -> HumanMotion:
        """Whoever comes next; subclasses may send others, of the same body parts."""
        return WalkBy(self.speed, self.offset, acceleration=self.acceleration)

    def _come(self, start: Array) -> None:
        walk = self.visitor()
        self._there.append((walk, walk.reset(self._rng, start, self._next)))
        self._next += 1

    def _entrance(self) -> Array:
        """Where somebody stands whose body is all outside of the box and next to its edge, shape (2,) [m]."""
        side, along = self._rng.integers(4), self._rng.random()
        axis, across = int(side % 2), 1 - int(side % 2)
        start = np.zeros(2)
        start[axis] = self.low[axis] - _EXTENT if side < 2 else self.high[axis] + _EXTENT
        start[across] = self.low[across] + along * (self.high[across] - self.low[across])
        return start

    def _gone(self, people: CapsuleSet) -> bool:
        """Whether somebody is far outside of the box; who comes in is next to it."""
        ends = np.concatenate([people.start, people.end])[:, :2]
        radius = np.tile(people.radius, 2)[:, None]
        before = np.array(self.low[:2]) - (ends + radius).max(axis=0)
        behind = (ends - radius).min(axis=0) - self.high[:2]
        return bool(max(before.max(), behind.max()) > GONE)
