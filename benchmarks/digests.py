"""Hashes of thousands of episodes, to see whether a change of the code changed what the code does.

    python benchmarks/digests.py before          # with the code before, in a folder of its own
    python benchmarks/digests.py now
    python benchmarks/digests.py before now --compare

Every job is a filter with people, a policy and a fault; every step hashes action, jerk, state, observation, all of
``info``, reward and the whole decision. What was begun goes on where it was stopped.
"""

import argparse
import hashlib
import json
import zlib
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.envs.faults import FAULTS
from jssa_gym.evaluation.contenders import CONTENDERS, shielded
from jssa_gym.evaluation.people import PEOPLE
from jssa_gym.evaluation.study import put_filter
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.storage import write_whole

PEOPLE_TRIED = ("constant_velocity", "approach_retreat", "random", "walk_by", "pursuit", "hand", "feint", "two")
POLICIES_TRIED = ("hold", "constant", "random", "wander", "bang_bang", "limit_seeking", "chase")
OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"projector": "osqp"},
    "printed": {"gradient": "printed", "recovery": 0.0},
    "published": {},
    "closest": {"rows": "closest"},
    "weight": {"weight": [1.0, 2.0, 3.0, 1.0, 5.0, 1.0]},
    "full weight": {"weight": (np.eye(6) + 0.2).tolist()},
    "static rows": {"static_rows": True},
    "sliding": {"sliding": True},
    "one step": {"recovery": 0.0},
    "paper's index": {"lambda1": 3.0, "lambda2": 1.0},
    "no box": {"viability": False},
    "no stop": {"failsafe": False},
    "lag": {"failsafe": {"actuation_lag": 0.1, "position_error": 0.02}},
    "touch": {"failsafe": {"contact_speed": 0.25}},
    "tolerance": {"failsafe": {"state_tolerance": (1e-4, 1e-3, 1.0), "tracking_error": 0.001}},
}
"""Of ``JSSAShield``."""


class Job(NamedTuple):
    """Episodes of one kind."""

    door: str
    """How the shield is made: ``contender``, ``filter`` or ``options``."""
    shield: str
    human: str
    policy: str
    task: str = "home"
    fault: str = "none"
    dynamics: str = "kinematic"
    scene: str = "table"
    steps: int = 250


def jobs() -> list[Job]:
    """What is tried."""
    found = [
        Job("contender", "full", human, policy, fault=fault)
        for human, policy, fault in product(PEOPLE_TRIED, POLICIES_TRIED, (*FAULTS, "missed ticks"))
    ]
    names = [f"{name}{stop}" for name in jssa_gym.FILTERS for stop in ("", "+stop")]
    for task, name, human, policy in product(
        ("home", "reach", "track", "handover"), names, ("random", "pursuit", "hand"), ("jpc", "random")
    ):
        found.append(Job("filter", name, human, policy, task))
    for name, human, policy in product(
        ("jssa", "stop+stop", "jssa+stop", "cbf+stop", "none"), ("pursuit", "walk_by"), ("bang_bang", "jpc")
    ):
        found.append(Job("filter", name, human, policy, dynamics="servo"))
    for name, human, policy, scene in product(
        OPTIONS, ("walk_by", "pursuit", "two"), ("bang_bang", "jpc", "wander"), ("table", "floor")
    ):
        found.append(Job("options", name, human, policy, scene=scene, steps=100 if name == "osqp" else 200))
    for name, human, policy in product(CONTENDERS, ("pursuit", "hand"), ("wander", "chase")):
        fault = "stale joints" if name == "no_joint_check" else "latency 100 ms"
        found.append(Job("contender", name, human, policy, fault=fault))
    return [job for job in found if job.shield != UNSHIELDED or job.door != "contender"]


def play(job: Job, episodes: int) -> list[tuple[str, list[int]]]:
    """SHA-256 of every episode, and a checksum of every step."""
    env: Any = gym.make(
        f"jssa_gym/{job.task.capitalize()}-v0", human=PEOPLE[job.human](), dynamics=job.dynamics, scene=job.scene,
        terminate_on=(), max_episode_steps=job.steps,
    )  # fmt: skip
    base = env.unwrapped
    if job.door == "options":
        published = job.shield == "published"
        shield = jssa_gym.JSSAShield
        env = shield.as_published(env) if published else shield(env, **OPTIONS[job.shield])
    else:
        env = shielded(env, job.shield, job.fault) if job.door == "contender" else put_filter(env, job.shield)
    digests = []
    for seed in range(7000, 7000 + episodes):
        observation, _ = env.reset(seed=seed)
        policy, whole, steps = jssa_gym.POLICIES[job.policy](base, 100 + seed), hashlib.sha256(), []
        for _ in range(job.steps):
            action = policy(observation)
            observation, reward, terminated, truncated, info = env.step(action)
            state, decision, step = base.scene.robot, env.last_decision, hashlib.sha256()
            for array in (np.asarray(action, np.float64), info["jerk"], np.array(state), observation):
                step.update(np.ascontiguousarray(array).tobytes())
            told = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in info.items()}
            step.update(repr((sorted(told.items()), reward, terminated, truncated)).encode())
            if decision is not None:
                jerks = decision.jerk.tolist(), decision.nominal.tolist()
                step.update(repr((*jerks, int(decision.status), *decision[3:])).encode())
            whole.update(step.digest())
            steps.append(zlib.crc32(step.digest()))
        digests.append((whole.hexdigest(), steps))
    return digests


def compare(one: Path, other: Path) -> None:
    """Say which episodes of two folders differ, and from which step on."""
    same, differ = 0, []
    for file in sorted(one.glob("*.json")):
        told, again = (json.loads((folder / file.name).read_text()) for folder in (one, other))
        for before, now in zip(told["digests"], again["digests"], strict=True):
            if before[0] == now[0]:
                same += 1
            else:
                first = next(k for k, (a, b) in enumerate(zip(before[1], now[1], strict=True)) if a != b)
                differ.append(f"from step {first}: {', '.join(map(str, told['job']))}")
    print(f"{same} episodes are the same, {len(differ)} differ")
    print("\n".join(differ))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--episodes", type=int, default=2, help="of each kind")
    parser.add_argument("--part", default="0/1", help="K/N: every N-th job from the K-th on, for several processes")
    options = parser.parse_args()
    if options.compare:
        compare(*options.folders)
        return
    folder, (first, parts) = options.folders[0], map(int, options.part.split("/"))
    folder.mkdir(parents=True, exist_ok=True)
    for number, job in enumerate(jobs()):
        file = folder / f"{number:05d}.json"
        if number % parts == first and not file.exists():
            write_whole(file, json.dumps({"job": job, "digests": play(job, options.episodes)}))


if __name__ == "__main__":
    main()
