"""Reasons that decisions give, where a kernel says why by a number or several filters say the same."""

import numpy as np

from jssa_gym.types import Array

FAULTS = (
    "",
    "nominal jerk is not finite",
    "joint state is not finite",
    "human measurement is not finite",
    "a human capsule was not measured",
)
"""Of the input, by the number of :func:`~jssa_gym.kernels.tick.take_in`."""

UNFIT = (
    "",
    "the filter's answer is not finite",
    "the filter's answer is outside the jerk bounds",
    "the filter's answer is not the nominal, as it claims",
)
"""Of the answer, by the number of :func:`~jssa_gym.kernels.tick.unfit`."""

NO_SCENE = "the joint state cannot be read: there is no scene"
"""Of a tick in which a perception system delivered nothing at all."""

OUTSIDE = "outside the jerk bounds"
"""Of a decision that only clipped the nominal to the jerk bounds."""

UNRECOVERABLE = "would leave no way to keep the joint limits"
"""Of a decision that only clipped the nominal, to a viability box narrower than the jerk bounds."""


def of_clipping(nominal: Array, clipped: Array, bound: Array) -> str:
    """Why the nominal was clipped: by the jerk bounds alone, or by the viability box in some joint; shapes (n,)."""
    plain = np.maximum(np.minimum(nominal, bound), -bound)
    return OUTSIDE if (clipped == plain).all() else UNRECOVERABLE
