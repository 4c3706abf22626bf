"""What a control step of an evaluation or a campaign costs, played one by one and at once, in the same process.

    python benchmarks/campaign_rate.py

Processor time from reset to row, metrics included, an episode's step [µs]: medians over rounds in which single and
batched play take turns, after a round that warms up. ``--episodes`` says how many are played at once; single play is
measured on the first few of them. The last rows are cells of the campaign ``claim``, with its 12 episodes a cell.
"""

import argparse
import json
import time

POLICIES = ("random", "straight", "reach-sac")
FILTERS = ("none", "stop", "jssa+stop", "work")
FAULTS = ("none", "noise", "all that is reported", "missed ticks")
ALONE = 3
"""Episodes that are played one by one in a round."""


def _timed(rows, steps: int) -> float:
    """Processor time of a step of playing and measuring episodes [µs]."""
    start = time.process_time()
    count = sum(1 for _ in rows)
    return (time.process_time() - start) / (count * steps) * 1e6


def costs(plans: dict, rounds: int) -> dict:
    """Medians of processor time of a step [µs], one by one and at once, by the plans' names."""
    import numpy as np

    from jssa_gym.evaluation.play import Player

    found = {}
    for name, plan in plans.items():
        ((cell, seeds),) = plan.seeds().items()
        player, alone, together = Player(plan, cell), [], []
        for number in range(rounds + 1):
            single = _timed(map(player.measure, seeds[:ALONE]), plan.steps)
            batched = _timed(player.measure_all(seeds), plan.steps)
            if number:  # the first warms up
                alone.append(single)
                together.append(batched)
        found[name] = {"single": float(np.median(alone)), "at once": float(np.median(together))}
    return found


def plans(episodes: int, steps: int) -> dict:
    """What is played, by name: settings of an evaluation beside ``walk_by``, and cells of the campaign ``claim``."""
    from jssa_gym.evaluation.campaign import PRESETS, Campaign, Grid
    from jssa_gym.evaluation.study import Study

    found: dict = {
        f"reach, {policy}, {name}": Study(("reach",), (name,), ("walk_by",), (policy,), episodes=episodes, steps=steps)
        for policy in POLICIES
        for name in FILTERS
    }
    (claim,) = PRESETS["claim"]
    for fault in FAULTS:
        grid = Grid(claim.filters, ("pursuit",), ("wander",), (fault,), min(claim.episodes, episodes))
        found[f"claim, wander, pursuit, {fault}"] = Campaign((grid,), steps=steps)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    from jssa_gym.evaluation.identity import made_with

    found = costs(plans(options.episodes, options.steps), options.rounds)
    if options.json:
        print(json.dumps({"made with": made_with()} | found, indent=1))
        return
    print(made_with())
    print(f"{'':45}{'single':>9}{'at once':>9}")
    for name, cost in found.items():
        ratio = cost["single"] / cost["at once"]
        print(f"{name:45}{cost['single']:9.1f}{cost['at once']:9.1f}  ({ratio:.1f} x)")


if __name__ == "__main__":
    main()
