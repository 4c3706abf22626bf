"""Environments that vary from episode to episode: random within stated ranges, or harder as learning goes on."""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from jssa_gym.envs import ArmEnv
from jssa_gym.envs.faults import SensorFaults
from jssa_gym.envs.sensor import SensorModel
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import Paced, make_human
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import Shield
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.validation import low_high, share

_ROUNDING = 1e-9

Range = Sequence[float]
"""(low, high) that something is drawn from."""


class DomainRandomisation(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Draws the arm's limits, the people's pace and the sensor's delay anew for every episode.

    It goes around the shield and varies only what the shield's promise covers: limits are scaled down, never up; people
    who could be faster than the shield assumes are refused, and so is a delay beyond the age up to which it believes
    measurements. What an episode has is ``info["randomised/limits"]``, ``"randomised/pace"`` and
    ``"randomised/latency"`` [s]. Everything is drawn from the seed of ``reset``.

    Args:
        env: An :class:`~jssa_gym.ArmEnv` in its wrappers.
        limits: Range of the share of its velocity, acceleration and jerk limits that the arm has, within (0, 1]; an
            action of 1 asks for that share of the jerk bound. The shield goes on knowing the full limits, which it may
            need for a stop.
        pace: Range of the pace of the people, see :class:`~jssa_gym.humans.Paced`.
        latency: Range of the delay of the :class:`~jssa_gym.SensorModel` inside of the shield [s].

    Raises:
        ParameterError: A range is none, or contradicts what the shield assumes.
        InterfaceError: The environment is none of this package, or has no sensor whose delay could be varied.
    """

    outside_shield: ClassVar[bool] = True
    """Shields refuse to go around it."""

    def __init__(
        self, env: gym.Env, *, limits: Range | None = None, pace: Range | None = None, latency: Range | None = None
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, limits=limits, pace=pace, latency=latency)
        gym.Wrapper.__init__(self, env)
        arm, assumed = _arm_of(env), _assumed_of(env)
        self._limits = (1.0, 1.0) if limits is None else low_high("limits", limits)
        if not 0.0 < self._limits[0] <= self._limits[1] <= 1.0:
            raise ParameterError(f"limits has to be (low, high) with 0 < low <= high <= 1, got {limits!r}")
        self._sensor, self._latency = None, (0.0, 0.0)
        if latency is not None:
            self._sensor, self._latency = _sensor_of(env), low_high("latency", latency)
            if assumed is not None and self._latency[1] > assumed.max_age:
                raise ParameterError(
                    f"latency reaches {self._latency[1]:g} s, but the shield takes what is older than "
                    f"{assumed.max_age:g} s for a fault: lower it, or raise max_age of FailsafeParams"
                )
        if pace is not None:
            _put_pace(arm, Paced(make_human(arm.human), pace), assumed)
        self._arm, self._dt = arm, float(arm.dt)
        self._bounds = arm.robot.limits.bounds()
        self._share = 1.0
        self._box = np.zeros((2, arm.robot.n))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, with other limits, people and delays."""
        if self._sensor is not None:
            self._sensor.latency_range = self._latency
        observation, info = self.env.reset(seed=seed, options=options)
        low, high = self._limits
        self._share = float(self._arm.np_random.uniform(low, high)) if low < high else high
        return observation, info | self._told()

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment by what is left of an action."""
        *result, info = self.env.step(action if self._share == 1.0 else self._weakened(action))
        return *result, info | self._told()  # ty: ignore[invalid-explicit-return]

    def _weakened(self, action: Any) -> Any:
        """The action of an arm with the drawn limits; what is no action is left to those inside."""
        wanted = np.asarray(action)
        if wanted.shape != (len(self._box[0]),) or wanted.dtype.kind not in "fiu" or not np.all(np.isfinite(wanted)):
            return action
        bounds = self._bounds.copy()
        bounds[2:] *= self._share
        lower, upper = self._box
        jerk_box(np.array(self._arm.scene.robot), bounds, self._dt, lower, upper)
        return np.clip(np.clip(wanted.astype(np.float64), -1.0, 1.0) * bounds[4], lower, upper) / self._bounds[4]

    def _told(self) -> dict[str, float]:
        human, latency = self._arm.human, 0.0 if self._sensor is None else self._sensor.latency
        return {
            "randomised/limits": self._share,
            "randomised/pace": float(human.now) if isinstance(human, Paced) else 1.0,
            "randomised/latency": latency,
        }


class Curriculum(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Lets the people move the slower, the lower the difficulty is: at 0 they stand, at 1 they are as ever.

    ``set_difficulty`` is for a callback, ``env.env_method("set_difficulty", 0.5)`` in Stable-Baselines3; it counts from
    the next reset on. People only ever become slower, so that what the shield assumes of them stays true. The people
    have a pace in a :class:`DomainRandomisation` too: the two multiply. The present one is ``info["difficulty"]``.

    Args:
        env: An :class:`~jssa_gym.ArmEnv` in its wrappers.
        difficulty: At the beginning, in [0, 1].

    Raises:
        ParameterError: The difficulty is out of range, or the people are faster than the shield assumes.
        InterfaceError: The environment is none of this package.
    """

    def __init__(self, env: gym.Env, difficulty: float = 0.0) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, difficulty=difficulty)
        gym.Wrapper.__init__(self, env)
        self._arm = _arm_of(env)
        if not isinstance(self._arm.human, Paced):
            _put_pace(self._arm, Paced(make_human(self._arm.human), (1.0, 1.0)), _assumed_of(env))
        self._difficulty = self._next = share("difficulty", difficulty)

    @property
    def difficulty(self) -> float:
        """How difficult episodes are, in [0, 1]; of the next reset on."""
        return self._next

    def set_difficulty(self, difficulty: float) -> None:
        """How hard the next episodes are, in [0, 1].

        Raises:
            ParameterError: It is out of range.
        """
        self._next = share("difficulty", difficulty)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, as hard as it is to be."""
        self._difficulty = self._next
        if isinstance(self._arm.human, Paced):
            self._arm.human.level = self._difficulty
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | {"difficulty": self._difficulty}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment."""
        *result, info = self.env.step(action)
        return *result, info | {"difficulty": self._difficulty}  # ty: ignore[invalid-explicit-return]


def _arm_of(env: gym.Env) -> ArmEnv:
    arm = env.unwrapped
    if not isinstance(arm, ArmEnv):
        raise InterfaceError(f"only environments around ArmEnv can be varied, not {type(arm).__name__}")
    return arm


def _assumed_of(env: gym.Env) -> FailsafeParams | None:
    """What the verified stop of the shield among the wrappers assumes; None without one."""
    shield = layer_of(env, Shield)
    return None if shield is None else shield.filter.failsafe


def _sensor_of(env: gym.Env) -> SensorModel:
    sensor = layer_of(env, SensorModel)
    if sensor is None or not isinstance(sensor.faults, SensorFaults):
        raise InterfaceError(
            "latency is of a sensor with faults of its own: JSSAShield(SensorModel(env, {'latency': 0.0})) has one"
        )
    return sensor


def _put_pace(arm: ArmEnv, paced: Paced, assumed: FailsafeParams | None) -> None:
    """Give an environment's people a pace.

    Raises:
        ParameterError: They may be faster than is assumed of them.
    """
    if isinstance(arm.human, Paced):
        raise ParameterError("the people have a pace already: put Curriculum around DomainRandomisation")
    if assumed is not None:
        if assumed.watched is not None and paced.speed_bound > assumed.entry_speed * (1.0 + _ROUNDING):
            raise ParameterError(
                f"people may come in at {paced.speed_bound:.3g} m/s with that pace, the region's entry_speed is "
                f"{assumed.entry_speed:g} m/s at most: lower the pace, or give it another entry_speed"
            )
        for name in dict.fromkeys(paced.comers or make_human(paced).reset(np.random.default_rng(0)).names):
            most, bound = paced.acceleration_of(name), assumed.acceleration_of(name)
            if most is not None and most > bound * (1.0 + _ROUNDING) > 0.0:
                raise ParameterError(
                    f"{name} may change its velocity at {most:.3g} m/s² with that pace, the shield assumes {bound:g} "
                    "m/s² at most: lower the pace, or tell the shield by FailsafeParams"
                )
            for speed, bound in zip(paced.end_speeds_of(name), assumed.end_speeds_of(name), strict=True):
                if speed > bound * (1.0 + _ROUNDING):
                    raise ParameterError(
                        f"{name} may move at {speed:.3g} m/s with that pace, the shield assumes {bound:g} m/s at most: "
                        "lower the pace, or tell the shield by FailsafeParams"
                    )
    arm.human = paced
