"""Resolved rates: joint velocities that move the tool centre point as wanted."""

import numpy as np

from jssa_gym.kernels.chain import forward, jacobian, tool_motion
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_number


class ResolvedRates:
    r"""The damped least squares solution :math:`J^\top(JJ^\top + \mu^2 I)^{-1}\,v` for the tool centre point.

    Args:
        robot: The arm; where it stands moves the point of :meth:`look` and nothing else.
        damping: :math:`\mu` [m]; near singular postures the tool moves more slowly than wanted.

    Raises:
        ParameterError: The damping is not positive.
    """

    def __init__(self, robot: RobotModel, damping: float = 0.1) -> None:
        self._robot, self.damping = robot, positive_number("damping", damping)
        self._frames, self._motion = records(robot.n, FRAME), np.zeros((2, 3))
        self._J = np.zeros((3, robot.n))

    def __reduce__(self) -> tuple[type["ResolvedRates"], tuple[RobotModel, float]]:
        # what was looked at last is no part of it: a policy's pickle, which tells it from others, must not change
        return ResolvedRates, (self._robot, self.damping)

    def look(self, state: JointState) -> tuple[Array, Array]:
        """Where the tool centre point is [m] and how it moves [m/s], each of shape (3,); copies."""
        robot = self._robot
        forward(robot.links, np.array([state.position, state.velocity, state.acceleration]), self._frames)
        tool_motion(self._frames, robot.tool_link, robot.tool_offset, self._motion)
        jacobian(self._frames, robot.tool_link, self._motion[0], self._J)
        return self._motion[0].copy(), self._motion[1].copy()

    def joint_velocity(self, velocity: Array) -> Array:
        """Joint velocity, shape (n,) [rad/s], for a velocity of the tool, shape (3,) [m/s], at the state looked at."""
        J = self._J
        return J.T @ np.linalg.solve(J @ J.T + self.damping**2 * np.eye(3), velocity)
