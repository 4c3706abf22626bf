"""Whether a prepared arm moves as the file says that it was made from, and its capsules hold what it draws."""

import numpy as np

from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.records import FRAME, SEGMENT, records
from jssa_gym.robots.coverage import ground_geoms, measured_geoms
from jssa_gym.robots.mjcf import carrier_links
from jssa_gym.robots.model import RobotModel
from jssa_gym.robots.prepare.anatomy import zero_pose
from jssa_gym.robots.prepare.enclose import Enclosure, Solid, farthest_out
from jssa_gym.robots.prepare.examine import Examination
from jssa_gym.robots.prepare.posture import some_postures
from jssa_gym.robots.prepare.surface import drawn

_LOOKED_AT = 200
"""Postures that are compared."""


def kinematic_error(arm: Examination, robot: RobotModel) -> float:
    """Largest distance of a joint's anchor, or of a tip of its axis at 1 m, from where the file's own arm has it [m].

    Args:
        arm: What the file is, with its model compiled by MuJoCo.
        robot: What was read from the prepared model, as it stands in its own file.
    """
    import mujoco

    model, joints = arm.source.model, arm.chain.joints
    data = zero_pose(model, arm.chain)
    moved = data.xanchor[joints[0]] - arm.anatomy.chain["offset"][0]
    frames, worst = records(robot.n, FRAME), 0.0
    for posture in some_postures(robot.limits.position)[:_LOOKED_AT]:
        for j, angle in zip(joints, posture, strict=True):
            data.qpos[model.jnt_qposadr[j]] = angle
        mujoco.mj_kinematics(model, data)
        forward(robot.links, np.array([posture, np.zeros(robot.n), np.zeros(robot.n)]), frames)
        anchors = np.array([data.xanchor[j] for j in joints]) - moved + robot.mount
        axes = np.array([data.xaxis[j] for j in joints])
        gaps = [frames["origin"] - anchors, frames["origin"] + frames["axis"] - anchors - axes]
        worst = max(worst, float(np.linalg.norm(gaps, axis=2).max()))
    return worst


def cover_of(arm: Examination, robot: RobotModel) -> float:
    """Farthest point of what the file draws of a link outside of that link's capsules in a model of it [m].

    Every geom of the file counts, in every group, but for its own capsules where it draws something else; fingers on
    slides at both ends of their way. 0 if all lies inside; links that the model says are uncovered do not count; inf
    if another one draws something and has no capsules.
    """
    model, joints = arm.source.model, list(arm.chain.joints)
    n, m = robot.n, len(robot.capsules)
    frames, segments = records(n, FRAME), records(m, SEGMENT)
    forward(robot.links, np.zeros((3, n)), frames)
    place(frames, robot.capsules, segments)
    carriers, measured = carrier_links(model, joints), measured_geoms(model, arm.anatomy.group)
    grounds, worst = ground_geoms(model), 0.0
    for i, name in enumerate(robot.joint_names):
        geoms = [g for g in range(model.ngeom) if carriers[int(model.geom_bodyid[g])] == i and not grounds[g]]
        if name in robot.uncovered or all(measured[g] for g in geoms):
            continue
        own = [
            Enclosure(one["start"] - frames["origin"][i], one["end"] - frames["origin"][i], float(one["radius"]))
            for one in segments[segments["link"] == i]
        ]
        for share in (None, 0.0, 1.0) if i == n - 1 else (None,):
            data = zero_pose(model, arm.chain, share)
            for g in geoms:
                if not measured[g]:
                    triangles, radius = drawn(model, data, g)
                    solid = Solid(triangles - data.xanchor[joints[i]], np.full(len(triangles), radius))
                    worst = max(worst, farthest_out(solid, own))
    return worst
