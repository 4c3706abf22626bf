"""Train the tuned policy of Reach inside the shield and judge it: half an hour for all of it, or ``--steps 2000``."""

import argparse
from dataclasses import replace

import jssa_gym
from jssa_gym.train import preset, train


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=30_000, help="of the policy, 0.2 s each")
    parser.add_argument("--episodes", type=int, default=50, help="of the evaluation")
    parser.add_argument("--out", default="my-reach", help="folder; the same command goes on from it")
    asked = parser.parse_args()
    tuned = preset("reach", "sac")
    config = replace(tuned, steps=asked.steps, interval=min(tuned.interval, asked.steps), eval_episodes=2)
    training = train(config, asked.out, say=print)
    report = jssa_gym.evaluate("jssa_gym/ReachShielded-v0", training.policy, episodes=asked.episodes)
    for name in ("success_rate", "moving_contact_rate"):
        print(f"{name}: {report.rates[name]}")


if __name__ == "__main__":
    main()
