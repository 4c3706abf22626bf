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
from jssa_gym.tick.moves import look_at_tools
from jssa_gym.types import Array, JointState
from jssa_gym.vectors import Infos, Mask


class VectorResolvedRates:
    """Joint velocities that move tool centre points, of many arms: each what
    :class:`~jssa_gym.control.resolved.ResolvedRates` says, bit for bit.

    Args:
        robot: The arm that all are alike.
        damping: As of one.
    """

    def __init__(self, robot: RobotModel, damping: float) -> None:
        self._n, self._damping, self._frames = robot.n, damping, records(robot.n, FRAME)
        # copies: to kernels arrays for reading alone are of another type
        self._arm = np.array(robot.links), int(robot.tool_link), np.array(robot.tool_offset)
        self._J = np.zeros((0, 3, robot.n))

    def look(self, state: Array) -> Array:
        """Where tool centre points are and how they move, shape (E, 2, 3) [m, m/s], at states of shape (E, 3, n)."""
        motion, self._J = np.empty((len(state), 2, 3)), np.empty((len(state), 3, self._n))
        look_at_tools(*self._arm, state, self._frames, motion, self._J)
        return motion

    def joint_velocity(self, velocity: Array) -> Array:
        """Joint velocities, shape (E, n) [rad/s], for those of tools, shape (E, 3) [m/s], at the states looked at.

        They are the same products and solutions as of one, a batch of them.
        """
        J = self._J
        transposed = J.transpose(0, 2, 1)
        damped = J @ transposed + self._damping**2 * np.eye(3)
        return (transposed @ np.linalg.solve(damped, velocity[:, :, None]))[:, :, 0]


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
        self._robot, rates = robot, self._one.rates
        self._rates = None if rates is None else VectorResolvedRates(robot, rates.damping)

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
            self._rates.look(state)
            velocity = self._rates.joint_velocity(clipped * TIP_SPEED)
            jerk = self._one.cascade.jerk_at_speed(states, velocity) / self._robot.limits.jerk
        else:
            jerk = self._one.jerk(states, clipped)
        jerk[~sound] = np.nan
        return jerk


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
