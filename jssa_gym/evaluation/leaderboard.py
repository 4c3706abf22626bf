"""Filters side by side: pooled over everything else, and in pairs on the same seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jssa_gym.evaluation.report import Report, column
from jssa_gym.evaluation.rows import EvaluationRow, Setting
from jssa_gym.evaluation.statistics import Mean, PairedDifference, mean_difference, paired_difference
from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array

PAIRED_RATES = ("collision", "moving_contact", "limits_exceeded", "success", "success_untouched", "success_and_safe")
"""Yes-or-no metrics of which paired differences are told."""

PAIRED_MEANS = ("ep_return", "min_distance_arm", "intervention_rate", "jerk_rms", "path_length")
"""Other metrics of which they are."""


@dataclass(frozen=True, slots=True)
class Standing:
    """One filter over all tasks, people and policies."""

    filter: str
    pooled: Report
    rates: dict[str, PairedDifference]
    """Of :data:`PAIRED_RATES`: this filter minus the first, on the same episodes; empty for the first."""
    means: dict[str, Mean]
    """Of :data:`PAIRED_MEANS`, likewise."""


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
    found = []
    for name, report in pooled.items():
        if [_trial(one) for one in report.episodes] != [_trial(one) for one in first.episodes]:
            raise ParameterError(f"{name} and {first.setting.filter} were not tried on the same episodes")
        if report is first:
            found.append(Standing(name, report, {}, {}))
            continue
        differences = {
            metric: mean_difference(column(report.episodes, metric), column(first.episodes, metric))
            for metric in PAIRED_MEANS
        }
        found.append(
            Standing(
                name,
                report,
                {
                    metric: paired_difference(column(report.episodes, metric), column(first.episodes, metric))
                    for metric in PAIRED_RATES
                },
                {metric: mean for metric, mean in differences.items() if mean is not None},
            )
        )
    return sorted(found, key=_rank)


def _rank(one: Standing) -> tuple[int, int, int]:
    rates = one.pooled.rates
    return -rates["success_and_safe_rate"].k, rates["moving_contact_rate"].k, rates["collision_rate"].k


def _trial(episode: EvaluationRow) -> tuple[str, str, str, int]:
    return episode.task, episode.human, episode.policy, episode.seed


def profile(values: Array, thresholds: Array) -> Array:
    """Performance profile: share of the values (n,) that are at least each threshold, shape of the thresholds.

    Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice, 2021.
    """
    known = np.sort(values[~np.isnan(values)])
    return 1.0 - np.searchsorted(known, thresholds, side="left") / max(len(known), 1)
