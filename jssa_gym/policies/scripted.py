"""Policies that need no learning."""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.control import Cascade
from jssa_gym.types import Array


class Policy(Protocol):
    """Anything that maps an observation to an action in [-1, 1]."""

    def __call__(self, observation: Any) -> Array:
        """The action for one observation, shape (n,)."""
        ...


class HoldPolicy:
    """Goes to a joint position and holds it, the home position by default: the paper's nominal task.

    It reads the joint state from the environment's scene, so that it works on any environment a shield works on.

    Args:
        env: The environment.
        target: Joint position, shape (n,) [rad]; None for the robot's home.
    """

    def __init__(self, env: gym.Env, target: ArrayLike | None = None) -> None:
        self._env = env
        robot = env.get_wrapper_attr("robot")
        self._target = np.array(robot.home if target is None else target, float)
        self._cascade = Cascade(robot.limits)

    def __call__(self, observation: Any) -> Array:
        """Action towards the target, shape (n,)."""
        jerk = self._cascade.jerk(self._env.get_wrapper_attr("scene").robot, self._target)
        return jerk / self._cascade.limits.jerk


class RandomPolicy:
    """Independent uniform jerks."""

    def __init__(self, env: gym.Env, seed: int | None = None) -> None:
        self._n = env.get_wrapper_attr("robot").n
        self._rng = np.random.default_rng(seed)

    def __call__(self, observation: Any) -> Array:
        """A random action, shape (n,)."""
        return self._rng.uniform(-1.0, 1.0, self._n)
