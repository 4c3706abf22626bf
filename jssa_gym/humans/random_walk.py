"""Wandering from place to place."""

import math
from collections.abc import Sequence

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.acceleration import WALKER, acceleration_bound, stopping_place, towards
from jssa_gym.humans.motion import CLEARANCE, STILL, Point, Walk
from jssa_gym.types import Array
from jssa_gym.validation import positive_number, real_array

_WITHIN = 1e-9
"""How far inside its region a person who has to brake comes to rest [m]."""

_ARRIVED = 0.1
"""Distance from which a wandering person picks the next place to go to [m]."""


class RandomWalk(Walk):
    """Wanders in front of the arm from one random place to the next, speed and change of velocity bounded.

    Args:
        speed: Largest speed [m/s].
        change: Largest change of velocity from one segment to the next [m/s].
        period: Duration of a segment [s].
        region: ((x_low, x_high), (y_low, y_high)) that the root stays in [m].
        acceleration: Largest acceleration, which spreads the changes over their segments [m/s²]; None for none: each
            comes at once.
    """

    def __init__(
        self,
        speed: float = 1.0,
        change: float = 0.4,
        period: float = 0.2,
        region: Sequence[Sequence[float]] = ((0.65, 2.0), (-1.2, 1.2)),
        acceleration: float | None = WALKER,
    ) -> None:
        self.speed_bound = positive_number("speed", speed)
        self.change, self.period = positive_number("change", change), positive_number("period", period)
        self.acceleration = acceleration_bound("acceleration", acceleration)
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
        self._velocity, self._wanted = STILL, STILL
        return start, np.pi

    def _next_velocity(self, dt: float) -> Point:
        if self._time + dt > self._segment_end + 1e-9 or not self._segment_end > 0.0:
            self._wanted = self._segment()
        if self.acceleration == math.inf:
            return self._wanted
        if dt == 0.0:
            return STILL
        vx, vy = towards(self._velocity, self._wanted, self.acceleration, dt)
        if not self._within(stopping_place(self._root, (vx, vy), self.acceleration, dt)):
            vx, vy = towards(self._velocity, STILL, self.acceleration, dt)
        return vx, vy

    def _within(self, place: Sequence[float]) -> bool:
        """Whether a place is in the region, or at its border, but no nearer to it than the root."""
        return all(
            min(low + _WITHIN, now) <= then <= max(high - _WITHIN, now)
            for low, high, now, then in zip(self._low, self._high, self._root, place, strict=True)
        )

    def _segment(self) -> Point:
        """Begin a segment: its velocity [m/s]."""
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
