"""What an MJCF file says about a serial arm: its chain, its capsules, its tool."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import RobotModelError
from jssa_gym.kernels.records import CAPSULE, LINK, records
from jssa_gym.robots.serial import called, serial_faults
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

COLLISION_GROUP = 3
"""MJCF geom group that holds the capsules, where nothing else is said."""

URDF_GROUP = 0
"""Geom group in which MuJoCo puts the ``<collision>`` shapes of a URDF."""


def joints_of_arm(model: "mujoco.MjModel", name: str, group: int = COLLISION_GROUP) -> list[int]:
    """Joint ids of a model that is a serial arm with capsules in a geom group.

    Raises:
        RobotModelError: It is not; the message has all that is in the way.
    """
    faults = serial_faults(model) + _capsule_faults(model, group)
    if len(faults) > 1:
        faults.append(f"`jssa-gym robot check {name}` makes a model of it")
    if faults:
        raise RobotModelError("; ".join(faults))
    return list(range(model.njnt))


def _capsule_faults(model: "mujoco.MjModel", group: int) -> list[str]:
    """What is wrong with the geoms that distances are to be measured with."""
    import mujoco

    measured = [g for g in range(model.ngeom) if model.geom_group[g] == group]
    if not measured:
        return [f"the model has no capsule geoms in group {group}; they are what distances are measured with"]
    carried, faults = carrier_links(model, list(range(model.njnt))), []
    for g in measured:
        geom, kind = called(model, mujoco.mjtObj.mjOBJ_GEOM, g), mujoco.mjtGeom(model.geom_type[g])
        if kind not in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE):
            faults.append(
                f"{geom} in group {group} is a {kind.name[7:].lower()}; collision geoms have to be capsules or spheres"
            )
        elif model.njnt and carried[int(model.geom_bodyid[g])] < 0:
            faults.append(
                f"{geom} in group {group} does not move with any joint; enclose the base in a capsule of the first link"
            )
    return faults


def _rotation(quaternion: Array) -> Array:
    import mujoco

    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _pose(model: "mujoco.MjModel", body: int, ancestor: int) -> tuple[Array, Array]:
    """Pose of a body in an ancestor body's frame, all joints in between at their reference."""
    rotation, position = np.eye(3), np.zeros(3)
    while body != ancestor:
        step = _rotation(model.body_quat[body])
        position = model.body_pos[body] + step @ position
        rotation = step @ rotation
        body = model.body_parentid[body]
    return rotation, position


def chain_of(model: "mujoco.MjModel", joints: list[int]) -> tuple[NDArray, list[Array]]:
    """Chain records, and the joint anchors in their body frames: a link frame sits on its joint's anchor."""
    import mujoco

    links, anchors = records(len(joints), LINK), []
    body, anchor = 0, np.zeros(3)
    for i, j in enumerate(joints):
        rotation, position = _pose(model, model.jnt_bodyid[j], body)
        axis, reference = model.jnt_axis[j], model.qpos0[model.jnt_qposadr[j]]
        quaternion = np.zeros(4)
        mujoco.mju_axisAngle2Quat(quaternion, axis, -reference)
        links[i]["rotation"] = rotation @ _rotation(quaternion)
        links[i]["offset"] = position + rotation @ model.jnt_pos[j] - anchor
        links[i]["axis"] = axis
        body, anchor = model.jnt_bodyid[j], model.jnt_pos[j].copy()
        anchors.append(anchor)
    return links, anchors


def carrier_links(model: "mujoco.MjModel", joints: list[int]) -> dict[int, int]:
    """Link that carries each body: of its own last joint, or of the nearest moving ancestor; -1 for the base."""
    own = {int(model.jnt_bodyid[j]): i for i, j in enumerate(joints)}
    carriers = {0: -1}
    for body in range(1, model.nbody):
        carriers[body] = own.get(body, carriers[int(model.body_parentid[body])])
    return carriers


def _carried_to(model: "mujoco.MjModel", body: int, link: int, anchors: list[Array], point: Array) -> Array:
    """A point of a body in the frame of the link that carries it."""
    rotation, position = _pose(model, body, model.jnt_bodyid[link])
    return position + rotation @ point - anchors[link]


def capsules_of(
    model: "mujoco.MjModel", link_of_body: dict[int, int], anchors: list[Array], group: int = COLLISION_GROUP
) -> tuple[NDArray, tuple[str, ...], list[int]]:
    """Capsules in their links' frames, their names, and the bodies that they sit on."""
    import mujoco

    rows, names, bodies = [], [], []
    for g in range(model.ngeom):
        if model.geom_group[g] != group:
            continue
        kind, body = mujoco.mjtGeom(model.geom_type[g]), int(model.geom_bodyid[g])
        link = link_of_body[body]
        half = model.geom_size[g][1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        # MuJoCo's z axis of a geom given by "fromto" points back at its first end
        along = _rotation(model.geom_quat[g]) @ np.array([0.0, 0.0, -half])
        start = _carried_to(model, body, link, anchors, model.geom_pos[g] - along)
        end = _carried_to(model, body, link, anchors, model.geom_pos[g] + along)
        rows.append((start, end, model.geom_size[g][0], link))
        names.append(model.geom(g).name or f"geom {g}")
        bodies.append(body)
    return np.array(rows, CAPSULE), tuple(names), bodies


def tool_of(
    model: "mujoco.MjModel", site: str, link_of_body: dict[int, int], anchors: list[Array]
) -> tuple[int, Array]:
    """Link of the tool centre point, and the point in its frame (3,) [m]; the last link's origin without a site.

    Raises:
        RobotModelError: The site does not move.
    """
    for s in range(model.nsite):
        if model.site(s).name == site:
            body = int(model.site_bodyid[s])
            link = link_of_body[body]
            if link < 0:
                raise RobotModelError(f"site '{site}' does not move with any joint")
            return link, _carried_to(model, body, link, anchors, model.site_pos[s])
    return len(anchors) - 1, np.zeros(3)


def self_pairs_of(model: "mujoco.MjModel", link: NDArray, bodies: list[int]) -> NDArray[np.int64]:
    """Pairs of capsules that are checked for self-collision, by their links and bodies, shape (p, 2)."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    pairs = [
        (i, j)
        for i in range(len(link))
        for j in range(i + 1, len(link))
        if abs(int(link[i]) - int(link[j])) > 1
        and (bodies[i], bodies[j]) not in excluded
        and (bodies[j], bodies[i]) not in excluded
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)
