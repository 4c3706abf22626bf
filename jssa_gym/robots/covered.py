"""How well the capsules of a robot model hold what its file draws."""

import numpy as np

from jssa_gym.headless import choose_gl_backend
from jssa_gym.robots.coverage import coverage
from jssa_gym.robots.model import COLLISION_GROUP, RobotModel, carrier_links
from jssa_gym.robots.serial import serial_joints


def cover_of(robot: RobotModel) -> float:
    """Farthest drawn corner of a link outside of its own capsules [m]; 0 if all lie inside.

    Links that the model says are uncovered do not count; inf if another one draws something and has none.
    """
    choose_gl_backend()
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    joints = serial_joints(model)
    links = coverage(model, joints, carrier_links(model, joints), np.array(robot.home), COLLISION_GROUP)
    spared = {i for i, name in enumerate(robot.joint_names) if name in robot.uncovered}
    return max((link.own if link.capsules else link.joined for link in links if link.link not in spared), default=0.0)
