"""Safety filters, and the wrappers that put them around an environment."""

from typing import Protocol

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields.filter import NoFilter, SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.shield import JSSAShield, Shield
from jssa_gym.validation import known_name

__all__ = ["FILTERS", "Build", "JSSAFilter", "JSSAShield", "NoFilter", "SafetyFilter", "Shield", "make_filter"]


class Build(Protocol):
    """Builds a filter for a robot and a time step."""

    def __call__(
        self,
        robot: RobotModel,
        dt: float,
        index: IndexParams | None,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> SafetyFilter:
        """The filter; without viability box and verified stop unless they are asked for."""
        ...


def _jssa(
    robot: RobotModel,
    dt: float,
    index: IndexParams | None,
    *,
    viability: bool = False,
    failsafe: FailsafeParams | None = None,
) -> SafetyFilter:
    return JSSAFilter(robot, dt, index, viability=viability, failsafe=failsafe)


def _jssa_published(
    robot: RobotModel,
    dt: float,
    index: IndexParams | None,
    *,
    viability: bool = False,
    failsafe: FailsafeParams | None = None,
) -> SafetyFilter:
    published = index or IndexParams(lambda1=3.0, lambda2=1.0, sliding=False)
    return JSSAFilter(
        robot,
        dt,
        published,
        rows="closest",
        gradient="printed",
        recovery=0.0,
        viability=viability,
        failsafe=failsafe,
    )


def _none(
    robot: RobotModel,
    dt: float,
    index: IndexParams | None,
    *,
    viability: bool = False,
    failsafe: FailsafeParams | None = None,
) -> SafetyFilter:
    return NoFilter(robot, dt, viability=viability, failsafe=failsafe)


FILTERS: dict[str, Build] = {
    "jssa": _jssa,
    "jssa_published": _jssa_published,
    "none": _none,
}
"""Filters by name, built for a robot and a time step."""


def make_filter(
    name: str,
    robot: RobotModel,
    dt: float,
    index: IndexParams | None = None,
    *,
    viability: bool = False,
    failsafe: FailsafeParams | None = None,
) -> SafetyFilter:
    """A filter by its name in :data:`FILTERS`, for :class:`Shield`.

    The bare filter, to be compared with others; ``viability=True, failsafe=FailsafeParams()`` puts the viability box
    and the verified stop around it.

    Raises:
        ParameterError: Unknown name.
    """
    return FILTERS[known_name("filter", name, FILTERS)](robot, dt, index, viability=viability, failsafe=failsafe)
