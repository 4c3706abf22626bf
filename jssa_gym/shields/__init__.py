"""Safety filters, and the wrappers that put them around an environment."""

from collections.abc import Callable

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields.filter import NoFilter, SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.shield import JSSAShield, Shield
from jssa_gym.validation import known_name

__all__ = ["FILTERS", "JSSAFilter", "JSSAShield", "NoFilter", "SafetyFilter", "Shield", "make_filter"]


def _jssa(robot: RobotModel, dt: float, index: IndexParams | None) -> SafetyFilter:
    return JSSAFilter(robot, dt, index, viability=True, failsafe=FailsafeParams())


def _jssa_published(robot: RobotModel, dt: float, index: IndexParams | None) -> SafetyFilter:
    published = index or IndexParams(lambda1=3.0, lambda2=1.0, sliding=False)
    return JSSAFilter(robot, dt, published, rows="closest", gradient="printed", recovery=0.0)


def _none(robot: RobotModel, dt: float, index: IndexParams | None) -> SafetyFilter:
    return NoFilter(robot, dt)


FILTERS: dict[str, Callable[[RobotModel, float, IndexParams | None], SafetyFilter]] = {
    "jssa": _jssa,
    "jssa_published": _jssa_published,
    "none": _none,
}
"""Filters by name, built for a robot and a time step."""


def make_filter(name: str, robot: RobotModel, dt: float, index: IndexParams | None = None) -> SafetyFilter:
    """A filter by its name in :data:`FILTERS`, for :class:`Shield`.

    Raises:
        ParameterError: Unknown name.
    """
    return FILTERS[known_name("filter", name, FILTERS)](robot, dt, index)
