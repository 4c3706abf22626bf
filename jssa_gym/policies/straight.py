"""A policy that needs no plan: straight towards the goal, as fast as it is let."""

from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.control import Cascade
from jssa_gym.control.resolved import ResolvedRates
from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_number


class StraightPolicy:
    r"""Moves the tool centre point straight towards the environment's goal by resolved rates.

    With the way :math:`e` to the goal and the Jacobian :math:`J` of the tool centre point, the joint velocity is the
    damped least squares solution :math:`J^\top(JJ^\top + \mu^2 I)^{-1}\,\min(k, v/|e|)\,e`, which the loops of
    :class:`~jssa_gym.control.Cascade` follow. It keeps no plan that a shield could void: beside somebody near it creeps
    on at whatever speed it is let. It looks at no table and at no people. A goal that is a joint position, or the last
    of several waypoints, is approached by the cascade alone.

    Args:
        env: The environment, wrapped or not; its task's ``space`` says how to read ``goal``.
        gain: k [1/s].
        speed: v, of the tool centre point at most [m/s].
        damping: :math:`\mu` [m].

    Raises:
        ParameterError: A number is not positive, or the environment has no goal.
    """

    def __init__(self, env: gym.Env, gain: float = 2.5, speed: float = 0.6, damping: float = 0.1) -> None:
        if not hasattr(env.unwrapped, "goal"):
            raise ParameterError(f"{env} has no goal to move to; HoldPolicy holds a joint position on any environment")
        self._env, self._robot = env, env.get_wrapper_attr("robot")
        self.gain, self.speed = positive_number("gain", gain), positive_number("speed", speed)
        self._rates = ResolvedRates(self._robot, damping)
        self.damping = self._rates.damping
        self._tip = getattr(getattr(env.unwrapped, "task", None), "space", "joints") == "tip"
        self.cascade = Cascade(self._robot.limits, share=1.0 if self._tip else 0.5)

    def __call__(self, observation: Any) -> Array:
        """Action towards the goal, shape (n,)."""
        state, goal = self._env.get_wrapper_attr("scene").robot, self._env.get_wrapper_attr("goal")
        if self._tip:
            jerk = self.cascade.jerk_at_speed(state, self._velocity(state, goal))
        else:
            jerk = self.cascade.jerk(state, goal if goal.ndim == 1 else goal[-1])
        return jerk / self._robot.limits.jerk

    def _velocity(self, state: JointState, goal: Array) -> Array:
        """Joint velocity that moves the tool centre point towards a point (3,), shape (n,) [rad/s]."""
        way = goal - self._rates.look(state)[0]
        rate = min(self.gain, self.speed / max(float(np.linalg.norm(way)), 1e-9))
        return self._rates.joint_velocity(rate * way)
