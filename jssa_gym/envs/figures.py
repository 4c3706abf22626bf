"""What people and marks look like: rounded limbs inside of their capsules, a goal, a contact.

Capsules are what is measured; here is only what is drawn of them.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jssa_gym.safety.parts import FOOT_PARTS, LIMB_PARTS, is_called
from jssa_gym.types import Array, CapsuleSet

Colour = tuple[float, float, float]

SKIN, HAIR = (0.87, 0.66, 0.53), (0.22, 0.15, 0.11)
_SHIRTS = ((0.20, 0.42, 0.70), (0.30, 0.52, 0.44), (0.55, 0.36, 0.60), (0.62, 0.42, 0.30))
"""One a person, in turn."""
_TROUSERS, SHOES = (0.21, 0.23, 0.30), (0.12, 0.12, 0.13)
_CAPSULE = (0.35, 0.55, 0.85)
GREEN, RED, ORANGE = (0.05, 0.72, 0.30), (0.90, 0.10, 0.10), (0.95, 0.55, 0.05)

_FAINT = 0.28
"""How opaque a capsule is that is shown over what it stands for."""


class Rounded(NamedTuple):
    """Something round: a capsule, or a ball where both ends are one point."""

    start: Array
    """Shape (3,) [m]."""
    end: Array
    """Shape (3,) [m]."""
    radius: float
    """[m]."""
    colour: Colour
    opacity: float = 1.0


def person(capsules: CapsuleSet, opacity: float = 1.0) -> list[Rounded]:
    """One person as drawn.

    Whoever has the paper's six parts is drawn with shoulders, elbows, hands, knees and shoes; of others every capsule
    is drawn as a limb.

    Args:
        capsules: Of one person.
        opacity: 1 for nothing to be seen through.
    """
    if not len(capsules.radius):
        return []
    part = {name: k for k, name in enumerate(capsules.names)}
    shirt = _SHIRTS[int(capsules.person[0]) % len(_SHIRTS)]
    whole = {"head", "core_body", "right_arm", "left_arm", "right_leg", "left_leg"} <= part.keys()
    drawn = _whole(capsules, part, shirt) if whole else _limbs(capsules, shirt)
    return [solid._replace(opacity=opacity) for solid in drawn]


def shells(capsules: CapsuleSet) -> list[Rounded]:
    """The capsules themselves, to be seen through."""
    ends = zip(capsules.start, capsules.end, capsules.radius, strict=True)
    return [Rounded(start, end, float(radius), _CAPSULE, _FAINT) for start, end, radius in ends]


def goal(points: Array, floor: float) -> list[Rounded]:
    """Where the tool is to be, shape (k, 3) [m], with halos; a single one stands on a stem, which tells its depth.

    Args:
        points: One, or several that are visited in their order.
        floor: Height that the stem stands on [m].
    """
    drawn = [Rounded(point, point, 0.022, GREEN) for point in points]
    drawn += [Rounded(point, point, 0.05, GREEN, 0.35) for point in points]
    if len(points) == 1 and points[0][2] > floor:
        foot = np.array([points[0][0], points[0][1], floor])
        drawn.append(Rounded(foot, points[0], 0.005, GREEN, 0.8))
        drawn.append(Rounded(foot, foot, 0.018, GREEN, 0.8))
    drawn += [Rounded(a, b, 0.005, GREEN, 0.8) for a, b in pairwise(points)]
    return drawn


def shortest_line(pair: tuple[Array, Array], colour: Colour = RED) -> list[Rounded]:
    """The line between the closest points of an arm and of people, (3,) [m] each."""
    return [Rounded(*pair, 0.006, colour), *(Rounded(end, end, 0.014, colour) for end in pair)]


def contact(point: Array) -> list[Rounded]:
    """Where an arm and people touch, (3,) [m]: a bright ball in a halo."""
    return [Rounded(point, point, 0.045, RED), Rounded(point, point, 0.13, RED, 0.4)]


def _limbs(capsules: CapsuleSet, shirt: Colour) -> list[Rounded]:
    """Every capsule as a limb of its own, of a colour by its name."""
    drawn = []
    for k, name in enumerate(capsules.names):
        start, end, radius = capsules.start[k], capsules.end[k], float(capsules.radius[k])
        if is_called(name, ("head", "hand", "palm", "fist")):
            colour, share = SKIN, 0.68 if is_called(name, ("head",)) else 0.5
        elif is_called(name, (*FOOT_PARTS, "leg", "knee", "thigh", "hip", "pelvis")):
            colour, share = SHOES if is_called(name, ("foot", "toe", "shoe")) else _TROUSERS, 0.75
        else:
            colour, share = shirt, 0.62 if is_called(name, LIMB_PARTS) else 0.85
        drawn.append(Rounded(start, end, share * radius, colour))
    return drawn


def _whole(capsules: CapsuleSet, part: dict[str, int], shirt: Colour) -> list[Rounded]:
    """Somebody of six capsules."""
    start, end, radius = capsules.start, capsules.end, capsules.radius
    head, core = part["head"], part["core_body"]
    shoulders = [start[part[f"{side}_arm"]] for side in ("right", "left")]
    hips = [start[part[f"{side}_leg"]] for side in ("right", "left")]
    aside = _unit(shoulders[0] - shoulders[1], (0.0, 1.0, 0.0))  # from the left to the right
    up = _unit((shoulders[0] + shoulders[1] - hips[0] - hips[1]) / 2.0, (0.0, 0.0, 1.0))
    ahead = _unit(np.cross(up, aside), (-1.0, 0.0, 0.0))
    drawn = _head(start[head], float(radius[head]), up, ahead, (start[core] + end[core]) / 2.0)
    drawn += _trunk(shoulders, hips, aside, float(radius[core]), shirt)
    for side in ("right", "left"):
        k = part[f"{side}_arm"]
        drawn += _arm(start[k], end[k], float(radius[k]), -ahead, shirt)
        k = part[f"{side}_leg"]
        drawn += _leg(start[k], end[k], float(radius[k]), ahead)
    return drawn


def _head(middle: Array, radius: float, up: Array, ahead: Array, chest: Array) -> list[Rounded]:
    """Face, hair and neck: with the paper's radius of 0.2 m a face of 0.11 m."""
    size = 0.54 * radius
    face = middle + 0.10 * radius * up
    chin = middle - 0.30 * radius * up
    crown = face + 0.14 * radius * up - 0.16 * radius * ahead
    nose = face + 0.94 * size * ahead - 0.22 * size * up
    return [
        Rounded(chin, face, 0.94 * size, SKIN),
        Rounded(crown, crown - 0.22 * radius * up - 0.06 * radius * ahead, 1.0 * size, HAIR),
        Rounded(nose + 0.3 * size * up - 0.08 * size * ahead, nose, 0.15 * size, SKIN),
        Rounded(middle, middle + 0.55 * (chest - middle), 0.30 * radius, SKIN),
    ]


def _trunk(
    shoulders: Sequence[Array], hips: Sequence[Array], aside: Array, radius: float, shirt: Colour
) -> list[Rounded]:
    """Shoulders, chest and waist, narrower below."""
    (right, left), (one, other) = shoulders, hips
    waist = (one + other) / 2.0
    half, wide = 0.40 * radius * aside, 0.56 * radius
    down = _unit(waist - (right + left) / 2.0, (0.0, 0.0, -1.0))
    inner = [
        shoulder + sign * 0.18 * radius * aside + 0.22 * radius * down
        for shoulder, sign in ((right, -1.0), (left, 1.0))
    ]
    drawn = [Rounded(inner[0], inner[1], 0.40 * radius, shirt)]
    breast = (inner[0] + inner[1]) / 2.0 + 0.35 * radius * down
    drawn.append(Rounded(breast, waist, wide, shirt))
    for sign, shoulder in zip((1.0, -1.0), inner, strict=True):
        drawn.append(
            Rounded(shoulder + 0.3 * radius * down - sign * 0.1 * radius * aside, waist + sign * half, wide, shirt)
        )
    drawn.append(Rounded(waist + half - 0.1 * radius * down, waist - half - 0.1 * radius * down, 0.58 * radius, shirt))
    drawn.append(
        Rounded(waist + half + 0.32 * radius * down, waist - half + 0.32 * radius * down, 0.52 * radius, _TROUSERS)
    )
    return drawn


def _arm(shoulder: Array, hand: Array, radius: float, back: Array, shirt: Colour) -> list[Rounded]:
    """Sleeve, forearm, palm, fingers; the elbow is as far behind the line as the capsule is wide."""
    along = _unit(hand - shoulder, (0.0, 0.0, -1.0))
    elbow = shoulder + 0.48 * (hand - shoulder) + 0.38 * radius * back
    wrist, palm = hand - 0.9 * radius * along, hand - 0.15 * radius * along
    return [
        Rounded(shoulder, elbow, 0.56 * radius, shirt),
        Rounded(elbow, wrist, 0.46 * radius, shirt),
        Rounded(wrist, palm, 0.34 * radius, SKIN),
        Rounded(palm, hand + 0.35 * radius * along, 0.42 * radius, SKIN),
        Rounded(palm, palm + 0.5 * radius * (along - back), 0.17 * radius, SKIN),
    ]


def _leg(hip: Array, ankle: Array, radius: float, ahead: Array) -> list[Rounded]:
    """Thigh, shin and shoe."""
    knee = hip + 0.5 * (ankle - hip) + 0.25 * radius * ahead
    flat = _unit(np.array([ahead[0], ahead[1], 0.0]), (-1.0, 0.0, 0.0))
    sole = ankle - np.array([0.0, 0.0, 0.55 * radius])
    return [
        Rounded(hip, knee, 0.84 * radius, _TROUSERS),
        Rounded(knee, ankle, 0.60 * radius, _TROUSERS),
        Rounded(sole - 0.35 * radius * flat, sole + 1.1 * radius * flat, 0.44 * radius, SHOES),
    ]


def _unit(vector: Array, otherwise: Sequence[float]) -> Array:
    """A vector's direction, or another where it has none."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-6 else np.array(otherwise)
