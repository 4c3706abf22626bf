"""What a step of many environments at once costs an arm, beside a single environment in the same process.

    python benchmarks/vector_step.py

Processor time an arm: medians over rounds in which the single environment and every vector take turns. Everybody
walks (``human="random"``, or as ``--human`` says), policies wander about home, episodes do not end. Then the memory of
an environment, and what an arm of a large vector costs beside one of 256. ``--json`` writes all numbers.
"""

import argparse
import json
import time

SHIELDS = {"environment alone": None, "JSSA with all rows": "jssa", "all layers": {}}
COUNTS = (1, 64, 256, 4096)


def _policy(count: int, n: int):
    """Jerks that keep arms moving about where they are, one array a step, for ever."""
    import numpy as np

    rng, k = np.random.default_rng(0), 0
    drawn = 0.3 * rng.choice([-1.0, 1.0], (count, n))
    while True:
        yield drawn * (1.0 if (k // 8) % 2 else -1.0)
        k += 1


def _timed(env, actions, steps: int, count: int) -> float:
    """Processor time of a step, an arm [µs]."""
    start = time.process_time()
    for _ in range(steps):
        env.step(next(actions))
    return (time.process_time() - start) / steps / count * 1e6


def costs(counts: tuple[int, ...], rounds: int, human: str) -> dict:
    """Medians of processor time an arm and step [µs], by shield and number of arms; "single" is the single one."""
    import gymnasium as gym
    import numpy as np

    import jssa_gym

    found: dict = {}
    for name, shield in SHIELDS.items():
        same = {"human": human, "terminate_on": (), "max_episode_steps": 10**9}
        single = gym.make("jssa_gym/Reach-v0", disable_env_checker=True, **same)
        if isinstance(shield, str):
            single = jssa_gym.Shield(single, shield)
        elif shield is not None:
            single = jssa_gym.JSSAShield(single)
        single.reset(seed=0)
        stepped = {"single": (single, (action[0] for action in _policy(1, 6)), 200, 1)}
        for count in counts:
            many = gym.make_vec("jssa_gym/Reach-v0", count, shield=shield, **same)
            many.reset(seed=0)
            stepped[str(count)] = (many, _policy(count, 6), max(4, 400 // count), count)
        times: dict = {key: [] for key in stepped}
        for number in range(rounds + 1):
            for key, what in stepped.items():
                took = _timed(*what)
                if number:  # the first warms up
                    times[key].append(took)
        found[name] = {key: float(np.median(values)) for key, values in times.items()}
    return found


def memory(count: int, human: str) -> float:
    """Memory that ``count`` shielded environments hold, an environment [KiB]: what Python and NumPy allocate."""
    import tracemalloc

    import gymnasium as gym

    small = gym.make_vec("jssa_gym/Reach-v0", 2, shield={}, human=human)
    small.reset(seed=0)
    small.step(next(_policy(2, 6)))  # what all share is there
    tracemalloc.start()
    many = gym.make_vec("jssa_gym/Reach-v0", count, shield={}, human=human)
    many.reset(seed=0)
    for _ in range(3):
        many.step(next(_policy(count, 6)))
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    many.close()
    return held / count / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--human", default="random", help="people by name; default: random")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    from jssa_gym.evaluation.identity import made_with

    found = {"cost": costs(COUNTS, options.rounds, options.human)}
    large = costs((256, 16384), 3, options.human)
    found["16384 beside 256"] = {name: times["16384"] / times["256"] for name, times in large.items()}
    found["KiB an environment"] = memory(2048, options.human)
    if options.json:
        print(json.dumps({"made with": made_with()} | found, indent=1))
        return
    print(made_with())
    print(f"{'':20}" + "".join(f"{key:>17}" for key in ("single", *COUNTS)))
    for name, times in found["cost"].items():
        alone = times["single"]
        shown = [f"{times[str(key)]:6.1f} ({alone / times[str(key)]:4.1f} x)" for key in COUNTS]
        print(f"{name:20}{alone:17.1f}" + "".join(f"{text:>17}" for text in shown))
    for name, ratio in found["16384 beside 256"].items():
        print(f"{name}: an arm of 16,384 costs {ratio:.2f} times one of 256")
    print(f"{found['KiB an environment']:.1f} KiB an environment, all layers")


if __name__ == "__main__":
    main()
