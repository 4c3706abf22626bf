"""What can be commanded instead of jerk: by a controller, in units; by an agent, in [-1, 1]."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.control.cascade import Cascade
from jssa_gym.control.resolved import ResolvedRates
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import JointLimits, RobotModel
from jssa_gym.safety.action import checked_action
from jssa_gym.types import Array, JointState
from jssa_gym.validation import known_name
from jssa_gym.vectors import refuse_vector

MODES = ("position", "velocity", "tip")
"""What can be commanded instead of jerk."""

TIP_SPEED = 0.5
"""Speed of the tool centre point along an axis that a command of 1 asks for [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class JointJerk:
    """Joint jerk, as it is."""

    jerk: Array
    """Shape (n,) [rad/s³]."""


@dataclass(frozen=True, slots=True, eq=False)
class JointVelocity:
    """Joint velocity."""

    velocity: Array
    """Shape (n,) [rad/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class JointPosition:
    """Where the joints are to be at the end of this tick: a point of a stream, one a tick, or a lasting target."""

    position: Array
    """Shape (n,) [rad]; clipped to the position limits."""
    velocity: Array | None = None
    """How they are to move there, shape (n,) [rad/s]. None: as the last two positions say, if they were commanded one
    tick after the other and no farther apart than the velocity limits allow; else at rest."""
    acceleration: Array | None = None
    """Shape (n,) [rad/s²]; None: 0. With both, a stream within the limits is followed to fractions of a milliradian."""


@dataclass(frozen=True, slots=True, eq=False)
class TipVelocity:
    """Velocity of the tool centre point; its orientation is nobody's concern."""

    velocity: Array
    """World axes, shape (3,) [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Twist:
    """Velocity of the tool in all six directions."""

    linear: Array
    """Velocity of the tool centre point, world axes, shape (3,) [m/s]."""
    angular: Array
    """Angular velocity of the last link, world axes, shape (3,) [rad/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPose:
    """Where the tool is to be, approached at no more than 0.5 m/s and 1.5 rad/s."""

    position: Array
    """Position of the tool centre point in the world, shape (3,) [m]."""
    rotation: Array
    """Rotation of the last link: its axes as columns, world coordinates, shape (3, 3)."""


Command = JointJerk | JointVelocity | JointPosition | TipVelocity | Twist | ToolPose
"""What :meth:`jssa_gym.Guard.tick` takes."""


@dataclass(frozen=True, slots=True, eq=False)
class Commands:
    """What a command in [-1, 1] means, in jerk; the table is :class:`JPCAction`'s.

    Raises:
        ParameterError: ``mode`` is none of :data:`MODES`, ``share`` out of range, or there is no robot for ``tip``.
    """

    limits: JointLimits
    mode: str
    share: float = 0.5
    """Share of the velocity and acceleration limits that is used, in (0, 1]."""
    robot: RobotModel | None = None
    """Whose tool is commanded; only ``tip`` needs it."""
    cascade: Cascade = field(init=False, repr=False)
    """Leads to joint velocities and positions."""
    rates: ResolvedRates | None = field(init=False, repr=False)
    """Makes joint velocities of the tool's; None but for ``tip``."""

    def __post_init__(self) -> None:
        known_name("mode", self.mode, MODES)
        if self.mode == "tip" and self.robot is None:
            raise ParameterError("commands of the tool centre point need a robot")
        object.__setattr__(self, "cascade", Cascade(self.limits, share=self.share))
        tip = self.mode == "tip" and self.robot is not None
        object.__setattr__(self, "rates", ResolvedRates(self.robot) if tip else None)

    @property
    def size(self) -> int:
        """How many numbers a command has."""
        return len(self.limits.jerk) if self.rates is None else 3

    def jerk(self, state: JointState, command: Array) -> Array:
        """The jerk towards a command, as a share of the jerk bounds, shape (n,).

        Args:
            state: Joint state.
            command: Within [-1, 1], shape (:attr:`size`,).
        """
        cascade, limits = self.cascade, self.limits
        if self.rates is not None:
            self.rates.look(state)
            jerk = cascade.jerk_at_speed(state, self.rates.joint_velocity(command * TIP_SPEED))
        elif self.mode == "position":
            low, high = limits.position.T
            jerk = cascade.jerk(state, (low + high) / 2.0 + command * ((high - low) / 2.0))
        else:
            jerk = cascade.jerk_at_speed(state, command * self.share * limits.velocity)
        return jerk / limits.jerk

    def met_by(self, state: JointState) -> Array:
        """The command in [-1, 1] that a state is what was asked for, or the nearest one, shape (:attr:`size`,)."""
        if self.rates is not None:
            command = self.rates.look(state)[1] / TIP_SPEED
        elif self.mode == "position":
            low, high = self.limits.position.T
            command = (2.0 * state.position - high - low) / (high - low)
        else:
            command = state.velocity / (self.share * self.limits.velocity)
        return np.clip(command, -1.0, 1.0)


class JPCAction(gym.ActionWrapper[Any, NDArray[np.float32], Any], gym.utils.RecordConstructorArgs):
    r"""Lets an agent command positions or velocities; goes *outside* a shield, which filters the jerk.

    Every tick's jerk leads towards the command by :class:`~jssa_gym.control.Cascade`: position, velocity and
    acceleration loops whose references are clipped to a share of the limits.

    **Action**: ``Box(-1, 1, (n,), float32)``, of each joint; of ``tip`` ``(3,)``, of each axis of the world

    ============  =============================================  ======================================
    mode          meaning of an action :math:`\alpha`            reference
    ============  =============================================  ======================================
    ``position``  mid-range + :math:`\alpha` · half the range    position [rad]
    ``velocity``  :math:`\alpha` · share · velocity limit        velocity [rad/s]
    ``tip``       :math:`\alpha` · 0.5 m/s                       velocity of the tool centre point, by
                                                                 :class:`~jssa_gym.control.ResolvedRates`
    ============  =============================================  ======================================

    Commands outside [-1, 1] are clipped. One that is not finite is passed on as a jerk of NaN: a shield brakes, an
    environment without one refuses it. Positions stay within their limits by themselves; velocities, of joints or tool,
    lead beyond the ends of the range unless a shield prevents it.

    Args:
        env: With ``robot`` and ``scene`` in its chain, shielded or not.
        mode: What is commanded.
        share: Share of the velocity and acceleration limits that is used, in (0, 1].

    Raises:
        ParameterError: ``mode`` is unknown or ``share`` out of range.
    """

    outside_shield: ClassVar[bool] = True
    """Shields refuse to go around it."""

    def __init__(
        self, env: gym.Env, *, mode: Literal["position", "velocity", "tip"] = "position", share: float = 0.5
    ) -> None:
        refuse_vector(env, "VectorJPCAction")
        robot = env.get_wrapper_attr("robot")
        self._commands = Commands(robot.limits, mode, share, robot)
        gym.utils.RecordConstructorArgs.__init__(self, mode=mode, share=share)
        gym.ActionWrapper.__init__(self, env)
        self.mode = mode
        self.action_space = gym.spaces.Box(-1.0, 1.0, (self._commands.size,), np.float32)

    def action(self, action: Any) -> Array:
        """The jerk towards a command, as a share of the jerk bounds, shape (n,)."""
        command = checked_action(action, self._commands.size)
        if not np.all(np.isfinite(command)):
            return np.full(len(self._commands.limits.jerk), np.nan)
        return self._commands.jerk(self.env.get_wrapper_attr("scene").robot, np.clip(command, -1.0, 1.0))
