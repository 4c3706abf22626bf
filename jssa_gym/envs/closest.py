"""The closest robot-human pair."""

from typing import NamedTuple


class Closest(NamedTuple):
    """Truth about the closest robot-human pair after a step."""

    distance: float
    """Signed surface distance [m]; inf without a human."""
    rate: float
    """[m/s]."""
    curvature: float
    """Second derivative [m/s²], the human at constant velocity, the points' sliding along the axes included."""
    robot: int
    """Robot capsule, -1 without a human."""
    human: int
    """Human capsule, -1 without a human."""
    contact_speed: float
    """Largest speed of a touching point of the robot [m/s]; 0 without contact."""
