"""What a shield needs of an environment: robot, time step and scene, and actions that are shares of the jerk bounds."""

import logging
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.exceptions import InterfaceError
from jssa_gym.humans import Crowd, HumanMotion, Recorded, make_human
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter

_logger = logging.getLogger("jssa_gym")

_ROUNDING = 1.0 + 1e-9


def provider(env: gym.Env, name: str) -> Any:
    """The outermost environment of a wrapper chain that has an attribute: found once, read every step."""
    layer: Any = env
    # a property counts even if it cannot answer yet: some environments know their scene only after reset
    while not (any(name in vars(kind) for kind in type(layer).__mro__) or hasattr(layer, name)):
        if not isinstance(layer, gym.Wrapper):
            raise InterfaceError(
                f"{env} has no attribute '{name}'; a shield needs robot (RobotModel), dt [s] and scene (Scene)"
            )
        layer = layer.env
    return layer


def robot_and_dt(env: gym.Env) -> tuple[RobotModel, Any]:
    """What a filter is built for."""
    robot, dt = provider(env, "robot").robot, provider(env, "dt").dt
    if not isinstance(robot, RobotModel):
        raise InterfaceError(f"robot has to be a RobotModel, got {type(robot).__name__}")
    return robot, dt


def refuse_misfit(env: gym.Env, filter: SafetyFilter) -> RobotModel:
    """The environment's robot, if the filter is for it and for the environment's time step and actions.

    Raises:
        InterfaceError: It is not, or the environment lacks an attribute.
    """
    robot, dt = robot_and_dt(env)
    dt = float(dt)
    if filter.dt != dt:
        raise InterfaceError(f"the filter's time step is {filter.dt} s, the environment's {dt} s")
    if not _same_robot(filter.robot, robot):
        raise InterfaceError(
            f"the filter is for {filter.robot.name} at {filter.robot.mount}, the environment has {robot.name} "
            f"at {robot.mount}, or their capsules or limits differ"
        )
    shape = env.action_space.shape
    if shape != (robot.n,):
        raise InterfaceError(f"the action space has shape {shape}, the robot {robot.n} joints")
    if not (np.all(env.action_space.low == -1.0) and np.all(env.action_space.high == 1.0)):  # ty: ignore[missing-attribute]
        raise InterfaceError("the action space has to be [-1, 1]: fractions of the jerk bounds")
    return robot


def _same_robot(one: RobotModel, other: RobotModel) -> bool:
    return one is other or (
        one.n == other.n
        and one.links.tobytes() == other.links.tobytes()
        and one.capsules.tobytes() == other.capsules.tobytes()
        and np.array_equal(one.limits.bounds(), other.limits.bounds())
    )


def tell_of_fast_people(env: gym.Env, params: FailsafeParams) -> None:
    """Say aloud, once, if an environment's people may be faster than a shield assumes.

    Of a recording every end of a capsule is compared with its own bound; of other motions no more is known than how
    fast the fastest point is, which is compared with the fastest of the bounds.
    """
    motion = vars(env.unwrapped).get("human")
    if isinstance(motion, HumanMotion) and (faster := _faster(motion, params)):
        say_faster("; ".join(dict.fromkeys(faster)))


def _faster(motion: HumanMotion, params: FailsafeParams) -> list[str]:
    if isinstance(motion, Crowd):
        return [told for one in motion.motions for told in _faster(one, params)]
    names = make_human(motion).reset(np.random.default_rng(0)).names
    bounds = np.array([params.end_speeds_of(name) for name in names], np.float64).reshape(-1, 2)
    if not isinstance(motion, Recorded):
        fastest, most = getattr(motion, "speed_bound", 0.0), bounds.max(initial=0.0)
        told = f"people may move at {fastest:.3g} m/s, {most:g} m/s is assumed"
        return [told] if fastest > most * _ROUNDING else []
    speeds = motion.recording.end_speeds
    worst = (speeds / bounds).argmax(axis=1)
    return [
        f"{name} moves at {speed[k]:.3g} m/s, {bound[k]:g} m/s is assumed"
        for name, speed, bound, k in zip(names, speeds, bounds, worst, strict=True)
        if speed[k] > bound[k] * _ROUNDING
    ]


@cache  # many environments have the same people
def say_faster(who: str) -> None:
    """Say that once."""
    _logger.warning(
        "%s: the shield does not believe measurements of faster people, and may stop for them too late. "
        "FailsafeParams has human_speed, limb_speed, foot_speed and end_speeds.",
        who,
    )
