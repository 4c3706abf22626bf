"""CBFpy as a filter, to be put on the same board as all others.

    python3 -m venv .venv-cbfpy && .venv-cbfpy/bin/pip install -e . cbfpy
    .venv-cbfpy/bin/jssa-gym leaderboard submit --filter benchmarks.cbfpy_filter:CBFpyFilter --out cbfpy
    .venv-cbfpy/bin/jssa-gym leaderboard submit --filter benchmarks.cbfpy_filter:CBFpyFilter+stop --out cbfpy-inside

CBFpy is built on JAX, whose versions need not be those of the rest: hence an environment of its own. What it is asked
is what ``cbfpy_peer.py`` asks it: the nearest jerk in the bounds with ``h_dot >= -alpha h`` for the index of every
pair, violations paid for. Its solver ends within a thousandth, so a jerk that near to the nominal counts as the
nominal. With ``+stop`` its answer is clipped to the viability box, which CBFpy, whose bounds are fixed, is not told.
"""

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import DEFAULT
from jssa_gym.safety.pairs import Pairs
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.shields.tick import Tick
from jssa_gym.types import Array, Decision, Status

NEAR = 1e-3
"""Share of the jerk bounds within which an answer is the nominal."""

_SOLVERS: dict[Any, Callable[[Array, Array, Array], Array]] = {}
"""Compiled once for an arm and a number of capsules; filters are copied, these are not."""


def compiled(robot: RobotModel, dt: float, humans: int) -> Callable[[Array, Array, Array], Array]:
    """CBFpy's answer to [q, v, a, 0], a nominal jerk and capsules (humans, 13)."""
    key = robot.links.tobytes(), robot.capsules.tobytes(), robot.limits.jerk.tobytes(), dt, humans
    if key not in _SOLVERS:
        peer = importlib.import_module(f"{__package__}.cbfpy_peer" if __package__ else "cbfpy_peer")
        _SOLVERS[key] = peer.CBF.from_config(
            peer.JerkConfig(robot, humans, 1.0 / dt, **peer.SOLVERS["qpax"])
        ).safety_filter
    return _SOLVERS[key]


class CBFpyFilter(PairFilter):
    """The nearest jerk that CBFpy finds."""

    def coefficients(self) -> tuple[float, float, float]:
        return DEFAULT.d_min, DEFAULT.lambda1, DEFAULT.lambda2

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        z = np.append(tick.state.ravel(), 0.0)
        people = np.column_stack([tick.people[name] for name in tick.people.dtype.names])
        jerk = np.asarray(compiled(tick.robot, self.dt, len(people))(z, tick.clipped, people), np.float64)
        if not np.isfinite(jerk).all():
            return self.failed(tick, "CBFpy found no jerk")
        largest = float(index.max())
        if np.abs(jerk - tick.clipped).max() <= NEAR * tick.robot.limits.jerk.min():
            return self.untouched(tick, largest)
        return self.decided(
            tick, np.clip(jerk, tick.lower, tick.upper), Status.PROJECTED, "keeps the barrier", largest, rows=len(index)
        )
