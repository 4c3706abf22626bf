"""Meshes: capsules that can be stretched, and what an arm looks like."""

from typing import Any, NamedTuple

import numpy as np
import trimesh
import trimesh.creation
import trimesh.transformations
from numpy.typing import NDArray

from jssa_gym.envs.world import World
from jssa_gym.robots.mjcf import COLLISION_GROUP
from jssa_gym.types import Array

_AROUND = 24
"""Corners of a capsule's cross-section."""

_UP = 8
"""Rings of its cap."""

_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = 2, 3, 4, 5, 6, 7
"""MuJoCo's numbers of geom types."""


class Mesh(NamedTuple):
    """Triangles."""

    vertices: NDArray[np.float32]
    """Shape (v, 3) [m]."""
    faces: NDArray[np.uint32]
    """Shape (f, 3)."""


def tube() -> Mesh:
    """An open cylinder of radius 1 from z = 0 to 1: a capsule's middle, without walls that would shine through."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(_AROUND)], axis=1)
    return _rings([ring, ring + np.array([0.0, 0.0, 1.0])])


def dome() -> Mesh:
    """The upper half of a sphere of radius 1: a capsule's end."""
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    rings = []
    for up in np.linspace(0.0, np.pi / 2.0, _UP + 1):
        flat = max(np.cos(up), 1e-6)  # of one corner the faces would have no direction
        rings.append(np.stack([flat * np.cos(turn), flat * np.sin(turn), np.full(_AROUND, np.sin(up))], axis=1))
    return _rings(rings)


def _rings(rings: list[Array]) -> Mesh:
    faces = []
    for k in range(len(rings) - 1):
        for i in range(_AROUND):
            a, b = k * _AROUND + i, k * _AROUND + (i + 1) % _AROUND
            faces += [(a, b, b + _AROUND), (a, b + _AROUND, a + _AROUND)]
    return Mesh(np.concatenate(rings).astype(np.float32), np.array(faces, np.uint32))


def turned_to(direction: Array) -> NDArray[np.float32]:
    """Quaternions (w, x, y, z) that turn the z axis along directions, shape (k, 3); any where there is none."""
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    unit = np.where(length > 1e-9, direction / np.maximum(length, 1e-9), [0.0, 0.0, 1.0])
    w = 1.0 + unit[:, 2]
    out = np.stack([w, -unit[:, 1], unit[:, 0], np.zeros(len(unit))], axis=1)
    out[w < 1e-6] = [0.0, 1.0, 0.0, 0.0]  # straight down
    return (out / np.linalg.norm(out, axis=1, keepdims=True)).astype(np.float32)


class Painted(NamedTuple):
    """What a body has of one colour."""

    mesh: Mesh
    colour: tuple[int, int, int]


def looks(world: World) -> dict[int, list[Painted]]:
    """What an arm's bodies look like, by their number in MuJoCo's model; empty for one that has capsules only."""
    model, found = world.model, {}
    for body in range(1, model.nbody):
        parts: dict[tuple[int, int, int], list[trimesh.Trimesh]] = {}
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            material = model.geom_matid[geom]
            *rgb, alpha = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
            if model.geom_group[geom] != COLLISION_GROUP and alpha > 0.05 and (part := _geom(model, geom)) is not None:
                r, g, b = (round(255.0 * float(one)) for one in rgb)
                parts.setdefault((r, g, b), []).append(part)
        if parts:
            found[body] = [Painted(_as_one(same), colour) for colour, same in parts.items()]
    return found


def _as_one(parts: list[trimesh.Trimesh]) -> Mesh:
    begin = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, begin, strict=False)]
    vertices = np.concatenate([part.vertices for part in parts])
    return Mesh(vertices.astype(np.float32), np.concatenate(faces).astype(np.uint32))


def _geom(model: Any, geom: int) -> trimesh.Trimesh | None:
    """A geom in its body's frame."""
    size, kind = model.geom_size[geom], int(model.geom_type[geom])
    if kind == _MESH:
        mesh = model.geom_dataid[geom]
        v, f = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = model.mesh_vert[v : v + model.mesh_vertnum[mesh]]
        part = trimesh.Trimesh(vertices, model.mesh_face[f : f + model.mesh_facenum[mesh]], process=False)
    elif kind == _BOX:
        part = trimesh.creation.box(2.0 * size)
    elif kind == _CYLINDER:
        part = trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=_AROUND)
    elif kind == _CAPSULE:
        part = trimesh.creation.capsule(2.0 * size[1], size[0], count=(_AROUND, _AROUND))
        part.apply_translation(-part.bounds.mean(axis=0))
    elif kind in (_SPHERE, _ELLIPSOID):
        part = trimesh.creation.icosphere(subdivisions=2)
        part.apply_scale(size[0] if kind == _SPHERE else size)
    else:
        return None
    place = trimesh.transformations.quaternion_matrix(model.geom_quat[geom])
    place[:3, 3] = model.geom_pos[geom]
    return part.apply_transform(place)
