"""What people and a shield cost a task in time."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.evaluation.report import Report, column
from jssa_gym.evaluation.statistics import Mean, Rate, means
from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array


@dataclass(frozen=True, slots=True)
class Slowdown:
    """Time to the goal over that of the same policy in other company, goal by goal: alone, or without a shield."""

    ratio: Mean | None
    """Over the goals that were reached both ways; None if there is none."""
    lost: Rate
    """How many of the goals that were reached there were not reached here, which the ratio says nothing about."""

    @classmethod
    def of(cls, here: Array, success: Array, there: Array, reached: Array) -> "Slowdown | None":
        """Compare times on the same goals.

        Args:
            here: Time to each goal, shape (g,) [s]; NaN for never.
            success: Whether it was reached and, where staying is the task, not left again, shape (g,).
            there: As ``here``, of what is compared with.
            reached: As ``success``, likewise.

        Returns:
            None if no goal was reached there: there is no time to compare with.
        """
        # who was there once and did not stay, where staying is the task, has not reached it
        done, could = success > 0.0, reached > 0.0
        if not could.any():
            return None
        ratio = np.where(could & done, here / there, np.nan)
        return cls(means(ratio[:, None])[0], Rate.of(int((could & ~done).sum()), int(could.sum())))

    @property
    def brief(self) -> str:
        """The ratio in few words, whatever it is compared with; ``1.2 (1.1 to 1.3), lost 2 of 40``."""
        return f"{'-' if self.ratio is None else self.ratio}, lost {self.lost.k} of {self.lost.n}"

    def __str__(self) -> str:
        ratio = "no goal was reached both ways" if self.ratio is None else str(self.ratio)
        return f"{ratio}; not reached of those reached alone: {self.lost}"


def slowdown(report: Report, alone: Report) -> Slowdown | None:
    """Compare an evaluation with one of the same policy and seeds, without a filter and with nobody there.

    A seed stands for a goal, whoever is there. Of a task that holds a goal from the beginning (Home) the ratio says
    nothing; what was lost does.

    Args:
        report: Of what is judged, of one setting.
        alone: ``jssa_gym.evaluate(..., env_kwargs={"human": "none"})`` on the same seeds, without a filter.

    Returns:
        None if no goal was reached alone: there is no time to compare with.

    Raises:
        ParameterError: Policies or seeds differ. That the tasks are the same is the caller's affair.
    """
    trials = [[(e.policy, e.seed) for e in one.episodes] for one in (report, alone)]
    if trials[0] != trials[1]:
        raise ParameterError("both evaluations have to be of the same policy and seeds")
    return Slowdown.of(*(column(one.episodes, name) for one in (report, alone) for name in ("time_to_goal", "success")))
