"""Agents that command joint positions or velocities instead of jerk."""

from typing import Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.control.cascade import Cascade
from jssa_gym.safety.action import checked_action
from jssa_gym.types import Array
from jssa_gym.validation import known_name


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
        known_name("mode", mode, ("position", "velocity"))
        gym.utils.RecordConstructorArgs.__init__(self, mode=mode, share=share)
        gym.ActionWrapper.__init__(self, env)
        self.mode = mode
        limits = env.get_wrapper_attr("robot").limits
        self._cascade = Cascade(limits, share=share)
        low, high = limits.position.T
        self._middle, self._half = (low + high) / 2.0, (high - low) / 2.0
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(limits.jerk),), np.float32)

    def action(self, action: Any) -> Array:
        """The jerk towards a command, as a share of the jerk bounds, shape (n,)."""
        command = checked_action(action, len(self._half))
        if not np.all(np.isfinite(command)):
            return command
        command = np.clip(command, -1.0, 1.0)
        state, cascade = self.env.get_wrapper_attr("scene").robot, self._cascade
        if self.mode == "position":
            jerk = cascade.jerk(state, self._middle + command * self._half)
        else:
            jerk = cascade.jerk_at_speed(state, command * cascade.share * cascade.limits.velocity)
        return jerk / cascade.limits.jerk
