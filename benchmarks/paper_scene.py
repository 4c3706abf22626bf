"""Every filter, bare, in the scene of the paper's Fig. 5: a person walks up to the arm and back, at 0.8 and 1.6 m/s.

    python benchmarks/paper_scene.py

One episode each, in which nothing is left to chance. Saturated is the share of the active time with a joint at its jerk
bound.
"""

import argparse

import gymnasium as gym
import numpy as np

from jssa_gym.cli.demo import paper_scene
from jssa_gym.envs.arm import DT, MOVING
from jssa_gym.evaluation import rollout
from jssa_gym.evaluation.identity import made_with
from jssa_gym.policies import HoldPolicy
from jssa_gym.shields import FILTERS, Shield


def cells(name: str, speed: float, seconds: float) -> list[str]:
    """Smallest distance, contact, active and saturated of one episode."""
    steps = round(seconds / DT)
    bare = gym.make("jssa_gym/Home-v0", human=paper_scene(speed), terminate_on=(), max_episode_steps=steps)
    env = Shield(bare, name)
    trace = rollout(env, HoldPolicy(env), seed=0, steps=steps)
    active = trace.intervened
    bound = env.get_wrapper_attr("robot").limits.jerk
    saturated = (np.abs(trace.jerk) >= (1.0 - 1e-9) * bound).any(axis=1)[active]
    contact = "no" if trace.distance.min() > 0.0 else "moving" if trace.contact_speed.max() > MOVING else "at rest"
    share = saturated.mean() if active.any() else 0.0
    return [f"{trace.distance.min():.3f} m", contact, f"{DT * active.sum():.2f} s", f"{share:.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=6.0, help="length of an episode")
    parser.add_argument("--filters", nargs="+", default=list(FILTERS), help="by name")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    print("| filter | 0.8 m/s: smallest distance | contact | active | saturated |"
          " 1.6 m/s: smallest distance | contact | active | saturated |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    for name in args.filters:
        found = [cell for speed in (0.8, 1.6) for cell in cells(name, speed, args.seconds)]
        print(f"| `{name}` | {' | '.join(found)} |", flush=True)


if __name__ == "__main__":
    main()
