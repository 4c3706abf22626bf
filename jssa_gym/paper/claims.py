"""What the paper says about its results, held against numbers: the paper's own, and ours."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jssa_gym.paper import reported
from jssa_gym.paper.reported import Measures
from jssa_gym.robots import JointLimits
from jssa_gym.types import Trace

PAPER = "paper"
"""Name of the column that holds the paper's own numbers."""

ASKED = "Fig. 6, asked of the stand-in"
"""Source of what the search for the person who stands in for the paper's was told to bring about: that it comes out
says that there is such a person, not more."""

_AT_BOUND = 0.999
"""Share of a jerk bound from which a joint counts as saturated."""

_TELLING = 0.01
"""Share of a number by which another has to differ to count as larger or smaller."""

_AT_HOME = 5.0
"""Farthest that a joint may be from home for the arm to have returned [°]."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Whether a claim holds somewhere, and by which figures."""

    holds: bool
    seen: str
    partly: bool = False
    """Whether it holds in less than half of the cases, and nowhere the opposite."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "holds", bool(self.holds))  # JSON cannot hold numpy's


@dataclass(frozen=True, slots=True)
class Claim:
    """Something that the paper says about its results."""

    text: str
    source: str
    verdicts: Mapping[str, Evidence]
    """By shield, the published one first; under :data:`PAPER` whether the paper's own numbers bear it out."""

    @property
    def reproduced(self) -> bool:
        """Whether the claim holds for the published algorithm."""
        return self._published.holds

    @property
    def extent(self) -> str:
        """How far it does, in words."""
        if not self.reproduced:
            return "not reproduced"
        return "partly reproduced" if self._published.partly else "reproduced"

    @property
    def _published(self) -> Evidence:
        return next(verdict for name, verdict in self.verdicts.items() if name != PAPER)


def stays_above(trace: Trace, d_min: float) -> Evidence:
    """Whether an episode's distance does [m]."""
    least = float(trace.distance.min())
    return Evidence(least > d_min, f"{least:.3f} m")


# ---- collision avoidance, Fig. 6 and 8 ---------------------------------------------------------------


def saturation(trace: Trace, limits: JointLimits) -> float:
    """Share of an episode's steps in which some joint's jerk is at its bound."""
    return float(np.any(np.abs(trace.jerk) >= _AT_BOUND * limits.jerk, axis=1).mean())


def sequence(links: NDArray[np.int64]) -> tuple[int, ...]:
    """Critical links in the order of their appearance, counted from 1; (T,) of them, counted from 0."""
    changes = np.flatnonzero(np.diff(links)) + 1
    return tuple(int(links[k]) + 1 for k in (0, *changes))


def avoidance_claims(traces: Mapping[str, Trace], limits: JointLimits, d_min: float) -> list[Claim]:
    """What section 4.1 says about Fig. 6.

    Args:
        traces: By shield, the published one first.
        limits: The robot's limits.
        d_min: The margin [m].
    """

    def claim(text: str, judge: Callable[[Trace], Evidence], source: str = "Fig. 6") -> Claim:
        return Claim(text, source, {name: judge(trace) for name, trace in traces.items()})

    def early(trace: Trace) -> Evidence:
        if not trace.intervened.any():
            return Evidence(False, "never triggered")
        distance = float(trace.distance[trace.intervened.argmax()])
        return Evidence(distance > 5.0 * d_min, f"{distance:.2f} m")

    def bounded(trace: Trace) -> Evidence:
        share = float((np.abs(trace.jerk) / limits.jerk).max())
        return Evidence(share <= 1.0 + 1e-9, f"{share:.0%} of it")

    def gentle(trace: Trace) -> Evidence:
        jerk = float(np.abs(trace.jerk).max())
        return Evidence(jerk <= 1.1 * reported.FIG6_JERK, f"{np.degrees(jerk):.0f} °/s³")

    def tip(trace: Trace) -> Evidence:
        share = float((trace.pair[:, 0] == reported.FIG6_ROBOT_LINK - 1).mean())
        return Evidence(share == 1.0, f"{share:.0%} of the time")

    def person(trace: Trace) -> Evidence:
        seen = sequence(trace.pair[:, 1])
        return Evidence(seen == reported.FIG6_HUMAN_LINKS, "-".join(map(str, seen)))

    def home(trace: Trace) -> Evidence:
        left = float(np.degrees(np.abs(trace.position[-1] - trace.initial_state[0]).max()))
        return Evidence(left < _AT_HOME, f"{left:.1f}° off")

    return [
        claim("the distance stays above d_min", lambda trace: stays_above(trace, d_min)),
        claim("triggered while there is a decent margin", early),
        claim("the jerk keeps its bound", bounded),
        claim("the jerk stays within about 2000 °/s³", gentle, ASKED),
        claim("the arm's critical link is the end effector", tip, ASKED),
        claim("the person's are left arm, core, head, core (4-2-1-2)", person, ASKED),
        claim("the arm returns home when the person leaves", home),
    ]


def comparison_claims(ssa: Trace, jssa: Mapping[str, Trace], limits: JointLimits) -> list[Claim]:
    """What section 4.3 says about Fig. 8: the SSA against the JSSA.

    Args:
        ssa: Episode with the SSA.
        jssa: Episodes with the JSSA, by shield, the published one first.
        limits: The robot's limits.
    """

    def claim(text: str, measure: Callable[[Trace], float], unit: str, sign: int) -> Claim:
        one = measure(ssa)
        others = {name: measure(trace) for name, trace in jssa.items()}
        return Claim(
            text,
            "Fig. 8",
            {
                name: Evidence(sign * (one - other) > _TELLING * abs(other), f"{one:.3g} against {other:.3g}{unit}")
                for name, other in others.items()
            },
        )

    return [
        claim("SSA: smaller minimum distance", lambda trace: float(trace.distance.min()), " m", -1),
        claim("SSA: active for longer", lambda trace: float(trace.intervened.sum() * trace.dt), " s", +1),
        claim("SSA: the jerk saturates more often", lambda trace: saturation(trace, limits), "", +1),
        claim("SSA: the distance fluctuates more (mean |D̈|)", _fluctuation, " m/s²", +1),
    ]


def _fluctuation(trace: Trace) -> float:
    return float(np.abs(trace.acceleration_of_distance).mean())


# ---- sensitivity, Table 1 ----------------------------------------------------------------------------

LambdaTable = Mapping[tuple[float, float], Measures]
"""Measures by (λ₁, λ₂)."""

_TRENDS: tuple[tuple[str, int, str, int], ...] = (
    ("λ₁ up: active for longer", 0, "active_duration", +1),
    ("λ₁ up: triggered earlier", 0, "first_trigger", -1),
    ("λ₁ up: the last trigger is later", 0, "last_trigger", +1),
    ("λ₁ up: larger minimum distance", 0, "min_distance", +1),
    ("λ₂ up: smaller minimum distance", 1, "min_distance", -1),
    ("λ₂ up: lower mean acceleration", 1, "mean_acceleration", -1),
    ("λ₂ up: triggered later", 1, "first_trigger", +1),
)
"""What section 4.2 says about Table 1: text, which λ grows, which measure changes, and whether it grows or falls."""


def sensitivity_claims(tables: Mapping[str, LambdaTable]) -> list[Claim]:
    """What section 4.2 says about Table 1, for the paper's own numbers and for others.

    A trend is judged along each line of the table, from its smallest to its largest λ. It holds if it is seen in one
    line at least and no line goes the other way; a time counts as changed from one step on, the rest from 1 % on.

    Args:
        tables: By shield, the published one first.
    """
    every = {PAPER: reported.TABLE1, **tables}
    return [
        Claim(text, "Table 1", {name: _trend(table, axis, measure, sign) for name, table in every.items()})
        for text, axis, measure, sign in _TRENDS
    ]


def _trend(table: LambdaTable, axis: int, measure: str, sign: int) -> Evidence:
    values = sorted({key[axis] for key in table})
    others = sorted({key[1 - axis] for key in table})
    along, against = 0, 0
    for other in others:
        low, high = (
            getattr(table[(value, other) if axis == 0 else (other, value)], measure)
            for value in (values[0], values[-1])
        )
        change = 0.0 if low is None or high is None else sign * (high - low)
        least = 1e-9 if measure.endswith("trigger") else _TELLING * abs(low or 0.0)
        along, against = along + (change > least), against + (change < -least)
    holds, seen = along > 0 and against == 0, f"{along} of {len(others)}"
    return Evidence(holds, f"{seen}, {against} against" if against else seen, holds and 2 * along < len(others))
