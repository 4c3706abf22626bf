r"""Rows from a predicted miss: what the arm has to do now in order to be out of somebody's way by then.

Where the rows of a safety index ask for what the *next* step needs, these look ahead: the arm takes its nominal step
and stops, people go on as they do, and only a pair that would come too close asks for anything, as softly as the time
that is left allows.
"""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair, common_pair
from jssa_gym.kernels.chain import place_axes, place_present, pose
from jssa_gym.kernels.index import direction
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.stopping import stop_length
from jssa_gym.kernels.vector import add, along, cross, dot, fill_rows, scale, subtract
from jssa_gym.kernels.verification import posture_at


class Foresight(NamedTuple):
    """How far ahead is looked, and what counts as too close."""

    d_min: float
    """Gap that has to be left now [m] ..."""
    growth: float
    """... and by how much more with time: what constant velocities do not know [m/s]."""
    horizon: float
    """[s]."""
    step: float
    """Between the moments that are looked at [s]."""
    soonest: float
    """No row asks to be out of the way sooner [s]."""
    deepest: float
    """A pair that is further inside the gap asks for nothing: there the normal says nothing [m]."""
    authority: float
    """Pairs that the jerk bounds move by less make no rows [m/s³]."""


@jit
def _square(v):
    return dot(v, v)


@jit
def _moved(agent, t):
    """The axis of a person's capsule after the time t at its present velocity."""
    start = add(agent["start"], scale(agent["start_velocity"], t))
    return start, add(agent["end"], scale(agent["end_velocity"], t))


@jit
def _demand(motion, frames, link, point, n, short, T, work):
    r"""The row of one pair at one moment: reach the gap by the minimum-jerk move that is at rest there at T.

    .. math:: n^\top J u \ge \frac{60}{T^3} x - \frac{36}{T^2} n^\top J \dot q - \frac9T n^\top J \ddot q, \quad
        x = m - g + n^\top J (q_\pi - q),

    the first jerk of the quintic that ends at rest in x (Flash, Hogan, J. Neuroscience 5(7), 1985).

    Returns:
        The right side [m/s³]; ``work.jerk`` (n,) becomes n^T J [m].
    """
    state, posture, row = motion.state, work.posture, work.jerk
    x, rate, curvature = short, 0.0, 0.0
    for j in range(row.shape[0]):
        row[j] = 0.0
        if j <= link:
            frame = frames[j]
            row[j] = dot(n, cross(frame["axis"], subtract(point, frame["origin"])))
        x += row[j] * (posture[j] - state[0, j])
        rate += row[j] * state[1, j]
        curvature += row[j] * state[2, j]
    return 60.0 / T**3 * x - 36.0 / T**2 * rate - 9.0 / T * curvature


@jit
def _asked(off, t):
    """Whether any pair has to be looked at at a time t; ``off`` says before when it need not, shape (m, k) [s]."""
    for i in range(off.shape[0]):
        for k in range(off.shape[1]):
            if not t < off[i, k]:
                return True
    return False


@jit
def predicted_rows(robot, motion, agents, foresight, work):
    """Make a row for every pair that would come too close, from its most demanding moment.

    Args:
        robot: The arm, see :class:`~jssa_gym.tick.layout.ArmRecord`.
        motion: The nominal step and the stop after it, as of :class:`~jssa_gym.kernels.verification.StepAndStop`.
        agents: People now, shape (k,) of ``AGENT``.
        foresight: See :class:`Foresight`.
        work: Scratch, as of :class:`~jssa_gym.tick.layout.Work`; ``L``, ``S`` and ``owner`` are the result.

    Returns:
        Number of rows; smallest gap that was predicted and the smallest one now [m], robot capsule and agent of this.
        The smallest predicted one is NaN, and there are no rows, if a gap or a row is not finite: nobody knows then who
        is in the way.
    """
    people, levers, U, row = agents.shape[0], robot.levers, robot.limits[4], work.jerk
    posture, fastest, off, L, S = work.posture, work.fastest, work.people_off, work.L, work.S
    frames, segments = work.frames_present, work.segments_present
    wide = foresight.d_min + foresight.growth * foresight.horizon
    # once the stop is over, the arm stays where it is
    stopped, rests = stop_length(motion.plan) * motion.dt, False
    least, nearest, nearest_row, nearest_column = np.inf, np.inf, -1, -1
    fill_rows(off, -np.inf)
    for p in range(segments.shape[0] * people):
        work.target[p] = -np.inf
    for moment in range(int(np.round(foresight.horizon / foresight.step)) + 1):
        t = moment * foresight.step
        if not _asked(off, t):
            continue  # however they move on, nobody can be too close yet
        if not rests:
            posture_at(motion, t, posture, fastest)
            if moment == 0:
                place_present(robot, posture, work)
            else:
                frames, segments = work.frames, work.segments
                pose(robot.links, posture, frames)
                place_axes(frames, robot.capsules, segments)
            rests = t - motion.dt >= stopped
        for i in range(segments.shape[0]):
            part, rate = segments[i], 0.0
            for j in range(part["link"] + 1):
                rate += levers[i, j] * fastest[j]
            for k in range(people):
                if t < off[i, k]:
                    continue
                agent = agents[k]
                radii = part["radius"] + agent["radius"]
                start, end = _moved(agent, t)
                a, b = part["start"], part["end"]
                gap, s, r, common = common_pair((a[0], a[1], a[2]), (b[0], b[1], b[2]), start, end, radii)
                if not common:
                    gap, s, r = capsule_pair(a, b, start, end, radii)
                if not np.isfinite(gap):
                    return 0, np.nan, np.nan, -1, -1
                least = min(least, gap)
                if moment == 0 and gap < nearest:
                    nearest, nearest_row, nearest_column = gap, i, k
                short = foresight.d_min + foresight.growth * t - gap
                if short <= 0.0:
                    # however both move on, they cannot be too close before that
                    speed = np.sqrt(max(_square(agent["start_velocity"]), _square(agent["end_velocity"])))
                    off[i, k] = t + (gap - wide) / (rate + speed) if rate + speed > 0.0 else np.inf
                    continue
                if not short <= foresight.deepest:
                    off[i, k] = np.inf
                    continue
                point = along(part["start"], part["end"], s)
                middle = subtract(along(part["start"], part["end"], 0.5), along(start, end, 0.5))
                n = direction(subtract(point, along(start, end, r)), gap + radii, middle)
                right = _demand(
                    motion, frames, part["link"], point, n, short, max(t, foresight.soonest), work
                )  # fmt: skip
                authority = 0.0
                for j in range(row.shape[0]):
                    authority += abs(row[j]) * U[j]
                if not np.isfinite(right + authority):
                    return 0, np.nan, np.nan, -1, -1
                p = i * people + k
                if authority >= foresight.authority and right > work.target[p] * authority:
                    work.target[p], S[p] = right / authority, right
                    for j in range(row.shape[0]):
                        L[p, j] = row[j]
    count = 0
    for p in range(segments.shape[0] * people):
        if work.target[p] > -np.inf:
            work.owner[count], S[count] = p, S[p]
            for j in range(row.shape[0]):
                L[count, j] = L[p, j]
            count += 1
    return count, least, nearest, nearest_row, nearest_column
