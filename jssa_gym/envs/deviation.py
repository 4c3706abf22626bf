"""Deviations of joint states: whether they are noise, and in words."""

import numpy as np

from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, JointState

_MEMORY = 0.5
"""Correlation of successive deviations from which they add up."""

_CHANCE = 0.1
"""Share of the deviations' power that has to be left when the motion has explained what it can."""

_UNIT = 1e-6
"""Share by which a factor may differ from one of units."""

ROWS = JointState._fields
UNITS = ("rad", "rad/s", "rad/s²")
_BOUNDS = ("its range", "its limit", "its limit")


def is_noise(off: Array, known: Array, least: float) -> bool:
    """Whether deviations have no memory and are no function of the motion.

    Args:
        off: Deviations, shape (T, n).
        known: What a mistake may make them of, states and jerks of now and before, shape (T, n, c).
        least: What is smaller is rounding.
    """
    rest = off - off.mean(axis=0)
    noisy = np.minimum(np.abs(off), np.abs(rest)) > least
    joints = np.flatnonzero(noisy.any(axis=0))
    # a reading that is wrong now and then is no noise
    if len(joints) == 0 or 2 * np.count_nonzero(noisy[:, joints]) < noisy[:, joints].size:
        return False
    power = float((rest**2).sum())
    if (rest[1:] * rest[:-1]).sum() > _MEMORY * power:
        return False
    left = 0.0
    for j in joints:
        causes = known[:, j] - known[:, j].mean(axis=0)
        made = causes @ np.linalg.lstsq(causes, rest[:, j], rcond=None)[0]
        left += float(((rest[:, j] - made) ** 2).sum())
    return left > _CHANCE * power


def rounded_up(value: float) -> float:
    """A number rounded up to two significant digits."""
    if not 0.0 < value < np.inf:
        return value
    digit = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(f"{np.ceil(value / digit - 1e-9) * digit:.2g}")


def largest(off: Array, robot: RobotModel, scale: Array) -> str:
    """The largest of deviations (..., 3, n) as shares of a scale (3, n): with its unit, joint and share."""
    shares = np.abs(off / scale)
    worst = np.unravel_index(int(np.argmax(shares)), shares.shape)
    row, j = worst[-2:]
    return f"{np.abs(off)[worst]:.3g} {UNITS[row]} at {robot.joint_names[j]} ({shares[worst]:.2g} of {_BOUNDS[row]})"


def degrees(factor: Array) -> str:
    """What to say of a factor that looks like a confusion of units; empty for others."""
    if np.all(np.abs(np.radians(factor) - 1.0) < _UNIT):
        return "degrees? radians are expected"
    if np.all(np.abs(np.degrees(factor) - 1.0) < _UNIT):
        return "radians taken for degrees? they are expected as they are"
    return ""
