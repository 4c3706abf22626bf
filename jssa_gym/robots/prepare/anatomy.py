"""An arm's links as they stand while every joint is at zero: axes, what they draw, what they weigh."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.records import LINK, records
from jssa_gym.robots.coverage import ground_geoms, measured_geoms
from jssa_gym.robots.mjcf import COLLISION_GROUP, carrier_links
from jssa_gym.robots.prepare.chain import Chain, name_of, ranges
from jssa_gym.robots.prepare.enclose import Enclosure, Solid, joined
from jssa_gym.robots.prepare.surface import drawn
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

_TOOLS = ("tcp", "attachment", "ee", "grip", "grasp", "pinch", "tool", "flange")
"""Words in the names of sites and bodies that are a tool's, the first that is found counts."""

STOUT = 0.35
"""Share of the arm's reach up to which a base is enclosed in a column."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """One link; lengths are in the frame that sits on its joint and has the world's axes while all joints are at 0."""

    body: str
    """Name of the body that its joint moves."""
    geoms: tuple[int, ...]
    """What it and all that is fixed to it draw; ids."""
    solid: Solid | None
    """The same as triangles; None if it draws nothing."""
    found: tuple[Enclosure, ...]
    """Capsules that the file gives it."""
    names: tuple[str, ...]
    """Their names."""
    mass: float
    """[kg]."""
    centre: Array
    """Centre of mass, shape (3,) [m]."""
    inertia: Array
    """About it, shape (3, 3) [kg m²]."""
    armature: float
    """Armature of its joint [kg m²]."""


@dataclass(frozen=True, slots=True, eq=False)
class Anatomy:
    """The whole arm."""

    joints: tuple[str, ...]
    """Names."""
    chain: NDArray
    """Geometry of the joints, shape (n,) of ``LINK``; all rotations are unit matrices."""
    ranges: Array
    """Position ranges, shape (n, 2) [rad]."""
    links: tuple[Link, ...]
    base: Solid | None
    """What the base draws, in the world [m]."""
    base_geoms: tuple[int, ...]
    bystanders: tuple[str, ...]
    """Geoms that no joint of the arm moves and that are none of its base's: names."""
    tool: Array
    """Tool centre point in the last link's frame, shape (3,) [m]."""
    tool_name: str
    """Site or body that says so; empty if none does."""
    group: int = COLLISION_GROUP
    """Geom group of the file that holds its capsules."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def reach(self) -> float:
        """No point of the arm is farther from the second joint [m]."""
        lengths = np.linalg.norm(self.chain["offset"][min(2, self.n - 1) :], axis=1).sum()
        last = self.links[-1]
        if last.solid is not None:
            tip = np.linalg.norm(last.solid.triangles, axis=2).max() + last.solid.radius.max()
        else:  # drawn by its capsules
            ends = [np.linalg.norm(end) + capsule.radius for capsule in last.found for end in capsule[:2]]
            tip = max(ends, default=0.0)
        return float(lengths + max(tip, np.linalg.norm(self.tool)))


def zero_pose(model: "mujoco.MjModel", chain: Chain, share: float | None = None) -> "mujoco.MjData":
    """The file's arm with every joint at 0 and what is frozen at its reference.

    Args:
        model: The compiled file.
        chain: What moves.
        share: Where slides beyond the base are instead, as a share of their range: where a gripper's fingers can be.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    for j in chain.joints:
        data.qpos[model.jnt_qposadr[j]] = 0.0
    carriers = carrier_links(model, list(chain.joints))
    for j in chain.frozen:
        slides = model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE and model.jnt_limited[j]
        # those between base and tip stay: they carry the rest of the arm
        if share is not None and slides and carriers[int(model.jnt_bodyid[j])] == len(chain.joints) - 1:
            data.qpos[model.jnt_qposadr[j]] = (1.0 - share) * model.jnt_range[j, 0] + share * model.jnt_range[j, 1]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def anatomy_of(model: "mujoco.MjModel", chain: Chain, tool: str | None = None, group: int = COLLISION_GROUP) -> Anatomy:
    """Take a file's arm apart.

    Args:
        model: The compiled file.
        chain: What moves and what does not.
        tool: Name of the site or body at the tool centre point.
        group: Geom group that holds the capsules.

    Raises:
        RobotModelError: A link draws what cannot be looked at.
    """
    data = zero_pose(model, chain)
    poses = [data, zero_pose(model, chain, 0.0), zero_pose(model, chain, 1.0)]
    anchors = np.array([data.xanchor[j] for j in chain.joints])
    geometry = records(len(chain.joints), LINK)
    geometry["rotation"] = np.eye(3)
    geometry["offset"] = np.diff(anchors, axis=0, prepend=np.zeros((1, 3)))
    geometry["axis"] = [data.xaxis[j] for j in chain.joints]
    carriers, parts = carrier_links(model, list(chain.joints)), _parts(model, chain)
    where = np.array([carriers[int(body)] for body in model.geom_bodyid])
    measured = measured_geoms(model, group)
    links = []
    for i, j in enumerate(chain.joints):
        bodies = [b for b in range(1, model.nbody) if carriers[b] == i]
        geoms, found = np.flatnonzero((where == i) & ~measured), np.flatnonzero((where == i) & measured)
        links.append(
            Link(
                model.body(model.jnt_bodyid[j]).name or f"body {model.jnt_bodyid[j]}",
                tuple(geoms.tolist()),
                _solid(model, poses if i == len(chain.joints) - 1 else poses[:1], geoms, anchors[i]),
                tuple(_capsule(model, data, g, anchors[i]) for g in found),
                tuple(model.geom(g).name or f"geom {g}" for g in found),
                *_weight(model, data, bodies, anchors[i]),
                float(model.dof_armature[model.jnt_dofadr[j]]),
            )
        )
    point, said = _tool(model, data, chain, carriers, tool)
    arm = Anatomy(
        tuple(name_of(model, j) for j in chain.joints),
        geometry,
        ranges(model, chain.joints),
        tuple(links),
        None,
        (),
        (),
        point - anchors[-1],
        said,
        group,
    )
    still = np.flatnonzero((where < 0) & ~ground_geoms(model)).tolist()
    base = [g for g in still if int(model.geom_bodyid[g]) in parts or _under(model, data, g, arm)]
    others = tuple(model.geom(g).name or f"geom {g}" for g in still if g not in base)
    solid = _solid(model, poses[:1], np.array(base, int), np.zeros(3))
    return replace(arm, base=solid, base_geoms=tuple(base), bystanders=others)


def _under(model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, arm: Anatomy) -> bool:
    """Whether a geom of the world itself is a pedestal: about the first joint's axis, and below it."""
    if model.geom_bodyid[geom]:
        return False
    triangles, radius = drawn(model, data, geom)
    away = triangles - arm.chain["offset"][0]
    wide = float(np.hypot(away[..., 0], away[..., 1]).max()) + radius
    return wide <= STOUT * arm.reach and float(away[..., 2].min()) - radius < 0.0


def _parts(model: "mujoco.MjModel", chain: Chain) -> set[int]:
    """Bodies of the tree that the arm belongs to: tables and what else stands about are none of it."""
    body = int(model.jnt_bodyid[chain.joints[0]])
    while model.body_parentid[body]:
        body = int(model.body_parentid[body])
    return {b for b in range(1, model.nbody) if model.body_rootid[b] == body}


def _solid(
    model: "mujoco.MjModel", poses: Sequence["mujoco.MjData"], geoms: NDArray[np.int64], anchor: Array
) -> Solid | None:
    pieces = []
    for g in geoms:
        places = [drawn(model, data, int(g)) for data in poses]
        triangles, radius = places[0]
        for other, _ in places[1:]:
            if not np.array_equal(other, places[0][0]):
                triangles = np.concatenate([triangles, other, *_between(places[0][0], other)])
        pieces.append(Solid(triangles - anchor, np.full(len(triangles), radius)))
    return joined(pieces) if pieces else None


def _between(triangles: Array, moved: Array) -> list[Array]:
    """Triangles that what slides from one place to another along a line sweeps over, edge by edge, (t, 3, 3) each."""
    found = []
    for i, k in ((0, 1), (1, 2), (2, 0)):
        a, b, c, d = triangles[:, i], triangles[:, k], moved[:, k], moved[:, i]
        found += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return found


def _capsule(model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, anchor: Array) -> Enclosure:
    triangles, radius = drawn(model, data, int(geom))
    start, end = triangles[0, :2] - anchor
    return Enclosure(start, end, radius)


def _weight(
    model: "mujoco.MjModel", data: "mujoco.MjData", bodies: Sequence[int], anchor: Array
) -> tuple[float, Array, Array]:
    """Mass, centre and inertia of bodies that move as one."""
    masses = model.body_mass[bodies]
    mass = float(masses.sum())
    if mass <= 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centre = masses @ data.xipos[bodies] / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        axes, away = data.ximat[body].reshape(3, 3), data.xipos[body] - centre
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += model.body_mass[body] * (away @ away * np.eye(3) - np.outer(away, away))
    return mass, centre - anchor, inertia


def _tool(
    model: "mujoco.MjModel", data: "mujoco.MjData", chain: Chain, carriers: dict[int, int], name: str | None
) -> tuple[Array, str]:
    """The tool centre point in the world, and who says so."""
    last = len(chain.joints) - 1
    sites = {
        model.site(s).name: data.site_xpos[s] for s in range(model.nsite) if carriers[int(model.site_bodyid[s])] == last
    }
    bodies = {model.body(b).name: data.xpos[b] for b in range(1, model.nbody) if carriers[b] == last}
    places = {**bodies, **sites}
    if name is not None:
        if name not in places:
            raise ParameterError(
                f"no site or body '{name}' on the last link; there are {', '.join(filter(None, places))}"
            )
        return places[name].copy(), name
    for word in _TOOLS:
        for some in (sites, bodies):
            for said, point in some.items():
                if word in said.casefold().replace("-", "_").split("_") or (len(word) > 2 and word in said.casefold()):
                    return point.copy(), said
    return data.xanchor[chain.joints[-1]].copy(), ""
