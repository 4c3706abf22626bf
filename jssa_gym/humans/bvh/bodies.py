"""Bodies of capsules around a skeleton's joints: the paper's six, or one for every bone of arms and legs."""

import numpy as np

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans.body import PARTS
from jssa_gym.humans.bvh.guess import Ends
from jssa_gym.humans.bvh.names import JOINTS
from jssa_gym.humans.bvh.skeleton import Skeleton, bones
from jssa_gym.humans.recording import Recording
from jssa_gym.types import Array

BODIES = ("six", "jointed")
"""The paper's six capsules, or an upper arm, a forearm, a hand, a thigh, a shin and a foot of each side."""

_LIMBS = {
    "right_arm": ("right_upper_arm", "right_forearm", "right_hand"),
    "left_arm": ("left_upper_arm", "left_forearm", "left_hand"),
    "right_leg": ("right_thigh", "right_knee_to_ankle", "right_foot"),
    "left_leg": ("left_thigh", "left_knee_to_ankle", "left_foot"),
}
"""Capsules of a limb in a jointed body. Names decide on speed bounds: an ankle is as fast as its foot."""

_HAND = 0.74
"""Length of a hand over that of the forearm, of skeletons that end at the wrist; Drillis and Contini, 1966: 0.108 and
0.146 of the stature."""

_HEAD = 0.4
"""How far from its joint a head may end [m]; beyond, an end site is none of a head."""

_SHORT = 0.02
"""Length up to which an end site says nothing [m]."""


def capsules_of(skeleton: Skeleton, points: Array, ends: Ends, body: str) -> Recording:
    """The capsules where the file has the person, z up."""
    time = np.array([k * skeleton.frame_time for k in range(len(points))])
    radius = {name: radius for name, _, _, radius in PARTS}
    if body == "six":
        first, last = ([ends[part][k] for part in JOINTS] for k in (0, 1))
        return Recording(
            time, points[:, first], points[:, last], np.array([radius[part] for part in JOINTS]), tuple(JOINTS)
        )
    lengths = bones(points, skeleton.point_parents)
    made: list[tuple[str, Array, Array, float]] = []
    for part, (first, last) in ends.items():
        begin, end = points[:, first], points[:, last]
        if part == "head":
            top, far = _farthest(skeleton, lengths, last)
            if radius[part] < far <= _HEAD:  # else the top is within the sphere around the joint, or is none
                end = begin + (1.0 - radius[part] / far) * (points[:, top] - begin)
        if part not in _LIMBS:
            made.append((part, begin, end, radius[part]))
            continue
        upper, lower, outer = _LIMBS[part]
        middle = points[:, _middle(skeleton, lengths, part, first, last)]
        tip, far = _farthest(skeleton, lengths, last)
        if far > _SHORT:
            outermost = points[:, tip]
        elif part.endswith("arm"):
            outermost = end + _HAND * (end - middle)
        else:
            outermost = end
        for name, one, other in ((upper, begin, middle), (lower, middle, end), (outer, end, outermost)):
            made.append((name, one, other, radius[part]))
    return Recording(
        time,
        np.stack([begin for _, begin, _, _ in made], axis=1),
        np.stack([end for _, _, end, _ in made], axis=1),
        np.array([radius for _, _, _, radius in made]),
        tuple(name for name, _, _, _ in made),
    )


def _farthest(skeleton: Skeleton, lengths: Array, joint: int) -> tuple[int, float]:
    """The point that hangs farthest along the bones from a joint, and how far, in the unit of ``lengths``."""
    far = {joint: 0.0}
    for point in skeleton.below(joint):
        far[point] = far[skeleton.point_parents[point]] + float(lengths[point])
    farthest = max(far, key=lambda point: far[point])
    return farthest, far[farthest]


def _middle(skeleton: Skeleton, lengths: Array, part: str, first: int, last: int) -> int:
    """Elbow or knee: the joint that cuts the way between the ends of a limb most evenly."""
    way = skeleton.path(first, last)
    if len(way) < 3 or way[0] != min(way):
        raise RecordingError(
            f"{part} has no joint between {skeleton.names[first]} and {skeleton.names[last]} that could be an elbow or "
            "a knee; take the body 'six'"
        )
    so_far = np.cumsum([lengths[point] for point in way[1:]])
    return way[1 + int(np.abs(so_far[:-1] - so_far[-1] / 2.0).argmin())]
