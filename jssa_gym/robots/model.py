"""A serial arm as the kernels need it, read from an MJCF file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import RobotModelError
from jssa_gym.headless import choose_gl_backend
from jssa_gym.kernels.records import CAPSULE, LINK, records
from jssa_gym.robots.coverage import check_coverage
from jssa_gym.robots.serial import called, serial_faults
from jssa_gym.storage import read_text
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

COLLISION_GROUP = 3
"""MJCF geom group that holds the capsules."""


def _frozen(values: ArrayLike, dtype: np.dtype | type = np.float64) -> NDArray:
    array = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array


def _made_anew(thing: Any) -> tuple[type, tuple[Any, ...]]:
    """How to pickle a dataclass so that its arrays come back read-only: others are another type to the kernels."""
    return type(thing), tuple(getattr(thing, field.name) for field in fields(thing))


class LimitsError(RobotModelError):
    """Unfit limits of velocity, acceleration or jerk, which no MJCF file holds."""


@dataclass(frozen=True, slots=True, eq=False)
class JointLimits:
    """Limits of every joint, symmetric but for the position.

    Raises:
        RobotModelError: Shapes differ, or a limit is not positive, not finite or an empty range.
    """

    position: Array
    """Lower and upper, shape (n, 2) [rad]."""
    velocity: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (n,) [rad/s²]."""
    jerk: Array
    """Shape (n,) [rad/s³]."""

    __reduce__ = _made_anew

    def __post_init__(self) -> None:
        for name in ("position", "velocity", "acceleration", "jerk"):
            object.__setattr__(self, name, _frozen(getattr(self, name)))
        if self.position.ndim != 2 or self.position.shape[1] != 2:
            raise RobotModelError(f"position limits have shape {self.position.shape}, expected (n, 2)")
        if not (np.all(self.position[:, 0] < self.position[:, 1]) and np.all(np.isfinite(self.position))):
            raise RobotModelError(
                f"position limits have to be finite, the lower below the upper, got {self.position.tolist()}"
            )
        for name in ("velocity", "acceleration", "jerk"):
            limit = getattr(self, name)
            if limit.shape != (len(self.position),):
                raise LimitsError(f"{name} limits have shape {limit.shape}, expected ({len(self.position)},)")
            if not (np.all(limit > 0.0) and np.all(np.isfinite(limit))):
                raise LimitsError(f"{name} limits have to be positive and finite, got {limit}")

    def bounds(self) -> Array:
        """The limits as the kernels take them: a new array, shape (5, n).

        Its rows are the lower and the upper position [rad], velocity [rad/s], acceleration [rad/s²], jerk [rad/s³].
        """
        return np.array([*self.position.T, self.velocity, self.acceleration, self.jerk])


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """Chain, capsules and limits of a serial arm of n hinge joints.

    The MJCF file is where lengths and position ranges are written; this is what was read from it.
    """

    name: str
    joint_names: tuple[str, ...]
    links: NDArray
    """Geometry of each joint, shape (n,) of :data:`~jssa_gym.kernels.records.LINK`; world frame at the front."""
    capsules: NDArray
    """Collision capsules in their link frames, shape (m,) of :data:`~jssa_gym.kernels.records.CAPSULE`."""
    capsule_names: tuple[str, ...]
    self_pairs: NDArray[np.int64]
    """Capsule pairs that are checked for self-collision, shape (p, 2)."""
    limits: JointLimits
    home: Array
    """Home position, shape (n,) [rad]."""
    tool_link: int
    tool_offset: Array
    """Tool centre point in the frame of ``tool_link``, shape (3,) [m]."""
    mjcf: Path
    mount: Array = field(default_factory=lambda: _frozen(np.zeros(3)))
    """Where the MJCF's world origin stands in the world, shape (3,) [m]."""
    uncovered: tuple[str, ...] = ()
    """Joints of links that draw something outside of capsules: nothing is measured there, and nothing promised."""

    __reduce__ = _made_anew

    def __post_init__(self) -> None:
        for name in ("links", "capsules", "self_pairs", "home", "tool_offset", "mount"):
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        """Itself: it cannot change, and a copy's arrays would be writable."""
        return self

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    def mounted(self, position: ArrayLike) -> Self:
        """The same robot standing at another place in the world, shape (3,) [m]."""
        mount = _frozen(position)
        if mount.shape != (3,) or not np.all(np.isfinite(mount)):
            raise RobotModelError(f"a mount is a finite point of shape (3,), got {position!r}")
        links = self.links.copy()
        links[0]["offset"] += mount - self.mount
        return replace(self, links=_frozen(links, LINK), mount=mount)

    def with_limits(self, limits: JointLimits) -> Self:
        """The same robot under other limits."""
        if limits.jerk.shape != (self.n,):
            raise RobotModelError(f"{self.name} has {self.n} joints, the limits are for {len(limits.jerk)}")
        return replace(self, limits=limits)

    @classmethod
    def from_mjcf(
        cls,
        path: str | Path,
        *,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        jerk: ArrayLike,
        tool_site: str = "tcp",
        home_key: str = "home",
        uncovered: Sequence[str] = (),
    ) -> Self:
        """Read a serial arm of hinge joints from an MJCF file.

        Joints, offsets and position ranges come from the file; capsules are its capsule and sphere geoms in group 3.
        A link that draws something needs some, or turns inside those of the link before it, and reaches at most 300 mm
        out of all; what reaches out by more than 5 mm is logged, of the fixed base too. Two capsules are a
        self-collision pair if their links are neither equal nor neighbours and no ``<contact><exclude/>`` names their
        bodies. MJCF has no velocity, acceleration or jerk limits.

        Args:
            path: The MJCF file.
            velocity: Shape (n,) [rad/s].
            acceleration: Shape (n,) [rad/s²].
            jerk: Shape (n,) [rad/s³].
            tool_site: Name of the site at the tool centre point; without it, the origin of the last link.
            home_key: Name of the keyframe with the home position; without it, mid-range of every joint.
            uncovered: Joints of links that need no capsules; see :attr:`uncovered`.

        Raises:
            RobotModelError: The file cannot be read, or holds what a serial arm of hinge joints with capsules
                cannot be; the message names the joint, geom or link.
        """
        choose_gl_backend()
        import mujoco

        path = Path(path).resolve()
        if not path.is_file():
            raise RobotModelError(f"no MJCF file at {path}")
        read_text(path, RobotModelError)  # MuJoCo takes any bytes, and ends at the first NUL
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise RobotModelError(f"{path.name} does not compile: {error}") from error

        joints = _joints_of_arm(model, path.name)
        links, anchors = _links(model, joints)
        limits = JointLimits(
            _frozen([model.jnt_range[j] for j in joints]), _frozen(velocity), _frozen(acceleration), _frozen(jerk)
        )
        link_of_body = carrier_links(model, joints)
        capsules, names, bodies = _capsules(model, link_of_body, anchors)
        tool_link, tool_offset = _tool(model, tool_site, link_of_body, anchors)
        keys = [model.key_qpos[k].copy() for k in range(model.nkey) if model.key(k).name == home_key]
        home = keys[-1] if keys else np.array(limits.position.mean(axis=1))
        low, high = limits.position.T
        if not np.all((low <= home) & (home <= high)):
            raise RobotModelError(f"keyframe '{home_key}' lies outside the position ranges: {home.tolist()}")
        names_of_joints = tuple(model.joint(j).name or f"joint {j}" for j in joints)
        if unknown := [name for name in uncovered if name not in names_of_joints]:
            raise RobotModelError(f"no joint {unknown[0]!r} to leave uncovered; there are {', '.join(names_of_joints)}")
        spared = [i for i, name in enumerate(names_of_joints) if name in uncovered]
        check_coverage(model, joints, link_of_body, home, COLLISION_GROUP, spared)
        return cls(
            name=_model_name(model) or path.stem,
            joint_names=names_of_joints,
            links=_frozen(links, LINK),
            capsules=_frozen(capsules, CAPSULE),
            capsule_names=names,
            self_pairs=_frozen(_self_pairs(model, capsules["link"], bodies), np.int64),
            limits=limits,
            home=_frozen(home),
            tool_link=tool_link,
            tool_offset=_frozen(tool_offset),
            mjcf=path,
            uncovered=tuple(uncovered),
        )


def _joints_of_arm(model: "mujoco.MjModel", name: str) -> list[int]:
    """Joint ids of a model that is a serial arm with capsules.

    Raises:
        RobotModelError: It is not; the message has all that is in the way.
    """
    faults = serial_faults(model) + _capsule_faults(model)
    if len(faults) > 1:
        faults.append(f"`jssa-gym robot check {name}` makes a model of it")
    if faults:
        raise RobotModelError("; ".join(faults))
    return list(range(model.njnt))


def _capsule_faults(model: "mujoco.MjModel") -> list[str]:
    """What is wrong with the geoms that distances are to be measured with."""
    import mujoco

    measured = [g for g in range(model.ngeom) if model.geom_group[g] == COLLISION_GROUP]
    if not measured:
        return [f"the model has no capsule geoms in group {COLLISION_GROUP}; they are what distances are measured with"]
    carried, faults = carrier_links(model, list(range(model.njnt))), []
    for g in measured:
        geom, kind = called(model, mujoco.mjtObj.mjOBJ_GEOM, g), mujoco.mjtGeom(model.geom_type[g])
        if kind not in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE):
            faults.append(
                f"{geom} in group {COLLISION_GROUP} is a {kind.name[7:].lower()}; "
                "collision geoms have to be capsules or spheres"
            )
        elif model.njnt and carried[int(model.geom_bodyid[g])] < 0:
            faults.append(
                f"{geom} in group {COLLISION_GROUP} does not move with any joint; "
                "enclose the base in a capsule of the first link"
            )
    return faults


def _model_name(model: "mujoco.MjModel") -> str:
    return bytes(model.names).split(b"\0", 1)[0].decode()


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


def _links(model: "mujoco.MjModel", joints: list[int]) -> tuple[NDArray, list[Array]]:
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


def _capsules(
    model: "mujoco.MjModel", link_of_body: dict[int, int], anchors: list[Array]
) -> tuple[NDArray, tuple[str, ...], list[int]]:
    import mujoco

    rows, names, bodies = [], [], []
    for g in range(model.ngeom):
        if model.geom_group[g] != COLLISION_GROUP:
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


def _tool(model: "mujoco.MjModel", site: str, link_of_body: dict[int, int], anchors: list[Array]) -> tuple[int, Array]:
    for s in range(model.nsite):
        if model.site(s).name == site:
            body = int(model.site_bodyid[s])
            link = link_of_body[body]
            if link < 0:
                raise RobotModelError(f"site '{site}' does not move with any joint")
            return link, _carried_to(model, body, link, anchors, model.site_pos[s])
    return len(anchors) - 1, np.zeros(3)


def _self_pairs(model: "mujoco.MjModel", link: NDArray, bodies: list[int]) -> NDArray[np.int64]:
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
