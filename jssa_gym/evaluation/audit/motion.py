"""A log's motion on the control grid: stated rules, and a gap stays a gap."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from jssa_gym.evaluation.audit.log import RobotLog
from jssa_gym.humans import Recording
from jssa_gym.types import Array

GAP, GAP_STEPS = 0.1, 5.0
"""A gap is longer than this [s], and than so many usual steps."""

_ON_GRID = 1e-6
"""Share of the control step by which a sample may be off the grid and still is on it."""


class Gap(NamedTuple):
    """A time without data."""

    of: str
    """The robot, or a person's file."""
    start: float
    """[s]."""
    end: float
    """[s]."""


class Stretch(NamedTuple):
    """A time in which robot and people are known, on the control grid: T + 1 moments."""

    time: Array
    """By the log's clock, shape (T + 1,) [s]."""
    states: Array
    """Shape (T + 1, 3, n) [rad, rad/s, rad/s²]."""
    ends: Array
    """Everybody's capsules, starts and ends, shape (T + 1, 2, m, 3) [m]."""


def gaps_of(what: str, time: Array) -> list[Gap]:
    """Where samples are missing."""
    step = np.diff(time)
    usual = float(np.median(step))
    return [
        Gap(what, float(time[k]), float(time[k + 1]))
        for k in np.flatnonzero(step > max(GAP, GAP_STEPS * usual)).tolist()
    ]


def stretches(log: RobotLog, people: Sequence[Recording], gaps: Sequence[Gap], dt: float) -> list[Stretch]:
    """The times without gaps in which robot and everybody were recorded, two control steps long at least.

    Between samples people move on straight lines. Joints follow the cubic that has the positions and velocities of
    both samples; where velocities were not logged, the cubic spline with continuous acceleration through the positions,
    which is the motion of Eq. (1) if these are a control step apart. The grid begins with the first sample of the
    robot; samples on the grid are taken as they are, accelerations too where they were logged.
    """
    begin = max(log.time[0], *(one.time[0] for one in people), log.time[0])
    end = min(log.time[-1], *(one.time[-1] for one in people), log.time[-1])
    cuts = sorted((gap.start, gap.end) for gap in gaps)
    edges, since = [], begin
    for start, stop in cuts:
        edges.append((since, min(start, end)))
        since = max(since, stop)
    edges.append((since, end))
    found = []
    for first, last in edges:
        inside = (log.time >= first - dt * _ON_GRID) & (log.time <= last + dt * _ON_GRID)
        if np.count_nonzero(inside) >= 4 and last - first >= 2.0 * dt:
            found.append(_stretch(log, inside, people, dt))
    return found


def _stretch(log: RobotLog, inside: NDArray[np.bool_], people: Sequence[Recording], dt: float) -> Stretch:
    time = log.time[inside]
    count = int((time[-1] - time[0]) / dt + _ON_GRID)
    grid = time[0] + dt * np.arange(count + 1)
    position = log.position[inside]
    if log.velocity is None:
        curve = CubicSpline(time, position, bc_type=spline_ends(position))
    else:
        curve = CubicHermiteSpline(time, position, log.velocity[inside])
    inner = np.clip(grid, time[0], time[-1])
    states = np.stack([curve(inner), curve(inner, 1), curve(inner, 2)], axis=1)
    nearest = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    nearest -= np.abs(time[nearest - 1] - grid) <= np.abs(time[nearest] - grid)
    exact = np.abs(time[nearest] - grid) <= dt * _ON_GRID
    for row, logged in enumerate((log.position, log.velocity, log.acceleration)):
        if logged is not None:
            states[exact, row] = logged[inside][nearest[exact]]
    moments = np.where(exact, time[nearest], grid)
    return Stretch(moments, states, _people_at(people, moments))


def spline_ends(position: Array) -> tuple[Any, Any]:
    """Ends of the spline: at rest where the outermost three samples are alike, else the outermost pieces are one."""
    still = (1, np.zeros(position.shape[1]))
    first, last = (
        still if np.ptp(three, axis=0).max() < 1e-6 else "not-a-knot" for three in (position[:3], position[-3:])
    )
    return first, last


def _people_at(people: Sequence[Recording], moments: Array) -> Array:
    parts = sum(len(one.names) for one in people)
    ends = np.zeros((len(moments), 2, parts, 3))
    first = 0
    for one in people:
        both = np.stack([one.start, one.end], axis=1)
        k = np.clip(np.searchsorted(one.time, moments, "right") - 1, 0, len(one.time) - 2)
        share = np.clip((moments - one.time[k]) / (one.time[k + 1] - one.time[k]), 0.0, 1.0)[:, None, None, None]
        # so that samples stay what they are, at both ends
        between = both[k] + share * (both[k + 1] - both[k])
        ends[:, :, first : first + len(one.names)] = np.where(share == 1.0, both[k + 1], between)
        first += len(one.names)
    return ends
