"""What do closer bounds on people bring, and what do they cost?

The same episodes with one speed for the whole of an arm, with a speed for either end of it, and beside people who
accelerate gently also with an acceleration bound. Then the time of a decision, of shields that take turns.

    python benchmarks/closer_reach.py
"""

import argparse
import itertools
import time

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.humans import Pursuit, Steered
from jssa_gym.safety.failsafe import ARM_SPEEDS, FailsafeParams
from jssa_gym.types import Status

GENTLE = 4.0
"""Acceleration of the people who accelerate gently [m/s²]."""

ASSUMED = {
    "one speed": FailsafeParams(),
    "by end": FailsafeParams(end_speeds=ARM_SPEEDS),
    "acceleration": FailsafeParams(human_acceleration=GENTLE, velocity_error=GENTLE * 0.008),
}
"""A pursuer's velocity changes once a step, by as much as the acceleration does in it."""


def people(name: str):
    """Somebody by name; ``gentle`` runs at the arm, stops and starts, ``standing`` stands where it works."""
    if name == "standing":
        return Steered(np.zeros((1, 2)), start=(1.15, 0.1))
    if name == "gentle":
        return Pursuit(speed=1.0, acceleration=GENTLE, feint=True)
    return jssa_gym.HUMANS[name]()


def build(task: str, human: str, failsafe: FailsafeParams, filter: str = "jssa") -> gym.Env:
    env = gym.make(f"jssa_gym/{task}-v0", human=people(human), terminate_on=())
    return jssa_gym.Shield(env, filter, stop=failsafe)


def compare(task: str, human: str, names: tuple[str, ...], filter: str, args: argparse.Namespace) -> None:
    for name in names:
        env, good, touched, fastest, told = build(task, human, ASSUMED[name], filter), 0, 0, 0.0, []
        for seed in range(args.seed, args.seed + args.episodes):
            observation, info = env.reset(seed=seed)
            policy, contact, success = jssa_gym.POLICIES["jpc_paper"](env.unwrapped, seed), False, False
            for _ in range(500):
                observation, _, terminated, truncated, info = env.step(policy(observation))
                told.append(int(info["shield/status"]))
                contact, success = contact or info["contact"], success or info["success"]
                fastest = max(fastest, info["contact_speed"])
                if terminated or truncated:
                    break
            good, touched = good + (success and not contact), touched + contact
        shares = np.bincount(told, minlength=5) / len(told)
        print(
            f"{task} beside {human}, {filter}+stop, {name}: success, nobody touched {Rate.of(good, args.episodes)}; "
            f"touched {Rate.of(touched, args.episodes)}, at {fastest:.2g} m/s; "
            f"stored stop {shares[Status.FAILSAFE]:.2%}, faults {shares[Status.FAULT]:.2%} of {len(told)} steps",
            flush=True,
        )


def cost(task: str, human: str, episodes: int) -> None:
    """Mean time of a decision, shields taking turns step by step [µs]."""
    spent: dict[str, list[float]] = {name: [] for name in ASSUMED}
    envs = {name: build(task, human, failsafe) for name, failsafe in ASSUMED.items()}

    def timed(decide, times):
        def call(scene, nominal):
            begun = time.perf_counter()
            decision = decide(scene, nominal)
            times.append(time.perf_counter() - begun)
            return decision

        return call

    for name, env in envs.items():
        filter = env.get_wrapper_attr("filter")
        filter.decide = timed(filter.decide, spent[name])
    for seed in range(episodes):
        policies, seen = {}, {}
        for name, env in envs.items():
            seen[name], _ = env.reset(seed=seed)
            policies[name] = jssa_gym.POLICIES["jpc_paper"](env.unwrapped, seed)
        for _, (name, env) in itertools.product(range(400), envs.items()):
            seen[name], *_ = env.step(policies[name](seen[name]))
    base = np.median(spent["one speed"])
    for name, times in spent.items():
        p50, p99 = np.percentile(times, (50, 99))
        mean = np.mean(times) / np.mean(spent["one speed"])
        print(
            f"decision, {task} beside {human}, {name}: median {p50 / base:.2f}, mean {mean:.2f} of one speed's; "
            f"p99 {p99 * 1e6:.0f} µs"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=16, help="per cell")
    parser.add_argument("--seed", type=int, default=900_000, help="first seed")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    for task in ("Reach", "Home"):
        compare(task, "hand", ("one speed", "by end"), "jssa", args)
        compare(task, "hand", ("one speed", "by end"), "stop", args)
        compare(task, "gentle", tuple(ASSUMED), "jssa", args)
        compare(task, "standing", tuple(ASSUMED), "stop", args)
        compare(task, "standing", tuple(ASSUMED), "jssa", args)
    cost("Reach", "hand", 4)


if __name__ == "__main__":
    main()
