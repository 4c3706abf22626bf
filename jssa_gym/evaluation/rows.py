"""Episodes in numbers, each a row of the table: what an evaluation and what a campaign take down of one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.contenders import contender, within_assumptions
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.storage import file_name, sha256
from jssa_gym.types import Array, Trace

_ROUNDING = 1e-9
"""Share of a limit that rounding may cost, as in the environment."""


class Setting(NamedTuple):
    """Cell of an evaluation."""

    task: str
    filter: str
    human: str
    policy: str


class Cell(NamedTuple):
    """Cell of a campaign."""

    filter: str
    human: str
    policy: str
    fault: str


class Row:
    """A line of the table: a dataclass of strings, numbers and yes or no, and of dataclasses of such.

    The names of its cell come first, then the seed.
    """

    __slots__ = ()

    kind: ClassVar[type[Any]]
    """Class of its cell."""
    seed: int
    """Seed of the episode."""
    digest: str
    """SHA-256 of states, jerks and statuses."""
    wall: float
    """Time that it took to play and measure it [s]."""

    @property
    def cell(self) -> Any:
        """What kind of episode it is."""
        return self.kind(*(getattr(self, name) for name in self.kind._fields))

    @property
    def severity(self) -> Any:
        """How bad it is, for keeping the worst: the larger, the worse."""
        raise NotImplementedError

    @property
    def broken(self) -> bool:
        """Whether something happened that must not."""
        return False

    @property
    def trace_name(self) -> str:
        """Name of the file with its recording."""
        return trace_name(self.cell, self.seed)


def trace_name(cell: Sequence[str], seed: int) -> str:
    """Name of the file with an episode's recording."""
    return f"{file_name('-'.join(part for part in cell if part))}-{seed}.npz"


def digest_of(trace: Trace) -> str:
    """SHA-256 of an episode's states, jerks and statuses."""
    arrays = (states_of(trace), np.float64), (trace.jerk, np.float64), (trace.status, np.int64)
    return sha256(b"".join(np.ascontiguousarray(array, kind).tobytes() for array, kind in arrays))


def states_of(trace: Trace) -> Array:
    """Joint positions, velocities and accelerations, shape (T, 3, n) [rad, rad/s, rad/s²]."""
    return np.stack([trace.position, trace.velocity, trace.acceleration], axis=1)


@dataclass(frozen=True, slots=True)
class EvaluationRow(Row):
    """One episode of an evaluation in numbers."""

    kind: ClassVar[type[Any]] = Setting

    task: str
    filter: str
    human: str
    policy: str
    seed: int
    summary: Summary
    fault: str
    """The most frequent reason of its FAULTs; empty without any."""
    digest: str
    wall: float

    @property
    def severity(self) -> tuple[float, float, float]:
        """How bad it is: by the speed of a moving contact, then by limits exceeded, then by distance."""
        summary = self.summary
        # the speed of an arm at rest is rounding
        return (
            summary.contact_speed if summary.moving_contact else 0.0,
            summary.limit_violation_rate,
            -summary.min_distance,
        )


@dataclass(frozen=True, slots=True)
class StressRow(Row):
    """One episode of a campaign in numbers."""

    kind: ClassVar[type[Any]] = Cell

    filter: str
    human: str
    policy: str
    fault: str
    seed: int
    steps: int
    contact: bool
    moving_contact: bool
    """A touching point of the arm was faster than 1e-3 m/s at some tick."""
    contact_speed: float
    """Largest speed of a touching point [m/s]."""
    min_distance: float
    """[m]; inf without people."""
    violations: int
    """Ticks at which a joint limit is exceeded by more than rounding."""
    excess: float
    """By what share of its limit a joint exceeds it at most; negative if none does."""
    nominal: int
    """Ticks with this status; so the next four."""
    projected: int
    relaxed: int
    failsafe: int
    faulty: int
    no_stop: int
    """Ticks at which the wanted jerk had no stop inside the joint limits."""
    interventions: int
    first_fault: str
    """Reason of the first FAULT; empty without any."""
    joint_speed: float
    """Mean over the ticks of the Euclidean norm of the joint velocities [rad/s]."""
    wall: float
    digest: str
    judged: bool = False
    """Whether MuJoCo has judged it; else the rest says nothing."""
    agrees: bool = True
    """Whether the episode played again has the same digest and MuJoCo finds the same distances and contacts."""
    judged_speed: float = 0.0
    """Largest speed of a touching point at 1 kHz [m/s]."""
    judged_excess: float = 0.0
    """As ``excess``, at 1 kHz."""
    overlaps: int = 0
    """Collisions with the table and with itself at 1 kHz."""

    @property
    def touched_moving(self) -> bool:
        """Whether the arm moved at some touching point, at a tick or, if MuJoCo was asked, between."""
        return self.moving_contact or self.judged_speed > MOVING

    @property
    def exceeds(self) -> bool:
        """Whether a joint limit was exceeded, at a tick or, if MuJoCo was asked, between."""
        return self.violations > 0 or self.judged_excess > _ROUNDING

    @property
    def broken(self) -> bool:
        """Whether something happened that must not: a broken promise, or two judges who disagree."""
        if not self.agrees:
            return True
        if not (contender(self.filter).promises and within_assumptions(self.human, self.fault)):
            return False
        return self.touched_moving or self.exceeds or self.overlaps > 0

    @property
    def severity(self) -> float:
        """How bad it is: disagreements first, then by contact speed and excess."""
        return (0.0 if self.agrees else 1e6) + max(self.contact_speed, self.judged_speed) + max(self.excess, 0.0)
