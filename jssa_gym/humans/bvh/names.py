"""What joints are called: one table, and how the names of a file become those of the table."""

import re
from collections import Counter

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans.bvh.skeleton import Skeleton
from jssa_gym.text import words

JOINTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "head": (("Head",), ("Head",)),
    "core_body": (
        ("Hips", "Pelvis", "Root", "Hip"),
        ("Neck", "Neck1", "Chest", "UpperChest", "Spine3", "Spine2", "Spine1"),
    ),
    "right_arm": (
        ("RightArm", "RightUpArm", "RightUpperArm", "RightShldr", "RightHumerus", "RightShoulder"),
        ("RightHand", "RightWrist"),
    ),
    "left_arm": (
        ("LeftArm", "LeftUpArm", "LeftUpperArm", "LeftShldr", "LeftHumerus", "LeftShoulder"),
        ("LeftHand", "LeftWrist"),
    ),
    "right_leg": (
        ("RightUpLeg", "RightUpperLeg", "RightThigh", "RightFemur", "RightHip"),
        ("RightFoot", "RightAnkle"),
    ),
    "left_leg": (
        ("LeftUpLeg", "LeftUpperLeg", "LeftThigh", "LeftFemur", "LeftHip"),
        ("LeftFoot", "LeftAnkle"),
    ),
}
"""The joints that a body part starts and ends at, by the names that they have in common skeletons; the first that is
there counts. Names are compared as :func:`normalised` makes them."""

_BEGINNING = re.compile(r"[^ _.-]+[ _.-]+")

_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}


def normalised(name: str) -> str:
    """A joint's name without case, separators and leading zeros, its side written out in front.

    ``R UpperArm``, ``upper_arm.R``, ``rUpperArm`` and ``RightUpperArm`` are all ``rightupperarm``.
    """
    found = words(name)
    side = next((_SIDES[word] for word in found if word in _SIDES), "")
    rest = [str(int(word)) if word.isdigit() else word for word in found if word not in _SIDES]
    return side + "".join(rest)


def normalised_names(skeleton: Skeleton) -> list[str]:
    """Names of a skeleton's joints as :func:`normalised` makes them, without what most of them begin with.

    That is whose they are: ``mixamorig:``, ``Bip01 ``, ``Character1_``, or a person's own name.
    """
    names = [name.rsplit(":", 1)[-1] for name in skeleton.names]
    while True:
        begun = Counter(match.group() for name in names if (match := _BEGINNING.match(name)))
        whose, count = begun.most_common(1)[0] if begun else ("", 0)
        if 2 * count <= len(names) or len(names) == 1:
            return [normalised(name) for name in names]
        names = [name.removeprefix(whose) for name in names]


def ends_of(skeleton: Skeleton, part: str, chosen: tuple[str, str] | None = None) -> tuple[int, int]:
    """Indices of the joints that a body part starts and ends at.

    Args:
        skeleton: Whose.
        part: A key of :data:`JOINTS`.
        chosen: Names of the two, instead of those in :data:`JOINTS`.

    Raises:
        RecordingError: There is none; the message lists those that are there.
    """
    ours, exact = normalised_names(skeleton), [name.rsplit(":", 1)[-1].casefold() for name in skeleton.names]
    found = []
    for names in JOINTS[part] if chosen is None else ((chosen[0],), (chosen[1],)):
        known = [name.rsplit(":", 1)[-1] for name in names]
        index = next((exact.index(name.casefold()) for name in known if name.casefold() in exact), None)
        if index is None:
            index = next((ours.index(normalised(name)) for name in known if normalised(name) in ours), None)
        if index is None:
            raise RecordingError(
                f"no joint {' or '.join(names)} for {part}; name one in joints, out of: {', '.join(skeleton.names)}"
            )
        found.append(index)
    return found[0], found[1]
