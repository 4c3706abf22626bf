"""How much energy do contacts have that a shield admits by energy, and those that it admits only at rest?

People who are out to touch the arm, policies that move it all the time, the verified stop alone: without it, with the
arm at rest in every contact, and with ``contact_energy``. The energy is of the arm's own motion, over the body part's
limit; indicative, as the limits are. About two minutes of one core::

    python benchmarks/contact_energy.py
"""

import argparse
from collections.abc import Iterator
from typing import Any

import gymnasium as gym

from jssa_gym.evaluation import Summary, geometry, make_policy, rollout, summarise
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.people import make_person
from jssa_gym.evaluation.statistics import Rate, short
from jssa_gym.safety.energy import CONTACT_ENERGY
from jssa_gym.shields import Shield

HUMANS = ("pursuit", "hand", "two")
POLICIES = ("chase", "random")
STOPS: dict[str, Any] = {
    "no shield": None,
    "at rest": True,
    "`contact_energy`": {"contact_energy": dict(CONTACT_ENERGY)},
}
POLICY_SEEDS = 10**9


def played(stop: Any, episodes: int) -> Iterator[Summary]:
    for human in HUMANS:
        for policy in POLICIES:
            for seed in range(7000, 7000 + episodes):
                env: gym.Env = gym.make("jssa_gym/Home-v0", human=make_person(human), terminate_on=())
                robot = env.unwrapped.robot  # ty: ignore[unresolved-attribute]
                if stop is not None:
                    env = Shield(env, "stop", stop=stop)
                acting = make_policy(policy, env.unwrapped, POLICY_SEEDS + seed, seen=env)
                trace = rollout(env, acting, seed=seed, steps=500)
                yield summarise(trace, robot.limits, geometry(trace, robot))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=10, help="of every kind of people and policy")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    print("| contacts | touched | moving contact | fastest | above the energy | largest share of it | limit exceeded |")
    print("|---|---|---|---|---|---|---|")
    for name, stop in STOPS.items():
        told = list(played(stop, args.episodes))
        ratios = [one.energy_ratio or 0.0 for one in told]
        counts = (
            sum(one.collision for one in told),
            sum(one.moving_contact for one in told),
            sum(ratio > 1.0 for ratio in ratios),
            sum(one.limits_exceeded for one in told),
        )
        touched, moving, above, exceeded = (str(Rate.of(k, len(told))) for k in counts)
        fastest, most = short(max(one.contact_speed for one in told)), short(max(ratios))
        print(f"| {name} | {touched} | {moving} | {fastest} m/s | {above} | {most} | {exceeded} |", flush=True)


if __name__ == "__main__":
    main()
