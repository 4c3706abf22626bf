"""What a shield needs of an environment: robot, time step and scene, and actions that are shares of the jerk bounds."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.exceptions import InterfaceError
from jssa_gym.humans import Paced, Visitors
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.shields.filter import SafetyFilter

_ASSUMED = FailsafeParams()


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


def region_of(env: gym.Env, assumed: Any) -> WatchedRegion | None:
    """Where an environment's people come and go, for assumptions of a verified stop that do not say it themselves."""
    said = assumed.get("watched") if isinstance(assumed, Mapping) else getattr(assumed, "watched", None)
    if assumed is False or assumed is None or said is not None:
        return None
    human: Any = vars(env.unwrapped).get("human")
    motion = human
    while isinstance(motion, Paced):
        motion = motion.motion
    if not isinstance(motion, Visitors):
        return None
    # nobody comes through the floor, or from above
    return WatchedRegion.box(motion.low, motion.high, ("bottom", "top"), max(_ASSUMED.limb_speed, human.speed_bound))


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
