"""Tables of a comparison for the docs: cell by cell, and where one filter is not the best.

    jssa-gym compare --tasks ... --filters ... --out board
    python benchmarks/leaderboard.py board

Several folders are one table; none may repeat a cell of another. The first filter, or those of --ours, are compared
with every other one in every cell (task, people, policy) on the same seeds: "behind" means that the 95 % interval of
the paired difference excludes 0 to its disadvantage. Many cells and thirteen rivals make some by chance. A cell counts
only where ours and every rival have the same seeds. Success without contact is success in an episode in which nobody
was touched, by an arm at rest neither. How the arm moves and how long it takes is told of episodes that have these
columns; folders of older versions have not. --rivals names those that count; by default all.
"""

import argparse
import csv
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.leaderboard import UNFILTERED
from jssa_gym.evaluation.slowdown import Slowdown
from jssa_gym.evaluation.statistics import Rate, paired_difference, short
from jssa_gym.palette import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = tuple[str, str, str]
Episodes = dict[Cell, dict[str, dict[int, dict[str, float]]]]
"""By cell, filter and seed."""

ASKED = {"moving contact": -1, "success without contact": 1}
"""What is compared; whether more is better."""

YES_OR_NO = {"1": True, "True": True, "0": False, "False": False}
"""What else stands in a file is an error, not a no."""


MOTION = {
    "jerk_jumps_shield": ("steps with a jump of the jerk by the shield", 100.0, " %"),
    "jerk_jumps_nominal": ("by the policy", 100.0, " %"),
    "status_switches": ("status switches", 1.0, " /s"),
    "jerk_rms": ("RMS jerk, of its bound", 100.0, " %"),
}
"""How an arm moves: columns, what they are called, and their scale and unit there."""


def read(folders: Sequence[Path]) -> Episodes:
    """The episodes of comparisons' folders."""
    found: Episodes = defaultdict(lambda: defaultdict(dict))
    for folder in folders:
        before = set(found)
        try:
            with (folder / "episodes.csv").open(newline="") as file:
                rows = list(csv.DictReader(file))
        except OSError as error:
            raise SystemExit(f"{folder} holds no comparison: {error}") from error
        for row in rows:
            contact, success, moving = (YES_OR_NO[row[x]] for x in ("collision", "success", "moving_contact"))
            cell = (row["task"], row["human"], row["policy"])
            if cell in before:
                raise SystemExit(f"{folder} repeats the cell {', '.join(cell)}")
            found[cell][row["filter"]][int(row["seed"])] = {
                "contact": contact,
                "moving contact": moving,
                "success": success,
                "success without contact": success and not contact,
                "limit violation": not float(row["limit_violation_rate"]) <= 0.0,
                "contact speed": float(row["contact_speed"]),
                **{name: float(row.get(name) or "nan") for name in (*MOTION, "time_to_goal")},
            }
    return found


def rate(episodes: Sequence[dict[str, float]], name: str) -> Rate:
    """How often something happened."""
    return Rate.of(sum(bool(episode[name]) for episode in episodes), len(episodes))


def comparable(cell: dict[str, dict[int, dict[str, float]]], filters: Sequence[str]) -> bool:
    """Whether all of them met the same seeds."""
    return all(cell[name] and cell[name].keys() == cell[filters[0]].keys() for name in filters)


def behind(cell: dict[str, dict[int, dict[str, float]]], ours: str, rival: str, name: str) -> float | None:
    """By how much a rival does better; None where the interval has 0 in it."""
    seeds = sorted(cell[ours])
    difference = paired_difference(
        np.array([cell[rival][seed][name] for seed in seeds], float),
        np.array([cell[ours][seed][name] for seed in seeds], float),
    )
    low, high = sorted((ASKED[name] * difference.low, ASKED[name] * difference.high))
    return abs(difference.value) if low > 0.0 and high > 0.0 else None


def overview(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> None:
    """One line a filter, over everything; success over the episodes of the policies that want it."""
    wanted = f"success without contact, of `{'`, `'.join(policies)}`"
    print(f"| filter | moving contact | any contact | limit exceeded | {wanted} | of these, within all limits |")
    print("|---|---|---|---|---|---|")
    for name in filters:
        episodes = [one for cell in found.values() for one in cell[name].values()]
        told = [rate(episodes, x) for x in ("moving contact", "contact", "limit violation")]
        trying = [one for key, cell in found.items() if key[2] in policies for one in cell[name].values()]
        succeeded = rate(trying, "success without contact")
        within = sum(bool(one["success without contact"] and not one["limit violation"]) for one in trying)
        print(f"| `{name}` | {' | '.join(map(str, (*told, succeeded, f'{within:,}')))} |")


def moving(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> None:
    """One line a filter that had moving contacts: how fast they were, and whether the arm kept its limits."""
    told = ("moving contact", "their median, largest speed [m/s]", "of these with a limit exceeded", "limit exceeded")
    print(f"\n| filter | {' | '.join(f'`{policy}`: {text}' for policy in policies for text in told)} |")
    print("|---|" + "---|" * len(told) * len(policies))
    for name in filters:
        line, some = [f"`{name}`"], False
        for policy in policies:
            episodes = [one for key, cell in found.items() if key[2] == policy for one in cell[name].values()]
            hits = [one for one in episodes if one["moving contact"]]
            speeds = [one["contact speed"] for one in hits]
            line += [
                f"{len(hits):,} / {len(episodes):,}",
                f"{short(float(np.median(speeds)))}, {short(max(speeds))}" if hits else "",
                f"{sum(one['limit violation'] for one in hits):,}",
                f"{sum(one['limit violation'] for one in episodes):,}",
            ]
            some = some or bool(hits)
        if some:
            print(f"| {' | '.join(line)} |")


def motion(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> None:
    """One line a filter, over the episodes of the policies that want to succeed: how the arm moves, how long it takes.

    Times are of the tasks that have a way to go, not of Home; they are compared with no filter on the same episodes.
    """
    wanted = {key: cell for key, cell in found.items() if key[2] in policies}
    timed = [cell for key, cell in wanted.items() if key[0] not in TASKS or TASKS[key[0]].ends]
    titles = [title for title, *_ in MOTION.values()]
    told = [*titles, "median time to the goal", f"its ratio to `{UNFILTERED}`, and goals lost"]
    print(f"\n| filter, of `{'`, `'.join(policies)}` | {' | '.join(told)} |\n|---|{'---|' * len(told)}")
    for name in filters:
        line = []
        for metric, (_, scale, unit) in MOTION.items():
            known = values(wanted.values(), name, metric)
            known = known[~np.isnan(known)]
            line.append(f"{short(scale * float(known.mean()))}{unit}" if len(known) else "-")
        times = values(timed, name, "time_to_goal")
        there = ~np.isnan(times)
        line.append(f"{short(float(np.median(times[there])))} s" if there.any() else "-")
        line.append(cost(timed, name) if name != UNFILTERED and UNFILTERED in filters else "-")
        print(f"| `{name}` | {' | '.join(line)} |")


def cost(cells: Sequence[dict[str, dict[int, dict[str, float]]]], name: str) -> str:
    """What a filter costs in time, goal by goal."""
    found = Slowdown.of(*(values(cells, who, of) for who in (name, UNFILTERED) for of in ("time_to_goal", "success")))
    return "-" if found is None else found.brief


def values(cells: Iterable[dict[str, dict[int, dict[str, float]]]], name: str, metric: str) -> NDArray[np.float64]:
    """A metric of a filter in all cells' episodes, in the order of cells and seeds."""
    return np.array([cell[name][seed][metric] for cell in cells for seed in sorted(cell[name])], float)


def by_cell(found: Episodes, filters: Sequence[str], name: str, policy: str) -> None:
    """One line a task and kind of people, one column a filter: per cent."""
    print(f"\n{name}, policy `{policy}`, per cent\n\n| task, people | {' | '.join(f'`{f}`' for f in filters)} |")
    print("|---|" + "---|" * len(filters))
    for (task, human, who), cell in found.items():
        if who == policy:
            shares = (
                f"{100.0 * float(np.mean([e[name] for e in cell[f].values()])):.0f}" if cell[f] else "" for f in filters
            )
            print(f"| {task}, `{human}` | {' | '.join(shares)} |")


def verdicts(found: Episodes, ours: str, rivals: Sequence[str], policies: Sequence[str]) -> None:
    """Cells in which somebody is better than ours."""
    for name, who in (("moving contact", None), ("success without contact", policies)):
        cells = {key: cell for key, cell in found.items() if who is None or key[2] in who}
        worse = {
            key: found_behind
            for key, cell in cells.items()
            if (found_behind := {r: x for r in rivals if (x := behind(cell, ours, r, name)) is not None})
        }
        empty = sum(not any(e[name] for one in cell.values() for e in one.values()) for cell in cells.values())
        print(
            f"\n`{ours}` on {name}: first or tied in {len(cells) - len(worse)} of {len(cells)} cells, in {empty} of "
            f"which there is none by any filter"
        )
        for key, others in worse.items():
            told = ", ".join(f"`{rival}` by {100 * x:.0f}" for rival, x in sorted(others.items(), key=lambda t: -t[1]))
            print(f"- {', '.join(key)}: behind {told} (per cent)")
        pooled = {
            r: [(e[name], cell[r][s][name]) for cell in cells.values() for s, e in cell[ours].items()] for r in rivals
        }
        for rival, pairs in pooled.items():
            one, other = np.array(pairs, float).T
            more = paired_difference(other, one)
            least, most = 100 * more.low, 100 * more.high
            print(f"- over all, `{rival}` minus it: {100 * more.value:+.1f} of 100 ({least:.1f} to {most:.1f})")


def draw(found: Episodes, filters: Sequence[str], policies: Sequence[str], path: Path) -> None:
    """Moving contacts of everything against success without contact of the policies that want it, with intervals."""
    from jssa_gym.plots.style import styled  # the tables do without

    styled(_scatter)(found, filters, policies).savefig(path, dpi=110)


def _scatter(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(filters):
        everything = [e for cell in found.values() for e in cell[name].values()]
        wanted = [e for key, cell in found.items() if key[2] in policies for e in cell[name].values()]
        x, y = rate(everything, "moving contact"), rate(wanted, "success without contact")
        spread = [[[100 * (r.value - r.low)], [100 * (r.high - r.value)]] for r in (x, y)]
        # a colour comes again with another shape; hollow ones have no verified stop
        shape = "osD^v"[k // len(COLOURS) % 5]
        fill = "full" if name.endswith("+stop") or name == "stop" else "none"
        style = {"marker": shape, "fillstyle": fill, "color": COLOURS[k % len(COLOURS)], "markersize": 8}
        axes.errorbar(100 * x.value, 100 * y.value, spread[1], spread[0], label=name, elinewidth=1.0, **style)
    axes.set(xlabel="episodes with a moving contact [%]", ylabel="success without a contact [%]")
    figure.legend(loc="outside right upper", title="filled: verified stop")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--ours", nargs="*", help="filters that are compared with the others; the first by default")
    parser.add_argument("--rivals", nargs="*", help="filters that count as others; all by default")
    parser.add_argument("--purposeful", nargs="*", default=["jpc"], help="policies that want to succeed")
    parser.add_argument("--figure", type=Path, help="draw safety against success into this file")
    args = parser.parse_args()
    found = read(args.folders)
    filters = list(dict.fromkeys(name for cell in found.values() for name in cell))
    policies = list(dict.fromkeys(key[2] for key in found))
    for option, names, known in (
        ("--ours", args.ours, filters),
        ("--rivals", args.rivals, filters),
        ("--purposeful", args.purposeful, policies),
    ):
        if missing := sorted({*(names or ())} - {*known}):
            parser.error(f"{option}: nothing of {', '.join(missing)} in there; there is {', '.join(known)}")
    if short := [key for key, cell in found.items() if not comparable(cell, filters)]:
        print(f"incomplete, and so left out: {'; '.join(', '.join(key) for key in short)}\n")
    found = {key: cell for key, cell in found.items() if key not in short}
    if not found:
        parser.error("no cell in which all filters have the same seeds")
    overview(found, filters, args.purposeful)
    moving(found, filters, policies)
    motion(found, filters, args.purposeful)
    for policy in policies:
        by_cell(found, filters, "success without contact", policy)
        by_cell(found, filters, "moving contact", policy)
    for ours in args.ours or filters[:1]:
        rivals = [name for name in (args.rivals or filters) if name != ours]
        verdicts(found, ours, rivals, args.purposeful)
    if args.figure:
        draw(found, filters, args.purposeful, args.figure)


if __name__ == "__main__":
    main()
