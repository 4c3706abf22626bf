"""People by name: the package's own, several at once, those of before, and some that are faster than assumed."""

from collections.abc import Callable, Iterable
from functools import cache, partial
from pathlib import Path

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans import HUMANS, STREAMS, Hand, HumanMotion, Pursuit, WalkBy, make_human
from jssa_gym.humans.files import is_file, load
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.speeds import part_speeds
from jssa_gym.storage import read_whole, sha256
from jssa_gym.validation import known_name

MULTIPLES = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
"""Speeds of people, as multiples of what a shield assumes."""

_ASSUMED = FailsafeParams()


_RUNNERS = {m: m * _ASSUMED.human_speed for m in MULTIPLES}
_HANDS = {m: m * _ASSUMED.limb_speed for m in MULTIPLES}
_BOUNDED: dict[str, Callable[..., HumanMotion]] = {
    name: HUMANS[name] for name in ("approach_retreat", "random", "walk_by", "pursuit", "hand", "receive")
}

ABRUPT: dict[str, Callable[[], HumanMotion]] = {
    **{f"{name} abrupt": partial(kind, acceleration=None) for name, kind in _BOUNDED.items()},
    "feint abrupt": partial(Pursuit, acceleration=None, feint=True),
    "two abrupt": lambda: make_human((Pursuit(acceleration=None), WalkBy(acceleration=None))),
    "two hands abrupt": lambda: make_human((Hand(acceleration=None), Pursuit(acceleration=None))),
}
"""People whose velocity changes at once, as that of the package's own did before it had a bound."""

PEOPLE: dict[str, Callable[[], HumanMotion]] = {
    **HUMANS,
    "feint": partial(Pursuit, feint=True),
    "two": partial(make_human, ("pursuit", "walk_by")),
    "two hands": partial(make_human, ("hand", "pursuit")),
    **ABRUPT,
    **{f"pursuit x{m:g}": partial(Pursuit, most, acceleration=None) for m, most in _RUNNERS.items()},
    **{f"hand x{m:g}": partial(Hand, speed=(0.5 * most, most), acceleration=None) for m, most in _HANDS.items()},
}
"""People by name: the package's own, several at once, and some that are faster than assumed; these are so at once,
since what is asked of them is their speed.
"""

TOO_FAST = tuple(f"{who} x{m:g}" for who in ("pursuit", "hand") for m in MULTIPLES if m > 1.0)
"""People who break the assumption on their speed."""


def make_person(human: str) -> HumanMotion:
    """People by name in :data:`PEOPLE`, or from a file as :func:`~jssa_gym.humans.make_human` reads it.

    Raises:
        ParameterError: Unknown name.
        RecordingError: The file is not a sound recording.
    """
    return make_human(human) if is_file(human) else PEOPLE[known_person(human)]()


def known_person(human: str) -> str:
    """A name in :data:`PEOPLE`, or a file that can be read; errors as of :func:`make_person`."""
    if is_file(human):
        load(human)
        return human
    if human in STREAMS:
        raise ParameterError(
            f"{human} come and go, and an episode that is recorded has the same people throughout: play them in an "
            "environment of your own"
        )
    return known_name("human", human, PEOPLE)


def people_digests(humans: Iterable[str]) -> dict[str, str]:
    """Digests of the files among some people, by name."""
    return {human: sha256(read_whole(Path(human), RecordingError))[:16] for human in humans if is_file(human)}


@cache  # of files, which are asked about for every episode
def too_fast(human: str) -> bool:
    """Whether some part of somebody moves faster than a shield assumes by default."""
    if is_file(human):
        return any(part.excess > 0.0 for part in part_speeds(load(human).recording, _ASSUMED))
    return human in TOO_FAST
