"""What the episodes of an evaluation amount to, setting by setting."""

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.evaluation.blocked import commonest, warning
from jssa_gym.evaluation.definitions import Metric, metrics_of
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.rows import EvaluationRow, Setting
from jssa_gym.evaluation.statistics import Mean, Rate, means
from jssa_gym.storage import write_whole
from jssa_gym.text import counted
from jssa_gym.types import Array

METRICS: tuple[Metric, ...] = tuple(metrics_of(Summary))
"""All metrics of an episode."""


@dataclass(frozen=True, slots=True)
class Report:
    """Episodes of one setting: rates with Clopper-Pearson, means with bootstrap 95 % intervals."""

    setting: Setting
    episodes: tuple[EvaluationRow, ...]
    """In the order of settings and seeds."""
    rates: dict[str, Rate]
    """Of the yes-or-no metrics, by :attr:`~jssa_gym.evaluation.definitions.Metric.over_episodes`."""
    means: dict[str, Mean]
    """Of all other metrics; those that no episode has are missing."""
    traces: tuple[Path, ...] = ()
    """Recordings of the worst episodes, the worst first."""
    unlike: tuple[int, ...] = ()
    """Seeds among them that went otherwise when they were played again: something draws without a seed."""

    @classmethod
    def of(cls, episodes: Sequence[EvaluationRow], setting: Setting | None = None) -> "Report":
        """The report about some episodes, at least one.

        Args:
            episodes: Of one setting, or of what has something in common.
            setting: What they have in common; None for the first one's setting.
        """
        ordered = tuple(sorted(episodes, key=lambda episode: (episode.cell, episode.seed)))
        yes = [metric for metric in METRICS if metric.yes_or_no]
        numbers = [metric for metric in METRICS if not metric.yes_or_no]
        rates = {metric.over_episodes: Rate.of(int(column(ordered, metric.name).sum()), len(ordered)) for metric in yes}
        values = np.stack([column(ordered, metric.name) for metric in numbers], axis=1)
        found = zip(numbers, means(values), strict=True)
        return cls(
            setting or ordered[0].cell,
            ordered,
            rates,
            {metric.over_episodes: mean for metric, mean in found if mean is not None},
        )

    @property
    def blocked(self) -> str:
        """Why every decision of every episode was a FAULT, most often; empty if not every one was."""
        if not (column(self.episodes, "fault_rate") == 1.0).all():
            return ""
        return commonest(episode.fault for episode in self.episodes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the run or the policy itself, whatever the filter made of it."""
        told, steps = [], column(self.episodes, "n_actions_not_finite")
        if reason := self.blocked:
            told.append(warning(reason))
        if steps.any():
            where = f"{counted(int(steps.sum()), 'step')} of {counted(int((steps > 0.0).sum()), 'episode')}"
            told.append(f"the policy's action was not finite in {where}: the arm braked there (status FAULT)")
        return tuple(told)

    def as_dict(self) -> dict[str, Any]:
        """As JSON can hold it."""
        return {
            **self.setting._asdict(),
            "episodes": len(self.episodes),
            "rates": {name: dataclasses.asdict(rate) for name, rate in self.rates.items()},
            "means": {name: dataclasses.asdict(mean) for name, mean in self.means.items()},
            "traces": [str(path) for path in self.traces],
            "unlike": list(self.unlike),
            "warnings": list(self.warnings),
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON.

        Raises:
            StorageError: The file cannot be written.
        """
        write_reports(Path(path), [self])

    def __str__(self) -> str:
        lines = [f"{', '.join(part for part in self.setting if part)}: {counted(len(self.episodes), 'episode')}"]
        lines += [f"  {name:<32} {rate}" for name, rate in self.rates.items()]
        units = {metric.over_episodes: metric.unit for metric in METRICS}
        lines += [f"  {name:<32} {mean} {units[name]}".rstrip() for name, mean in self.means.items()]
        lines += [f"  warning: {one}" for one in self.warnings]
        return "\n".join(lines)


def column(episodes: Sequence[EvaluationRow], name: str) -> Array:
    """A metric of every episode, shape (n,); NaN where there is none."""
    values = (getattr(episode.summary, name) for episode in episodes)
    return np.array([np.nan if value is None else float(value) for value in values])


def write_reports(path: Path, reports: Sequence[Report]) -> None:
    """Write reports as JSON into a file that is complete or not there."""
    write_whole(path, json.dumps([report.as_dict() for report in reports], indent=2, allow_nan=False) + "\n")
