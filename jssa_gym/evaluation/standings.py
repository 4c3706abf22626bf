"""Filters side by side: pooled over everything else, and in pairs on the same seeds.

The columns of a comparison's report are chosen here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.definitions import in_words
from jssa_gym.evaluation.report import METRICS, Report, column
from jssa_gym.evaluation.rows import EvaluationRow, Setting
from jssa_gym.evaluation.slowdown import Slowdown
from jssa_gym.evaluation.statistics import Mean, PairedDifference, Rate, mean_difference, paired_difference, short
from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array

PAIRED_RATES = ("collision", "moving_contact", "limits_exceeded", "success", "success_untouched", "success_and_safe")
"""Yes-or-no metrics of which paired differences are told."""

PAIRED_MEANS = (
    *("ep_return", "min_distance_arm", "intervention_rate", "path_length", "time_to_goal"),
    *("jerk_jumps_shield", "status_switches", "jerk_rms"),
)
"""Other metrics of which they are."""

_RATES = tuple(
    f"{name}_rate"
    for name in ("success_and_safe", "success_untouched", "success", "collision", "moving_contact", "limits_exceeded")
)
_MEANS = (
    *("min_distance_arm", "contact_speed", "ep_return", "intervention_rate", "backup_rate"),
    *("jerk_jumps_shield", "jerk_jumps_nominal", "status_switches", "jerk_rms"),
)
"""What tables of filters show, of all metrics."""

UNFILTERED = "none"
"""Filter that leaves every jerk as it is: what the others cost in time is told against it."""


@dataclass(frozen=True, slots=True)
class Standing:
    """One filter over all tasks, people and policies."""

    filter: str
    pooled: Report
    rates: dict[str, PairedDifference]
    """Those of :data:`PAIRED_RATES`: this filter minus the first, on the same episodes; empty for the first."""
    means: dict[str, Mean]
    """Those of :data:`PAIRED_MEANS`, likewise."""
    slowdown: Slowdown | None
    """Against :data:`UNFILTERED`, see :func:`slowdown_beside_people`."""


@dataclass(frozen=True, slots=True)
class PolicyStanding:
    """One policy under one filter, over all tasks and people."""

    rank: int
    """Among the policies under that filter, from 1 on."""
    pooled: Report
    paired: int
    """Episodes that it shares with the best one: the same task, people and seed."""
    rates: dict[str, PairedDifference]
    """Those of :data:`PAIRED_RATES`: this policy minus the best, on the shared episodes; empty without any."""

    @property
    def policy(self) -> str:
        """Its name."""
        return self.pooled.setting.policy


def policy_standings(reports: Sequence[Report]) -> dict[str, list[PolicyStanding]]:
    """Policies under each filter, the best first, by the order of :func:`standings`.

    Policies that had other seeds than the best one are ranked by their own rates, and not compared in pairs.

    Args:
        reports: A report a setting.
    """
    found: dict[str, list[PolicyStanding]] = {}
    for name in dict.fromkeys(report.setting.filter for report in reports):
        episodes: dict[str, list[EvaluationRow]] = {}
        for report in reports:
            if report.setting.filter == name:
                episodes.setdefault(report.setting.policy, []).extend(report.episodes)
        pooled = sorted((Report.of(some, Setting("", name, "", who)) for who, some in episodes.items()), key=_merit)
        best = {_occasion(one): one for one in pooled[0].episodes}
        found[name] = [_beside(rank, report, best) for rank, report in enumerate(pooled, 1)]
    return found


def _beside(rank: int, report: Report, best: Mapping[tuple[str, str, int], EvaluationRow]) -> PolicyStanding:
    """A policy's standing against the best one's episodes."""
    shared = [(one, best[_occasion(one)]) for one in report.episodes if _occasion(one) in best]
    if rank == 1 or not shared:
        return PolicyStanding(rank, report, len(shared), {})
    return PolicyStanding(rank, report, len(shared), _rates_minus(*zip(*shared, strict=True)))


def _rates_minus(own: Sequence[EvaluationRow], theirs: Sequence[EvaluationRow]) -> dict[str, PairedDifference]:
    """Differences of the yes-or-no metrics over paired episodes."""
    return {name: paired_difference(column(own, name), column(theirs, name)) for name in PAIRED_RATES}


def standings(reports: Sequence[Report]) -> list[Standing]:
    """Filters, the best first: by success and safety, then by the fewest moving contacts and the fewest contacts.

    Args:
        reports: A report a setting; every filter with the same tasks, people, policies and seeds.

    Raises:
        ParameterError: The filters were not tried on the same episodes.
    """
    by_filter: dict[str, list[Report]] = {}
    for report in reports:
        by_filter.setdefault(report.setting.filter, []).append(report)
    pooled = {
        name: Report.of([episode for report in some for episode in report.episodes], Setting("", name, "", ""))
        for name, some in by_filter.items()
    }
    first = next(iter(pooled.values()))
    for name, report in pooled.items():
        if [_trial(one) for one in report.episodes] != [_trial(one) for one in first.episodes]:
            raise ParameterError(f"{name} and {first.setting.filter} were not tried on the same episodes")
    found = []
    for name, report in sorted(pooled.items(), key=lambda one: _merit(one[1])):
        own, theirs = report.episodes, first.episodes
        means = {of: mean_difference(column(own, of), column(theirs, of)) for of in PAIRED_MEANS if report is not first}
        found.append(
            Standing(
                name,
                report,
                {} if report is first else _rates_minus(own, theirs),
                {metric: mean for metric, mean in means.items() if mean is not None},
                slowdown_beside_people(report, pooled.get(UNFILTERED)),
            )
        )
    return found


def slowdown_beside_people(report: Report, unfiltered: Report | None) -> Slowdown | None:
    """What a filter costs in time: against no filter on the same episodes, beside the same people.

    Args:
        report: Of the filter.
        unfiltered: Of :data:`UNFILTERED` on the same episodes; None if it was not tried.

    Returns:
        None where there is nothing to compare with: no such report, it is the filter's own, or no goal was reached.
    """
    if unfiltered is None or report.setting.filter == UNFILTERED:
        return None
    return Slowdown.of(
        *(column(_timed(one), name) for one in (report, unfiltered) for name in ("time_to_goal", "success"))
    )


def median_time_to_goal(report: Report) -> float | None:
    """Median over the episodes in which the goal was reached [s]; None if it never was."""
    times = column(_timed(report), "time_to_goal")
    known = times[np.isfinite(times)]
    return float(np.median(known)) if len(known) else None


RATE_COLUMNS = len(_RATES)
"""So many of :func:`columns` are rates; what follows is how the arm moves, and for how long."""


def titles() -> list[str]:
    """The titles of :func:`columns`, in words, with units."""
    units = {metric.over_episodes: metric.unit for metric in METRICS}
    named = [in_words(name, units[name]) for name in (*_RATES, *_MEANS)]
    return [*named, "median time to the goal [s]", f"its ratio to {UNFILTERED}"]


def columns(report: Report, slowdown: Slowdown | None) -> list[Rate | Mean | str]:
    """What a table of filters shows of one, as text where printed; a dash for what there is none of."""
    time = median_time_to_goal(report)
    return [
        *(report.rates[name] for name in _RATES),
        *(report.means.get(name, "-") for name in _MEANS),
        "-" if time is None else short(time),
        "-" if slowdown is None else slowdown.brief,
    ]


def _timed(report: Report) -> list[EvaluationRow]:
    """Episodes that have a way to go; a goal that is held from the beginning (Home) would only hide their times."""
    return [one for one in report.episodes if one.task not in TASKS or TASKS[one.task].ends]


def _merit(report: Report) -> tuple[float, float, float]:
    """Less is better."""
    rates = report.rates
    return -rates["success_and_safe_rate"].value, rates["moving_contact_rate"].value, rates["collision_rate"].value


def _occasion(episode: EvaluationRow) -> tuple[str, str, int]:
    return episode.task, episode.human, episode.seed


def _trial(episode: EvaluationRow) -> tuple[str, str, str, int]:
    return episode.task, episode.human, episode.policy, episode.seed


def profile(values: Array, thresholds: Array) -> Array:
    """Performance profile: share of the values (n,) that are at least each threshold, shape of the thresholds.

    Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice, 2021.
    """
    known = np.sort(values[~np.isnan(values)])
    return 1.0 - np.searchsorted(known, thresholds, side="left") / max(len(known), 1)
