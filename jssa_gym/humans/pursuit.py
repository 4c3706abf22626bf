"""Somebody who runs at the arm."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from jssa_gym.humans.acceleration import RUNNER, acceleration_bound
from jssa_gym.humans.walker import Walker
from jssa_gym.kernels.walkers import PURSUES
from jssa_gym.types import Array
from jssa_gym.validation import low_high, positive_number


class Pursuit(Walker):
    """Runs straight at the nearest link that walking can touch, wherever the arm moves it, into contact.

    The body does not turn: its closest capsule closes in on the closest of the arm's at that height, until their axes
    cross. It does not slow down before it touches. In the first step it stands, and for ever where there is no arm.

    Args:
        speed: Running speed [m/s].
        acceleration: Largest acceleration [m/s²]; None for none: it starts, turns and stops at once.
        feint: Whether it stops and starts again at random.
        distance: Range of the root's distance from the base axis at the beginning [m]; the default is out of reach.
    """

    kind: ClassVar[int] = PURSUES
    clearance = 0.0
    reacts = True

    def __init__(
        self,
        speed: float = 1.6,
        acceleration: float | None = RUNNER,
        feint: bool = False,
        distance: Sequence[float] = (1.9, 3.0),
    ) -> None:
        self.speed_bound = positive_number("speed", speed)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.feint = feint
        self.distance = low_high("distance", distance, 0.6)

    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        walker["acceleration"], walker["feints"] = self.acceleration, self.feint
        walker["runs"], walker["until"] = True, rng.uniform(0.5, 1.5)
        if start is None:
            bearing, distance = rng.uniform(-np.pi, np.pi), rng.uniform(*self.distance)
            start = distance * np.array([np.cos(bearing), np.sin(bearing)])
        return start, np.arctan2(-start[1], -start[0])
