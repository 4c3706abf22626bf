"""The way back to a path that something else has taken the arm off, ahead of where it was and without a stop."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jssa_gym.control.least_jerk import FEWEST
from jssa_gym.control.plan import Plan
from jssa_gym.kernels.profile import may_join
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array

_SURELY = 1e-4
"""Share of a limit that is more than rounding: what exceeds it by that exceeds it."""

Clear = Callable[[Array], bool]
"""Whether joint positions, shape (m, n) [rad], are clear of what stands still."""

_TIMES = (0.1, 0.16, 0.24, 0.36, 0.54, 0.8, 1.2)
"""That a way back may take [s], the shortest first."""

_LEADS = (1.0, 0.7, 0.4)
"""How far ahead on the path it ends, as a share of its own time: less where the arm has to gather speed."""

_SHARES = (0.7, 1.0)
"""Shares of the jerk limits that it may use: as much as other plans if possible."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A host's plan, and how the arm gets onto it."""

    plan: Plan
    """What is played: the way back, then the rest of the host's plan."""
    host: Plan
    """What the host has planned."""
    entry: int = 0
    """Ticks that the way back takes."""
    begin: int = 0
    """Tick of the host's plan that the arm was at when it began."""
    meets: int = 0
    """Tick of the host's plan that it ends at."""

    def at(self, ticks: int, position: Array) -> int:
        """Tick of the host's plan that the arm is at, or nearest to.

        Args:
            ticks: That have been played.
            position: Where the arm is, shape (n,) [rad].
        """
        if ticks >= self.entry:
            return min(self.meets + ticks - self.entry, len(self.host))
        # before it ends: a waypoint that it ends at is still to be met
        gaps = np.abs(self.host.states[self.begin : max(self.meets, self.begin + 1), 0] - position).max(axis=1)
        return self.begin + int(gaps.argmin())


def rejoin(route: Route, at: int, state: Array, limits: JointLimits, clear: Clear) -> Route | None:
    """A move of least squared jerk from any state to a moving point of the path, and on along it.

    No waypoint is left out: it ends at the next one at the latest.

    Args:
        route: That the arm was thrown off.
        at: Tick of the host's plan that it is at, by :meth:`Route.at`.
        state: Where it is: rows position, velocity, acceleration, shape (3, n).
        limits: Of the joints.
        clear: What the way back is checked by; the rest of the plan was checked before.

    Returns:
        The route, or None if no such move keeps the limits and is clear.
    """
    host = route.host
    last = next((mark for mark in host.marks if mark > at), len(host))
    begin = np.ascontiguousarray(state, float)
    for share in _SHARES:
        kept = limits.bounds()
        kept[4] *= share
        for time in _TIMES:
            entry = max(round(time / host.dt), FEWEST)
            inverse = _least_norm(entry)[1]
            for meets in sorted({min(at + max(round(lead * entry), 1), last) for lead in _LEADS}, reverse=True):
                if not may_join(begin, host.states[meets], inverse, host.dt, kept, _SURELY):
                    continue
                jerk = _joining(state, host.states[meets], entry, host.dt)
                way = Plan.follow(state, jerk, host.dt, (entry,))
                if not way.within(kept) or not clear(way.states[:, 0]):
                    continue
                marks = tuple(entry + mark - meets for mark in host.marks if mark >= max(meets, at + 1))
                plan = Plan.follow(state, np.concatenate([jerk, host.jerk[meets:]]), host.dt, marks)
                return Route(plan, host, entry, at, meets)
    return None


def _joining(state: Array, target: Array, ticks: int, dt: float) -> Array:
    """Jerks of least norm from one joint state to another, each of shape (3, n), in so many ticks: shape (H, n)."""
    unit = np.array([1.0, dt, dt**2])[:, None]
    (q, v, a), (end_q, end_v, end_a) = state * unit, target * unit
    right = np.array([end_q - (q + ticks * v + ticks**2 / 2.0 * a), end_v - (v + ticks * a), end_a - a])
    effect, inverse = _least_norm(ticks)
    jerk = inverse @ right
    return (jerk + inverse @ (right - effect @ jerk)) / dt**3  # once more for the digits that were lost


@functools.lru_cache(maxsize=64)
def _least_norm(ticks: int) -> tuple[Array, Array]:
    """What jerks (H,) do to position, speed and acceleration at the end, in ticks, (3, H); and the inverse (H, 3).

    The jerks of least norm are a combination of the three rows, so a parabola over the ticks.
    """
    left = ticks - 1.0 - np.arange(ticks)
    effect = np.array([1.0 / 6.0 + left / 2.0 + left**2 / 2.0, 0.5 + left, np.ones(ticks)])
    parabolas = np.vander((left + 0.5) / ticks - 0.5, 3)
    return effect, parabolas @ np.linalg.inv(effect @ parabolas)
