"""What episodes amount to: those of an evaluation in a report a setting, those of a campaign in a tally a group."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.evaluation.blocked import commonest, warning
from jssa_gym.evaluation.definitions import Metric, metrics_of
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.rows import Cell, EvaluationRow, Setting, StressRow
from jssa_gym.evaluation.statistics import Mean, Rate, means
from jssa_gym.robots.model import unpromised
from jssa_gym.storage import as_json, write_json
from jssa_gym.text import counted
from jssa_gym.types import Array
from jssa_gym.validation import known_name

METRICS: tuple[Metric, ...] = tuple(metrics_of(Summary))
"""All metrics of an episode."""


@dataclass(frozen=True, slots=True)
class Report:
    """Episodes of one setting: rates with Clopper-Pearson, means with bootstrap 95 % intervals."""

    setting: Setting
    episodes: tuple[EvaluationRow, ...]
    """In the order of settings and seeds."""
    rates: dict[str, Rate]
    """Rates of the yes-or-no metrics, by :attr:`~jssa_gym.evaluation.definitions.Metric.over_episodes`."""
    means: dict[str, Mean]
    """Means of all other metrics; those that no episode has are missing."""
    traces: tuple[Path, ...] = ()
    """Recordings of the worst episodes, the worst first."""
    unlike: tuple[int, ...] = ()
    """Seeds among them that went otherwise when they were played again: something draws without a seed."""
    uncovered: tuple[str, ...] = ()
    """Joints of the robot's links that have no capsules: no number is about them."""

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
        """The report as JSON can hold it."""
        return {
            **self.setting._asdict(),
            "episodes": len(self.episodes),
            "rates": as_json(self.rates),
            "means": as_json(self.means),
            "traces": as_json(self.traces),
            "unlike": list(self.unlike),
            "warnings": list(self.warnings),
            **({"uncovered": list(self.uncovered)} if self.uncovered else {}),
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
        if self.uncovered:
            lines.append(f"  {unpromised(self.uncovered)}")
        return "\n".join(lines)


def column(episodes: Sequence[EvaluationRow], name: str) -> Array:
    """A metric of every episode, shape (n,); NaN where there is none."""
    values = (getattr(episode.summary, name) for episode in episodes)
    return np.array([np.nan if value is None else float(value) for value in values])


def write_reports(path: Path, reports: Sequence[Report]) -> None:
    """Write reports as JSON into a file that is complete or not there."""
    write_json(path, [report.as_dict() for report in reports])


@dataclass(frozen=True, slots=True)
class Tally:
    """Episodes that have something in common; rates of episodes with Clopper-Pearson 95 % intervals."""

    group: tuple[str, ...]
    """What they have in common."""
    contacts: Rate
    """Any contact."""
    moving: Rate
    """A contact with a touching point of the arm faster than 1e-3 m/s, at a tick or seen by MuJoCo between."""
    violations: Rate
    """A joint limit exceeded, at a tick or seen by MuJoCo between."""
    contact_speed: float
    """Largest [m/s]."""
    excess: float
    """By what share of its limit a joint exceeded it at most; 0 if none did."""
    stored: float
    """Share of the ticks in which a stored stop went on and nothing was faulty."""
    faulty: float
    """Share of the ticks with a FAULT."""
    intervened: float
    """Share of the ticks with an intervention."""
    no_stop: float
    """Share of the ticks in which the wanted jerk had no stop inside the joint limits."""
    joint_speed: float
    """Mean Euclidean norm of the joint velocities [rad/s]."""
    judged: int
    """Episodes that MuJoCo judged."""
    disagreements: int
    """Those of them in which it found something else."""
    overlaps: int
    """Those of them in which the arm met the table or itself."""


def tally(episodes: Sequence[StressRow], by: Sequence[str]) -> list[Tally]:
    """Group episodes and count.

    Args:
        episodes: Of one campaign.
        by: What makes a group: fields of :class:`~jssa_gym.evaluation.rows.Cell`.

    Returns:
        A tally a group, in the order in which the groups appear.

    Raises:
        ParameterError: ``by`` names something else.
    """
    for name in by:
        known_name("column to group by", name, Cell._fields)
    groups: dict[tuple[str, ...], list[StressRow]] = {}
    for episode in episodes:
        groups.setdefault(tuple(getattr(episode, name) for name in by), []).append(episode)
    return [_tally(group, members) for group, members in groups.items()]


def _tally(group: tuple[str, ...], episodes: Sequence[StressRow]) -> Tally:
    count, ticks = len(episodes), sum(e.steps for e in episodes)
    judged = [e for e in episodes if e.judged]
    return Tally(
        group,
        contacts=Rate.of(sum(e.contact for e in episodes), count),
        moving=Rate.of(sum(e.touched_moving for e in episodes), count),
        violations=Rate.of(sum(e.exceeds for e in episodes), count),
        contact_speed=max(max(e.contact_speed, e.judged_speed) for e in episodes),
        excess=max(0.0, *(max(e.excess, e.judged_excess) for e in episodes)),
        stored=sum(e.failsafe for e in episodes) / ticks,
        faulty=sum(e.faulty for e in episodes) / ticks,
        intervened=sum(e.interventions for e in episodes) / ticks,
        no_stop=sum(e.no_stop for e in episodes) / ticks,
        joint_speed=float(np.mean([e.joint_speed for e in episodes])),
        judged=len(judged),
        disagreements=sum(not e.agrees for e in judged),
        overlaps=sum(e.overlaps > 0 for e in judged),
    )
