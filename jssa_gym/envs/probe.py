"""An environment driven by small random jerks, and what it shows meanwhile."""

import copy
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from jssa_gym.envs.scenery import leaves
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, Scene


class Run(NamedTuple):
    """An episode's beginning."""

    scenes: list[Scene]
    """Copies, after reset and after every step."""
    results: list[bytes]
    """Observation and reward of each of them, to be compared."""
    rereads: list[str]
    """What differed when a tick's scene was read again; empty for nothing."""
    shielded: bool
    trouble: str
    """What was raised; empty for nothing."""


def probing_jerks(robot: RobotModel, dt: float, ticks: int, seed: int) -> Array:
    """Random jerks that bring the arm back to rest every four ticks and nowhere near a limit, shape (ticks, n)."""
    limits, rng = robot.limits, np.random.default_rng(seed)
    low, high = limits.position.T
    room = np.array([(high - low) / (8.0 * dt**3), limits.velocity / (2.0 * dt**2), limits.acceleration / (2.0 * dt)])
    most = np.minimum((room / limits.jerk).min(axis=0), 1.0)
    blocks = -(-ticks // 4)
    size = most * rng.uniform(0.3, 1.0, (blocks, robot.n))
    size[0] = most
    # there and back again, so that the arm stays where it began
    size[1::2] *= -1.0
    size *= rng.choice([-1.0, 1.0], robot.n)
    return (size[:, None] * np.array([1.0, -1.0, -1.0, 1.0])[:, None]).reshape(-1, robot.n)[:ticks]


def drive(env: gym.Env, actions: Array, seed: int) -> Run:
    """Reset an environment and apply jerks, shape (ticks, n), one a step, until the episode ends; never raises."""
    run, doing, trouble = Run([], [], [], False, ""), "reset", ""
    try:
        observation, info = env.reset(seed=seed)
        run = run._replace(shielded="shield/status" in info)
        doing = "scene"
        _look(env, run, observation, 0.0)
        for k, action in enumerate(actions):
            doing = f"step {k + 1}"
            observation, reward, terminated, truncated, _ = env.step(action.copy())
            doing = f"scene after step {k + 1}"
            _look(env, run, observation, reward)
            if terminated or truncated:
                break
    except Exception as error:  # whatever an environment of somebody's does, it is reported
        trouble = f"{doing} raised {type(error).__name__}: {error}"
    return run._replace(trouble=trouble)


def _look(env: gym.Env, run: Run, observation: Any, reward: Any) -> None:
    scene = copy.deepcopy(env.get_wrapper_attr("scene"))
    again = env.get_wrapper_attr("scene")
    run.scenes.append(scene)
    run.rereads.append(difference(scene, again))
    run.results.append(repr((_bits(observation), float(reward))).encode())


def _bits(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _bits(one) for key, one in value.items()}
    return np.asarray(value).tobytes()


def difference(one: Scene, other: Scene) -> str:
    """The first field in which two scenes differ; empty for none, or if there are no fields to compare."""
    try:
        pairs = zip(leaves(one), leaves(other), strict=True)
        return next((name for (name, a), (_, b) in pairs if _bits(a) != _bits(b)), "")
    except AttributeError:  # said elsewhere
        return ""
