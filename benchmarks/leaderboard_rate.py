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
from itertools import product
from pathlib import Path

PEOPLE = ("random", "walk_by", "approach_retreat", "pursuit", "hand")
PARTS = (
    (("home",), PEOPLE, ("jpc", "random")),
    (("reach", "track"), PEOPLE, ("jpc",)),
    (("handover",), (*PEOPLE, "receive"), ("jpc",)),
    (("reach",), PEOPLE, ("random",)),
)
"""Tasks, people and policies, as docs/leaderboard.md has them."""

STEPS = 1000
"""Of an episode: 8 s."""

TIMES = ("shield_p50", "shield_p95", "shield_p99", "shield_max", "deadline_miss_rate")
"""Of a summary, what is no other tree's."""


def serve() -> None:
    """Play the cells that are asked for on the standard input, a line each."""
    from jssa_gym.evaluation.identity import made_with
    from jssa_gym.evaluation.play import Player
    from jssa_gym.evaluation.study import Study

    print(made_with(), flush=True)
    for line in sys.stdin:
        *names, seed, episodes, steps = json.loads(line)
        study = Study(*((name,) for name in names), episodes=episodes, seed=seed, steps=steps)
        ((cell, seeds),) = study.seeds().items()
        start = time.process_time()
        rows = list(Player(study, cell).measure_all(seeds))
        print(json.dumps((time.process_time() - start, [_untimed(row) for row in rows])), flush=True)


def _untimed(row) -> str:
    """What a row says, but for how long anything took."""
    said = dataclasses.asdict(row) | dataclasses.asdict(row.summary)
    return repr([(name, value) for name, value in said.items() if name not in ("summary", "wall", *TIMES)])


class Tree:
    """A process that plays with the package of a folder."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.resolve().name
        # OpenBLAS' threads wait for each other where there are fewer cores
        env = os.environ | {"PYTHONPATH": str(folder.resolve()), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve"], env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.made_with = self._process.stdout.readline().strip()

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
    for tree in trees:
        print(f"{tree.name}: {tree.made_with}")
    print(f"processor time of an episode [ms]\n{'':40}{''.join(f'{tree.name:>12}' for tree in trees)}")
    total, differ, episodes = [0.0] * len(trees), [0] * len(trees), 0
    for tasks, people, policies in PARTS:
        people = [human for human in people if human in (options.humans or people)]
        for task, policy, name in product(tasks, policies, options.filters):
            spent = [0.0] * len(trees)
            for human in people:
                for tree in trees:  # compiles
                    tree.play(task, name, human, policy, 0, 4, 20)
                asked = task, name, human, policy, options.seed, options.episodes, STEPS
                played = [tree.play(*asked) for tree in trees]
                for k, (seconds, rows) in enumerate(played):
                    spent[k] += seconds
                    differ[k] += sum(a != b for a, b in zip(rows, played[0][1], strict=True))
            _tell(f"{task}, {policy}, {name}", spent, len(people) * options.episodes)
            total = [sum(both) for both in zip(total, spent, strict=True)]
            episodes += len(people) * options.episodes
    _tell(f"all {episodes}", total, episodes)
    print(f"rows that differ: {', '.join(map(str, differ))}")


def _tell(what: str, seconds: list[float], episodes: int) -> None:
    print(f"{what:40}" + "".join(f"{1e3 * spent / episodes:12.1f}" for spent in seconds), flush=True)


if __name__ == "__main__":
    main()
