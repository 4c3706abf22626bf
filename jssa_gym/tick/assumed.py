"""What is assumed of people's capsules, and where the control step remembers it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.tick.layout import Memory


class Assumed(NamedTuple):
    """Bounds on how k human capsules move, and on how they may be touched."""

    speed: NDArray[np.float64]
    """How fast start and end move, shape (k, 2) [m/s]; a measurement that says otherwise is not believed."""
    growth: NDArray[np.float64]
    """How fast they can reach an arm, shape (k, 2) [m/s]."""
    touch: NDArray[np.float64]
    """Speed of a point of the arm with which each may be touched, shape (k,) [m/s]."""
    acceleration: NDArray[np.float64]
    """How fast both ends change their velocity, shape (k,) [m/s²]; 0: nobody says."""
    velocity_error: float = 0.0
    """Bound on the error of a measured velocity [m/s]."""


def assume(memory: Memory, assumed: Assumed) -> None:
    """Take that down for every arm."""
    growth = assumed.growth.max(axis=1)
    memory.growth[:], memory.touch[:] = growth, assumed.touch
    memory.tracks["speed"], memory.tracks["slower"] = assumed.speed, growth[:, None] - assumed.growth
    memory.tracks["acceleration"], memory.tracks["velocity_error"] = assumed.acceleration, assumed.velocity_error
