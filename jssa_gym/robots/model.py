"""A serial arm as the kernels need it, read from an MJCF file."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import RobotModelError
from jssa_gym.headless import choose_gl_backend
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
from jssa_gym.storage import read_text
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco


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

        joints = joints_of_arm(model, path.name)
        links, anchors = chain_of(model, joints)
        limits = JointLimits(
            _frozen([model.jnt_range[j] for j in joints]), _frozen(velocity), _frozen(acceleration), _frozen(jerk)
        )
        link_of_body = carrier_links(model, joints)
        capsules, names, bodies = capsules_of(model, link_of_body, anchors)
        tool_link, tool_offset = tool_of(model, tool_site, link_of_body, anchors)
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
            self_pairs=_frozen(self_pairs_of(model, capsules["link"], bodies), np.int64),
            limits=limits,
            home=_frozen(home),
            tool_link=tool_link,
            tool_offset=_frozen(tool_offset),
            mjcf=path,
            uncovered=tuple(uncovered),
        )


def _model_name(model: "mujoco.MjModel") -> str:
    return bytes(model.names).split(b"\0", 1)[0].decode()
