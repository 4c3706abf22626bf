"""Which body part a name means, as far as that decides how fast the part can be."""

from collections.abc import Iterable, Mapping
from typing import TypeVar

from jssa_gym.text import words

SLOW_PARTS = (
    "head",
    "neck",
    "torso",
    "trunk",
    "body",
    "chest",
    "spine",
    "hip",
    "pelvis",
    "leg",
    "knee",
)
"""A body part whose name contains one of these, in any case, keeps ``human_speed``; all others may be upper limbs."""

LIMB_PARTS = ("arm", "elbow", "wrist", "hand", "palm", "fist", "finger", "thumb")
"""A body part whose name contains one of these, in any case, may move at ``limb_speed``, whatever else it contains: the
wrist of a body is a wrist."""

FOOT_PARTS = (
    "foot",
    "feet",
    "toe",
    "ankle",
    "heel",
    "shoe",
    "sole",
    "shin",
    "shank",
    "calf",
    "calves",
    "tibia",
    "lower leg",
)
"""A body part whose name contains one of these, in any case, may move at ``foot_speed``, whatever else it contains: all
that end at the foot that swings. Of two words it contains both, in any order: ``LeftLowerLeg``, ``lowerleg_l``."""

WHOLE_WORDS = ("hip",)
"""Those that count as a word of its own only, or its plural, since a ship, whip or chip is no hip. Words end at
separators, digits and capitals, as in ``left_hip``, ``hip2``, ``LeftHip``. A fast part's name that is contained by
chance, as in ``wheel``, makes the part fast, which is the safe way to be wrong."""

Value = TypeVar("Value")


def is_called(part: str, known: Iterable[str]) -> bool:
    """Whether a body part's name contains one of these, such as :data:`FOOT_PARTS`, in any case."""
    name, own = part.casefold(), set(words(part))
    return any(
        bool(own & {one, f"{one}s"}) if one in WHOLE_WORDS else all(word in name for word in one.split())
        for one in known
    )


def by_name(values: Mapping[str, Value], part: str) -> Value | None:
    """What a mapping holds for a body part, whose names are the same in any case; None if it holds nothing."""
    name = part.casefold()
    return next((value for one, value in values.items() if one.casefold() == name), None)
