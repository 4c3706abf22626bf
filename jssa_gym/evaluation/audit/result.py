"""What an audit finds, and the safe trajectory as a table."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.evaluation.audit.motion import Gap
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.spans import spans
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.storage import as_json, write_whole
from jssa_gym.types import Array, Status, Trace

_APART = 0.2
"""Interventions that are not interrupted for longer than this are one [s]."""

FIGURES = (
    *("min_distance", "contact_speed", "moving_contact", "collision", "d_min_violation_rate", "ttc"),
    *("ssm_margin", "ssm_violation_rate", "ssm_violation_time", "limit_violation_rate"),
    *("speed_limit_ratio", "acceleration_limit_ratio", "jerk_limit_ratio", "position_violation_rate"),
    *("velocity_violation_rate", "acceleration_violation_rate", "jerk_violation_rate", "path_length"),
    *("n_collisions_self", "n_collisions_static"),
)
"""Metrics of an episode that say something of a log."""


@dataclass(frozen=True, slots=True)
class Intervention:
    """A time in which the shield would have done something else than the log shows."""

    start: float
    """By the log's clock [s]."""
    end: float
    """[s]."""
    status: str
    """The strongest of its decisions."""
    reason: str
    """Reason of its first decision."""
    distance: float
    """Smallest robot-human distance in it, as logged [m]."""
    slowed: float
    """By how much later the arm is when the next one begins, or at the end [s]."""


@dataclass(frozen=True, slots=True)
class ClosestApproach:
    """The closest approach."""

    time: float
    """By the log's clock [s]."""
    distance: float
    """[m]."""
    robot: str
    """Capsule of the arm."""
    human: str
    """Body part."""
    speed: float
    """Speed of the arm's nearest point [m/s]."""
    approach: float
    """Rate at which the distance falls [m/s]; negative where it grows."""


@dataclass(frozen=True, slots=True, eq=False)
class AuditedStretch:
    """A time without gaps."""

    time: Array
    """Times of the steps, by the log's clock, shape (T,) [s]."""
    logged: Trace
    """As it was."""
    safe: Trace
    """As the shield would have had it."""
    lateness: Array
    """Lateness of the safe motion behind the log, shape (T,) [s]."""
    margins: tuple[Array, Array]
    """Distance minus S_p, as logged and with the shield, shape (T,) each [m]."""
    summaries: tuple[Summary, Summary]
    """As logged, and with the shield."""
    closest: tuple[ClosestApproach | None, ClosestApproach | None]
    """None without people."""
    off: float
    """How far the motion that the shield was asked for is from a log that exceeds the limits [rad]."""

    @property
    def interventions(self) -> tuple[Intervention, ...]:
        """When and why."""
        safe, found = self.safe, []
        active = spans(safe.intervened, round(_APART / safe.dt))
        for k, (first, last) in enumerate(active):
            end = active[k + 1][0] if k + 1 < len(active) else len(self.lateness)
            status = max(safe.status[first:last].tolist())
            before = self.lateness[first - 1] if first else 0.0
            found.append(
                Intervention(
                    float(self.time[first] - safe.dt),
                    float(self.time[last - 1]),
                    Status(status).name,
                    next(filter(None, safe.reason[first:last].tolist()), ""),
                    float(self.logged.distance[first:last].min()),
                    float(self.lateness[end - 1] - before),
                )
            )
        return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Audit:
    """A log, judged."""

    log: str
    """Name of the file."""
    people: tuple[str, ...]
    """Names of their files."""
    robot: str
    filter: str
    assumed: FailsafeParams
    dt: float
    """Control step [s]."""
    gaps: tuple[Gap, ...]
    stretches: tuple[AuditedStretch, ...]

    @property
    def interventions(self) -> tuple[Intervention, ...]:
        """The interventions of all stretches."""
        return tuple(one for stretch in self.stretches for one in stretch.interventions)

    @property
    def duration(self) -> float:
        """Time that was audited, gaps left out [s]."""
        return float(sum(len(one.time) for one in self.stretches) * self.dt)

    @property
    def lateness(self) -> float:
        """Behind the log at the ends of the stretches, together [s]."""
        return float(sum(one.lateness[-1] for one in self.stretches))

    @property
    def held(self) -> float:
        """Time with an intervention [s]."""
        return float(sum(one.safe.intervened.sum() for one in self.stretches) * self.dt)

    def totals(self) -> tuple[dict[str, float | bool | None], dict[str, float | bool | None]]:
        """Metrics over all stretches, as logged and with the shield: the worst, sums of times, weighed rates."""
        one, other = (_together([stretch.summaries[k] for stretch in self.stretches]) for k in (0, 1))
        return one, other

    def closest(self, which: int) -> ClosestApproach | None:
        """The closest approach as logged (0) or with the shield (1)."""
        found = [stretch.closest[which] for stretch in self.stretches]
        return min((one for one in found if one is not None), key=lambda one: one.distance, default=None)

    def as_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it; what is not finite is null."""
        logged, safe = self.totals()
        told = {
            "log": self.log,
            "people": self.people,
            "robot": self.robot,
            "filter": self.filter,
            "assumed": self.assumed,
            "dt": self.dt,
            "duration": self.duration,
            "gaps": self.gaps,
            "would_intervene": bool(self.interventions),
            "interventions": self.interventions,
            "intervention_time": self.held,
            "lateness": self.lateness,
            "logged": logged,
            "with_shield": safe,
            "closest_logged": self.closest(0),
            "closest_with_shield": self.closest(1),
            "stretches": [
                {
                    "start": float(one.time[0] - self.dt),
                    "end": float(one.time[-1]),
                    "off": one.off,
                    "logged": _figures(one.summaries[0]),
                    "with_shield": _figures(one.summaries[1]),
                    "lateness": float(one.lateness[-1]),
                }
                for one in self.stretches
            ],
        }
        return as_json(told)


def _figures(summary: Summary) -> dict[str, float | bool | None]:
    return {name: getattr(summary, name) for name in FIGURES}


_SMALLEST = ("min_distance", "ttc", "ssm_margin")
_SUMMED = ("ssm_violation_time", "path_length", "n_collisions_self", "n_collisions_static")


def _together(summaries: Sequence[Summary]) -> dict[str, float | bool | None]:
    weight = np.array([one.ep_len for one in summaries], np.float64)
    found: dict[str, float | bool | None] = {}
    for name in FIGURES:
        values = [getattr(one, name) for one in summaries]
        known = [(value, w) for value, w in zip(values, weight, strict=True) if value is not None]
        if not known:
            found[name] = None
        elif name in _SMALLEST:
            found[name] = min(value for value, _ in known)
        elif name in _SUMMED:
            found[name] = sum(value for value, _ in known)
        elif name.endswith("_rate"):
            found[name] = float(sum(value * w for value, w in known) / sum(w for _, w in known))
        else:
            found[name] = max(value for value, _ in known)
    return found


def write_safe_trajectory(path: Path, audit: Audit) -> None:
    """Write the motion that the shield would have made, a row a control step; ``jssa-gym audit`` can read it again.

    Numbers are written so that they are read as they were, to the bit. Stretches follow one another; their gaps are
    gaps of the table.

    Args:
        path: Of the ``.csv`` file; it is replaced.
        audit: Whose.

    Raises:
        StorageError: The file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    joints = range(1, audit.stretches[0].safe.position.shape[1] + 1)
    what = ("position", "velocity", "acceleration")
    writer.writerow(["time", *(f"q{j}.{one}" for one in what for j in joints), "status", "reason", "distance", "late"])
    for stretch in audit.stretches:
        safe = stretch.safe
        first = (float(stretch.time[0] - safe.dt), *safe.initial_state.ravel().tolist(), "", "", "", 0.0)
        writer.writerow(first)
        for k, time in enumerate(stretch.time.tolist()):
            state = [float(x) for name in what for x in getattr(safe, name)[k]]
            told = (Status(int(safe.status[k])).name, str(safe.reason[k]), float(safe.distance[k]))
            writer.writerow((time, *state, *told, float(stretch.lateness[k])))
    write_whole(path, text.getvalue())
