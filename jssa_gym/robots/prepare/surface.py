"""What geoms draw, as triangles that lie around all of it."""

from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.exceptions import RobotModelError
from jssa_gym.robots.serial import called
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

_ROUND = 24
"""Sides of the prisms that stand for what is round; they lie around it, and add 0.9 % of its radius."""

_BOX = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]),
    ]
)
"""Corners of the triangles of a box, by number: bit 0 is x, bit 1 y, bit 2 z."""


def drawn(model: "mujoco.MjModel", data: "mujoco.MjData", geom: int) -> tuple[Array, float]:
    """Triangles around a geom where it stands, and the radius of balls that it is drawn as around them.

    Returns:
        Triangles, shape (t, 3, 3) [m], in the world; all of them points or lines for spheres and capsules; radius [m].

    Raises:
        RobotModelError: The geom is of a kind that no link can draw.
    """
    local, radius = _local(model, geom)
    return data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T, radius


def _local(model: "mujoco.MjModel", geom: int) -> tuple[Array, float]:
    import mujoco

    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind = kinds(model.geom_type[geom])
    if kind == kinds.mjGEOM_SPHERE:
        return np.zeros((1, 3, 3)), float(size[0])
    if kind == kinds.mjGEOM_CAPSULE:
        return np.array([[0, 0, -1], [0, 0, 1], [0, 0, 1]])[None] * [0.0, 0.0, size[1]], float(size[0])
    if kind == kinds.mjGEOM_BOX:
        corners = np.array([[(i >> k & 1) * 2.0 - 1.0 for k in range(3)] for i in range(8)])
        return (corners * size)[_BOX], 0.0
    if kind == kinds.mjGEOM_CYLINDER:
        return _prism(size[0], size[1]), 0.0
    if kind == kinds.mjGEOM_ELLIPSOID:
        return _ball() * size, 0.0
    if kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        return faces_of_mesh(model, int(model.geom_dataid[geom])), 0.0
    raise RobotModelError(
        f"{called(model, mujoco.mjtObj.mjOBJ_GEOM, geom)} of a link is a {kind.name[7:].lower()}; what a link "
        "draws has to be a box, capsule, cylinder, ellipsoid, mesh, sdf or sphere"
    )


def _prism(radius: float, half: float) -> Array:
    turn = np.arange(_ROUND) * 2.0 * np.pi / _ROUND
    rim = radius / np.cos(np.pi / _ROUND) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    low, high = (np.column_stack([rim, np.full(_ROUND, z)]) for z in (-half, half))
    after = np.roll(np.arange(_ROUND), -1)
    sides = [np.stack([low, high, high[after]], 1), np.stack([low, high[after], low[after]], 1)]
    ends = [
        np.stack([np.broadcast_to([0.0, 0.0, z], end.shape), end, end[after]], 1)
        for end, z in ((low, -half), (high, half))
    ]
    return np.concatenate([*sides, *ends])


def _ball() -> Array:
    """Triangles around the unit ball: its points on rings, pushed out until no face cuts into it."""
    tilt = np.linspace(0.0, np.pi, _ROUND // 2 + 1)
    turn = np.arange(_ROUND + 1) * 2.0 * np.pi / _ROUND
    grid = np.stack(
        [np.outer(np.sin(tilt), np.cos(turn)), np.outer(np.sin(tilt), np.sin(turn)), np.outer(np.cos(tilt), turn**0)],
        -1,
    )
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)])
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.linalg.norm(normal, axis=1)
    faces, normal, length = faces[length > 1e-9], normal[length > 1e-9], length[length > 1e-9]
    return faces / float((np.abs((faces[:, 0] * normal).sum(axis=1)) / length).min())


def faces_of_mesh(model: "mujoco.MjModel", mesh: int) -> Array:
    """Corners of a mesh's triangles in its own frame, shape (F, 3, 3) [m]."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count].astype(float)
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return corners[model.mesh_face[first : first + count]]
