"""Four filters on the same seeds: how often they are touched, how often they succeed, and how sure that is."""

import argparse

import jssa_gym
from jssa_gym.evaluation import paired_difference

FILTERS = ("none", "stop", "cbf+stop", "jssa+stop")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=40)
    episodes = parser.parse_args().episodes
    reports = {
        name: jssa_gym.evaluate(
            "jssa_gym/Home-v0", "hold", episodes=episodes, env_kwargs={"human": "approach_retreat"}, filter=name
        )
        for name in FILTERS
    }
    for name, report in reports.items():
        print(f"{name:<10} touched {report.rates['collision_rate']}, success {report.rates['success_rate']}")
    touched = {name: [episode.summary.collision for episode in report.episodes] for name, report in reports.items()}
    difference = paired_difference(touched["jssa+stop"], touched["stop"])
    print(f"rate of jssa+stop touched minus that of stop: {difference}, p = {difference.p_value:.2g}")


if __name__ == "__main__":
    main()
