"""What people and a shield cost a task in time."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.evaluation.report import Report, column
from jssa_gym.evaluation.statistics import Mean, Rate, means
from jssa_gym.exceptions import ParameterError


@dataclass(frozen=True, slots=True)
class Slowdown:
    """Time to the goal beside people over that of the same policy without shield and people, goal by goal."""

    ratio: Mean | None
    """Over the goals that were reached both ways; None if there is none."""
    lost: Rate
    """How many of the goals that were reached alone were not reached here, which the ratio says nothing about."""

    def __str__(self) -> str:
        ratio = "no goal was reached both ways" if self.ratio is None else str(self.ratio)
        return f"{ratio}; not reached of those reached alone: {self.lost}"


def slowdown(report: Report, alone: Report) -> Slowdown | None:
    """Compare an evaluation with one of the same task, policy and seeds, without a filter and with nobody there.

    A seed stands for a goal, whoever is there.

    Args:
        report: Of what is judged, of one setting.
        alone: ``jssa_gym.evaluate(..., env_kwargs={"human": "none"})`` on the same seeds, without a filter.

    Returns:
        None if no goal was reached alone: there is no time to compare with.

    Raises:
        ParameterError: The seeds differ.
    """
    seeds = [[episode.seed for episode in one.episodes] for one in (report, alone)]
    if seeds[0] != seeds[1]:
        raise ParameterError("both evaluations have to be of the same seeds, one setting each")
    here, there = (column(one.episodes, "time_to_goal") for one in (report, alone))
    reached = np.isfinite(there)
    if not reached.any():
        return None
    # of a task that holds a goal, success is another thing than having been there once
    success = column(report.episodes, "success") > 0.0
    ratio = np.where(reached & success, here / there, np.nan)
    return Slowdown(means(ratio[:, None])[0], Rate.of(int((reached & ~success).sum()), int(reached.sum())))
