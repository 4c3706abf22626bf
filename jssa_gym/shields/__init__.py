"""Safety filters, and the wrappers that put them around an environment."""

from typing import Any, Protocol

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields.closed_form import (
    PFMFilter,
    PFMParams,
    SMAFilter,
    SMAParams,
    SSMFilter,
    SSMParams,
)
from jssa_gym.shields.energy import CBFFilter, CBFParams, SSAFilter, SSAParams, SSSFilter, SSSParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.plain import NoFilter, StopFilter
from jssa_gym.shields.shield import JSSAShield, Shield
from jssa_gym.validation import known_name

__all__ = [
    "FILTERS",
    "Build",
    "CBFFilter",
    "CBFParams",
    "JSSAFilter",
    "JSSAShield",
    "NoFilter",
    "PFMFilter",
    "PFMParams",
    "SMAFilter",
    "SMAParams",
    "SSAFilter",
    "SSAParams",
    "SSMFilter",
    "SSMParams",
    "SSSFilter",
    "SSSParams",
    "SafetyFilter",
    "Shield",
    "StopFilter",
    "make_filter",
]


class Build(Protocol):
    """Builds a filter for a robot and a time step: a class of filters, or a function that sets some options."""

    def __call__(
        self,
        robot: RobotModel,
        dt: float,
        params: Any = None,
        /,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> SafetyFilter:
        """The filter; without viability box and verified stop unless they are asked for."""
        ...


def _jssa_published(
    robot: RobotModel, dt: float, params: Any = None, /, *, viability: bool = False, failsafe: Any = None
) -> SafetyFilter:
    """The paper to the letter, see :meth:`JSSAShield.as_published`."""
    published = IndexParams(lambda1=3.0, lambda2=1.0) if params is None else params
    options: Any = {"rows": "closest", "gradient": "printed", "recovery": 0.0}
    return JSSAFilter(robot, dt, published, **options, viability=viability, failsafe=failsafe)


def _jssa_near(
    robot: RobotModel, dt: float, params: Any = None, /, *, viability: bool = False, failsafe: Any = None
) -> SafetyFilter:
    """The same as ``jssa``, giving way later: at 0.6 m instead of 1.4 m of a person who comes at 1 m/s."""
    near = IndexParams(lambda1=0.4, lambda2=0.1) if params is None else params
    return JSSAFilter(robot, dt, near, viability=viability, failsafe=failsafe)


FILTERS: dict[str, Build] = {
    "jssa": JSSAFilter,
    "jssa_near": _jssa_near,
    "jssa_published": _jssa_published,
    "ssa": SSAFilter,
    "sss": SSSFilter,
    "cbf": CBFFilter,
    "pfm": PFMFilter,
    "sma": SMAFilter,
    "ssm": SSMFilter,
    "stop": StopFilter,
    "none": NoFilter,
}
"""Filters by name, built for a robot and a time step."""


def make_filter(
    name: str,
    robot: RobotModel,
    dt: float,
    index: IndexParams | None = None,
    *,
    params: Any = None,
    viability: bool = False,
    failsafe: FailsafeParams | None = None,
) -> SafetyFilter:
    """A filter by its name in :data:`FILTERS`, for :class:`Shield`.

    The bare filter, to be compared with others; ``viability=True, failsafe=FailsafeParams()`` puts the viability box
    and the verified stop around it.

    Args:
        name: The filter.
        robot: The arm, where it stands.
        dt: Control step [s].
        index: Parameters of the JSSA filters, another word for their ``params``.
        params: The filter's own parameters, such as ``SSAParams()`` for ``"ssa"``; None for its defaults.
        viability, failsafe: See :class:`~jssa_gym.shields.filter.SafetyFilter`.

    Raises:
        ParameterError: Unknown name, or parameters of another filter.
    """
    build = FILTERS[known_name("filter", name, FILTERS)]
    if index is not None and params is not None:
        raise ParameterError("index and params are two words for the same: give one of them")
    return build(robot, dt, index if params is None else params, viability=viability, failsafe=failsafe)
