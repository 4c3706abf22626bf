"""Whether a prepared arm moves as the file says that it was made from, and its capsules hold what it draws."""

import numpy as np

from jssa_gym.kernels.chain import forward
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots.coverage import coverage
from jssa_gym.robots.mjcf import COLLISION_GROUP, carrier_links
from jssa_gym.robots.model import RobotModel
from jssa_gym.robots.prepare.anatomy import zero_pose
from jssa_gym.robots.prepare.examine import Examination
from jssa_gym.robots.prepare.posture import some_postures
from jssa_gym.robots.serial import serial_joints

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


def cover_of(robot: RobotModel) -> float:
    """Farthest drawn corner of a link outside of its own capsules [m]; 0 if all lie inside.

    Links that the model says are uncovered do not count; inf if another one draws something and has none.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    joints = serial_joints(model)
    links = coverage(model, joints, carrier_links(model, joints), np.array(robot.home), COLLISION_GROUP)
    spared = {i for i, name in enumerate(robot.joint_names) if name in robot.uncovered}
    return max((link.own if link.capsules else link.joined for link in links if link.link not in spared), default=0.0)
