"""Commands of many arms at once."""

import numpy as np

from jssa_gym.control.commands import TIP_SPEED, Commands
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.tick.moves import tool_jacobians
from jssa_gym.types import Array, JointState
from jssa_gym.vectors import Mask


class VectorCommands:
    """What commands in [-1, 1] mean, in jerk, for many arms: for each what :class:`Commands` says, bit for bit.

    Args:
        robot: The arm that all are alike.
        mode, share: As of :class:`~jssa_gym.JPCAction`.

    Raises:
        ParameterError: See :class:`Commands`.
    """

    def __init__(self, robot: RobotModel, mode: str, share: float) -> None:
        self._one = Commands(robot.limits, mode, share, robot)
        self._robot, self._rates = robot, self._one.rates
        self._frames, self._motion = records(robot.n, FRAME), np.zeros((2, 3))

    @property
    def size(self) -> int:
        """How many numbers a command has."""
        return self._one.size

    def jerk(self, state: Array, command: Array) -> Array:
        """Jerks towards commands, as shares of the jerk bounds, shape (E, n).

        Args:
            state: Joint states, shape (E, 3, n).
            command: Shape (E, :attr:`size`), clipped to [-1, 1]; one that is not finite gives NaN.
        """
        sound: Mask = np.all(np.isfinite(command), axis=1)
        clipped = np.clip(np.where(sound[:, None], command, 0.0), -1.0, 1.0)
        states = JointState(state[:, 0], state[:, 1], state[:, 2])
        if self._rates is not None:
            velocity = self._joint_velocity(state, clipped * TIP_SPEED, self._rates.damping)
            jerk = self._one.cascade.jerk_at_speed(states, velocity) / self._robot.limits.jerk
        else:
            jerk = self._one.jerk(states, clipped)
        jerk[~sound] = np.nan
        return jerk

    def _joint_velocity(self, state: Array, velocity: Array, damping: float) -> Array:
        """As of :class:`~jssa_gym.control.ResolvedRates`: the same products and solutions, a batch of them."""
        robot = self._robot
        J = np.empty((len(state), 3, robot.n))
        tool_jacobians(
            np.array(robot.links), robot.tool_link, np.array(robot.tool_offset), state, self._frames, self._motion, J
        )
        transposed = J.transpose(0, 2, 1)
        damped = J @ transposed + damping**2 * np.eye(3)
        return (transposed @ np.linalg.solve(damped, velocity[:, :, None]))[:, :, 0]
