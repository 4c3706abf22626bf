"""Tables of a comparison for the docs: cell by cell, and where one filter is not the best.

"Behind" means that the 95 % interval of the paired difference excludes 0 to a filter's disadvantage; many cells and
rivals make some by chance. A cell counts only where all have the same seeds. Success without contact is success in an
episode in which nobody was touched, by an arm at rest neither.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from jssa_gym.board.episodes import MOTION, BoardCell, Episodes
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.slowdown import Slowdown
from jssa_gym.evaluation.standings import UNFILTERED
from jssa_gym.evaluation.statistics import Rate, paired_difference, short

ASKED = {"moving contact": -1, "success without contact": 1}
"""What is compared; whether more is better."""

_TITLES = (
    ("steps with a jump of the jerk by the shield", 100.0, " %"),
    ("by the policy", 100.0, " %"),
    ("status switches", 1.0, " /s"),
    ("RMS jerk, of its bound", 100.0, " %"),
)
MOTION_TITLES = dict(zip(MOTION, _TITLES, strict=True))
"""How an arm moves: columns, what they are called, and their scale and unit there."""


def all_tables(
    found: Episodes, ours: Sequence[str], rivals: Sequence[str] | None = None, purposeful: Sequence[str] = ("jpc",)
) -> Iterator[str]:
    """All tables, line by line.

    Args:
        found: Cells in which every filter has the same seeds, see :func:`complete_cells`.
        ours: Filters that are compared with the others.
        rivals: The others; None for all.
        purposeful: Policies that want to succeed.
    """
    filters, policies = filters_of(found), policies_of(found)
    yield from overview(found, filters, purposeful)
    yield from moving(found, filters, policies)
    yield from motion(found, filters, purposeful)
    for policy in policies:
        yield from by_cell(found, filters, "success without contact", policy)
        yield from by_cell(found, filters, "moving contact", policy)
    for name in ours:
        others = [one for one in (filters if rivals is None else rivals) if one != name]
        yield from verdicts(found, name, others, purposeful)


def filters_of(found: Episodes) -> list[str]:
    """All filters, in their order."""
    return list(dict.fromkeys(name for cell in found.values() for name in cell))


def policies_of(found: Episodes) -> list[str]:
    """All policies, in their order."""
    return list(dict.fromkeys(policy for _, _, policy in found))


def complete_cells(found: Episodes) -> tuple[Episodes, list[BoardCell]]:
    """Cells in which every filter has the same seeds, and those that are left out."""
    filters = filters_of(found)
    short = [key for key, cell in found.items() if not comparable(cell, filters)]
    return {key: cell for key, cell in found.items() if key not in short}, short


def rate(episodes: Sequence[dict[str, float]], name: str) -> Rate:
    """How often something happened."""
    return Rate.of(sum(bool(episode[name]) for episode in episodes), len(episodes))


def comparable(cell: dict[str, dict[int, dict[str, float]]], filters: Sequence[str]) -> bool:
    """Whether all of them met the same seeds."""
    return all(cell[name] and cell[name].keys() == cell[filters[0]].keys() for name in filters)


def behind(cell: dict[str, dict[int, dict[str, float]]], ours: str, rival: str, name: str) -> float | None:
    """How much better a rival does; None where the interval has 0 in it."""
    seeds = sorted(cell[ours])
    difference = paired_difference(
        np.array([cell[rival][seed][name] for seed in seeds], float),
        np.array([cell[ours][seed][name] for seed in seeds], float),
    )
    low, high = sorted((ASKED[name] * difference.low, ASKED[name] * difference.high))
    return abs(difference.value) if low > 0.0 and high > 0.0 else None


def overview(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> Iterator[str]:
    """One line a filter, over everything; success over the episodes of the policies that want it."""
    wanted = f"success without contact, of `{'`, `'.join(policies)}`"
    yield f"| filter | moving contact | any contact | limit exceeded | {wanted} | of these, within all limits |"
    yield "|---|---|---|---|---|---|"
    for name in filters:
        episodes = [one for cell in found.values() for one in cell[name].values()]
        told = [rate(episodes, x) for x in ("moving contact", "contact", "limit violation")]
        trying = [one for key, cell in found.items() if key[2] in policies for one in cell[name].values()]
        succeeded = rate(trying, "success without contact")
        within = sum(bool(one["success without contact"] and not one["limit violation"]) for one in trying)
        yield f"| `{name}` | {' | '.join(map(str, (*told, succeeded, f'{within:,}')))} |"


def moving(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> Iterator[str]:
    """One line a filter that had moving contacts: how fast they were, and whether the arm kept its limits."""
    told = ("moving contact", "their median, largest speed [m/s]", "of these with a limit exceeded", "limit exceeded")
    yield f"\n| filter | {' | '.join(f'`{policy}`: {text}' for policy in policies for text in told)} |"
    yield "|---|" + "---|" * len(told) * len(policies)
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
            yield f"| {' | '.join(line)} |"


def motion(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> Iterator[str]:
    """One line a filter, over the episodes of the policies that want to succeed: how the arm moves, how long it takes.

    Times are of the tasks that have a way to go, not of Home; they are compared with no filter on the same episodes.
    """
    wanted = {key: cell for key, cell in found.items() if key[2] in policies}
    timed = [cell for key, cell in wanted.items() if key[0] not in TASKS or TASKS[key[0]].ends]
    titles = [title for title, *_ in MOTION_TITLES.values()]
    told = [*titles, "median time to the goal", f"its ratio to `{UNFILTERED}`, and goals lost"]
    yield f"\n| filter, of `{'`, `'.join(policies)}` | {' | '.join(told)} |\n|---|{'---|' * len(told)}"
    for name in filters:
        line = []
        for metric, (_, scale, unit) in MOTION_TITLES.items():
            known = values(wanted.values(), name, metric)
            known = known[~np.isnan(known)]
            line.append(f"{short(scale * float(known.mean()))}{unit}" if len(known) else "-")
        times = values(timed, name, "time_to_goal")
        there = ~np.isnan(times)
        line.append(f"{short(float(np.median(times[there])))} s" if there.any() else "-")
        line.append(cost(timed, name) if name != UNFILTERED and UNFILTERED in filters else "-")
        yield f"| `{name}` | {' | '.join(line)} |"


def cost(cells: Sequence[dict[str, dict[int, dict[str, float]]]], name: str) -> str:
    """What a filter costs in time, goal by goal."""
    found = Slowdown.of(*(values(cells, who, of) for who in (name, UNFILTERED) for of in ("time_to_goal", "success")))
    return "-" if found is None else found.brief


def values(cells: Iterable[dict[str, dict[int, dict[str, float]]]], name: str, metric: str) -> NDArray[np.float64]:
    """A metric of a filter in all cells' episodes, in the order of cells and seeds."""
    return np.array([cell[name][seed][metric] for cell in cells for seed in sorted(cell[name])], float)


def by_cell(found: Episodes, filters: Sequence[str], name: str, policy: str) -> Iterator[str]:
    """One line a task and kind of people, one column a filter: per cent."""
    yield f"\n{name}, policy `{policy}`, per cent\n\n| task, people | {' | '.join(f'`{f}`' for f in filters)} |"
    yield "|---|" + "---|" * len(filters)
    for (task, human, who), cell in found.items():
        if who == policy:
            shares = (
                f"{100.0 * float(np.mean([e[name] for e in cell[f].values()])):.0f}" if cell[f] else "" for f in filters
            )
            yield f"| {task}, `{human}` | {' | '.join(shares)} |"


def verdicts(found: Episodes, ours: str, rivals: Sequence[str], policies: Sequence[str]) -> Iterator[str]:
    """Cells in which somebody is better than ours."""
    for name, who in (("moving contact", None), ("success without contact", policies)):
        cells = {key: cell for key, cell in found.items() if who is None or key[2] in who}
        worse = {
            key: found_behind
            for key, cell in cells.items()
            if (found_behind := {r: x for r in rivals if (x := behind(cell, ours, r, name)) is not None})
        }
        empty = sum(not any(e[name] for one in cell.values() for e in one.values()) for cell in cells.values())
        yield (
            f"\n`{ours}` on {name}: first or tied in {len(cells) - len(worse)} of {len(cells)} cells, in {empty} of "
            f"which there is none by any filter"
        )
        for key, others in worse.items():
            told = ", ".join(f"`{rival}` by {100 * x:.0f}" for rival, x in sorted(others.items(), key=lambda t: -t[1]))
            yield f"- {', '.join(key)}: behind {told} (per cent)"
        pooled = {
            r: [(e[name], cell[r][s][name]) for cell in cells.values() for s, e in cell[ours].items()] for r in rivals
        }
        for rival, pairs in pooled.items():
            one, other = np.array(pairs, float).T
            more = paired_difference(other, one)
            least, most = 100 * more.low, 100 * more.high
            yield f"- over all, `{rival}` minus it: {100 * more.value:+.1f} of 100 ({least:.1f} to {most:.1f})"
