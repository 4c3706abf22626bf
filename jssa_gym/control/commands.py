"""Agents that command joint positions or velocities instead of jerk."""

from dataclasses import dataclass, field
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.control.cascade import Cascade
from jssa_gym.robots import JointLimits
from jssa_gym.safety.action import checked_action
from jssa_gym.types import Array, JointState
from jssa_gym.validation import known_name

MODES = ("position", "velocity")
"""What can be commanded instead of jerk."""


@dataclass(frozen=True, slots=True, eq=False)
class Commands:
    """What a command in [-1, 1] means, in jerk; the table is :class:`JPCAction`'s.

    Raises:
        ParameterError: ``mode`` is none of :data:`MODES` or ``share`` out of range.
    """

    limits: JointLimits
    mode: str
    share: float = 0.5
    """Share of the velocity and acceleration limits that is used, in (0, 1]."""
    _cascade: Cascade = field(init=False, repr=False)

    def __post_init__(self) -> None:
        known_name("mode", self.mode, MODES)
        object.__setattr__(self, "_cascade", Cascade(self.limits, share=self.share))

    def jerk(self, state: JointState, command: Array) -> Array:
        """The jerk towards a command, as a share of the jerk bounds, shape (n,).

        Args:
            state: Joint state.
            command: Within [-1, 1], shape (n,).
        """
        cascade, limits = self._cascade, self.limits
        if self.mode == "position":
            low, high = limits.position.T
            jerk = cascade.jerk(state, (low + high) / 2.0 + command * ((high - low) / 2.0))
        else:
            jerk = cascade.jerk_at_speed(state, command * self.share * limits.velocity)
        return jerk / limits.jerk


class JPCAction(gym.ActionWrapper[Any, NDArray[np.float32], Any], gym.utils.RecordConstructorArgs):
    r"""Lets an agent command joint positions or velocities; goes *outside* a shield, which filters the jerk.

    Every tick's jerk leads towards the command by :class:`~jssa_gym.control.Cascade`: position, velocity and
    acceleration loops whose references are clipped to a share of the limits.

    **Action**: ``Box(-1, 1, (n,), float32)``, of each joint

    ============  =============================================  =================
    mode          meaning of an action :math:`\alpha`            reference
    ============  =============================================  =================
    ``position``  mid-range + :math:`\alpha` · half the range    position [rad]
    ``velocity``  :math:`\alpha` · share · velocity limit        velocity [rad/s]
    ============  =============================================  =================

    Commands outside [-1, 1] are clipped. An action that is not finite is passed on as it is: a shield brakes, an
    environment without one refuses it. Positions stay within their limits by themselves; velocities lead beyond the
    ends of the range unless a shield prevents it.

    Args:
        env: With ``robot`` and ``scene`` in its chain, shielded or not.
        mode: What is commanded.
        share: Share of the velocity and acceleration limits that is used, in (0, 1].

    Raises:
        ParameterError: ``mode`` is unknown or ``share`` out of range.
    """

    def __init__(self, env: gym.Env, *, mode: Literal["position", "velocity"] = "position", share: float = 0.5) -> None:
        limits = env.get_wrapper_attr("robot").limits
        self._commands = Commands(limits, mode, share)
        gym.utils.RecordConstructorArgs.__init__(self, mode=mode, share=share)
        gym.ActionWrapper.__init__(self, env)
        self.mode = mode
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(limits.jerk),), np.float32)

    def action(self, action: Any) -> Array:
        """The jerk towards a command, as a share of the jerk bounds, shape (n,)."""
        command = checked_action(action, len(self._commands.limits.jerk))
        if not np.all(np.isfinite(command)):
            return command
        return self._commands.jerk(self.env.get_wrapper_attr("scene").robot, np.clip(command, -1.0, 1.0))
