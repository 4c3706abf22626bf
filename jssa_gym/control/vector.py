"""Commands of many arms at once."""

from typing import Any, ClassVar, Literal

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from jssa_gym.control.commands import TIP_SPEED, Commands
from jssa_gym.exceptions import InterfaceError, InvalidActionError
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.tick.moves import tool_jacobians
from jssa_gym.types import Array, JointState
from jssa_gym.vectors import Infos, Mask


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


class VectorJPCAction(VectorWrapper):
    """Lets an agent command positions or velocities of many arms, as :class:`~jssa_gym.JPCAction` around each would.

    It goes *outside* the shield, and inside of what repeats actions.

    Args:
        env: A :class:`~jssa_gym.VectorArmEnv`, shielded or not.
        mode, share: As of :class:`~jssa_gym.JPCAction`.

    Raises:
        InterfaceError: It is another vector.
        ParameterError: ``mode`` is unknown or ``share`` out of range.
    """

    outside_shield: ClassVar[bool] = True
    """Shields refuse to go around it."""

    def __init__(
        self, env: VectorEnv, *, mode: Literal["position", "velocity", "tip"] = "position", share: float = 0.5
    ) -> None:
        super().__init__(env)
        self._arms: Any = env.unwrapped
        if missing := [name for name in ("robot", "state") if not hasattr(self._arms, name)]:
            raise InterfaceError(f"{env} has no {', '.join(missing)}: take a VectorArmEnv")
        self._commands = VectorCommands(self._arms.robot, mode, share)
        self.single_action_space = Box(-1.0, 1.0, (self._commands.size,), np.float32)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        """Step the environments with the jerks towards commands, shape (E, size).

        Raises:
            InvalidActionError: They are no array of that shape of real numbers, or not finite without a shield.
        """
        commands, shape = np.asarray(actions), (self.num_envs, self._commands.size)
        if commands.dtype.kind not in "fiu" or commands.shape != shape:
            raise InvalidActionError(
                f"commands are real numbers of shape {shape}, got shape {commands.shape} of type {commands.dtype}"
            )
        return self.env.step(self._commands.jerk(self._arms.state, commands.astype(np.float64)))
