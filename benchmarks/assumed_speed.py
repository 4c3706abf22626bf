"""What does a task pay for people who could be faster than they are?

The verified stop holds against people who may move at 1.6 m/s, their arms at 2.0 m/s, at any time. Those of `walk_by`
and `random` never exceed 1 m/s. The same episodes of Track with the usual bounds, and with 1 m/s for every part of the
body, which is true of these people and of nobody else.

    python benchmarks/assumed_speed.py
"""

import argparse
import functools

import gymnasium as gym

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.safety.failsafe import FailsafeParams

ASSUMED = {"1.6 m/s, arms 2.0 m/s": FailsafeParams(), "1 m/s": FailsafeParams(human_speed=1.0, limb_speed=1.0)}


def build(human: str, failsafe: FailsafeParams) -> gym.Env:
    env = gym.make("jssa_gym/Track-v0", human=human, terminate_on=())
    return jssa_gym.Shield(env, "jssa_near", stop=failsafe)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100, help="per cell")
    parser.add_argument("--seed", type=int, default=800_000, help="first seed")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    for human in ("walk_by", "random"):
        for name, failsafe in ASSUMED.items():
            report = jssa_gym.evaluate(functools.partial(build, human, failsafe), "jpc", args.episodes, args.seed)
            ends = [episode.summary for episode in report.episodes]
            good = Rate.of(sum(e.success and not e.collision for e in ends), len(ends))
            print(
                f"{human}, assumed {name}: success, nobody touched {good}; {report.rates['moving_contact_rate']} moving"
            )


if __name__ == "__main__":
    main()
