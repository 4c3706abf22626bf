"""Policies that are out for trouble: what a shield has to stand."""

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.control import Cascade
from jssa_gym.control.resolved import ResolvedRates
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.reach import nearest_to_point
from jssa_gym.types import Array, CapsuleSet, JointState
from jssa_gym.validation import positive_number, real_array


class BangBangPolicy:
    """Full jerk one way or the other, every joint switching at random times of its own.

    Args:
        env: The environment.
        seed: Seed of all randomness.
        period: Mean time between the switches of a joint [s].
    """

    def __init__(self, env: gym.Env, seed: int | None = None, period: float = 0.15) -> None:
        self._n = env.get_wrapper_attr("robot").n
        self._chance = min(1.0, env.get_wrapper_attr("dt") / positive_number("period", period))
        self._rng = np.random.default_rng(seed)
        self.action = self._rng.choice([-1.0, 1.0], self._n)
        """What was done last, or comes before the first."""

    def __call__(self, observation: Any) -> Array:
        """An action of ones and minus ones, shape (n,)."""
        self.action = np.where(self.draw(1)[0], -self.action, self.action)
        return self.action.copy()

    def draw(self, count: int) -> NDArray[np.bool_]:
        """Which joints switch in the next so many steps, shape (count, n)."""
        return self._rng.random((count, self._n)) < self._chance


class ConstantPolicy:
    """One random jerk, drawn anew for every episode and now and then within it.

    Args:
        env: The environment.
        seed: Seed of all randomness.
        period: Mean time between draws within an episode [s].
    """

    def __init__(self, env: gym.Env, seed: int | None = None, period: float = 1.0) -> None:
        self._env, self._n = env, env.get_wrapper_attr("robot").n
        self._period = positive_number("period", period)
        self._rng = np.random.default_rng(seed)
        self._time, self._until = np.inf, -np.inf

    def __call__(self, observation: Any) -> Array:
        """The present action, shape (n,)."""
        time = self._env.get_wrapper_attr("scene").time
        if time < self._time or time >= self._until:
            self._action, duration = self.draw()
            self._until = time + duration
        self._time = time
        return self._action.copy()

    def draw(self) -> tuple[Array, float]:
        """Another action, shape (n,), and for how long [s]."""
        return self._rng.uniform(-1.0, 1.0, self._n), self._rng.exponential(self._period)


class LimitSeekingPolicy:
    """Drives every joint beyond one of its limits as hard as it can, then beyond another.

    A joint is sent to a side, either within its speed and acceleration limits and on beyond the end of its range, or
    at a speed and an acceleration beyond them. It turns when it is past the end of its range or, the sooner, after a
    while: a shield may keep it from getting there.

    Args:
        env: The environment.
        seed: Seed of all randomness.
        excess: Share by which speed and acceleration limits are exceeded, of those joints that do.
        patience: Longest time until a joint is sent elsewhere [s].
    """

    def __init__(self, env: gym.Env, seed: int | None = None, excess: float = 0.3, patience: float = 3.0) -> None:
        self._env, self._limits = env, env.get_wrapper_attr("robot").limits
        n = len(self._limits.jerk)
        self._excess, self._patience = positive_number("excess", excess), positive_number("patience", patience)
        self._rng, self._cascade = np.random.default_rng(seed), Cascade(self._limits, share=1.0)
        self._over = np.ones(n)
        self.side = np.ones(n)
        """Which way each joint is sent, 1 or -1."""
        self.until = np.full(n, -np.inf)
        """When it is sent elsewhere at the latest [s]."""
        self._time = np.inf

    def __call__(self, observation: Any) -> Array:
        """Action that seeks the limits, shape (n,)."""
        scene, limits = self._env.get_wrapper_attr("scene"), self._limits
        if scene.time < self._time:
            self.until[:] = -np.inf
        self._time = scene.time
        low, high = limits.position.T
        past = np.where(self.side > 0.0, scene.robot.position > high, scene.robot.position < low)
        turn = past | (scene.time >= self.until)
        if turn.any():
            self.redirect(scene.time, past, turn)
        fastest, hardest = self.fastest, self.hardest
        return self._cascade.within(scene.robot, self.side * fastest, fastest, hardest) / limits.jerk

    def redirect(self, time: float, past: NDArray[np.bool_], turn: NDArray[np.bool_]) -> None:
        """Send those joints that ``turn`` elsewhere, those ``past`` the end of their ranges back, shapes (n,)."""
        n = len(turn)
        side, over = self._rng.choice([-1.0, 1.0], n), 1.0 + self._excess * self._rng.integers(0, 2, n)
        until = time + self._patience * self._rng.uniform(0.3, 1.0, n)
        self.side = np.where(past, -self.side, np.where(turn, side, self.side))
        self._over, self.until = np.where(turn, over, self._over), np.where(turn, until, self.until)

    @property
    def fastest(self) -> Array:
        """Speed that each joint is sent at, shape (n,) [rad/s]."""
        return self._limits.velocity * self._over

    @property
    def hardest(self) -> Array:
        """Acceleration that it is sent with, shape (n,) [rad/s²]."""
        return self._limits.acceleration * self._over


class ChasePolicy:
    """Moves the tool centre point towards the nearest point of a person at full effort, to hit it.

    Joint velocities by damped inverse kinematics, scaled so that one joint is at its limit; joints slow down before
    the ends of their ranges. Without people it brings the arm to rest.

    Args:
        env: The environment.
        seed: Taken as every policy takes it; nothing here is random.
        damping: Of the inverse [m].
    """

    def __init__(self, env: gym.Env, seed: int | None = None, damping: float = 0.05) -> None:
        self._env, self._robot = env, env.get_wrapper_attr("robot")
        self._rates = ResolvedRates(self._robot, damping)
        self._cascade = Cascade(self._robot.limits, share=1.0)

    def __call__(self, observation: Any) -> Array:
        """Action towards the nearest person, shape (n,)."""
        scene, robot = self._env.get_wrapper_attr("scene"), self._robot
        state = scene.robot
        velocity = np.zeros(robot.n)
        if len(scene.human.radius):
            velocity = self._towards(state, scene.human)
        # as a target, so that joints slow down before the ends of their ranges
        target = state.position + velocity / self._cascade.kp
        return self._cascade.jerk(state, target) / robot.limits.jerk

    @property
    def damping(self) -> float:
        """Damping of the inverse [m]."""
        return self._rates.damping

    def _towards(self, state: JointState, people: CapsuleSet) -> Array:
        """Joint velocity that moves the tip to the nearest person, shape (n,) [rad/s]."""
        tip, _ = self._rates.look(state)
        _, point = nearest_to_point(tip, people.start, people.end, people.radius)
        velocity = self._rates.joint_velocity(np.array(point) - tip)
        # which way counts; how fast is up to the limits
        return velocity / max(np.max(np.abs(velocity) / self._robot.limits.velocity), 1e-9)


class SteeredPolicy:
    """Given piecewise-constant jerks, nothing after the last; for a search after the worst case.

    Args:
        env: The environment.
        parameters: Actions, shape (segments, n), clipped to [-1, 1].
        period: Duration of a segment [s].
    """

    def __init__(self, env: gym.Env, parameters: ArrayLike, *, period: float = 0.2) -> None:
        n, shape = env.get_wrapper_attr("robot").n, np.shape(parameters)
        if len(shape) != 2 or shape[0] < 1 or shape[1] != n:
            raise ParameterError(f"parameters have to be of shape (segments, {n}), got shape {shape}")
        self._env, self._period = env, positive_number("period", period)
        self._actions = np.clip(real_array("parameters", parameters, shape, "actions"), -1.0, 1.0)

    def __call__(self, observation: Any) -> Array:
        """The segment's action, shape (n,)."""
        segment = int((self._env.get_wrapper_attr("scene").time + 1e-9) / self._period)
        if segment < len(self._actions):
            return self._actions[segment].copy()
        return np.zeros(self._actions.shape[1])
