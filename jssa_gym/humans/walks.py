"""Straight walks past the arm and up to it."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.acceleration import WALKER, acceleration_bound
from jssa_gym.humans.motion import CLEARANCE, STILL
from jssa_gym.humans.walker import Walker
from jssa_gym.kernels.walkers import APPROACHES, PASSES, STRAIGHT
from jssa_gym.types import Array
from jssa_gym.validation import low_high, positive_number, share


def _heading_past(start: Array, offset: float) -> float:
    """Heading [rad] that leads past the base axis at ``offset`` [m], whose sign is the side; straight across if the
    start, shape (2,) [m], is nearer than that.
    """
    return np.arctan2(-start[1], -start[0]) + np.sign(offset) * np.arcsin(min(abs(offset) / np.hypot(*start), 1.0))


class ConstantVelocity(Walker):
    """A straight walk through the workspace or past it: side, heading, speed and moment are drawn.

    Args:
        speed: Range of the walking speed [m/s].
        offset: Range of the root's smallest distance from the base axis [m]. The arms of the body reach 0.6 m to its
            sides, so that below 0.8 m one of them brushes the robot's base.
        passing: Range of the time of the closest approach [s].
    """

    kind: ClassVar[int] = STRAIGHT

    def __init__(
        self,
        speed: Sequence[float] = (0.3, 1.6),
        offset: Sequence[float] = (0.85, 1.3),
        passing: Sequence[float] = (1.5, 5.0),
    ) -> None:
        self.speed = low_high("speed", speed)
        self.offset = low_high("offset", offset, CLEARANCE)
        self.passing = low_high("passing", passing)
        self.speed_bound = self.speed[1]

    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        heading = rng.uniform(-np.pi, np.pi)
        side = rng.choice([-1.0, 1.0])
        speed, offset, passing = (rng.uniform(*r) for r in (self.speed, self.offset, self.passing))
        if start is not None:
            heading = _heading_past(start, side * offset)
        direction = np.array([np.cos(heading), np.sin(heading)])
        closest = side * offset * np.array([-direction[1], direction[0]])
        walking = speed * direction
        walker["velocity"] = walking
        root = closest - walking * passing if start is None else start
        return root, heading


class WalkBy(Walker):
    """Walks past in front of the arm or beside it, now a little slower, now a little faster, and may stop for a while.

    Args:
        speed: Range of the walking speed [m/s].
        offset: Range of the root's smallest distance from the base axis [m]. The arms of the body reach 0.6 m to its
            sides, so that below 0.8 m one of them brushes the robot's base.
        passing: Range of the time of the closest approach at the drawn speed [s]; changes and a stop move it.
        change: Largest share by which the speed differs from the drawn one; drawn anew every half second.
        stop: Range of the duration of the stop [s], which every second person makes.
        acceleration: Largest acceleration [m/s²]; None for none: the pace changes at once.
    """

    kind: ClassVar[int] = PASSES

    def __init__(
        self,
        speed: Sequence[float] = (0.3, 1.0),
        offset: Sequence[float] = (0.85, 1.2),
        passing: Sequence[float] = (1.5, 4.0),
        change: float = 0.2,
        stop: Sequence[float] = (0.3, 1.5),
        acceleration: float | None = WALKER,
    ) -> None:
        self.speed = low_high("speed", speed)
        self.offset = low_high("offset", offset, CLEARANCE)
        self.passing, self.stop = low_high("passing", passing), low_high("stop", stop)
        self.change = share("change", change)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.speed_bound = self.speed[1]

    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        bearing = rng.uniform(-2.0 / 3.0 * np.pi, 2.0 / 3.0 * np.pi)
        side = rng.choice([-1.0, 1.0])
        pace, offset, passing = (rng.uniform(*r) for r in (self.speed, self.offset, self.passing))
        stops, begin, duration = rng.random() < 0.5, rng.uniform(0.0, passing + 1.0), rng.uniform(*self.stop)
        heading = bearing + side * np.pi / 2.0 if start is None else _heading_past(start, side * offset)
        direction = np.array([np.cos(heading), np.sin(heading)])
        if start is None:
            start = offset * np.array([np.cos(bearing), np.sin(bearing)]) - pace * passing * direction
        walker["direction"], walker["acceleration"] = direction, self.acceleration
        walker["pace"], walker["now"], walker["change"], walker["slowest"] = pace, pace, self.change, self.speed[0]
        walker["stop_begin"], walker["stop_end"] = (begin, begin + duration) if stops else (math.inf, math.inf)
        return start, heading


class ApproachRetreat(Walker):
    """The paper's Fig. 5: walks up in front of the arm, slows down, stops, steps back.

    Every change of the velocity is a ramp of constant acceleration that takes as long as the start of the walk, speed
    over ``acceleration``: the place is the mean, over that time, of the places of a walk that changes its velocity at
    once. So it comes exactly as near as asked, and never nearer.

    Args:
        start: Root at the beginning [m]; x is in front of the arm.
        nearest: Range of the root's x where the person stops [m].
        side: Range of the root's y [m].
        speed: Range of the walking speed [m/s]; the last third of the way is walked at half of it.
        wait: Range of the time before the person starts [s].
        stay: Range of the time the person stays [s].
        acceleration: Largest acceleration [m/s²]; None for none: the velocity changes at once.
    """

    kind: ClassVar[int] = APPROACHES

    def __init__(
        self,
        start: float = 1.8,
        nearest: Sequence[float] = (0.62, 0.85),
        side: Sequence[float] = (-0.2, 0.2),
        speed: Sequence[float] = (0.4, 0.8),
        wait: Sequence[float] = (0.2, 1.0),
        stay: Sequence[float] = (0.5, 1.5),
        acceleration: float | None = WALKER,
    ) -> None:
        self.nearest = low_high("nearest", nearest, CLEARANCE)
        self.start = positive_number("start", start)
        if not self.nearest[1] < self.start:
            raise ParameterError(f"start has to be beyond nearest {self.nearest}, got {start!r}")
        self.side = low_high("side", side, -np.inf)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.speed, self.wait, self.stay = (
            low_high(n, r) for n, r in zip(("speed", "wait", "stay"), (speed, wait, stay), strict=True)
        )
        self.speed_bound = self.speed[1]

    def check_start(self, start: Array) -> None:
        super().check_start(start)
        if not start[0] >= self.nearest[1]:
            raise ParameterError(
                f"the person comes from in front: start needs x >= {self.nearest[1]}, got {start.tolist()}"
            )

    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        nearest, side, speed, wait, stay = (
            rng.uniform(*r) for r in (self.nearest, self.side, self.speed, self.wait, self.stay)
        )
        root = np.array([self.start, side]) if start is None else start
        way = np.array([nearest, root[1]]) - root
        length = float(np.hypot(*way))
        walker["acceleration"], walker["ramp"] = self.acceleration, speed / self.acceleration
        walker["nearest"], walker["origin"] = nearest, root
        x, y = (float(c) for c in (way / length * speed if length > 0.0 else np.zeros(2)))
        fast, slow = 2.0 / 3.0 * length / max(speed, 1e-9), 2.0 / 3.0 * length / max(speed, 1e-9)
        moments = np.cumsum([wait, fast, slow, stay + speed / self.acceleration, length / max(speed, 1e-9)])
        velocities = (STILL, (x, y), (x / 2.0, y / 2.0), STILL, (-x, -y))
        walker["moments"], walker["legs"] = moments, velocities
        return root, np.pi
