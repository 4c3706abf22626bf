"""How fast everything is, measured side by side in one run: medians and 99th percentiles."""

import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.evaluation.blocked import commonest
from jssa_gym.evaluation.oracle import Oracle
from jssa_gym.exceptions import JSSAGymError
from jssa_gym.kernels.capsules import measure_agents
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.records import FRAME, PAIR, SEGMENT, records
from jssa_gym.policies import HoldPolicy
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.projectors import ExactProjector, OSQPProjector
from jssa_gym.safety.proximity import agent_records, state_rows
from jssa_gym.shields import JSSAFilter, JSSAShield
from jssa_gym.types import Array, HalfSpaces, Scene, Status


@dataclass(frozen=True, slots=True)
class Timing:
    """Times of one thing."""

    name: str
    median: float
    """[s]."""
    p99: float
    """[s]."""
    count: int
    blocked: str = ""
    """Why every one of these decisions was a FAULT, most often; empty if not every one was."""


def _timing(name: str, times: list[float], faults: list[str] | None = None) -> Timing:
    blocked = commonest(faults) if faults and len(faults) == len(times) else ""
    return Timing(name, float(np.median(times)), float(np.percentile(times, 99)), len(times), blocked)


def record_scenes(env_human: Any, robot: str, steps: int = 1000) -> tuple[RobotModel, float, list[tuple[Scene, Array]]]:
    """Scenes and nominal jerks of a shielded episode, for filters to be timed on."""
    env = JSSAShield(gym.make("jssa_gym/Home-v0", human=env_human, robot=robot, terminate_on=()))
    policy, base = HoldPolicy(env), env.unwrapped
    arm, dt = env.get_wrapper_attr("robot"), env.get_wrapper_attr("dt")
    observation, _ = env.reset(seed=0)
    scenes = []
    for _ in range(steps):
        action = policy(observation)
        scenes.append((base.get_wrapper_attr("scene"), np.asarray(action) * arm.limits.jerk))
        observation, *_ = env.step(action)
    return arm, dt, scenes


def time_decisions(robot: RobotModel, dt: float, scenes: list[tuple[Scene, Array]], rounds: int) -> list[Timing]:
    """``filter.decide`` with all pairs, by what it decided: rows alone, rows by OSQP, and with all layers on."""
    filters = {
        "rows": JSSAFilter(robot, dt),
        "rows by OSQP": JSSAFilter(robot, dt, projector="osqp"),
        "all layers": JSSAFilter(robot, dt, viability=True, failsafe=FailsafeParams()),
    }
    times: dict[tuple[str, Status], list[float]] = {}
    everything: dict[str, list[float]] = {name: [] for name in filters}
    faults: dict[str, list[str]] = {name: [] for name in filters}
    for _ in range(rounds):
        for chosen in filters.values():
            chosen.reset(scenes[0][0])
        for scene, nominal in scenes:
            for name, chosen in filters.items():
                start = time.perf_counter()
                decision = chosen.decide(scene, nominal)
                took = time.perf_counter() - start
                times.setdefault((name, decision.status), []).append(took)
                everything[name].append(took)
                if decision.status == Status.FAULT:
                    faults[name].append(decision.reason)
    timings = []
    for name, values in everything.items():
        timings.append(_timing(f"filter.decide, {name}, whole episode", values, faults[name]))
        for status in Status:
            chosen_times = times.get((name, status), [])
            if len(chosen_times) >= 20:
                timings.append(_timing(f"  of it {status.name}", chosen_times))
    return timings


def _qps(robot: RobotModel, dt: float, scenes: list[tuple[Scene, Array]]) -> list[tuple[Array, HalfSpaces]]:
    """The quadratic programs that an episode gives rise to, taken from the projector's door."""
    problems: list[tuple[Array, HalfSpaces]] = []
    # of the filter whose projector can be changed: that of the other is compiled into its step
    recording, inner = JSSAFilter(robot, dt, projector="osqp"), ExactProjector(robot.n)

    class _Recorder(ExactProjector):
        def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Any:
            problems.append((nominal.copy(), HalfSpaces(rows.L.copy(), rows.S.copy())))
            return inner.project(nominal, rows, lower, upper)

    recording.projector = _Recorder(robot.n)
    for scene, nominal in scenes:
        recording.decide(scene, nominal)
    return problems


def time_projectors(robot: RobotModel, dt: float, scenes: list[tuple[Scene, Array]], rounds: int) -> list[Timing]:
    """Both projectors on the same problems."""
    bound = np.array(robot.limits.jerk)
    problems = _qps(robot, dt, scenes)
    if not problems:
        return []
    exact, osqp = ExactProjector(robot.n), OSQPProjector(robot.n)
    times: dict[str, list[float]] = {"exact": [], "osqp": []}
    osqp.project(*problems[0], -bound, bound)
    for _ in range(rounds):
        for nominal, rows in problems:
            for name, projector in (("exact", exact), ("osqp", osqp)):
                start = time.perf_counter()
                projector.project(nominal, rows, -bound, bound)
                times[name].append(time.perf_counter() - start)
    mean = np.mean([len(rows.S) for _, rows in problems])
    return [_timing(f"projection alone ({mean:.1f} rows on average), {name}", t) for name, t in times.items()]


def time_distances(robot: RobotModel, scenes: list[tuple[Scene, Array]], rounds: int) -> list[Timing]:
    """All capsule pairs: our kernel against ``mj_geomDistance`` on the same capsules."""
    frames, segments = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
    humans = scenes[0][0].human
    agents = agent_records(humans)
    pairs = records((len(segments), len(agents)), PAIR)
    chosen = [scene for scene, _ in scenes[::10]]
    ends = np.array([(scene.human.start, scene.human.end) for scene in chosen])
    oracle = Oracle(robot, ends[:, 0], ends[:, 1], humans.radius, np.zeros((0, 3)), np.zeros(0))
    geoms = [(one, other) for one in oracle.arm for other in oracle.human]
    ours, theirs = [], []
    for _ in range(rounds):
        for k, scene in enumerate(chosen):
            state = state_rows(scene.robot)
            agents = agent_records(scene.human, agents)
            start = time.perf_counter()
            forward(robot.links, state, frames)
            place(frames, robot.capsules, segments)
            measure_agents(segments, agents, pairs)
            ours.append(time.perf_counter() - start)
            oracle.place(k)
            start = time.perf_counter()
            oracle.move(scene.robot.position)
            distances = oracle.distances(geoms)
            theirs.append(time.perf_counter() - start)
            if not np.allclose(distances, pairs["distance"].ravel(), atol=1e-6):
                raise JSSAGymError("MuJoCo and the kernels disagree about a distance; nothing was compared")
    count = pairs.size
    return [
        _timing(f"forward kinematics and {count} distances, kernel", ours),
        _timing(f"forward kinematics and {count} distances, mj_geomDistance", theirs),
    ]


def time_steps(build: Callable[[], gym.Env], name: str, steps: int) -> Timing:
    """``env.step`` under :class:`HoldPolicy`'s actions, which are computed beforehand and not timed."""
    env = build()
    policy = HoldPolicy(env)
    observation, _ = env.reset(seed=0)
    times, faults = [], []
    for _ in range(steps):
        action = policy(observation)
        start = time.perf_counter()
        observation, _, terminated, truncated, info = env.step(action)
        times.append(time.perf_counter() - start)
        if info.get("shield/status") == Status.FAULT:
            faults.append(info["shield/reason"])
        if terminated or truncated:
            observation, _ = env.reset()
    env.close()
    return _timing(name, times, faults)


_FIRST_USE = """
import sys, time
import gymnasium as gym, jssa_gym
start = time.perf_counter()
env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", robot=sys.argv[1]))
policy = jssa_gym.HoldPolicy(env)
observation, _ = env.reset(seed=0, options={"human_start": [1.0, 0.0]})
for _ in range(100):
    observation, *_ = env.step(policy(observation))
print(time.perf_counter() - start)
"""


def time_first_use(robot: str) -> tuple[float, float]:
    """Seconds for a shielded environment and 100 steps in a new process: kernels compiled, then kernels cached."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}

        def once() -> float:
            run = subprocess.run(
                [sys.executable, "-c", _FIRST_USE, robot], env=environment, capture_output=True, text=True, check=True
            )
            return float(run.stdout.split()[-1])

        return once(), once()


CBFPY = Path(__file__).parents[2] / "benchmarks" / "cbfpy_peer.py"


def cbfpy_missing() -> str:
    """Why :func:`cbfpy_report` has nothing to run here, and what to do; empty if it has."""
    if not CBFPY.is_file():
        return "benchmarks/cbfpy_peer.py is not part of an installed package; run jssa-gym bench in a clone"
    if importlib.util.find_spec("cbfpy") is None:
        return 'cbfpy is not installed; pip install cbfpy "elastiqp[jax]"'
    return ""


def cbfpy_report() -> str | None:
    """CBFpy's times on the same arm and pairs, from ``benchmarks/cbfpy_peer.py``; None where either is missing."""
    if cbfpy_missing():
        return None
    run = subprocess.run([sys.executable, str(CBFPY), "--repeats", "5"], capture_output=True, text=True, check=False)
    return run.stdout if run.returncode == 0 else f"failed: {run.stderr.strip().splitlines()[-1:]}"
