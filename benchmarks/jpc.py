"""How often the jerk-bounded position controller reaches its targets, with nobody there and beside somebody.

python benchmarks/jpc.py --alone 300 --shielded 60
"""

import argparse
import statistics

import gymnasium as gym

import jssa_gym
from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.identity import made_with


def play(env, seed):
    """Whether the target was reached, when [s], and whether a contact with the arm moving or a limit was seen."""
    policy = jssa_gym.JPCPolicy(env, seed)
    observation, _ = env.reset(seed=seed)
    moving = exceeded = ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        moving |= info["contact_speed"] > MOVING
        exceeded |= info["limit_violation"]
        ended = terminated or truncated
    return info["success"], env.unwrapped.scene.time, moving, exceeded


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--alone", type=int, default=300, help="episodes with nobody there")
    parser.add_argument("--shielded", type=int, default=60, help="episodes beside the random walker, shielded")
    arguments = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    alone = gym.make("jssa_gym/Reach-v0", human="none")
    shielded = jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0"))
    for name, env, count in (("alone", alone, arguments.alone), ("shielded", shielded, arguments.shielded)):
        runs = [play(env, seed) for seed in range(count)]
        if runs:
            reached, times, moving, exceeded = zip(*runs, strict=True)
            print(
                f"{name}: {sum(reached)} of {count} reached, median {statistics.median(times):.2f} s, "
                f"{sum(moving)} with a moving contact, {sum(exceeded)} beyond a limit"
            )


if __name__ == "__main__":
    main()
