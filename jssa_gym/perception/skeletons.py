"""Which keypoints a detector delivers, and the body parts that they span.

A *joint* is the mean of some keypoints, or of those of them that are seen. The bodies are those of motion capture
(:mod:`jssa_gym.humans.bvh`): the paper's six capsules, or one for every bone of arms and legs. Radii cover what the
keypoints do not show: a head around any point of its face; a hand around its wrist, whichever way it points.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import PARTS
from jssa_gym.validation import known_name

Body = Literal["six", "jointed"]

BODIES = ("six", "jointed")

FACE = 0.08
"""How far the points of a face are at most taken to be from the middle of the head's sphere [m]."""

_RADIUS = {name: radius for name, _, _, radius in PARTS}

_SIDES = ("right", "left")


class BodyPart(NamedTuple):
    """A capsule between two joints."""

    name: str
    start: str
    """Joint that it begins at."""
    end: str
    radius: float
    """[m]."""


LIMBS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        f"{side}_{joint}": (f"{side}_{parent}", length)
        for side in _SIDES
        for joint, parent, length in (
            ("elbow", "shoulder", 0.40),
            ("wrist", "elbow", 0.36),
            ("hand", "wrist", 0.24),
            ("knee", "hip", 0.55),
            ("ankle", "knee", 0.55),
            ("toe", "ankle", 0.30),
        )
    }
)
"""The joint that another hangs on, and a length that nobody's limb between them exceeds [m]: shares of the stature
after Drillis and Contini, 1966, of somebody of 2.15 m and more."""


@dataclass(frozen=True, slots=True, eq=False)
class KeypointTable:
    """A detector's keypoints.

    Raises:
        ParameterError: Names are double, or a joint is made of keypoints that are not there.
    """

    name: str
    keypoints: tuple[str, ...]
    """In the detector's order."""
    joints: Mapping[str, tuple[str, ...]]
    """Keypoints whose mean a joint is."""
    hand: float
    """Radius of a capsule from wrist to ``hand`` that covers the hand [m]."""
    foot: float
    """The same from ankle to ``toe`` [m]."""

    def __post_init__(self) -> None:
        if len(set(self.keypoints)) < len(self.keypoints):
            raise ParameterError(f"{self.name}: every keypoint needs a name of its own, got {self.keypoints}")
        for joint, points in self.joints.items():
            for point in points:
                known_name(f"keypoint of {joint}", point, self.keypoints)
        object.__setattr__(self, "keypoints", tuple(self.keypoints))

    def body(self, body: str = "jointed") -> tuple[BodyPart, ...]:
        """The parts of a body.

        Args:
            body: ``"jointed"``, or ``"six"`` for the capsules of the package's own people: arms and legs that bend
                leave those.

        Raises:
            ParameterError: Another name, or a joint is missing.
        """
        known_name("body", body, BODIES)
        parts = [
            # any point of the face may be all that is seen of a head
            BodyPart("head", "head", "head", _RADIUS["head"] + FACE),
            BodyPart("core_body", "hips", "shoulders", _RADIUS["core_body"]),
        ]
        arm, leg = _RADIUS["right_arm"], _RADIUS["right_leg"]
        limbs = (
            ("upper_arm", "shoulder", "elbow", arm),
            ("forearm", "elbow", "wrist", arm),
            ("hand", "wrist", "hand", self.hand),
            ("thigh", "hip", "knee", leg),
            ("knee_to_ankle", "knee", "ankle", leg),
            ("foot", "ankle", "toe", self.foot),
        )
        if body == "six":
            limbs = ("arm", "shoulder", "wrist", arm), ("leg", "hip", "ankle", leg)
        parts += [
            BodyPart(f"{side}_{name}", f"{side}_{start}", f"{side}_{end}", radius)
            for side in _SIDES
            for name, start, end, radius in limbs
        ]
        for part in parts:
            for joint in (part.start, part.end):
                known_name(f"joint of {part.name}", joint, self.joints)
        return tuple(parts)


def _both(joints: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Joints of both sides; ``{}`` stands for the side, ``+`` between keypoints."""
    return {
        f"{side}_{joint}": tuple(point.format(side) for point in points.split("+"))
        for side in _SIDES
        for joint, points in joints.items()
    }


_LIMB_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")

_COCO = (
    "nose",
    *(f"{side}_{point}" for point in ("eye", "ear", *_LIMB_JOINTS) for side in ("left", "right")),
)

_MEDIAPIPE = (
    "nose",
    *(f"{side}_eye{which}" for side in ("left", "right") for which in ("_inner", "", "_outer")),
    *("left_ear", "right_ear", "mouth_left", "mouth_right"),
    *(
        f"{side}_{point}"
        for point in (
            *("shoulder", "elbow", "wrist", "pinky", "index", "thumb"),
            *("hip", "knee", "ankle", "heel", "foot_index"),
        )
        for side in ("left", "right")
    ),
)

_KINECT_ARM = ("clavicle", "shoulder", "elbow", "wrist", "hand", "handtip", "thumb")
_KINECT = (
    *("pelvis", "spine_navel", "spine_chest", "neck"),
    *(f"{point}_{side}" for side in ("left", "right") for point in _KINECT_ARM),
    *(f"{point}_{side}" for side in ("left", "right") for point in ("hip", "knee", "ankle", "foot")),
    *("head", "nose", "eye_left", "ear_left", "eye_right", "ear_right"),
)

_TRUNK = {"hips": ("left_hip", "right_hip"), "shoulders": ("left_shoulder", "right_shoulder")}

SKELETONS: dict[str, KeypointTable] = {
    "coco17": KeypointTable(
        "coco17",
        _COCO,
        {
            "head": _COCO[:5],
            **_TRUNK,
            **_both({joint: f"{{}}_{joint}" for joint in _LIMB_JOINTS}),
            **_both({"hand": "{}_wrist", "toe": "{}_ankle"}),
        },
        hand=0.22,
        foot=0.28,
    ),
    "mediapipe33": KeypointTable(
        "mediapipe33",
        _MEDIAPIPE,
        {
            "head": _MEDIAPIPE[:11],
            **_TRUNK,
            **_both({joint: f"{{}}_{joint}" for joint in _LIMB_JOINTS}),
            **_both({"hand": "{}_pinky+{}_index", "toe": "{}_foot_index"}),
        },
        hand=0.13,
        foot=0.12,
    ),
    "kinect32": KeypointTable(
        "kinect32",
        _KINECT,
        {
            "head": _KINECT[26:],
            "hips": ("pelvis",),
            "shoulders": ("neck",),
            **_both({joint: f"{joint}_{{}}" for joint in _LIMB_JOINTS}),
            **_both({"hand": "handtip_{}", "toe": "foot_{}"}),
        },
        hand=0.08,
        foot=0.12,
    ),
}
"""COCO's 17 keypoints, MediaPipe Pose's 33 landmarks and the 32 joints of Azure Kinect's body tracking, in their orders
and lower-case names."""


def make_skeleton(skeleton: str | KeypointTable) -> KeypointTable:
    """A skeleton, or the one of a name in :data:`SKELETONS`.

    Raises:
        ParameterError: Unknown name.
    """
    if isinstance(skeleton, KeypointTable):
        return skeleton
    return SKELETONS[known_name("skeleton", skeleton, SKELETONS)]


def ancestors(joint: str) -> Sequence[tuple[str, float]]:
    """Joints that another hangs on, nearest first, and how far it can be from each [m]."""
    found, length = [], 0.0
    while joint in LIMBS:
        joint, more = LIMBS[joint]
        length += more
        found.append((joint, length))
    return found
