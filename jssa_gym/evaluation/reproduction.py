"""The paper's experiments run again, and its claims held against what came out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.evaluation import paper
from jssa_gym.evaluation.metrics import summarise
from jssa_gym.evaluation.paper import Measures, measures
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.policies import HoldPolicy
from jssa_gym.robots import JointLimits
from jssa_gym.shields import JSSAShield, Shield, make_filter
from jssa_gym.types import Array, Trace

PAPER = "paper"
"""Name of the column that holds the paper's own numbers."""

PUBLISHED = "as published"
"""Name of the shield that claims are held against first."""

SHIELDS: Mapping[str, Callable[[gym.Env, float, float], gym.Env]] = {
    PUBLISHED: lambda env, lambda1, lambda2: JSSAShield.as_published(env, lambda1=lambda1, lambda2=lambda2),
    "exact row": lambda env, lambda1, lambda2: JSSAShield(
        env, lambda1=lambda1, lambda2=lambda2, rows="closest", recovery=0.0, viability=False, failsafe=False
    ),
    "JSSAShield": lambda env, lambda1, lambda2: JSSAShield(env, lambda1=lambda1, lambda2=lambda2),
}
"""The published algorithm; the same with nothing but its row corrected; all layers. Built for λ₁ and λ₂."""

_AT_BOUND = 0.999
"""Share of a jerk bound from which a joint counts as saturated."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a claim holds somewhere, and by which figures."""

    holds: bool
    seen: str


@dataclass(frozen=True, slots=True)
class Claim:
    """Something that the paper says about its results."""

    text: str
    source: str
    verdicts: Mapping[str, Verdict]
    """By shield; under :data:`PAPER` whether the paper's own numbers bear it out, where it gives them."""

    @property
    def reproduced(self) -> bool:
        """Whether it holds for the published algorithm."""
        return self.verdicts[PUBLISHED].holds


def play(wrap: Callable[[gym.Env], gym.Env], name: str, steps: int = paper.STEPS) -> tuple[Trace, JointLimits]:
    """One episode of the paper's simulation: the arm holds its home position, the stand-in person walks up to it.

    Args:
        wrap: Puts a shield around the environment.
        name: Of the trace.
        steps: Length.
    """
    env = wrap(gym.make("jssa_gym/Home-v0", human=paper.stand_in(), terminate_on=(), max_episode_steps=steps))
    base: Any = env.unwrapped
    trace = rollout(env, HoldPolicy(env), seed=0, steps=steps, name=name)
    env.close()
    return trace, base.robot.limits


def saturation(trace: Trace, limits: JointLimits) -> float:
    """Share of an episode's steps in which some joint's jerk is at its bound."""
    return float(np.any(np.abs(trace.jerk) >= _AT_BOUND * limits.jerk, axis=1).mean())


def sequence(links: Array) -> tuple[int, ...]:
    """Critical links in the order of their appearance, counted from 1, shape (T,) of them counted from 0."""
    changes = np.flatnonzero(np.diff(links)) + 1
    return tuple(int(links[k]) + 1 for k in (0, *changes))


# ---- collision avoidance, Fig. 6 and 8 ---------------------------------------------------------------


def avoidance() -> tuple[dict[str, Trace], JointLimits]:
    """Fig. 6: every shield with the paper's λ = (3, 1), and ours with its own."""
    traces = {}
    for name, wrap in SHIELDS.items():
        traces[name], limits = play(lambda env, wrap=wrap: wrap(env, 3.0, 1.0), name)
    traces["JSSAShield, its own λ"], limits = play(JSSAShield, "JSSAShield, its own λ")
    return traces, limits


def avoidance_claims(traces: Mapping[str, Trace], limits: JointLimits, d_min: float) -> list[Claim]:
    """What section 4.1 says about Fig. 6."""

    def claim(text: str, judge: Callable[[Trace], Verdict]) -> Claim:
        return Claim(text, "Fig. 6", {name: judge(trace) for name, trace in traces.items()})

    def margin(trace: Trace) -> Verdict:
        least = float(trace.distance.min())
        return Verdict(least > d_min, f"{least:.3f} m")

    def early(trace: Trace) -> Verdict:
        if not trace.intervened.any():
            return Verdict(False, "never triggered")
        distance = float(trace.distance[trace.intervened.argmax()])
        return Verdict(distance > 5.0 * d_min, f"{distance:.2f} m")

    def bounded(trace: Trace) -> Verdict:
        share = float((np.abs(trace.jerk) / limits.jerk).max())
        return Verdict(share <= 1.0 + 1e-9, f"{share:.0%} of the bound")

    def gentle(trace: Trace) -> Verdict:
        jerk = float(np.abs(trace.jerk).max())
        return Verdict(jerk <= 1.1 * paper.FIG6_JERK, f"{np.degrees(jerk):.0f} °/s³")

    def tip(trace: Trace) -> Verdict:
        share = float((trace.pair[:, 0] == paper.FIG6_ROBOT_LINK - 1).mean())
        return Verdict(share == 1.0, f"{share:.0%} of the time")

    def person(trace: Trace) -> Verdict:
        seen = sequence(trace.pair[:, 1])
        return Verdict(seen == paper.FIG6_HUMAN_LINKS, "-".join(map(str, seen)))

    def home(trace: Trace) -> Verdict:
        left = float(np.degrees(np.abs(trace.position[-1] - trace.initial_state[0]).max()))
        return Verdict(left < 5.0, f"{left:.1f}° off at the end")

    return [
        claim("the distance stays above d_min", margin),
        claim("triggered while there is a decent margin", early),
        claim("the jerk keeps its bounds", bounded),
        claim("the jerk stays within about 2000 °/s³", gentle),
        claim("the robot's critical link stays the end effector", tip),
        claim("the person's are left arm, core, head, core (4-2-1-2)", person),
        claim("the robot returns to home when the person leaves", home),
    ]


def comparison() -> tuple[dict[str, Trace], JointLimits]:
    """Fig. 8: the SSA with λ₁ = 3, and the JSSA with λ = (3, 1)."""
    traces = {}
    traces["SSA"], limits = play(_ssa, "SSA")
    traces[PUBLISHED], limits = play(lambda env: SHIELDS[PUBLISHED](env, 3.0, 1.0), "JSSA, as published")
    return traces, limits


def _ssa(env: gym.Env) -> gym.Env:
    return Shield(env, make_filter("ssa", env.get_wrapper_attr("robot"), env.get_wrapper_attr("dt")))


# ---- sensitivity, Table 1 ----------------------------------------------------------------------------

Grid = Mapping[tuple[float, float], Measures]
"""Measures by (λ₁, λ₂)."""


def sensitivity(
    shields: Sequence[str] = tuple(SHIELDS),
    values: Sequence[float] = paper.GRID,
    steps: int = paper.STEPS,
    done: Callable[[], None] = lambda: None,
) -> dict[str, dict[tuple[float, float], Measures]]:
    """Table 1 for several shields.

    Args:
        shields: Names in :data:`SHIELDS`.
        values: Of λ₁ and of λ₂.
        steps: Length of the episodes.
        done: Called after each.
    """
    tables: dict[str, dict[tuple[float, float], Measures]] = {name: {} for name in shields}
    for name, table in tables.items():
        for lambda2 in values:
            for lambda1 in values:
                trace, limits = play(lambda env, n=name, a=lambda1, b=lambda2: SHIELDS[n](env, a, b), name, steps)
                table[lambda1, lambda2] = measures(trace, limits)
                done()
    return tables


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


def sensitivity_claims(tables: Mapping[str, Grid]) -> list[Claim]:
    """What section 4.2 says about Table 1, for the paper's own numbers and for others.

    A trend is judged along each line of the table, from its smallest to its largest λ. It holds if it is seen in one
    line at least and no line goes the other way.
    """
    every = {PAPER: paper.TABLE1, **tables}
    return [
        Claim(text, "Table 1", {name: _trend(table, axis, measure, sign) for name, table in every.items()})
        for text, axis, measure, sign in _TRENDS
    ]


def _trend(table: Grid, axis: int, measure: str, sign: int) -> Verdict:
    values = sorted({key[axis] for key in table})
    others = sorted({key[1 - axis] for key in table})
    along, against = 0, 0
    for other in others:
        low, high = (
            getattr(table[(value, other) if axis == 0 else (other, value)], measure)
            for value in (values[0], values[-1])
        )
        change = 0.0 if low is None or high is None else sign * (high - low)
        along, against = along + (change > 1e-9), against + (change < -1e-9)
    return Verdict(along > 0 and against == 0, f"{along} of {len(others)}" + (f", {against} against" if against else ""))
