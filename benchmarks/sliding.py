"""Which treatment of the closest points' sliding along the capsules should the shield use?

Three candidates on paired seeds: the exact sliding term ("exact"), none ("none"), and capsules sampled by spheres,
whose distances have no sliding at all ("spheres"). The arm wanders between random postures around home while a
person walks up or past. The three have jerk bounds only and ask for an index of 0 at once, which is where a bad row
shows; the first two once more with all that the default shield has around them.

    python benchmarks/sliding.py --episodes 60
"""

import argparse
import dataclasses
import json
import time
from pathlib import Path

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.control import Cascade
from jssa_gym.evaluation.identity import made_with
from jssa_gym.humans import ApproachRetreat, ConstantVelocity
from jssa_gym.kernels.records import CAPSULE
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields import JSSAFilter, SafetyFilter
from jssa_gym.types import CapsuleSet

SPACING = 0.05


def fractions(length: float) -> np.ndarray:
    return np.linspace(0.0, 1.0, max(int(np.ceil(length / SPACING)) + 1, 1)) if length > 0 else np.zeros(1)


def sphere_robot(robot):
    rows, names = [], []
    for capsule, name in zip(robot.capsules, robot.capsule_names, strict=True):
        length = float(np.linalg.norm(capsule["end"] - capsule["start"]))
        steps = fractions(length)
        h = length / max(len(steps) - 1, 1)
        radius = np.sqrt(capsule["radius"] ** 2 + h**2 / 4)
        for f in steps:
            p = capsule["start"] + f * (capsule["end"] - capsule["start"])
            rows.append((p, p, radius, capsule["link"]))
            names.append(name)
    return dataclasses.replace(robot, capsules=np.array(rows, CAPSULE), capsule_names=tuple(names))


def sphere_people(people: CapsuleSet) -> CapsuleSet:
    points, rates, radii, names, person = [], [], [], [], []
    for i in range(len(people.radius)):
        length = float(np.linalg.norm(people.end[i] - people.start[i]))
        steps = fractions(length)
        h = length / max(len(steps) - 1, 1)
        for f in steps:
            points.append(people.start[i] + f * (people.end[i] - people.start[i]))
            rates.append(people.start_velocity[i] + f * (people.end_velocity[i] - people.start_velocity[i]))
            radii.append(np.sqrt(people.radius[i] ** 2 + h**2 / 4))
            names.append(people.names[i])
            person.append(people.person[i])
    p, v = np.array(points), np.array(rates)
    return CapsuleSet(p, p.copy(), v, v.copy(), np.array(radii), tuple(names), np.array(person))


class SphereFilter(SafetyFilter):
    """JSSA on spheres instead of capsules."""

    def __init__(self, robot, dt):
        super().__init__(robot, dt)
        self.inner = JSSAFilter(sphere_robot(robot), dt, IndexParams(sliding=False), recovery=0.0)

    def decide(self, scene, nominal):
        people = sphere_people(scene.human)
        m = len(people.radius)
        return self.inner.decide(scene._replace(human=people, age=np.zeros(m), valid=np.ones(m, bool)), nominal)


def whole(robot, dt, *, sliding: bool) -> SafetyFilter:
    """As JSSAShield has it: bounds that keep the joint limits, gradual recovery, and the verified stop."""
    return JSSAFilter(robot, dt, IndexParams(sliding=sliding), viability=True, failsafe=FailsafeParams())


class Stopwatch:
    """Notes how long the decisions of a filter take."""

    def __init__(self, filter: SafetyFilter):
        self.decide, self.took = filter.decide, []

    def __call__(self, scene, nominal):
        begin = time.perf_counter()
        decision = self.decide(scene, nominal)
        self.took.append(time.perf_counter() - begin)
        return decision


class Wander:
    """Nominal motion that really moves: a new posture around home every second."""

    def __init__(self, env, seed):
        self.env, self.rng = env, np.random.default_rng(seed)
        self.robot = env.unwrapped.robot
        self.cascade = Cascade(self.robot.limits)
        self.steps, self.target = 0, np.array(self.robot.home)

    def __call__(self, observation):
        if self.steps % 125 == 0:
            self.target = self.robot.home + self.rng.uniform(-0.6, 0.6, self.robot.n)
        self.steps += 1
        return self.cascade.jerk(self.env.unwrapped.scene.robot, self.target) / self.robot.limits.jerk


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=60, help="per human and candidate")
    parser.add_argument("--json", default="", help="also write the table to this file")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    candidates = {
        "none": lambda robot, dt: JSSAFilter(robot, dt, IndexParams(sliding=False), recovery=0.0),
        "exact": lambda robot, dt: JSSAFilter(robot, dt, IndexParams(sliding=True), recovery=0.0),
        "spheres": SphereFilter,
        "none, whole shield": lambda robot, dt: whole(robot, dt, sliding=False),
        "exact, whole shield": lambda robot, dt: whole(robot, dt, sliding=True),
    }
    humans = {
        "approach 0.3-0.8 m/s": ApproachRetreat(speed=(0.3, 0.8)),
        "approach 0.8-1.6 m/s": ApproachRetreat(speed=(0.8, 1.6)),
        "walk past 0.3-1.6 m/s": ConstantVelocity(),
    }
    table = []
    for human_name, human in humans.items():
        for name, build in candidates.items():
            env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
            shield = jssa_gym.Shield(env, build(env.unwrapped.robot, env.unwrapped.dt))
            shield.filter.decide = watch = Stopwatch(shield.filter)
            closest, moving, active, relaxed, fast = [], [], [], [], []
            for seed in range(args.episodes):
                observation, _ = shield.reset(seed=seed)
                policy = Wander(shield, seed)
                smallest, hit, speed = np.inf, False, 0.0
                for _ in range(1000):
                    observation, _, _, truncated, info = shield.step(policy(observation))
                    smallest = min(smallest, info["distance"])
                    hit = hit or info["contact_speed"] > 1e-3
                    active.append(info["shield/intervened"])
                    relaxed.append(info["shield/status"] == jssa_gym.Status.RELAXED)
                    velocity = env.unwrapped.scene.robot.velocity
                    speed = max(speed, float(np.max(np.abs(velocity) / env.unwrapped.robot.limits.velocity)))
                    if truncated:
                        break
                closest.append(smallest)
                moving.append(hit)
                fast.append(speed > 1.0)
            row = {
                "human": human_name,
                "sliding": name,
                "moving contact": float(np.mean(moving)),
                "contact": float(np.mean(np.array(closest) <= 0.0)),
                "over speed limit": float(np.mean(fast)),
                "min distance p5": float(np.percentile(closest, 5)),
                "min distance median": float(np.median(closest)),
                "intervened": float(np.mean(active)),
                "relaxed": float(np.mean(relaxed)),
                "decision p50 us": float(np.median(watch.took) * 1e6),
            }
            table.append(row)
            print("  ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{v:24s}" for k, v in row.items()), flush=True)
    if args.json:
        Path(args.json).write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
