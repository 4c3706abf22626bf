"""A prepared arm as files: an MJCF of its own, the meshes that it draws, and a table of limits."""

import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from jssa_gym.exceptions import RobotModelError, StorageError
from jssa_gym.kernels.chain import forward
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.robots.coverage import TOLERATED
from jssa_gym.robots.limits import LIMITS
from jssa_gym.robots.mjcf import COLLISION_GROUP
from jssa_gym.robots.prepare.agreement import cover_of, kinematic_error
from jssa_gym.robots.prepare.anatomy import zero_pose
from jssa_gym.robots.prepare.enclose import Enclosure
from jssa_gym.robots.prepare.examine import Examination
from jssa_gym.robots.prepare.posture import some_postures
from jssa_gym.robots.prepare.surface import faces_of_mesh
from jssa_gym.robots.reading import stl
from jssa_gym.storage import write_whole
from jssa_gym.types import Array

if TYPE_CHECKING:
    import mujoco

MODEL = "robot.xml"
"""Name of the model's file in a prepared folder."""

LIMITS_OF_MODEL = str(Path(MODEL).with_suffix(".limits.toml"))
"""Name of its table of limits."""

MOVED = 1e-12
"""How far a joint of the written model may be from where the file has it [m]."""

_GEAR = 0.1
"""Inertia of a drive, as a share of the largest that it moves, where the file states none."""

_STIFF = 120.0
"""Natural frequency of the position servos [rad/s]."""

_LIGHT = (1e-3, 1e-6)
"""Least mass [kg] and inertia [kg m²] of a link."""

_POSTURES = 100
"""Postures in which the inertia is looked at that drives are made for."""

_VISUAL = 2
"""Geom group of what is drawn."""


def write_prepared(arm: Examination, folder: str | Path) -> Path:
    """Write an examined arm into a folder, as ``robot=FOLDER`` reads it.

    Raises:
        RobotModelError: Something has to be decided first, the message lists all of it; or what was written does not
            move as the file says, or does not hold what it draws. Then nothing is left of it.
        StorageError: It cannot be written.
    """
    if arm.obstacles:
        raise RobotModelError("; ".join(map(str, arm.obstacles)))
    folder = Path(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder if folder.is_dir() else folder.parent) as made:
            unfinished = Path(made) / "robot"
            meshes = unfinished / "meshes"
            meshes.mkdir(parents=True)
            assets, drawn = _visuals(arm, meshes)
            write_whole(unfinished / LIMITS_OF_MODEL, _limits(arm))
            write_whole(unfinished / MODEL, _model(arm, assets, drawn))
            _agree(arm, make_robot(unfinished))
            _put(unfinished, folder)
    except OSError as error:
        raise StorageError(f"cannot write to {folder}: {error}") from error
    return folder


def _agree(arm: Examination, robot: RobotModel) -> None:
    """Refuse a model that is another arm than the file's, or measures less."""
    if (error := kinematic_error(arm, robot)) > MOVED:
        raise RobotModelError(f"the prepared arm's joints are {error:.1e} m from where {arm.source.path.name} has them")
    if (out := cover_of(arm, robot)) > TOLERATED:
        raise RobotModelError(
            f"what {arm.source.path.name} draws reaches {1e3 * out:.1f} mm out of the prepared arm's capsules"
        )


def _put(made: Path, folder: Path) -> None:
    """A finished folder in its place; where one is already, its model is the last that is replaced."""
    if not folder.exists():
        made.replace(folder)
        return
    meshes = folder / "meshes"
    meshes.mkdir(exist_ok=True)
    names = {mesh.name for mesh in (made / "meshes").iterdir()}
    for name in names:
        (made / "meshes" / name).replace(meshes / name)
    for name in (LIMITS_OF_MODEL, MODEL):
        (made / name).replace(folder / name)
    for old in meshes.glob("drawn_*.stl"):  # of an arm that was there before
        if old.name not in names:
            old.unlink()


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


# ---- what is drawn -------------------------------------------------------------------------------------


def _visuals(arm: Examination, meshes: Path) -> tuple[list[str], dict[int, list[str]]]:
    """Mesh assets, and geoms by link, -1 for the base; all in the links' frames."""
    import mujoco

    model, anatomy = arm.source.model, arm.anatomy
    data = zero_pose(model, arm.chain)
    anchors = [data.xanchor[j].copy() for j in arm.chain.joints]
    base = anchors[0] - anatomy.chain["offset"][0]  # by how much the arm was moved
    assets: list[str] = []
    drawn: dict[int, list[str]] = {}
    groups = [(-1, anatomy.base_geoms, base), *((i, link.geoms, anchors[i]) for i, link in enumerate(anatomy.links))]
    for i, geoms, anchor in groups:
        passing = [g for g in geoms if not model.geom_contype[g] and not model.geom_conaffinity[g]]
        for g in passing or geoms:
            colour = model.mat_rgba[model.geom_matid[g]] if model.geom_matid[g] >= 0 else model.geom_rgba[g]
            place, turn = data.geom_xpos[g] - anchor, data.geom_xmat[g].reshape(3, 3)
            shape = _primitive(model, g)
            if shape is None:
                triangles = faces_of_mesh(model, int(model.geom_dataid[g])) @ turn.T + place
                name = f"drawn_{len(assets)}"
                write_whole(meshes / f"{name}.stl", stl(triangles))
                assets.append(f'<mesh name="{name}" file="{name}.stl" inertia="shell"/>')
                shape = f'type="mesh" mesh="{name}"'
            else:
                quaternion = np.zeros(4)
                mujoco.mju_mat2Quat(quaternion, turn.ravel())
                shape += f' pos="{_numbers(place)}" quat="{_numbers(quaternion)}"'
            drawn.setdefault(i, []).append(f'<geom class="drawn" {shape} rgba="{_numbers(np.round(colour, 4))}"/>')
    return assets, drawn


def _primitive(model: "mujoco.MjModel", geom: int) -> str | None:
    import mujoco

    kinds = mujoco.mjtGeom
    count = {
        kinds.mjGEOM_SPHERE: 1,
        kinds.mjGEOM_CAPSULE: 2,
        kinds.mjGEOM_CYLINDER: 2,
        kinds.mjGEOM_BOX: 3,
        kinds.mjGEOM_ELLIPSOID: 3,
    }.get(kinds(model.geom_type[geom]))
    if count is None:
        return None
    kind = kinds(model.geom_type[geom]).name[7:].lower()
    return f'type="{kind}" size="{_numbers(model.geom_size[geom][:count])}"'


# ---- the model -----------------------------------------------------------------------------------------


def _model(arm: Examination, assets: list[str], drawn: dict[int, list[str]]) -> str:
    anatomy, n = arm.anatomy, arm.anatomy.n
    name = arm.source.path.stem
    apart = {one for pair in arm.excluded for one in pair}
    inertia = _turned_inertia(arm)
    armature = np.maximum([link.armature for link in anatomy.links], _GEAR * inertia)
    lines = [
        f"<!-- prepared by jssa_gym; the capsules of group {COLLISION_GROUP} are what distances are measured with -->",
        f"<mujoco model={quoteattr(name)}>",
        '<compiler angle="radian" autolimits="true" meshdir="meshes" balanceinertia="true"/>',
        '<default><default class="measured">',
        f'<geom type="capsule" group="{COLLISION_GROUP}" contype="0" conaffinity="0" mass="0" rgba=".2 .6 .9 .35"/>',
        f'</default><default class="drawn"><geom group="{_VISUAL}" contype="0" conaffinity="0" mass="0"/></default>',
        "</default>",
        "<asset>",
        *assets,
        "</asset>",
        "<worldbody>",
        '<body name="base">',
        *drawn.get(-1, []),
    ]
    for i, (joint, link) in enumerate(zip(anatomy.joints, anatomy.links, strict=True)):
        low, high = anatomy.ranges[i]
        lines.append(
            f'<body name={quoteattr(_body(arm, i))} pos="{_numbers(anatomy.chain["offset"][i])}" gravcomp="1">'
        )
        mass, moment = max(link.mass, _LIGHT[0]), link.inertia + _LIGHT[1] * np.eye(3)
        full = (*np.diag(moment), moment[0, 1], moment[0, 2], moment[1, 2])
        lines.append(
            f'<inertial mass="{mass!r}" pos="{_numbers(link.centre)}" fullinertia="{_numbers(np.array(full))}"/>'
        )
        lines.append(
            f'<joint name={quoteattr(joint)} axis="{_numbers(anatomy.chain["axis"][i])}" '
            f'range="{float(low)!r} {float(high)!r}" armature="{float(armature[i])!r}"/>'
        )
        for called, at, capsule in arm.named_capsules():
            if at != i:
                continue
            geom = f'<geom name={quoteattr(called)} class="measured" size="{capsule.radius!r}" {_ends(capsule)}/>'
            # bodies of their own, so that a pair can be left out without all others of these links
            lines.append(f"<body name={quoteattr('of ' + called)}>{geom}</body>" if called in apart else geom)
        lines += drawn.get(i, [])
    lines.append(f'<site name="tcp" pos="{_numbers(anatomy.tool)}" group="4"/>')
    lines += ["</body>"] * (n + 1)
    lines += ["</worldbody>", "<contact>"]
    lines += [f"<exclude body1={quoteattr('of ' + a)} body2={quoteattr('of ' + b)}/>" for a, b in arm.excluded]
    lines += ["</contact>", "<actuator>"]
    for joint, moved in zip(anatomy.joints, inertia + armature, strict=True):
        gain = f'kp="{float(moved) * _STIFF**2:.4g}" kv="{2.0 * float(moved) * _STIFF:.4g}"'
        lines.append(f"<position name={quoteattr(joint)} joint={quoteattr(joint)} {gain}/>")
    lines += ["</actuator>", f'<keyframe><key name="home" qpos="{_numbers(arm.home)}"/></keyframe>', "</mujoco>"]
    return "\n".join(lines) + "\n"


def _body(arm: Examination, i: int) -> str:
    """A link's name; that of its joint where several joints share a body."""
    names = [link.body for link in arm.anatomy.links]
    own = names[i] if names.count(names[i]) == 1 and names[i] != "base" else f"link of {arm.anatomy.joints[i]}"
    return own


def _ends(capsule: Enclosure) -> str:
    start, end, _ = capsule
    if np.linalg.norm(end - start) < 1e-6:  # MuJoCo takes no capsule without length
        return f'type="sphere" pos="{_numbers((start + end) / 2.0)}"'
    return f'fromto="{_numbers(start)} {_numbers(end)}"'


def _turned_inertia(arm: Examination) -> Array:
    """Largest inertia that each joint moves about its own axis over many postures, shape (n,) [kg m²]."""
    anatomy, n = arm.anatomy, arm.anatomy.n
    frames, found = records(n, FRAME), np.full(n, 10.0 * _LIGHT[1])
    for posture in some_postures(anatomy.ranges)[:_POSTURES]:
        forward(anatomy.chain, np.array([posture, np.zeros(n), np.zeros(n)]), frames)
        for i in range(n):
            axis, total = frames["axis"][i], 0.0
            for link, frame in zip(anatomy.links[i:], frames[i:], strict=True):
                away = np.cross(axis, frame["origin"] + frame["rotation"] @ link.centre - frames["origin"][i])
                about = frame["rotation"].T @ axis
                mass = max(link.mass, _LIGHT[0])  # as it is written
                total += float(about @ link.inertia @ about + mass * away @ away)
            found[i] = max(found[i], total)
    return found


# ---- limits --------------------------------------------------------------------------------------------


def _limits(arm: Examination) -> str:
    table = arm.limits
    said = f", as {table.source} states" if table.source else ""
    lines = [
        f"# Limits of the arm that was prepared from {arm.source.path.name}, one number a joint{said}.",
        f"# Joints: {', '.join(arm.anatomy.joints)}",
    ]
    if table.guessed:
        lines.append(f"# {', '.join(table.guessed)}: a GUESS; state those of your arm and empty the list `guessed`.")
    lines.append('unit = "rad"')
    lines += [f"{name} = [{', '.join(f'{value:.10g}' for value in getattr(table, name))}]" for name in LIMITS]
    lines.append(f"guessed = {json.dumps(list(table.guessed))}")
    lines.append(f"source = {json.dumps(table.source)}")
    uncovered = [cover.joint for cover in arm.covers if cover.left == np.inf]
    lines.append(f"uncovered = {json.dumps(uncovered)}  # links about which nothing is promised")
    return "\n".join(lines) + "\n"
