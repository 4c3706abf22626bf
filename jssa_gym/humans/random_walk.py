"""Wandering from place to place."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.acceleration import WALKER, acceleration_bound
from jssa_gym.humans.motion import CLEARANCE
from jssa_gym.humans.walker import Walker
from jssa_gym.kernels.walkers import ARRIVED, WANDERS
from jssa_gym.types import Array
from jssa_gym.validation import positive_number, real_array


class RandomWalk(Walker):
    """Wanders in front of the arm from one random place to the next, speed and change of velocity bounded.

    Args:
        speed: Largest speed [m/s].
        change: Largest change of velocity from one segment to the next [m/s].
        period: Duration of a segment [s].
        region: ((x_low, x_high), (y_low, y_high)) that the root stays in [m].
        acceleration: Largest acceleration, which spreads the changes over their segments [m/s²]; None for none: each
            comes at once.
    """

    kind: ClassVar[int] = WANDERS
    draws: ClassVar[int] = 3

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
        if np.hypot(*(self._high - self._low)) < 4.0 * ARRIVED:
            raise ParameterError(f"region has to be at least {4.0 * ARRIVED} m across, got {region!r}")
        nearest = np.hypot(*np.clip(np.zeros(2), self._low, self._high))
        if nearest < CLEARANCE:
            raise ParameterError(
                f"region has to keep {CLEARANCE} m from the base axis, it comes within {nearest:.2f} m"
            )

    def check_start(self, start: Array) -> None:
        super().check_start(start)
        if np.any(start < self._low) or np.any(start > self._high):
            raise ParameterError(f"start {start.tolist()} is outside the region of this motion")

    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        if start is None:
            # not within the arm's reach at once: the far half
            low = np.array([(self._low[0] + self._high[0]) / 2.0, self._low[1]])
            start = rng.uniform(low, self._high)
        walker["goal"], walker["acceleration"] = start, self.acceleration
        walker["low"], walker["high"] = self._low, self._high
        walker["change"], walker["period"] = self.change, self.period
        return start, np.pi
