"""What a shield costs in a handover: how often the tool arrives, and when.

A policy that moves the tool centre point straight towards the goal, or the jerk-bounded position controller, under
shields that let the arm touch the hand at rest only or at some speed, and none. Paired: the same seeds, hence people.

    python benchmarks/handover.py --episodes 40
    python benchmarks/handover.py --episodes 100 --policy jpc --seed 5000 --only "stop, "
"""

import argparse
import statistics

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.humans import Receive
from jssa_gym.policies import POLICIES


def shields():
    """Shields by name: λ1, λ2 of the index, its d_min, the speed at which the right hand may be touched, or no stop."""
    yield "none", lambda env: env
    for lambda1, lambda2 in ((2.0, 0.25), (1.0, 0.1), (0.5, 0.1)):
        for contact in (0.0, 0.1, 0.25, None):
            failsafe = False if contact is None else jssa_gym.FailsafeParams(contact_speed={"right_arm": contact})
            name = f"λ ({lambda1:g}, {lambda2:g}), " + ("no stop" if contact is None else f"contact {contact:g}")
            options = {"lambda1": lambda1, "lambda2": lambda2, "failsafe": failsafe}
            yield name, lambda env, options=options: jssa_gym.JSSAShield(env, **options)
    for contact in (0.0, 0.1, 0.15, 0.2):
        stop = jssa_gym.FailsafeParams(contact_speed={"right_arm": contact})
        yield f"stop, contact {contact:g}", lambda env, stop=stop: jssa_gym.Shield(env, "stop", stop=stop)
    allowed = jssa_gym.FailsafeParams(contact_speed={"right_arm": 0.25})
    for d_min in (0.02, 0.09, 0.15):
        options = {"lambda1": 1.0, "lambda2": 0.1, "d_min": d_min, "failsafe": allowed}
        yield f"λ (1, 0.1), contact 0.25, d_min {d_min:g}", lambda env, o=options: jssa_gym.JSSAShield(env, **o)


def play(env, policy, seed, steps):
    """Time of success [s] or None, smallest distance [m], largest speed of a contact [m/s], share of interventions,
    and the smallest way left [m]."""
    observation, info = env.reset(seed=seed)
    nearest, fastest, touched, left = info["distance"], 0.0, 0, np.inf
    for k in range(steps):
        observation, _, _, _, info = env.step(policy(observation))
        nearest, fastest = min(nearest, info["distance"]), max(fastest, info["contact_speed"])
        touched += info.get("shield/intervened", False)
        left = min(left, -info["reward/handover"])
        if info["success"]:
            return (k + 1) * 0.008, nearest, fastest, touched / (k + 1), left
    return None, nearest, fastest, touched / steps, left


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--policy", choices=("straight", "jpc", "jpc_paper"), default="straight")
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--only", nargs="*", default=[""], help="shields whose name contains one of these")
    parser.add_argument("--stay", type=float, help="how long the hand is held out [s]; the task's own without")
    arguments = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    steps = round(arguments.seconds / 0.008)
    print(
        "shield                                success  median time [s]  90 %   nearest [m]  contact [m/s]"
        "  intervened  left [m]"
    )
    for name, wrap in shields():
        if not any(word in name for word in arguments.only):
            continue
        human = None if arguments.stay is None else Receive(stay=(arguments.stay, arguments.stay))
        env = wrap(gym.make("jssa_gym/Handover-v0", human=human, terminate_on=(), max_episode_steps=steps + 1))
        policy = POLICIES[arguments.policy](env, 0)
        seen = [play(env, policy, seed, steps) for seed in range(arguments.seed, arguments.seed + arguments.episodes)]
        times = sorted(arguments.seconds if time is None else time for time, *_ in seen)
        won = sum(time is not None for time, *_ in seen)
        print(
            f"{name:<37} {won:>3}/{len(seen):<3}  {statistics.median(times):>15.2f}  {times[int(0.9 * len(times))]:.2f}"
            f"  {min(s[1] for s in seen):>12.3f}  {max(s[2] for s in seen):>13.3f}"
            f"  {statistics.mean(s[3] for s in seen):>10.2f}  {statistics.median(s[4] for s in seen):>8.3f}"
        )


if __name__ == "__main__":
    main()
