"""How far what an MJCF file draws of an arm lies outside of the capsules that distances are measured with."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import RobotModelError
from jssa_gym.robots.serial import called
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

_TURN = np.radians(2.0)
"""Between the angles of a joint at which a link is looked at beside the one before it, at most [rad]."""

_ROUND = 24
"""Points on a rim."""

_ALONG = 9
"""Points on an edge, on a ruling of a cylinder and on the axis of a capsule."""

_LONG = 0.02
"""Edge from which a triangle of a mesh is looked at between its corners too [m]."""

TOLERATED = 1e-3
"""How far what a link draws may reach out of the capsules that are to hold it [m]."""

NOTED = 5e-3
"""How far the base may reach out of all capsules of the arm without being noted [m]."""

_NOTE = "%s, which reaches %.0f mm out of all capsules: nothing is measured there"

_logger = logging.getLogger("jssa_gym")


@dataclass(frozen=True, slots=True)
class Coverage:
    """What one link draws, and how far the farthest point of it lies outside of capsules; 0 if all lies inside."""

    link: int
    """Number of the link, 0 for the first."""
    geoms: tuple[int, ...]
    """What it and the bodies fixed to it draw: ids of their geoms but for the capsules."""
    capsules: tuple[int, ...]
    """Ids of the geoms that are its capsules, those of bodies fixed to it included."""
    own: float
    """Outside of its own capsules [m]; inf if it has none."""
    joined: float
    """Outside of its own and of the capsules of the link before it, at the worst angle of the joint between [m]."""
    arm: float
    """Outside of these and of the capsules of the link after it, at the worst angle of the joint between those [m]."""


def coverage(
    model: "mujoco.MjModel", joints: Sequence[int], link_of_body: Mapping[int, int], home: Array, group: int
) -> list[Coverage]:
    """Look at every link that draws something.

    The surface is looked at in points: spheres and corners are exact, what lies between is sampled.

    Args:
        model: The compiled arm.
        joints: Id of the joint of each link.
        link_of_body: Link that carries each body, -1 for the base.
        home: Joint positions, shape (nq,) [rad].
        group: Geom group of the capsules.

    Raises:
        RobotModelError: A link draws a shape that cannot be looked at.
    """
    import mujoco

    data, measured = mujoco.MjData(model), measured_geoms(model, group)
    link, found = _link_of_geom(model, link_of_body), []
    for i, joint in enumerate(joints):
        geoms = np.flatnonzero((link == i) & ~measured)
        if not len(geoms):
            continue
        before, own, after = (np.flatnonzero((link == k) & measured) for k in (i - 1, i, i + 1))
        carrier = model.jnt_bodyid[joint]
        _pose(model, data, home)
        points, radius = _drawn(model, data, geoms, carrier)
        gap = _gaps(model, data, own, carrier, points)
        alone = max(float((gap + radius).max()), 0.0)
        out = gap + radius > 0.0
        points, radius, gap = points[out], radius[out], gap[out]
        # what covers at some angle only does not measure: each point counts where it is farthest out
        gap = np.minimum(gap, _farthest(model, data, home, joint, before, carrier, points))
        joined = float((gap + radius).max(initial=0.0))
        if i + 1 < len(joints):
            gap = np.minimum(gap, _farthest(model, data, home, joints[i + 1], after, carrier, points))
        arm = float((gap + radius).max(initial=0.0))
        found.append(Coverage(i, tuple(geoms.tolist()), tuple(own.tolist()), alone, joined, arm))
    return found


def measured_geoms(model: "mujoco.MjModel", group: int) -> NDArray[np.bool_]:
    """Which geoms distances are measured with: capsules and spheres of a group; all others are drawn, shape (g,)."""
    kinds = _kinds()
    return (model.geom_group == group) & np.isin(model.geom_type, (kinds.mjGEOM_CAPSULE, kinds.mjGEOM_SPHERE))


def ground_geoms(model: "mujoco.MjModel") -> NDArray[np.bool_]:
    """Which geoms are planes and height fields, no part of an arm, shape (g,)."""
    return np.isin(model.geom_type, (_kinds().mjGEOM_PLANE, _kinds().mjGEOM_HFIELD))


def check_coverage(
    model: "mujoco.MjModel",
    joints: Sequence[int],
    link_of_body: Mapping[int, int],
    home: Array,
    group: int,
    spared: Sequence[int] = (),
) -> None:
    """Refuse links that are drawn but not measured; note what the base draws outside of capsules.

    Arguments as of :func:`coverage`; ``spared`` are numbers of links that may be drawn outside of capsules.

    Raises:
        RobotModelError: A link draws something that is in no capsule; the message names all such links.
    """
    import mujoco

    def says(who: str, geoms: Sequence[int]) -> str:
        drawn = [called(model, mujoco.mjtObj.mjOBJ_GEOM, g) for g in geoms]
        return f"{who} draws " + ", ".join(drawn[:3]) + (f" and {len(drawn) - 3} more" if len(drawn) > 3 else "")

    def told(link: Coverage) -> str:
        return says(f"the link of {called(model, mujoco.mjtObj.mjOBJ_JOINT, joints[link.link])}", link.geoms)

    links = [link for link in coverage(model, joints, link_of_body, home, group) if link.link not in spared]
    if parts := [f"{told(link)}, {fault}" for link in links if (fault := fault_of_cover(link))]:
        raise RobotModelError(
            f"{'; '.join(parts)}: distances are measured with capsules alone, so enclose what a link draws in capsules "
            f"of group {group}, to {1e3 * TOLERATED:.0f} mm, or name its joint in `uncovered`"
        )
    geoms, out = _base(model, link_of_body, home, group)
    if out > NOTED:
        _logger.warning(_NOTE, says("the base", geoms), 1e3 * out)


def fault_of_cover(link: Coverage) -> str:
    """Why a link is not measured; empty if it is: in its own capsules and those of its neighbours."""
    if not link.capsules and link.joined > TOLERATED:
        if np.isfinite(link.joined):
            return f"has no capsule, and reaches {1e3 * link.joined:.3g} mm out of those of the link before it"
        return "has no capsule, nor has the link before it"
    if link.arm <= TOLERATED:
        return ""
    return f"and reaches {1e3 * link.arm:.3g} mm out of its capsules and those of the links beside it"


def _base(
    model: "mujoco.MjModel", link_of_body: Mapping[int, int], home: Array, group: int
) -> tuple[tuple[int, ...], float]:
    """What the base draws, and how far the farthest point of it lies outside of all capsules, at home [m]."""
    import mujoco

    data, link, measured = mujoco.MjData(model), _link_of_geom(model, link_of_body), measured_geoms(model, group)
    geoms = np.flatnonzero((link < 0) & ~measured & ~ground_geoms(model))
    if not len(geoms):
        return (), 0.0
    _pose(model, data, home)
    points, radius = _drawn(model, data, geoms, 0)
    out = _gaps(model, data, np.flatnonzero((link >= 0) & measured), 0, points) + radius
    return tuple(geoms.tolist()), max(float(out.max()), 0.0)


def _link_of_geom(model: "mujoco.MjModel", link_of_body: Mapping[int, int]) -> NDArray[np.int64]:
    return np.array([link_of_body[int(body)] for body in model.geom_bodyid])


def _pose(
    model: "mujoco.MjModel", data: "mujoco.MjData", position: Array, joint: int | None = None, turn: float = 0.0
) -> None:
    import mujoco

    data.qpos[:] = position
    if joint is not None:
        data.qpos[model.jnt_qposadr[joint]] = turn
    mujoco.mj_kinematics(model, data)


def _drawn(model: "mujoco.MjModel", data: "mujoco.MjData", geoms: NDArray[np.int64], body: int) -> tuple[Array, Array]:
    """Points that geoms are drawn at, in a body's frame, shape (p, 3), and the balls' radii, shape (p,) [m]."""
    points, radii = [], []
    for geom in geoms:
        local, radius = _surface(model, int(geom))
        world = data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T
        points.append((world - data.xpos[body]) @ data.xmat[body].reshape(3, 3))
        radii.append(np.full(len(local), radius))
    return np.concatenate(points), np.concatenate(radii)


def _gaps(
    model: "mujoco.MjModel", data: "mujoco.MjData", capsules: NDArray[np.int64], body: int, points: Array
) -> Array:
    """Distances of points of a body, shape (p, 3), from the nearest of some capsules as they stand, shape (p,) [m]."""
    world, nearest = data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T, np.full(len(points), np.inf)
    for c in capsules:
        half = model.geom_size[c, 1] if model.geom_type[c] == _kinds().mjGEOM_CAPSULE else 0.0
        axis, way = data.geom_xmat[c].reshape(3, 3)[:, 2], world - data.geom_xpos[c]
        foot = np.clip(way @ axis, -half, half)[:, None] * axis
        nearest = np.minimum(nearest, np.linalg.norm(way - foot, axis=1) - model.geom_size[c, 0])
    return nearest


def _farthest(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    home: Array,
    joint: int,
    capsules: NDArray[np.int64],
    body: int,
    points: Array,
) -> Array:
    """The largest of :func:`_gaps` of every point while one joint turns, the others at home, shape (p,) [m]."""
    farthest = np.full(len(points), -np.inf)
    low, high = model.jnt_range[joint]
    span = min(high - low, 2.0 * np.pi)  # what comes after a whole turn was there before
    for turn in np.linspace(low, low + span, int(np.ceil(span / _TURN)) + 1):
        _pose(model, data, home, joint, turn)
        farthest = np.maximum(farthest, _gaps(model, data, capsules, body, points))
    return farthest


def _kinds() -> "type[mujoco.mjtGeom]":
    import mujoco

    return mujoco.mjtGeom


def _surface(model: "mujoco.MjModel", geom: int) -> tuple[Array, float]:
    """Points in the frame of a geom, shape (p, 3), and the radius of the balls around them that it is drawn as [m]."""
    import mujoco

    kinds, kind, size = _kinds(), _kinds()(model.geom_type[geom]), model.geom_size[geom]
    along = np.linspace(-1.0, 1.0, _ALONG)
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return along[:, None] * [0.0, 0.0, size[1]], float(size[0])
    if kind == kinds.mjGEOM_BOX:
        grid = np.stack(np.meshgrid(along, along, along), axis=-1).reshape(-1, 3)
        return grid[np.abs(grid).max(axis=1) == 1.0] * size, 0.0
    turn = np.arange(_ROUND) * 2.0 * np.pi / _ROUND
    rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if kind == kinds.mjGEOM_CYLINDER:
        return np.array([(*(size[0] * point), z) for z in size[1] * along for point in rim]), 0.0
    if kind == kinds.mjGEOM_ELLIPSOID:
        tilt = np.linspace(-np.pi / 2.0, np.pi / 2.0, _ROUND // 2 + 1)
        return np.array([(*(np.cos(t) * point), np.sin(t)) for t in tilt for point in rim]) * size, 0.0
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        return _corners(model, model.geom_dataid[geom]), 0.0
    raise RobotModelError(
        f"{called(model, mujoco.mjtObj.mjOBJ_GEOM, geom)} of a link is a {kind.name[7:].lower()}; what a link "
        "draws has to be a box, capsule, cylinder, ellipsoid, mesh, sdf or sphere"
    )


def _corners(model: "mujoco.MjModel", mesh: int) -> Array:
    """Corners of a mesh, and points between those of its long triangles, shape (p, 3) [m]."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count].astype(float)
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    triangles = corners[model.mesh_face[first : first + count]]
    long = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1) > _LONG
    steps = _ALONG - 1
    shares = [(i, j, steps - i - j) for i in range(steps + 1) for j in range(steps + 1 - i)]
    between = np.einsum("sc,tcx->tsx", np.array(shares) / steps, triangles[long])
    return np.concatenate([corners, between.reshape(-1, 3)])
