"""A serial arm as the kernels need it, read from an MJCF file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import RobotModelError
from jssa_gym.kernels.records import CAPSULE, LINK
from jssa_gym.robots.coverage import check_coverage
from jssa_gym.robots.mjcf import (
    COLLISION_GROUP,
    capsules_of,
    carrier_links,
    chain_of,
    joints_of_arm,
    self_pairs_of,
    tool_of,
)
from jssa_gym.robots.reading import read_source, read_spec
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

ASSETS = Path(__file__).resolve().parent / "assets"
"""Files of the arms that the package comes with."""


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

    def contain(self, positions: Array) -> bool:
        """Whether joint positions, shape (..., n) [rad], lie inside the limits."""
        low, high = self.position.T
        return bool(np.all((low <= positions) & (positions <= high)))

    @property
    def state_scale(self) -> Array:
        """What deviations of joint states are shares of: range, velocity and acceleration limit, shape (3, n)."""
        low, high = self.position.T
        return np.array([high - low, self.velocity, self.acceleration])


def unpromised(uncovered: Sequence[str]) -> str:
    """What is to be said of links without capsules, by their joints; empty if there are none."""
    return f"nothing is measured or promised of the uncovered links of {', '.join(uncovered)}" if uncovered else ""


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
    """File that it was read from, MJCF or URDF."""
    mount: Array = field(default_factory=lambda: _frozen(np.zeros(3)))
    """Where the MJCF's world origin stands in the world, shape (3,) [m]."""
    uncovered: tuple[str, ...] = ()
    """Joints of links that draw something outside of capsules: nothing is measured there, and nothing promised."""
    group: int = COLLISION_GROUP
    """Geom group of the file that holds the capsules."""
    guessed: tuple[str, ...] = ()
    """Which of the limits nobody has stated, as their table says: ``velocity``, ``acceleration``, ``jerk``."""

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

    @property
    def unpromised(self) -> str:
        """What no report, certificate or shield speaks of, in words; empty if every link is covered."""
        return unpromised(self.uncovered)

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

    def spec(self) -> "mujoco.MjSpec":
        """What its file describes, for a scene of MuJoCo's; the capsules are in group 3, whichever the file has."""
        spec = read_spec(self.mjcf)
        swapped = {self.group: COLLISION_GROUP, COLLISION_GROUP: self.group}
        for geom in spec.geoms if self.group != COLLISION_GROUP else ():
            geom.group = swapped.get(geom.group, geom.group)
        return spec

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
        group: int | None = None,
    ) -> Self:
        """Read a serial arm of hinge joints from an MJCF or URDF file.

        Joints, offsets and position ranges come from the file; capsules are the capsule and sphere geoms of one group.
        What a link draws has to lie in its own capsules and those of the links before and after it, to 1 mm; what the
        fixed base draws outside of all is logged. This is what ``jssa-gym robot check`` goes by, which makes a model
        of most other files. Two capsules are a self-collision pair if their links are neither equal nor neighbours and
        no ``<contact><exclude/>`` names their bodies. Files have no acceleration or jerk limits, MJCF none of velocity.

        Args:
            path: The file; packages that a URDF names are looked for in and beside the folders that hold it.
            velocity: Shape (n,) [rad/s].
            acceleration: Shape (n,) [rad/s²].
            jerk: Shape (n,) [rad/s³].
            tool_site: Name of the site at the tool centre point; without it, the origin of the last link.
            home_key: Name of the keyframe with the home position; without it, mid-range of every joint.
            uncovered: Joints of links that need no capsules; see :attr:`uncovered`.
            group: Geom group that holds the capsules; 3 by default, and of a URDF 0, which has its ``<collision>``.

        Raises:
            RobotModelError: The file cannot be read, or holds what a serial arm of hinge joints with capsules
                cannot be; the message names the joint, geom or link.
        """
        source = read_source(path)
        # of these all that is asked here is true, which need not be found out at every start
        shipped = source.path.parent == ASSETS and (home_key, group) == ("home", None)
        path, model = source.path, source.model
        if faults := [str(finding) for finding in source.findings if not finding.fits]:
            raise RobotModelError(f"{'; '.join(faults)}; `jssa-gym robot check {path.name}` makes a model of it")
        group = source.group if group is None else group
        joints = joints_of_arm(model, path.name, group)
        links, anchors = chain_of(model, joints)
        limits = JointLimits(
            _frozen([model.jnt_range[j] for j in joints]), _frozen(velocity), _frozen(acceleration), _frozen(jerk)
        )
        link_of_body = carrier_links(model, joints)
        capsules, names, bodies = capsules_of(model, link_of_body, anchors, group)
        tool_link, tool_offset = tool_of(model, tool_site, link_of_body, anchors)
        keys = [model.key_qpos[k].copy() for k in range(model.nkey) if model.key(k).name == home_key]
        home = keys[-1] if keys else np.array(limits.position.mean(axis=1))
        if not limits.contain(home):
            raise RobotModelError(f"keyframe '{home_key}' lies outside the position ranges: {home.tolist()}")
        names_of_joints = tuple(model.joint(j).name or f"joint {j}" for j in joints)
        if unknown := [name for name in uncovered if name not in names_of_joints]:
            raise RobotModelError(f"no joint {unknown[0]!r} to leave uncovered; there are {', '.join(names_of_joints)}")
        spared = [i for i, name in enumerate(names_of_joints) if name in uncovered]
        if not shipped:
            check_coverage(model, joints, link_of_body, home, group, spared)
        return cls(
            name=_model_name(model) or path.stem,
            joint_names=names_of_joints,
            links=_frozen(links, LINK),
            capsules=_frozen(capsules, CAPSULE),
            capsule_names=names,
            self_pairs=_frozen(self_pairs_of(model, capsules["link"], bodies), np.int64),
            limits=limits,
            home=_frozen(home),
            tool_link=tool_link,
            tool_offset=_frozen(tool_offset),
            mjcf=path,
            uncovered=tuple(uncovered),
            group=group,
        )


def _model_name(model: "mujoco.MjModel") -> str:
    return bytes(model.names).split(b"\0", 1)[0].decode()
