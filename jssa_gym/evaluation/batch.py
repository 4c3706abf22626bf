"""Which episodes can be played many at once, and the environments in which they are."""

from collections.abc import Sequence
from functools import reduce
from typing import Any, cast

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.envs.keypoint_camera import CameraSettings
from jssa_gym.envs.sensor import MissedTicks, SensorModel
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.envs.vector.sensors import SensorsOneByOne, VectorMissedTicks, VectorSensorModel, VectorSensors
from jssa_gym.evaluation.contenders import Ageless, Late
from jssa_gym.evaluation.rollout_vector import TimedShield
from jssa_gym.exceptions import ParameterError
from jssa_gym.shields import JSSAShield, SafetyFilter, Shield

MOST = 64
"""Most episodes that are played at once."""

LEAST = 4
"""Fewest: for fewer the calls of a step take longer than single ones."""

_STEPS = 64_000
"""Most steps of all episodes at once: what is recorded of one takes about 1 KiB."""

_SENSORS: dict[type[gym.Wrapper], tuple[str, ...]] = {
    SensorModel: ("faults",), MissedTicks: ("probability", "longest"), Late: ("ticks",), Ageless: (),
}  # fmt: skip
"""Wrappers that change what a shield is shown and nothing else, and what they are made with."""

_PASSIVE = (OrderEnforcing, PassiveEnvChecker)
"""Wrappers that change nothing."""


def at_once(steps: int) -> int:
    """How many episodes of so many steps are played at once."""
    return max(1, min(MOST, _STEPS // steps))


def vector_like(env: gym.Env, count: int) -> VectorEnv | None:
    """So many environments like one, in a vector that does for each what the single one does.

    Args:
        env: The single one; it stays as it is.
        count: How many.

    Returns:
        The vector, or None where something is asked one arm at a time: servos, the projector of OSQP, cameras, sensors
        that change from episode to episode or have no verified stop behind them, dictionaries, people who come and
        go, and people, tasks, filters and wrappers of a user's own.
    """
    limits, shield, sensors, one = list[int](), None, list[Any](), cast(Any, env)
    while isinstance(one, gym.Wrapper):
        kind = type(one)
        if kind is TimeLimit:
            limits.append(one._max_episode_steps)
        elif kind in (Shield, JSSAShield):
            shield = one
        elif kind in _SENSORS and not isinstance(getattr(one, "faults", None), CameraSettings):
            if getattr(one, "latency_range", None) is not None:
                return None
            sensors.append(one)
        elif kind not in _PASSIVE:
            return None
        one = one.env
    if not _is_plain(one) or (shield is not None and not _is_compiled(shield.filter)):
        return None
    if sensors and (shield is None or shield.filter.failsafe is None):
        return None
    if shield is not None and getattr(shield.filter.failsafe, "watched", None) is not None:
        return None
    try:
        arms = VectorArmEnv(
            count,
            one.task,
            human=one.human,
            scene=one._scene_name,
            robot=one.robot,
            terminate_on=one.terminate_on,
            d_min=one.d_min,
            dt=one.dt,
            observation=one.observation,
            max_episode_steps=min(limits, default=None),
            autoreset_mode=AutoresetMode.DISABLED,
        )
    except ParameterError:  # dictionaries, people who come and go, or people or a task of a user's own
        return None
    if shield is None:
        return arms
    return TimedShield(arms, shield.filter, _sensors_like(sensors, arms))


def _sensors_like(sensors: Sequence[Any], arms: VectorArmEnv) -> VectorSensors | None:
    """What shows each arm what wrappers, the outermost first, show of a single one; None for none."""
    if not sensors:
        return None
    (one, *more) = sensors
    if not more and type(one) is MissedTicks:
        return VectorMissedTicks(arms, one.probability, one.longest)
    if not more and type(one) is SensorModel and VectorSensorModel.takes(one.faults):
        return VectorSensorModel(arms, one.faults)
    return SensorsOneByOne(arms, lambda env: reduce(_wrapped_like, reversed(sensors), env))


def _wrapped_like(env: gym.Env, sensor: Any) -> gym.Env:
    """Another sensor like one, around an environment."""
    return type(sensor)(env, *(getattr(sensor, name) for name in _SENSORS[type(sensor)]))


def _is_plain(env: gym.Env) -> bool:
    """Whether an environment is one of this package's as it is, that draws nothing."""
    return type(env) is ArmEnv and env.dynamics == "kinematic" and env.render_mode is None


def _is_compiled(filter: SafetyFilter) -> bool:
    """Whether all that a filter does is what the compiled step does."""
    kind = type(filter)
    asked = kind.decide is SafetyFilter.decide and kind.reset is SafetyFilter.reset
    return filter.compiled and asked and not {"decide", "reset"} & vars(filter).keys()
