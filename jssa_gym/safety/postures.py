"""Joint postures at rest: how clear they are of what stands still, and where they put the tool."""

import numpy as np

from jssa_gym.humans import nobody
from jssa_gym.kernels.chain import forward, tool_motion
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import measure
from jssa_gym.types import Array, JointState, Planes


def clearances(robot: RobotModel, position: Array, planes: Planes) -> tuple[float, float]:
    """Smallest distances of the arm at rest from the half-spaces and from itself [m]; inf where there is nothing.

    Args:
        robot: The arm, where it stands.
        position: Joint position, shape (n,) [rad].
        planes: Half-spaces, such as the table.
    """
    zero = np.zeros(robot.n)
    near = measure(robot, JointState(position, zero, zero), nobody(), planes)
    return float(near.planes.min(initial=np.inf)), float(near.own.min(initial=np.inf))


def tool_point(robot: RobotModel, position: Array) -> Array:
    """The tool centre point in the world, shape (3,) [m].

    Args:
        robot: The arm, where it stands.
        position: Joint position, shape (n,) [rad].
    """
    frames, out = records(robot.n, FRAME), np.zeros((2, 3))
    forward(robot.links, np.array([position, np.zeros(robot.n), np.zeros(robot.n)]), frames)
    tool_motion(frames, robot.tool_link, robot.tool_offset, out)
    return out[0]
