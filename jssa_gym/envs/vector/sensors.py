"""Sensors of many arms: each perceives as one around a single environment does."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.envs.vector.env import VectorArmEnv
from jssa_gym.humans import nobody
from jssa_gym.types import CapsuleSet, JointState, Scene
from jssa_gym.vectors import Mask


class OneOf(gym.Env):
    """One arm of a vector, which sensors look at; it moves when the vector does.

    Args:
        arms: The vector.
        e: Which of its arms.
    """

    def __init__(self, arms: VectorArmEnv, e: int) -> None:
        self._arms, self._e = arms, e
        self.robot, self.dt, self.planes = arms.robot, arms.dt, arms.planes
        self._static, self._names, self._person = nobody(), arms.part_names, arms.person

    @property
    def np_random_seed(self) -> int:  # ty: ignore[incompatible-method-override]  # never changed here
        """Seed of its environment, -1 for none."""
        seed = self._arms.np_random_seed[self._e]
        return -1 if seed is None else seed

    @property
    def scene(self) -> Scene:
        """The present; copies."""
        arms, e = self._arms, self._e
        state, (ends, radius) = arms.state[e].copy(), arms.people
        start, end, start_velocity, end_velocity = ends[e].copy()
        people = CapsuleSet(
            start, end, start_velocity, end_velocity, radius[e].copy(), self._names, self._person
        )  # fmt: skip
        count = len(self._person)
        return Scene(
            float(arms.time[e]), JointState(*state), people, self._static, self.planes, np.zeros(count),
            np.ones(count, np.bool_),
        )  # fmt: skip

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Nothing: the vector has been reset."""
        return None, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Nothing: the vector has stepped."""
        return None, 0.0, False, False, {}


class VectorSensors:
    """A sensor for each arm of a vector, as they are around single environments.

    Args:
        arms: The vector.
        wrap: Puts the wrappers that change ``scene`` around an environment, such as
            :class:`~jssa_gym.envs.sensor.SensorModel`.
    """

    def __init__(self, arms: VectorArmEnv, wrap: Callable[[gym.Env], gym.Env]) -> None:
        self._arms = arms
        self._sensors = [wrap(OneOf(arms, e)) for e in range(arms.num_envs)]

    def begin(self, which: Mask) -> None:
        """Episodes of those arms, which have been reset, begin with what is seen of them now."""
        seeds = self._arms.np_random_seed
        for e in np.flatnonzero(which).tolist():
            self._sensors[e].reset(seed=seeds[e])

    def look(self, live: Mask) -> None:
        """Look at what those arms have become in a step."""
        for e in np.flatnonzero(live).tolist():
            self._sensors[e].step(None)

    def scene(self, e: int) -> Scene | None:
        """The present of arm ``e`` as it is perceived; None where it is not."""
        return self._sensors[e].get_wrapper_attr("scene")
