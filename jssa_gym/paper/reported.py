"""What the paper reports, as data, and the same measures of an episode.

R. Liu, R. Chen, C. Liu: Safe interactive industrial robots using jerk-based safe set algorithm (2022), section 4.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jssa_gym.evaluation.metrics import summarise
from jssa_gym.robots import JointLimits
from jssa_gym.types import Trace


@dataclass(frozen=True, slots=True)
class Measures:
    """The six columns of Table 1; None where the paper gives no number, or where nothing was triggered."""

    min_distance: float | None
    """Smallest robot-human surface distance [m]."""
    first_trigger: float | None
    """Beginning of the first step that the filter changed [s]."""
    last_trigger: float | None
    """Beginning of the last one [s]."""
    active_duration: float | None
    """Time of all steps that the filter changed [s]."""
    mean_speed: float | None
    """Mean critical velocity [m/s]. The paper does not define it: here the mean, over all steps of the episode, of
    :math:`|\\dot D|` at the critical point pair."""
    mean_acceleration: float | None
    """Mean critical acceleration [m/s²]: the same of :math:`|\\ddot D|`."""


COLUMNS: Mapping[str, tuple[str, str]] = {
    "min_distance": ("min distance", "m"),
    "first_trigger": ("first trigger", "s"),
    "last_trigger": ("last trigger", "s"),
    "active_duration": ("active", "s"),
    "mean_speed": ("mean critical velocity", "m/s"),
    "mean_acceleration": ("mean critical acceleration", "m/s²"),
}
"""Title and unit of every measure, in the order of Table 1."""


def measures(trace: Trace, limits: JointLimits) -> Measures:
    """The columns of Table 1 of an episode.

    Args:
        trace: The episode.
        limits: The robot's limits.
    """
    summary = summarise(trace, limits)
    return Measures(
        summary.min_distance,
        summary.first_trigger,
        summary.last_trigger,
        summary.active_duration,
        float(np.abs(trace.speed).mean()),
        float(np.abs(trace.acceleration_of_distance).mean()),
    )


FIG6 = Measures(0.446, 1.856, 4.240, 0.352, None, None)
"""JSSA with λ = (3, 1): section 4.1, Fig. 6; the active time is from section 4.3."""

FIG6_JERK = np.radians(2000.0)
"""Largest jerk of Fig. 6, "approximately" [rad/s³]."""

FIG6_HUMAN_LINKS = (4, 2, 1, 2)
"""Critical links of the person in Fig. 6, counted from 1: left arm, core body, head, core body."""

FIG6_ROBOT_LINK = 5
"""Critical link of the robot in Fig. 6, throughout: the end effector."""

FIG8 = Measures(0.360, None, None, 0.872, None, None)
"""SSA with λ₁ = 3 on the same person: section 4.3, Fig. 8."""

FIG10 = Measures(None, 4.392, None, None, None, None)
"""Handover: section 4.4, Fig. 10; triggered when the hand begins to move."""

GRID = (6.0, 7.0, 8.0)
"""Values of λ₁ and of λ₂ in Table 1."""

TABLE1: Mapping[tuple[float, float], Measures] = {
    (6.0, 6.0): Measures(0.317, 1.848, 4.832, 0.536, 0.640, 0.304),
    (7.0, 6.0): Measures(0.343, 0.080, 4.848, 0.760, 0.654, 0.382),
    (8.0, 6.0): Measures(0.382, 0.080, 5.024, 1.064, 0.639, 0.413),
    (6.0, 7.0): Measures(0.284, 1.848, 4.544, 0.688, 0.665, 0.305),
    (7.0, 7.0): Measures(0.313, 0.080, 4.840, 0.864, 0.649, 0.312),
    (8.0, 7.0): Measures(0.342, 0.080, 4.840, 0.960, 0.641, 0.345),
    (6.0, 8.0): Measures(0.284, 1.856, 4.816, 0.736, 0.631, 0.303),
    (7.0, 8.0): Measures(0.291, 1.856, 4.840, 0.776, 0.643, 0.261),
    (8.0, 8.0): Measures(0.316, 0.080, 5.024, 0.944, 0.633, 0.299),
}
"""Table 1 by (λ₁, λ₂)."""

STEPS = 750
"""Length of the episodes: 6 s. The paper's last trigger is at 5.024 s."""
