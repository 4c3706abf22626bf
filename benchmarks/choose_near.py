"""Which λ does `jssa_near` get: the one that gives way late enough for the task and early enough for the person?

An arm with the whole shield is to be at home at the end of an episode, with nobody touched on the way: beside people
who wander about, which asks for giving way late, and people who walk up to it and back, which asks for it early. Chosen
is the pair with the most such episodes in both cells together, among equals the one that touches fewest people.
The seeds are for tuning; evaluations use others.

    python benchmarks/choose_near.py --jobs 2
    python benchmarks/choose_near.py --only 0.45,0.1
"""

import argparse
import functools

import gymnasium as gym

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate

TUNING = 700_000
"""First seed."""

PAIRS = ((2.0, 0.25), (0.5, 0.1), (0.4, 0.1), (0.4, 0.05), (0.35, 0.1), (0.35, 0.05), (0.3, 0.1), (0.3, 0.05))

PEOPLE = ("random", "approach_retreat")


def build(human: str, pair: tuple[float, ...] | None) -> gym.Env:
    """The arm at home beside somebody; without a pair the verified stop alone."""
    env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
    if pair is None:
        return jssa_gym.Shield(env, "stop")
    return jssa_gym.Shield(env, "jssa", stop=True, lambda1=pair[0], lambda2=pair[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=300, help="per cell and candidate")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", action="append", help="lambda1,lambda2 instead of all pairs and the stop")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    for pair in [tuple(map(float, one.split(","))) for one in args.only] if args.only else (*PAIRS, None):
        for human in PEOPLE:
            report = jssa_gym.evaluate(
                functools.partial(build, human, pair), "jpc", args.episodes, TUNING, jobs=args.jobs
            )
            ends = [episode.summary for episode in report.episodes]
            good = Rate.of(sum(e.success and not e.collision for e in ends), len(ends))
            touched = Rate.of(sum(e.collision for e in ends), len(ends))
            print(f"{pair or 'stop alone'}, {human}: at home, nobody touched {good}; touched {touched}", flush=True)


if __name__ == "__main__":
    main()
