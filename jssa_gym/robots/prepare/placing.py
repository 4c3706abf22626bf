"""Where a prepared arm stands, how large it is, and the column around what its base draws."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jssa_gym.robots.coverage import TOLERATED
from jssa_gym.robots.findings import FileFinding, obstacle
from jssa_gym.robots.limits import LimitTable
from jssa_gym.robots.prepare.anatomy import STOUT, Anatomy
from jssa_gym.robots.prepare.enclose import MARGIN, Enclosure, Solid, farthest_out

_OFF = 0.05
"""How far the first joint's axis may be from the upright axis, and the base's lowest point from the ground, before the
arm is moved there [m]."""

_SMALLEST, _LARGEST = 0.2, 5.0
"""Reaches of arms [m]; what lies beyond was hardly written in metres."""

_NARROW, _WIDE = 0.2, 16.0
"""Widths of position ranges below and above which the unit is asked about [rad]; wrists with ±400° are common."""

_FAST = 20.0
"""Velocity limit above which the unit is asked about [rad/s]."""

_CHECKED = "; if it is right, give --units-checked"

_PEDESTAL = 0.2
"""Height of the first joint of an arm that has no base, as a share of its reach."""

_TURNS = 25
"""Angles of the first joint at which its link's capsules are looked at as those of the base."""

_UPRIGHT = 1e-3
"""Sine of the angle from the upright axis up to which a first joint turns about it."""


def unit_findings(anatomy: Anatomy, limits: LimitTable, file: Path) -> list[FileFinding]:
    """Questions about units: of lengths, of position ranges, of velocity limits."""
    found, urdf = [], file.suffix != ".xml"
    if not _SMALLEST <= anatomy.reach <= _LARGEST:
        advice = 'lengths have to be in metres: give its meshes scale="0.001 0.001 0.001", or the like'
        found.append(obstacle("the arm", f"reaches {anatomy.reach:.3g} m", advice + _CHECKED))
    for name, wide, fast in zip(anatomy.joints, np.ptp(anatomy.ranges, axis=1), limits.velocity, strict=True):
        if wide < _NARROW or wide > _WIDE:
            unit = "degree" if wide > _WIDE else "radian"
            advice = f'if it is in {unit}s, write <compiler angle="{unit}"/>'
            if urdf:
                advice = "a URDF is in radians, so write them there"
            found.append(obstacle(f"joint '{name}'", f"has a range of {wide:.3g} rad", advice + _CHECKED))
        if fast > _FAST:
            advice = 'if it is in degrees, write it in radians, or unit = "deg" into a table of limits'
            found.append(obstacle(f"joint '{name}'", f"may turn at {fast:.4g} rad/s", advice + _CHECKED))
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
    elif anatomy.base is None and not 0.0 < first[2] < anatomy.reach:
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


def base_column(anatomy: Anatomy, first_link: Sequence[Enclosure] = ()) -> tuple[Enclosure | None, list[FileFinding]]:
    """A capsule about an upright first joint around all that the base draws: it turns with the first link, in place.

    None where the first link's own capsules hold the base already, at whatever angle.
    """
    if anatomy.base is None or _held(anatomy, list(first_link)):
        return None, []
    axis, first = anatomy.chain["axis"][0], anatomy.chain["offset"][0]
    points, radii = anatomy.base.points()
    local = points - first
    if np.hypot(axis[0], axis[1]) > _UPRIGHT:
        text = "is neither measured nor avoided: the first joint does not turn about the upright axis"
        return None, [FileFinding("the base", text)]
    radius = float((np.hypot(local[:, 0], local[:, 1]) + radii).max()) + MARGIN
    if radius > STOUT * anatomy.reach:
        text = f"reaches {radius:.2f} m from the first joint's axis and is neither measured nor avoided"
        return None, [FileFinding("the base", text)]
    radius = float(np.ceil(radius * 1e4) / 1e4)
    cap = np.sqrt((radius - radii) ** 2 - np.hypot(local[:, 0], local[:, 1]) ** 2)
    high, low = float((local[:, 2] - cap).max()), float((local[:, 2] + cap).min())
    if low > high:
        low = high = (low + high) / 2.0
    return Enclosure(np.array([0.0, 0.0, low]), np.array([0.0, 0.0, high]), radius), []


def _held(anatomy: Anatomy, capsules: list[Enclosure]) -> bool:
    """Whether capsules of the first link hold the base wherever that has turned to."""
    assert anatomy.base is not None
    away = anatomy.base.triangles - anatomy.chain["offset"][0]
    turns = np.linspace(*anatomy.ranges[0], _TURNS)[:, None] * anatomy.chain["axis"][0]
    # against the turning link the base turns back
    return all(
        farthest_out(
            Solid(Rotation.from_rotvec(-turn).apply(away.reshape(-1, 3)).reshape(away.shape), anatomy.base.radius),
            capsules,
        )
        <= TOLERATED
        for turn in turns
    )
