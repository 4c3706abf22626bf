"""Reasons that decisions give, where a kernel says why by a number."""

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

OUTSIDE = "outside the jerk bounds"
"""Of a decision that only clipped the nominal."""
