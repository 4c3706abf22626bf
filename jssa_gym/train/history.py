"""What a training has been through: safety of every episode, evaluations, time."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.evaluation.report import Report
from jssa_gym.exceptions import CheckpointError
from jssa_gym.storage import as_json, write_json, write_whole


@dataclass(frozen=True, slots=True)
class Leg:
    """What happened between two checkpoints."""

    steps: int
    """Policy steps at its end."""
    seconds: float
    """Time that it took, its evaluation not counted [s]."""
    episodes: int
    """Episodes of the learner that ended in it."""
    success: float
    """Share of them with success; NaN without any."""
    ep_return: float
    """Mean return of the task, without penalties."""
    collisions: int
    """Episodes with a contact."""
    moving_contacts: int
    """Episodes with a contact of the moving arm."""
    limit_violations: int
    """Episodes with a joint limit exceeded."""
    interventions: float
    """Mean share of control steps in which the shield changed the jerk."""
    eval_success: float
    """Share with success of the evaluation at its end."""
    eval_safe: float
    """Share with success, nobody nearer than d_min and no limit exceeded."""
    eval_collisions: int
    eval_moving_contacts: int
    eval_interventions: float
    eval_return: float
    eval_time: float
    """Mean time to the goal, of the episodes that reached it [s]."""
    processor_seconds: float = float("nan")
    """Processor time that it took in this process, its evaluation not counted [s]; NaN where it was not taken down."""
    cost_rate: float = float("nan")
    """Share of the control steps of the learner's episodes in which somebody was nearer than d_min; NaN as above."""


@dataclass(slots=True)
class EpisodeCounter:
    """Counts the episodes of a leg as they end."""

    summaries: list[Mapping[str, Any]] = field(default_factory=list)

    def take(self, info: Mapping[str, Any]) -> bool:
        """Look whether an episode ended."""
        if "safety" not in info:
            return False
        self.summaries.append(info["safety"])
        return True

    def blocked(self, enough: int) -> bool:
        """Whether so many episodes ended, and every step of them all was a FAULT."""
        return len(self.summaries) >= enough and all(one["fault_rate"] == 1.0 for one in self.summaries)

    def leg(self, steps: int, seconds: float, processor_seconds: float, report: Report) -> Leg:
        """The leg that ends now; counting begins anew."""
        ended = self.summaries
        self.summaries = []
        rates, times = report.rates, report.means.get("time_to_goal")

        def mean(name: str) -> float:
            return float(np.mean([float(x[name]) for x in ended])) if ended else float("nan")

        def count(name: str) -> int:
            return sum(bool(x[name]) for x in ended)

        return Leg(
            steps=steps,
            seconds=round(seconds, 1),
            episodes=len(ended),
            success=mean("success"),
            ep_return=mean("ep_return"),
            collisions=count("collision"),
            moving_contacts=count("moving_contact"),
            limit_violations=sum(x["limit_violation_rate"] > 0.0 for x in ended),
            interventions=mean("intervention_rate"),
            eval_success=rates["success_rate"].value,
            eval_safe=rates["success_and_safe_rate"].value,
            eval_collisions=rates["collision_rate"].k,
            eval_moving_contacts=rates["moving_contact_rate"].k,
            eval_interventions=report.means["intervention_rate"].value if "intervention_rate" in report.means else 0.0,
            eval_return=report.means["ep_return"].value,
            eval_time=float("nan") if times is None else times.value,
            processor_seconds=round(processor_seconds, 3),
            cost_rate=sum(x["ep_cost"] for x in ended) / sum(x["ep_len"] for x in ended) if ended else float("nan"),
        )


def as_rows(history: tuple[Leg, ...]) -> list[dict[str, Any]]:
    """A history as JSON can hold it: None for what is not there."""
    return as_json(history)


def from_rows(rows: list[dict[str, Any]]) -> tuple[Leg, ...]:
    """The history that :func:`as_rows` has written.

    Raises:
        CheckpointError: They are no such rows.
    """
    nothing = float("nan")
    try:
        filled: list[dict[str, Any]] = [{k: nothing if x is None else x for k, x in row.items()} for row in rows]
        legs = tuple(Leg(**row) for row in filled)
    except (TypeError, AttributeError) as error:
        raise CheckpointError(f"this is no history of a training: {error}") from error
    for row in filled:
        if wrong := [name for name, x in row.items() if isinstance(x, bool) or not isinstance(x, int | float)]:
            raise CheckpointError(f"this is no history of a training: {wrong[0]} is no number")
    return legs


def write_history(path: Path, history: tuple[Leg, ...]) -> None:
    """Write it as a table, complete or not at all."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [f.name for f in fields(Leg)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(as_rows(history))
    write_whole(path, text.getvalue().encode())


RECORD = "training.json"
"""What a training's folder says of it as JSON, for whoever draws its curve."""


def write_record(path: Path, training: Mapping[str, Any], history: tuple[Leg, ...]) -> None:
    """Write what was trained and what came of it so far, complete or not at all.

    Args:
        path: The file.
        training: As :meth:`~jssa_gym.train.TrainConfig.as_dict` gives it.
        history: Its legs.
    """
    write_json(path, {"training": training, "history": as_rows(history)})
