"""One episode, recorded."""

import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.evaluation.trace import WITHOUT_SHIELD, beginning, trace_of
from jssa_gym.exceptions import InterfaceError
from jssa_gym.policies import Policy
from jssa_gym.shields import SafetyFilter, Shield
from jssa_gym.shields.offers import Offered
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.types import Array, Decision, Scene, Trace


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


def _setting(base: Any) -> dict[str, Any]:
    """What a trace holds once: task, robot, people and half-spaces as they are after the reset."""
    if base.human.comers is not None:
        raise InterfaceError(f"a trace is of people who stay; {type(base.human).__name__} come and go")
    scene: Scene = base.scene
    return {
        **beginning(base.robot, np.array(scene.robot), scene.human, scene.planes),
        "dt": base.dt,
        "dynamics": base.dynamics,
        "task": base.task.name,
        "holds": not base.task.ends,
        "d_min": base.d_min,
    }


class Recorder:
    """Takes down an episode of an environment, a row a control step, and how long its shield's decisions take.

    Args:
        env: An :class:`~jssa_gym.envs.ArmEnv`, wrapped or not.
        name: Of the traces.
        most: Only the last so many steps are kept; None for all.
    """

    def __init__(self, env: gym.Env, name: str = "", most: int | None = None) -> None:
        self._base: Any = env.unwrapped
        self._shield = layer_of(env, Shield)
        self._watch: _Stopwatch | None = None
        if self._shield is not None:
            self._watch = _Stopwatch(self._shield.filter)
            self._shield.filter = self._watch
        self._name = name
        self._rows: deque[dict[str, Any]] = deque(maxlen=most)
        self._once: dict[str, Any] = {}

    def __len__(self) -> int:
        """Steps that are kept."""
        return len(self._rows)

    def begin(self) -> None:
        """A new episode begins here, after the environment's ``reset``, or in the midst of one."""
        self._rows.clear()
        self._once = _setting(self._base)
        self._start = float(self._base.scene.time)

    def take(self, reward: float, info: Mapping[str, Any]) -> None:
        """Take down the step that was just done.

        Args:
            reward: Of the step.
            info: What the environment says of it.
        """
        base, watch = self._base, self._watch
        if len(self._rows) == self._rows.maxlen:
            self._forget_first()
        scene, closest = base.scene, base.closest
        decision = None if self._shield is None else self._shield.last_decision
        self._rows.append(
            {
                "time": scene.time,
                **scene.robot._asdict(),
                "jerk": info["jerk"],
                "nominal": info["jerk"] if decision is None else decision.nominal,
                "goal": base.goal.ravel(),
                "reward": reward,
                "success": info["success"],
                "limit_violation": info["limit_violation"],
                "distance": closest.distance,
                "speed": closest.rate,
                "acceleration_of_distance": closest.curvature,
                "pair": (closest.robot, closest.human),
                "contact": info["contact"],
                "contact_speed": info["contact_speed"],
                **{name: info.get(f"shield/{name}", absent) for name, absent in WITHOUT_SHIELD.items()},
                "shield_time": np.nan if watch is None else watch.elapsed,
                "human_start": scene.human.start,
                "human_end": scene.human.end,
            }
        )

    def _forget_first(self) -> None:
        """What the first step led to is what the others begin with."""
        row = self._rows.popleft()
        self._once["initial_state"] = np.array([row[name] for name in ("position", "velocity", "acceleration")])
        self._once["initial_human"] = np.array([row["human_start"], row["human_end"]])
        self._start = row["time"]

    def trace(self, ended: str = "running") -> Trace:
        """What was taken down since the beginning, or of the last steps; times count from there."""
        once = {"name": self._name, "ended": ended, **self._once}
        rows = self._rows if self._start == 0.0 else [{**row, "time": row["time"] - self._start} for row in self._rows]
        return trace_of(once, list(rows))

    def close(self) -> None:
        """Leave the shield alone again."""
        if self._shield is not None and self._watch is not None:
            self._shield.filter = self._watch.timed


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
    recorder, ended = Recorder(env, name), "running"
    try:
        observation, _ = env.reset(seed=seed, options=options)
        recorder.begin()
        for _ in range(steps):
            action = policy(observation)
            observation, reward, terminated, truncated, info = env.step(action)
            recorder.take(float(reward), info)
            if terminated or truncated:
                ended = "terminated" if terminated else "truncated"
                break
    finally:
        recorder.close()
    return recorder.trace(ended)
