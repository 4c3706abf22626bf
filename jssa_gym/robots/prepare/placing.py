"""Where a prepared arm stands, how large it is, and the column around what its base draws."""

from dataclasses import replace

import numpy as np

from jssa_gym.robots.prepare.anatomy import Anatomy
from jssa_gym.robots.prepare.enclose import MARGIN, Enclosure, Solid
from jssa_gym.robots.prepare.findings import FileFinding, obstacle

_OFF = 0.05
"""How far the first joint's axis may be from the upright axis, and the base's lowest point from the ground, before the
arm is moved there [m]."""

_SMALLEST, _LARGEST = 0.05, 10.0
"""Reaches of arms [m]; what lies beyond was not written in metres."""

_NARROW, _WIDE = 0.25, 8.0 * np.pi
"""Widest position range of all below which, and widest of any above which, the unit is asked about [rad]."""

_PEDESTAL = 0.2
"""Height of the first joint of an arm that has no base, as a share of its reach."""

_STOUT = 0.35
"""Share of the arm's reach up to which a base is enclosed in a column."""

_UPRIGHT = 1e-3
"""Sine of the angle from the upright axis up to which a first joint turns about it."""


def size_findings(anatomy: Anatomy) -> list[FileFinding]:
    """Questions about units."""
    found, reach = [], anatomy.reach
    if not _SMALLEST <= reach <= _LARGEST:
        text = f"reaches {reach:.3g} m"
        found.append(
            obstacle("the arm", text, 'lengths have to be in metres: give its meshes scale="0.001 0.001 0.001"')
        )
    width = np.ptp(anatomy.ranges, axis=1)
    if width.max() < _NARROW:
        text = f"has no range wider than {width.max():.3g} rad"
        found.append(obstacle("the arm", text, 'if they are radians, write <compiler angle="radian"/>'))
    for name, wide in zip(anatomy.joints, width, strict=True):
        if wide > _WIDE:
            text = f"has a range of {wide:.3g} rad"
            found.append(obstacle(f"joint '{name}'", text, 'if it is in degrees, write <compiler angle="degree"/>'))
    return found


def placed(anatomy: Anatomy) -> tuple[Anatomy, list[FileFinding]]:
    """The arm with its first joint over the origin and its base on the ground, if it is far from there."""
    first = anatomy.chain["offset"][0]
    lowest = 0.0 if anatomy.base is None else float(_lowest(anatomy.base))
    shift = np.zeros(3)
    if np.hypot(first[0], first[1]) > _OFF:
        shift[:2] = -first[:2]
    if abs(lowest) > _OFF:
        shift[2] = -lowest
    elif anatomy.base is None and not 0.0 < first[2] / anatomy.reach < 1.0:
        shift[2] = _PEDESTAL * anatomy.reach - first[2]
    if not shift.any():
        return anatomy, []
    chain = anatomy.chain.copy()
    chain["offset"][0] += shift
    base = anatomy.base and Solid(anatomy.base.triangles + shift, anatomy.base.radius)
    text = f"is moved by {np.round(shift, 4).tolist()} m"
    told = FileFinding(
        "the arm", text, "its first joint stands over the origin, about which people walk, its base at 0"
    )
    return replace(anatomy, chain=chain, base=base), [told]


def _lowest(solid: Solid) -> float:
    return float((solid.triangles[..., 2].min(axis=1) - solid.radius).min())


def base_column(anatomy: Anatomy) -> tuple[Enclosure | None, list[FileFinding]]:
    """A capsule about an upright first joint around all that the base draws: it turns with the first link, in place."""
    if anatomy.base is None:
        return None, []
    axis, first = anatomy.chain["axis"][0], anatomy.chain["offset"][0]
    points, radii = anatomy.base.points()
    local = points - first
    if np.hypot(axis[0], axis[1]) > _UPRIGHT:
        text = "is neither measured nor avoided: the first joint does not turn about the upright axis"
        return None, [FileFinding("the base", text)]
    radius = float((np.hypot(local[:, 0], local[:, 1]) + radii).max()) + MARGIN
    if radius > _STOUT * anatomy.reach:
        text = f"reaches {radius:.2f} m from the first joint's axis and is neither measured nor avoided"
        return None, [FileFinding("the base", text)]
    radius = float(np.ceil(radius * 1e4) / 1e4)
    cap = np.sqrt((radius - radii) ** 2 - np.hypot(local[:, 0], local[:, 1]) ** 2)
    high, low = float((local[:, 2] - cap).max()), float((local[:, 2] + cap).min())
    if low > high:
        low = high = (low + high) / 2.0
    return Enclosure(np.array([0.0, 0.0, low]), np.array([0.0, 0.0, high]), radius), []
