"""FANUC LR Mate 200iD/7L, sold as LR Mate/7-9D: limits with their sources.

Kinematics, position ranges and capsules stand in ``assets/lr_mate_200id_7l.xml``.
"""

from pathlib import Path
from typing import Literal

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots.model import RobotModel
from jssa_gym.types import Array

MJCF = Path(__file__).parent / "assets" / "lr_mate_200id_7l.xml"

VELOCITY_DEG = (370.0, 310.0, 410.0, 550.0, 545.0, 1000.0)
"""Catalogue speeds J1 to J6 [deg/s]."""

PAPER_JERK_DEG = (3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0)
"""Jerk bounds printed in the JSSA paper, section 4 [deg/s³]."""

PAPER_ACCELERATION_DEG = (641.0, 576.0, 592.0, 1184.0, 1184.0, 1809.0)
"""Implied by the paper's jerk bounds, which are 0.9 V / (0.304 s · 0.152 s): V / 0.304 s [deg/s²].

The paper prints no acceleration limits."""

STREAM_ACCELERATION_DEG = (770.0, 645.0, 1025.0, 2022.0, 2128.0, 1785.0)
STREAM_JERK_DEG = (3211.0, 2690.0, 5125.0, 14868.0, 16632.0, 6377.0)
"""LR Mate row of the public Stream_Motion_Controller software, teleoperation branch [deg/s², deg/s³]."""

LIMITS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "paper": (PAPER_ACCELERATION_DEG, PAPER_JERK_DEG),
    "stream": (STREAM_ACCELERATION_DEG, STREAM_JERK_DEG),
}
"""Acceleration and jerk limits by name."""


def _radians(degrees: tuple[float, ...]) -> Array:
    return np.radians(np.array(degrees))


def lr_mate_200id_7l(limits: Literal["paper", "stream"] = "paper") -> RobotModel:
    """The paper's arm, standing at the world's origin.

    Args:
        limits: ``"paper"`` for the paper's jerk bounds, ``"stream"`` for those published for streamed motion.

    Raises:
        ParameterError: Unknown name of a set of limits.
    """
    if limits not in LIMITS:
        raise ParameterError(f"unknown limits {limits!r}; valid: {', '.join(LIMITS)}")
    acceleration, jerk = LIMITS[limits]
    return RobotModel.from_mjcf(
        MJCF, velocity=_radians(VELOCITY_DEG), acceleration=_radians(acceleration), jerk=_radians(jerk)
    )
