"""What episodes of the leaderboard cost in processor time, part by part; of several trees, side by side.

    python benchmarks/leaderboard_rate.py
    python benchmarks/leaderboard_rate.py . ../before

A tree is a folder with the package in it. Every tree plays the same episodes, each cell in turn with the others' and in
one process: seconds an episode from reset to row, metrics included, without what starting and compiling take. Rows are
compared but for their times: how many differ from the first tree's is printed last.
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

PEOPLE = ("random", "walk_by", "approach_retreat", "pursuit", "hand")
PARTS = (
    (("home",), PEOPLE, ("jpc", "random")),
    (("reach", "track"), PEOPLE, ("jpc",)),
    (("handover",), (*PEOPLE, "receive"), ("jpc",)),
    (("reach",), PEOPLE, ("random",)),
)
"""Tasks, people and policies, as docs/leaderboard.md has them."""


def serve() -> None:
    """Play the cells that are asked for on the standard input, a line each."""
    from jssa_gym.evaluation.play import Player
    from jssa_gym.evaluation.study import Study

    for line in sys.stdin:
        tasks, filters, humans, policies, seed, episodes = json.loads(line)
        study = Study((tasks,), (filters,), (humans,), (policies,), episodes=episodes, seed=seed)
        ((cell, seeds),) = study.seeds().items()
        start = time.process_time()
        rows = list(Player(study, cell).measure_all(seeds))
        spent = time.process_time() - start
        print(json.dumps((spent, [repr(dataclasses.replace(row, wall=0.0)) for row in rows])), flush=True)


class Tree:
    """A process that plays with the package of a folder."""

    def __init__(self, folder: Path) -> None:
        # OpenBLAS' threads wait for each other where there are fewer cores
        env = os.environ | {"PYTHONPATH": str(folder.resolve()), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve"], env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def play(self, *asked) -> tuple[float, list[str]]:
        """Processor time [s] and rows of a cell."""
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("trees", type=Path, nargs="*", default=[Path()])
    parser.add_argument("--filters", nargs="+", default=["none", "jssa+stop", "work"])
    parser.add_argument("--humans", nargs="+", help="people, of those of the leaderboard")
    parser.add_argument("--episodes", type=int, default=50, help="of a cell; they are played at once")
    parser.add_argument("--seed", type=int, default=6_100_000)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
        return
    trees = [Tree(folder) for folder in options.trees]
    spent, count, differ = defaultdict(lambda: [0.0] * len(trees)), defaultdict(int), [0] * len(trees)
    for tasks, people, policies in PARTS:
        for task in tasks:
            for policy in policies:
                for name in options.filters:
                    for tree in trees:  # compiles
                        tree.play(task, name, people[0], policy, 0, 4)
                    for human in people:
                        if options.humans and human not in options.humans:
                            continue
                        played = [
                            tree.play(task, name, human, policy, options.seed, options.episodes) for tree in trees
                        ]
                        count[task, policy, name] += options.episodes
                        for k, (seconds, rows) in enumerate(played):
                            spent[task, policy, name][k] += seconds
                            differ[k] += sum(a != b for a, b in zip(rows, played[0][1], strict=True))
    heads = "".join(f"{folder.name or 'here':>12}" for folder in options.trees)
    print(f"processor time of an episode [ms]\n{'':40}{heads}")
    for key, seconds in spent.items():
        print(f"{', '.join(key):40}" + "".join(f"{1e3 * s / count[key]:12.1f}" for s in seconds))
    total = sum(count.values())
    means = [1e3 * sum(s[k] for s in spent.values()) / total for k in range(len(trees))]
    print(f"{f'all {total}':40}" + "".join(f"{mean:12.1f}" for mean in means))
    print(f"rows that differ: {', '.join(map(str, differ))}")


if __name__ == "__main__":
    main()
