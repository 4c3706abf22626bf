"""Filters by name, and what a name means: the same in Python, on the command line, in reports and stored results."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, NamedTuple, Protocol

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import NEAR, PUBLISHED, IndexParams
from jssa_gym.shields.ahead import AheadFilter, AheadParams
from jssa_gym.shields.baselines import NoFilter, StopFilter
from jssa_gym.shields.closed_form import PFMFilter, SMAFilter, SSMFilter
from jssa_gym.shields.energy import CBFFilter, SSAFilter, SSSFilter
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter

STOP = "+stop"
"""Ending of a filter's name: with the viability box and the verified stop around it."""

TASK_SHIELD = "shielded"
"""Name of the shield that a task's shielded id has, such as ``jssa_gym/HandoverShielded-v0``."""

UNSHIELDED = "unshielded"
"""Name of no shield at all, where shields are chosen by name; ``none`` is a shield whose filter changes nothing."""

PUBLISHED_FORM: dict[str, Any] = {"rows": "closest", "gradient": "printed", "recovery": 0.0}
"""The paper's algorithm to the letter, as options of :class:`~jssa_gym.shields.jssa.JSSAFilter`."""


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
    """The paper to the letter, see :meth:`~jssa_gym.shields.JSSAShield.as_published`."""
    index = PUBLISHED if params is None else params
    return JSSAFilter(robot, dt, index, **PUBLISHED_FORM, viability=viability, failsafe=failsafe)


def _jssa_near(
    robot: RobotModel, dt: float, params: Any = None, /, *, viability: bool = False, failsafe: Any = None
) -> SafetyFilter:
    """The same as ``jssa``, giving way later: at 0.6 m instead of 1.4 m of a person who comes at 1 m/s."""
    return JSSAFilter(robot, dt, NEAR if params is None else params, viability=viability, failsafe=failsafe)


PROFILES: dict[str, AheadParams] = {"work": AheadParams(horizon=0.7), "yield": AheadParams(horizon=1.2)}
"""Whole shields by what they are for: the short horizon of ``work`` is for getting things done, the long one of
``yield`` for giving way early. They give way gradually and, by these names, have viability box and verified stop."""


def _profile(name: str) -> Build:
    def build(
        robot: RobotModel, dt: float, params: Any = None, /, *, viability: bool = True, failsafe: Any = None
    ) -> SafetyFilter:
        """A profile's look-ahead filter, whole."""
        assumed = replace(FailsafeParams() if failsafe is None else failsafe, graded=True)
        return AheadFilter(
            robot, dt, PROFILES[name] if params is None else params, viability=True, failsafe=assumed
        )  # fmt: skip

    return build


FILTERS: dict[str, Build] = {
    "jssa": JSSAFilter,
    "jssa_near": _jssa_near,
    "jssa_published": _jssa_published,
    "jssa_ahead": AheadFilter,
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

WHOLE = frozenset({"stop", *PROFILES})
"""What is never without a verified stop, whatever else its name says."""


class FilterName(NamedTuple):
    """What the name of a filter says."""

    filter: str
    """A name in :data:`FILTERS`; or :data:`TASK_SHIELD`."""
    stop: bool
    """Whether viability box and verified stop are around it."""

    @property
    def guarded(self) -> bool:
        """Whether there is a verified stop, by the name's end or by what the filter is."""
        return self.stop or self.filter in WHOLE


def read_name(name: str) -> FilterName:
    """What the name of a filter says; whoever takes one reads it here.

    Args:
        name: ``"jssa"``, of :data:`FILTERS`, for the bare filter; ``"jssa+stop"``, with :data:`STOP` behind it, for the
            same inside viability box and verified stop; one of :data:`PROFILES`; :data:`TASK_SHIELD`.

    Raises:
        ParameterError: There is no such filter; the message lists those there are.
    """
    if name == TASK_SHIELD or name in PROFILES:
        return FilterName(name, True)
    bare = name.removesuffix(STOP) if isinstance(name, str) else ""
    if bare not in FILTERS:
        valid = f"{', '.join(FILTERS)}, each also with '{STOP}' behind it, {', '.join(PROFILES)} and {TASK_SHIELD}"
        raise ParameterError(f"unknown filter {name!r}; valid: {valid}")
    return FilterName(bare, bare != name)


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
    """A filter by its name, for a robot and a time step; around an environment, ``Shield(env, name)`` is shorter.

    Args:
        name: Of :data:`FILTERS`, for the bare filter; with :data:`STOP` behind it, inside viability box and verified
            stop, which is short for ``viability=True, failsafe=FailsafeParams()``.
        robot: The arm, where it stands.
        dt: Control step [s].
        index: Parameters of the JSSA filters, another word for their ``params``.
        params: The filter's own parameters, such as ``SSAParams()`` for ``"ssa"``; None for its defaults.
        viability, failsafe: See :class:`~jssa_gym.shields.filter.SafetyFilter`.

    Raises:
        ParameterError: Unknown name, or parameters of another filter.
    """
    bare, stop = read_name(name)
    if bare == TASK_SHIELD:
        raise ParameterError(f"{name!r} depends on the environment's task: Shield(env, {name!r})")
    if bare in PROFILES:
        return _profile(bare)(robot, dt, params, failsafe=failsafe)
    if index is not None and params is not None:
        raise ParameterError("index and params are two words for the same: give one of them")
    if stop:
        viability, failsafe = True, FailsafeParams() if failsafe is None else failsafe
    return FILTERS[bare](robot, dt, index if params is None else params, viability=viability, failsafe=failsafe)


def changed_params(name: str, robot: RobotModel, dt: float, changes: Mapping[str, Any]) -> Any:
    """Parameters of a filter by its name: its defaults, with some fields changed.

    Raises:
        ParameterError: Unknown name or field, or a value out of range.
    """
    params = make_filter(name, robot, dt).params
    valid = [] if params is None else [field.name for field in fields(params)]
    for given in changes:
        if given not in valid:
            raise ParameterError(f"unknown parameter {given!r} of {name}; valid: {', '.join(valid) or 'none'}")
    return replace(params, **changes)
