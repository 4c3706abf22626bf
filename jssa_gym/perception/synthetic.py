"""Keypoints that a detector without any fault would find on the package's own people."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import NAMES
from jssa_gym.perception.skeletons import FACE, KeypointTable
from jssa_gym.types import Array, CapsuleSet


def people_in(human: CapsuleSet) -> tuple[int, ...]:
    """Ids of people of six parts each, in their order.

    Raises:
        ParameterError: Somebody has other parts than :data:`jssa_gym.humans.body.NAMES`.
    """
    ids = tuple(dict.fromkeys(human.person.tolist()))
    parts = len(NAMES)
    same = all(human.names[k * parts : (k + 1) * parts] == NAMES for k in range(len(ids)))
    if len(human.names) != parts * len(ids) or not same or not np.array_equal(human.person, np.repeat(ids, parts)):
        found = ", ".join(dict.fromkeys(human.names))
        raise ParameterError(f"keypoints are made of people of the parts {', '.join(NAMES)}; got {found}")
    return ids


def keypoints_of(human: CapsuleSet, skeleton: KeypointTable) -> tuple[NDArray[np.int64], Array]:
    """Ids, shape (p,), and keypoints, shape (p, k, 3) [m], NaN for those that no part is made of.

    Elbows and knees are in the middle of their limbs, the face's points around the middle of the head.

    Args:
        human: People of six parts.
        skeleton: The detector's.

    Raises:
        ParameterError: They have others.
    """
    ids, parts = people_in(human), len(NAMES)
    points = np.full((len(ids), len(skeleton.keypoints), 3), np.nan)
    for k in range(len(ids)):
        own = slice(k * parts, (k + 1) * parts)
        joints = _joints(human.start[own], human.end[own])
        for joint, place in joints.items():
            for point in skeleton.joints[joint]:
                points[k, skeleton.keypoints.index(point)] = place
        face = [skeleton.keypoints.index(point) for point in skeleton.joints["head"]]
        points[k, face] = joints["head"] + _around_a_head(joints, len(face))
    return np.array(ids, np.int64), points


def _joints(start: Array, end: Array) -> dict[str, Array]:
    found = {"head": start[NAMES.index("head")]}
    for side in ("right", "left"):
        for limb, names in (("arm", ("shoulder", "elbow", "wrist")), ("leg", ("hip", "knee", "ankle"))):
            part = NAMES.index(f"{side}_{limb}")
            for name, share in zip(names, (0.0, 0.5, 1.0), strict=True):
                found[f"{side}_{name}"] = (1.0 - share) * start[part] + share * end[part]
        found[f"{side}_hand"], found[f"{side}_toe"] = found[f"{side}_wrist"], found[f"{side}_ankle"]
    # last: where these are means of shoulders and hips, those stand
    middle = {f"{name}s": (found[f"right_{name}"] + found[f"left_{name}"]) / 2.0 for name in ("hip", "shoulder")}
    return {**middle, **found}


def _around_a_head(joints: dict[str, Array], count: int) -> Array:
    """Where a face's points are from the middle of the head, on a half circle, shape (count, 3) [m]."""
    aside = joints["left_shoulder"] - joints["right_shoulder"]
    aside = aside / max(float(np.linalg.norm(aside)), 1e-9)
    ahead = np.array([aside[1], -aside[0], 0.0])
    angle = np.linspace(0.0, np.pi, count)
    return FACE * (1.0 - 1e-9) * (np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * ahead)
