"""People who do not fit what a shield assumes of them: said aloud, once, where it meets them."""

import logging
from collections.abc import Sequence
from functools import cache
from numbers import Real

import gymnasium as gym
import numpy as np

from jssa_gym.humans import Crowd, HumanMotion, Recorded, make_human
from jssa_gym.safety.failsafe import FailsafeParams

_logger = logging.getLogger("jssa_gym")

FASTER = (
    "%s: the shield does not believe measurements of faster people, and may stop for them too late. FailsafeParams has "
    "human_speed, limb_speed, foot_speed and end_speeds."
)
BRISKER = (
    "%s: the shield may stop for them too late until it has seen that, and counts on speeds alone from then on. "
    "FailsafeParams has human_acceleration."
)
UNSAID = (
    "%s does not say how fast its people are: no speed_bound, or 0. Nobody can tell whether the shield assumes enough "
    "of them."
)
UNMET = "FailsafeParams: %s, which no capsule is called, so that this changes nothing; there are %s."
"""What is said of people."""

_ROUNDING = 1.0 + 1e-9


def tell_of_fast_people(env: gym.Env, params: FailsafeParams) -> None:
    """Say aloud, once, if an environment's people may be faster, or accelerate faster, than a shield assumes.

    Every end of a capsule is compared with its own bound, as far as a motion says which parts are fast. Of others no
    more is known than how fast the fastest point is: it may be any, so that it is compared with the smallest bound.
    """
    human = vars(env.unwrapped).get("human")
    motions = _motions(human) if isinstance(human, HumanMotion) else []
    # a motion knows its capsules when it has begun
    named = [(one, one.comers or make_human(one).reset(np.random.default_rng(0)).names) for one in motions]
    if params.watched is not None:
        entry = params.entry_speed
        for motion in (one for one in motions if one.comers and one.speed_bound > entry * _ROUNDING):
            say_once(
                FASTER, f"people may come in at {motion.speed_bound:.3g} m/s, {entry:g} m/s is the entry_speed assumed"
            )
    if faster := [told for motion, names in named for told in _faster(motion, names, params)]:
        say_once(FASTER, "; ".join(dict.fromkeys(faster)))
    if brisker := [told for motion, names in named for told in _brisker(motion, names, params)]:
        say_once(BRISKER, "; ".join(dict.fromkeys(brisker)))
    for motion, names in named:
        if names and _says_nothing(motion):
            say_once(UNSAID, type(motion).__name__)


def _motions(motion: HumanMotion) -> list[HumanMotion]:
    """All motions of a crowd, and of the crowds in it."""
    return [one for part in motion.motions for one in _motions(part)] if isinstance(motion, Crowd) else [motion]


def _says_nothing(motion: HumanMotion) -> bool:
    """Whether nobody says how fast the people of a motion are; who is there and has no speed at all says nothing."""
    bound = getattr(motion, "speed_bound", None)
    asked = type(motion).end_speeds_of is not HumanMotion.end_speeds_of
    return not (asked or (isinstance(bound, Real) and bound > 0.0))


def _faster(motion: HumanMotion, names: Sequence[str], params: FailsafeParams) -> list[str]:
    if _says_nothing(motion):
        return []
    beyond = []
    for name in names:
        ends = zip(motion.end_speeds_of(name), params.end_speeds_of(name), strict=True)
        speed, bound = max(ends, key=lambda end: end[0] / end[1])
        if speed > bound * _ROUNDING:
            beyond.append((name, speed, bound))
    if isinstance(motion, Recorded):
        return [f"{name} moves at {speed:.3g} m/s, {bound:g} m/s is assumed" for name, speed, bound in beyond]
    beyond.sort(key=lambda part: part[2] / part[1])
    return [f"people may move at {speed:.3g} m/s, {bound:g} m/s is assumed" for _, speed, bound in beyond[:1]]


def _brisker(motion: HumanMotion, names: Sequence[str], params: FailsafeParams) -> list[str]:
    told = []
    for name in names:
        most, bound = motion.acceleration_of(name), params.acceleration_of(name)
        if most is not None and most > bound * _ROUNDING > 0.0:
            told.append(f"{name} may change its velocity at {most:.3g} m/s², {bound:g} m/s² is assumed")
    return told


def tell_of_unmet_names(params: FailsafeParams, names: Sequence[str]) -> None:
    """Say aloud, once, if bounds are given for names that no capsule of the people who are there has."""
    if names and (beside := params.names_beside(names)):
        said = "; ".join(f"{field} names {', '.join(map(repr, given))}" for field, given in beside.items())
        say_once(UNMET, said, ", ".join(map(repr, dict.fromkeys(names))))


@cache  # many environments have the same people
def say_once(text: str, *given: str) -> None:
    """Say something aloud, unless it was said before."""
    _logger.warning(text, *given)
