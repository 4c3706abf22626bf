"""One episode, recorded."""

import time
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.evaluation.trace import trace_of
from jssa_gym.policies import Policy
from jssa_gym.shields import SafetyFilter, Shield
from jssa_gym.shields.offers import Offered
from jssa_gym.types import Array, Decision, Scene, Status, Trace


class _Stopwatch(SafetyFilter):
    """A filter that also measures how long its decisions take."""

    def __init__(self, timed: SafetyFilter) -> None:
        super().__init__(timed.robot, timed.dt)
        self.timed = timed
        self.elapsed = np.nan

    def reset(self, scene: Scene) -> None:
        self.timed.reset(scene)

    def decide(self, scene: Scene | None, nominal: Array, path: Offered | None = None) -> Decision:
        start = time.perf_counter()
        decision = self.timed.decide(scene, nominal, path)
        self.elapsed = time.perf_counter() - start
        return decision


def shield_of(env: gym.Env) -> Shield | None:
    """The shield among an environment's wrappers."""
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, Shield):
            return layer
        layer = layer.env
    return None


def _setting(base: Any) -> dict[str, Any]:
    """What a trace holds once: robot, people and half-spaces as they are after the reset."""
    scene: Scene = base.scene
    state, human, planes = scene.robot, scene.human, scene.planes
    return {
        "dt": base.dt,
        "robot": base.robot.name,
        "dynamics": base.dynamics,
        "task": base.task.name,
        "holds": not base.task.ends,
        "d_min": base.d_min,
        "mount": np.array(base.robot.mount),
        "initial_state": np.array([state.position, state.velocity, state.acceleration]),
        "initial_human": np.array([human.start, human.end]),
        "human_radius": np.array(human.radius),
        "human_person": np.array(human.person),
        "human_names": human.names,
        "plane_normal": np.array(planes.normal),
        "plane_offset": np.array(planes.offset),
        "plane_names": planes.names,
    }


def rollout(
    env: gym.Env,
    policy: Policy,
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    steps: int = 1000,
    name: str = "",
) -> Trace:
    """Run one episode and record it.

    Args:
        env: An :class:`~jssa_gym.envs.ArmEnv`, wrapped or not. ``terminate_on=()`` runs to the horizon.
        policy: Maps an observation to an action.
        seed: Of the episode.
        options: Of ``env.reset``.
        steps: At most so many.
        name: Of the trace.
    """
    base: Any = env.unwrapped
    shield = shield_of(env)
    watch = None
    if shield is not None:
        watch = _Stopwatch(shield.filter)
        shield.filter = watch
    try:
        observation, _ = env.reset(seed=seed, options=options)
        once: dict[str, Any] = {"name": name, "ended": "running", **_setting(base)}
        rows: list[dict[str, Any]] = []
        for _ in range(steps):
            action = policy(observation)
            observation, reward, terminated, truncated, info = env.step(action)
            scene, closest = base.scene, base.closest
            decision = None if shield is None else shield.last_decision
            rows.append(
                {
                    "time": scene.time,
                    "position": scene.robot.position,
                    "velocity": scene.robot.velocity,
                    "acceleration": scene.robot.acceleration,
                    "jerk": info["jerk"],
                    "nominal": info["jerk"] if decision is None else decision.nominal,
                    "goal": base.goal.ravel(),
                    "reward": float(reward),
                    "success": info["success"],
                    "limit_violation": info["limit_violation"],
                    "distance": closest.distance,
                    "speed": closest.rate,
                    "acceleration_of_distance": closest.curvature,
                    "pair": (closest.robot, closest.human),
                    "contact": info["contact"],
                    "contact_speed": info["contact_speed"],
                    "status": info.get("shield/status", int(Status.NOMINAL)),
                    "reason": info.get("shield/reason", ""),
                    "intervened": info.get("shield/intervened", False),
                    "correction": info.get("shield/correction", np.nan),
                    "phi": info.get("shield/phi", np.nan),
                    "slack": info.get("shield/slack", np.nan),
                    "shield_time": np.nan if watch is None else watch.elapsed,
                    "human_start": scene.human.start,
                    "human_end": scene.human.end,
                }
            )
            if terminated or truncated:
                once["ended"] = "terminated" if terminated else "truncated"
                break
    finally:
        if shield is not None and watch is not None:
            shield.filter = watch.timed
    return trace_of(once, rows)
