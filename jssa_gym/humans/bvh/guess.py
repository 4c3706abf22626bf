"""What a BVH file does not say: its unit, its upward axis, whether its first frames are motion at all."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans.bvh.skeleton import Skeleton, bones
from jssa_gym.types import Array

UNITS: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "cmu": 0.0254 / 0.45}
"""Metres in a unit of a file. ``cmu`` is 1/0.45 inch, of skeletons out of Carnegie Mellon's motion capture database."""

UNIT_NAMES = {
    "m": "metres",
    "cm": "centimetres",
    "mm": "millimetres",
    "in": "inches",
    "cmu": "CMU's units of 1/0.45 in",
}

_TALL = (1.0, 2.1)
"""From ankle to head along the bones, of adults and most children [m]. No two units have room in it: the factor is
2.1, the nearest two units are 2.2 apart."""

_ALONG = 0.75
"""Share of the way from feet to head that the upward axis has at least, in the median of the frames."""

_STILL = 1.0
"""Angle up to which a joint is not turned against its parent [deg]."""

_CALIBRATION_SPEED = 5.0
"""Speed at which no joint leaves, from one frame to the next, a pose in which somebody stood [m/s]."""

_STRAIGHT, _LEVEL, _UPRIGHT = 0.985, 0.17, 0.95
"""A T: length of a limb over that of its bones; sine of an arm's slope; cosine of a leg's, and between arms."""

Ends = Mapping[str, tuple[int, int]]
"""Indices of the joints that body parts start and end at."""


def bones_to_head(skeleton: Skeleton, points: Array, ends: Ends) -> float:
    """Length of the bones from an ankle by the hip to the head, whatever the posture, in the file's unit."""
    lengths = bones(points, skeleton.point_parents)
    total = 0.0
    for leg in ("right_leg", "left_leg"):
        way = skeleton.path(ends[leg][1], ends["head"][0])
        # the bone of the one where both ways meet leads elsewhere
        total += lengths[way].sum() - lengths[min(way)]
    return float(total / 2.0)


def unit_of(skeleton: Skeleton, points: Array, ends: Ends) -> str:
    """A file's unit, a key of :data:`UNITS`: the one in which the bones from ankle to head are a person's.

    Raises:
        RecordingError: There is none; the message says what would be.
    """
    length = bones_to_head(skeleton, points, ends)
    for unit, metres in UNITS.items():  # one fits at most
        if _TALL[0] <= length * metres <= _TALL[1]:
            return unit
    told = ", ".join(f"{length * metres:.3g} m in {UNIT_NAMES[unit]}" for unit, metres in UNITS.items())
    cure = f"; scale={1.5 / length:.3g} would make it 1.5 m" if length > 0.0 else ": all joints are in one place"
    raise RecordingError(
        f"the unit cannot be told: from ankle to head it is {told}; give scale, a unit or metres in a unit{cure}"
    )


def up_of(points: Array, ends: Ends) -> str:
    """A file's upward axis, ``"y"`` or ``"z"``: that of the way from the feet to the head in the median of the frames.

    Raises:
        RecordingError: It is another one or none.
    """
    feet = (points[:, ends["right_leg"][1]] + points[:, ends["left_leg"][1]]) / 2.0
    way = np.median(points[:, ends["head"][0]] - feet, axis=0)
    share = way / max(float(np.linalg.norm(way)), 1e-300)
    axis = int(np.abs(share).argmax())
    if axis > 0 and share[axis] >= _ALONG:
        return "xyz"[axis]
    if axis > 0 and share[axis] > -_ALONG:
        raise RecordingError(
            "the upward axis cannot be told: the head is above the feet along neither y nor z in most frames; give "
            "up, 'y' or 'z'"
        )
    raise RecordingError(
        f"the head is above the feet along {'-' if share[axis] < 0.0 else ''}{'xyz'[axis]}, which has to be y or z: "
        "turn the file, or give up, 'y' or 'z', if they lie"
    )


def calibration_frames(skeleton: Skeleton, points: Array, ends: Ends) -> int:
    """How many frames at the beginning are no motion but a pose for calibration, which the motion jumps away from.

    These are frames in which no joint but the root is turned against its parent, or in which arms and legs are
    straight, the arms level and opposite, a T; from the last of them to the next frame a joint of the body would have
    to move at more than 5 m/s.

    Args:
        skeleton: What was read.
        points: Its points, z up, shape (T, j + k, 3) [m].
        ends: Of its body parts.

    Returns:
        0 for none.
    """
    posed = (skeleton.turned() <= _STILL) | _is_t(skeleton, points, ends)
    count = int((~posed).argmax()) if not posed.all() else 0
    if count == 0 or count > len(points) - 2:
        return 0
    joints = sorted({joint for pair in ends.values() for joint in pair})
    way = np.linalg.norm(points[count, joints] - points[count - 1, joints], axis=-1).max()
    return count if way > _CALIBRATION_SPEED * skeleton.frame_time else 0


def _is_t(skeleton: Skeleton, points: Array, ends: Ends) -> NDArray[np.bool_]:
    """Whether arms and legs are straight, the arms level and opposite, the legs upright, shape (T,)."""
    lengths = bones(points, skeleton.point_parents)
    found, arms = np.ones(len(points), np.bool_), []
    for part in ("right_arm", "left_arm", "right_leg", "left_leg"):
        way = skeleton.path(*ends[part])
        limb = points[:, way[-1]] - points[:, way[0]]
        length = np.maximum(np.linalg.norm(limb, axis=-1), 1e-300)
        found &= length >= _STRAIGHT * (lengths[way].sum() - lengths[min(way)])
        limb /= length[:, None]
        if part.endswith("arm"):
            found &= np.abs(limb[:, 2]) <= _LEVEL
            arms.append(limb)
        else:
            found &= limb[:, 2] <= -_UPRIGHT
    return found & ((arms[0] * arms[1]).sum(axis=-1) <= -_UPRIGHT)
