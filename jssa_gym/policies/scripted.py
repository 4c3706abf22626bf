"""Policies that need no learning."""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.control import Cascade
from jssa_gym.exceptions import ParameterError
from jssa_gym.safety.postures import clearances, room
from jssa_gym.types import Array, JointState, Planes
from jssa_gym.validation import low_high, positive_number


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
        return self.draw(1)[0]

    def draw(self, count: int) -> Array:
        """The next so many actions, shape (count, n)."""
        return self._rng.uniform(-1.0, 1.0, (count, self._n))


class WanderPolicy:
    """A random policy that really moves: from one random joint posture to the next, most of the time under way.

    Postures keep clear of the table and of the arm itself; the way between them need not. The speed is drawn for
    every way. A posture is given up when a shield keeps the arm from it.

    Args:
        env: The environment.
        seed: Seed of all randomness.
        share: Range of the share of the velocity and acceleration limits.
        patience: Longest time for one posture [s].
    """

    NEAR = 0.3
    """Distance of every joint from its goal at which the next posture is drawn [rad]: the arm does not stop."""

    _CLEAR = 0.03
    """Distance of a posture from table and self-collision [m]; half of what there is at home, if that is less."""

    def __init__(
        self,
        env: gym.Env,
        seed: int | None = None,
        share: tuple[float, float] = (0.4, 1.0),
        patience: float = 4.0,
    ) -> None:
        self._env, self._rng = env, np.random.default_rng(seed)
        self._robot = env.get_wrapper_attr("robot")
        self._share, self.patience = low_high("share", share, 0.05), positive_number("patience", patience)
        if self._share[1] > 1.0:
            raise ParameterError(f"share has to be at most 1, got {share!r}")
        self._time, self._until = np.inf, -np.inf

    def __call__(self, observation: Any) -> Array:
        """Action towards the present posture, shape (n,)."""
        scene = self._env.get_wrapper_attr("scene")
        # a clock that went back is a new episode's
        if scene.time < self._time or scene.time >= self._until or self._there(scene.robot):
            self._target, share = self.draw(scene.planes)
            self._cascade = Cascade(self._robot.limits, share=share)
            self._until = scene.time + self.patience
        self._time = scene.time
        return self._cascade.jerk(scene.robot, self._target) / self._robot.limits.jerk

    def draw(self, planes: Planes) -> tuple[Array, float]:
        """Another posture, shape (n,) [rad], and the share of the limits on the way there."""
        return self._posture(planes), self._rng.uniform(*self._share)

    def _there(self, state: JointState) -> bool:
        return bool(np.abs(self._target - state.position).max() < self.NEAR)

    def _posture(self, planes: Planes) -> Array:
        robot = self._robot
        low, high = robot.limits.position.T
        margin = 0.05 * (high - low)
        off_planes, off_itself = room(robot, planes, (self._CLEAR, self._CLEAR))
        for _ in range(100):
            posture = self._rng.uniform(low + margin, high - margin)
            from_planes, from_itself = clearances(robot, posture, planes)
            if from_planes >= off_planes and from_itself >= off_itself:
                return posture
        return np.array(robot.home)
