"""Whole shields by their profile: the filter that a few words and numbers stand for."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT, IndexParams
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.shields.ahead import AheadFilter
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.options import JSSAOptions
from jssa_gym.shields.registry import PROFILES
from jssa_gym.validation import known_name

Assumed = bool | FailsafeParams | Mapping[str, Any]
"""Whether there is a verified stop, or under which assumptions."""


def assumptions(name: str, value: Assumed) -> FailsafeParams | None:
    """What a verified stop assumes; None for no verified stop.

    Raises:
        ParameterError: It is something else, or an assumption is unknown or out of range.
    """
    if isinstance(value, Mapping):
        return FailsafeParams.of(value)
    if not isinstance(value, bool | FailsafeParams):
        raise ParameterError(f"{name} has to be True, False, FailsafeParams or a mapping of its fields, got {value!r}")
    return FailsafeParams() if value is True else value or None


def watching(value: Assumed, watched: WatchedRegion | Mapping[str, Any] | None) -> Assumed:
    """The same assumptions about people who come and go in a region; None: as they are.

    Raises:
        ParameterError: There is no verified stop, or there is a region already, or it is none.
    """
    if watched is None:
        return value
    region, wrong = WatchedRegion.of(watched), "a watched region is for a verified stop, which this shield has not"
    if isinstance(value, Mapping):
        given = value.get("watched")
        value = {**value, "watched": region}
    elif isinstance(value, FailsafeParams):
        given = value.watched
        value = replace(value, watched=region)
    elif value is True:
        given, value = None, {"watched": region}
    else:
        raise ParameterError(wrong)
    if given is not None:
        raise ParameterError("watched is one of the assumptions: give it among them or alone, not both")
    return value


def profiled_filter(
    robot: RobotModel,
    dt: float,
    *,
    profile: str = "paper",
    horizon: float | None = None,
    lambda1: float = DEFAULT.lambda1,
    lambda2: float = DEFAULT.lambda2,
    d_min: float = DEFAULT.d_min,
    rows: Literal["all", "closest"] = "all",
    recovery: float = 0.5,
    viability: bool = True,
    failsafe: Assumed = True,
    options: JSSAOptions | None = None,
) -> SafetyFilter:
    """The filter of a profile; arguments as of :class:`~jssa_gym.shields.JSSAShield`.

    Raises:
        ParameterError: A parameter is out of range or unknown, or not one of the profile's.
    """
    options = options or JSSAOptions()
    known_name("profile", profile, ("paper", *PROFILES))
    own = (lambda1, lambda2, rows, recovery, options) == (DEFAULT.lambda1, DEFAULT.lambda2, "all", 0.5, JSSAOptions())
    if (profile == "paper" and horizon is not None) or (profile != "paper" and not own):
        raise ParameterError(
            f"profile {profile!r} does not take that: lambda1, lambda2, rows, recovery and options are of 'paper', "
            "horizon is of the others"
        )
    assumed = assumptions("failsafe", failsafe)
    if profile != "paper":
        # a mapping says what differs from the profile's own
        graded = failsafe is True or (isinstance(failsafe, Mapping) and "graded" not in failsafe)
        if graded and assumed is not None:
            assumed = replace(assumed, graded=True)
        params = replace(PROFILES[profile], d_min=d_min)
        if horizon is not None:
            params = replace(params, horizon=horizon)
        return AheadFilter(robot, dt, params, viability=viability, failsafe=assumed)
    index = IndexParams(d_min=d_min, lambda1=lambda1, lambda2=lambda2, sliding=options.sliding)
    return JSSAFilter(
        robot,
        dt,
        index,
        rows=rows,
        gradient=options.gradient,
        projector=options.projector,
        weight=options.weight,
        static_rows=options.static_rows,
        recovery=recovery,
        viability=viability,
        failsafe=assumed,
    )
