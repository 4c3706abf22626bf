"""The jerk-based safe set algorithm: the nearest jerk that keeps the index one step ahead at 0 or below."""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.capsules import nearest
from jssa_gym.kernels.chain import place_present
from jssa_gym.kernels.index import Index, advance, assess, exact_rows, reassess
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.projection import violation
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.rows import PROJECT, of_rows

TOLERANCE = 1e-6
"""Index [m²] up to which a row counts as kept once the arm's true motion is computed."""

CLOSE = -1e-6
"""Index [m²] below which no row is violated where it is linearised: all ask for 0 or more. Rounding is far less."""

ALL = -np.inf
"""Below the index of every pair."""

LINEARISATIONS = 3
"""How often the exact row is linearised anew at the projected jerk; once is the rule."""


class ExactRows(NamedTuple):
    """Rows of the index one step ahead, linearised: JSSA."""

    index: Index
    """Parameters of the safety index."""
    closest: bool
    """Whether only the closest pair makes a row."""
    authority: float
    """Pairs that the jerk bounds move by less make no rows [m²]."""
    recovery: float
    """Share of its authority by which an index above 0 has to fall in a step."""


@jit
def people_ahead(settings, memory, scene, work, e):
    """Let rows see everybody at the end of the step, and what stands still too, if asked for.

    Returns 0, or ``FILTER_FAILED`` if what stands still is no such thing.
    """
    people = memory.tracks.shape[1]
    if settings.static_rows:
        if not scene.now[e]["fixtures"]:
            return codes.FILTER_FAILED
        for k in range(scene.static_radius.shape[1]):
            agent, total = work.agents[people + k], 0.0
            for i in range(3):
                agent["start"][i], agent["end"][i] = scene.static_ends[e, 0, k, i], scene.static_ends[e, 1, k, i]
                agent["start_velocity"][i] = scene.static_ends[e, 2, k, i]
                agent["end_velocity"][i] = scene.static_ends[e, 3, k, i]
                total += agent["start"][i] + agent["end"][i] + agent["start_velocity"][i] + agent["end_velocity"][i]
            agent["radius"] = scene.static_radius[e, k]
            if not (np.isfinite(total) and 0.0 < agent["radius"] < np.inf):
                return codes.FILTER_FAILED
        for k in range(scene.offset.shape[1]):
            plane, length2 = work.planes[k], 0.0
            for i in range(3):
                plane["normal"][i] = scene.normal[e, k, i]
                length2 += plane["normal"][i] ** 2
            plane["offset"] = scene.offset[e, k]
            if not (abs(np.sqrt(length2) - 1.0) < 1e-6 and np.isfinite(plane["offset"])):
                return codes.FILTER_FAILED
    advance(work.agents, settings.dt)
    return 0


@jit
def look_ahead(robot, settings, proposal, memory, jerk, work, told, e):
    """Index of every pair at the end of the step under ``jerk``, and the closest human pair; ``told`` takes them down.

    ``work.agents`` are at the end of the step.

    Returns:
        The largest index [m²]; by how much the pairs of ``told["rows"]`` rows exceed what these ask for [m²].
    """
    pairs = work.pairs
    worst, _, _ = assess(
        robot.links, robot.capsules, memory.state[e], jerk, work.agents, work.planes, settings.dt, proposal.index,
        work.after, work.frames, work.segments, pairs,
    )  # fmt: skip
    kept = -np.inf
    for k in range(told["rows"]):
        i, j = work.owner[k] // pairs.shape[1], work.owner[k] % pairs.shape[1]
        excess = pairs[i, j]["phi"] - work.target[k]
        if not (excess <= kept):
            kept = excess
    told["phi"] = worst
    told["row"], told["column"], told["distance"] = nearest(pairs, memory.tracks.shape[1])
    return worst, kept


@part
def move_back(settings, work):
    """Where everybody whom rows see is at the beginning of the step, into ``work.agents_now``, from its end."""
    advance(work.agents, -settings.dt)
    for k in range(work.agents.shape[0]):
        work.agents_now[k] = work.agents[k]
    advance(work.agents, settings.dt)


@jit
def look_back(robot, proposal, state, above, work):
    """Index at the beginning of the step, after :func:`move_back`, of the pairs that at its end are above a level."""
    place_present(robot, state[0], work)
    reassess(
        robot.links, robot.capsules, state, work.agents_now, work.planes, proposal.index, above, work.pairs,
        work.frames_present, work.segments_present, work.pairs_now,
    )  # fmt: skip


@part
def rows_at(robot, settings, proposal, jerk, only, above, work):
    """Make the rows, linearised at ``jerk`` after :func:`look_ahead` at it.

    Args:
        only: Row-major number of the only pair to look at, or -1 for all.
        above: Only pairs whose index is above this are looked at [m²].

    Returns:
        Their number, their largest violation at ``jerk`` [m²], and whether one asks for less than 0 at once.
    """
    count = exact_rows(
        work.frames, work.segments, work.agents, work.planes, work.pairs, jerk, work.lower, work.upper,
        settings.dt, proposal.index, only, above, robot.limits[4], proposal.authority, proposal.recovery,
        work.pairs_now, work.L, work.S, work.owner, work.target,
    )  # fmt: skip
    recovering = False
    for k in range(count):
        recovering = recovering or work.target[k] > 0.0
    return count, violation(work.L, work.S, count, jerk), recovering


@jit
def exact(robot, settings, proposal, memory, nominal, work, told, e):
    r"""Keep :math:`\phi_{k+1} \le 0` (Eq. 6); arguments as of :mod:`jssa_gym.tick.proposals`.

    The nominal, clipped to the box, is kept if it satisfies the rows. Else the rows are linearised at it, the
    projection is computed, and the index is evaluated again with the arm's true motion; what linearisation missed is
    projected once more.
    """
    worst, _ = look_ahead(robot, settings, proposal, memory, work.wanted, work, told, e)
    if not worst < np.inf:
        return codes.INDEX
    if not worst > 0.0:
        return 0
    recovers = proposal.recovery > 0.0
    if recovers:
        move_back(settings, work)
        look_back(robot, proposal, memory.state[e], CLOSE, work)
    # rows that are kept by far have to be made only if another jerk is looked for
    stage = _linearise(robot, settings, proposal, CLOSE, work, told)
    if stage == PROJECT:
        if recovers:
            look_back(robot, proposal, memory.state[e], ALL, work)
        stage = _linearise(robot, settings, proposal, ALL, work, told)
    return stage


@jit
def _linearise(robot, settings, proposal, above, work, told):
    """Make rows of pairs above a level at ``work.wanted``; ``PROJECT`` unless they are kept, or there were enough."""
    only = told["row"] * work.pairs.shape[1] + told["column"] if proposal.closest else -1
    count, left, recovering = rows_at(robot, settings, proposal, work.wanted, only, above, work)
    if left <= (TOLERANCE if told["attempt"] > 0 else 0.0) or told["attempt"] == LINEARISATIONS:
        return _finish(left, told)
    told["rows"], told["recovering"] = count, recovering
    return PROJECT


@jit
def _finish(left, told):
    """Take down what is left of the rows [m²]; what became of them, as a code."""
    told["slack"] = max(left, 0.0)
    told["kept"] = told["kept"] and left <= TOLERANCE
    return of_rows(told) if left < np.inf and told["phi"] < np.inf else codes.INDEX


@jit
def after_exact(robot, settings, proposal, memory, nominal, work, told, e):
    """Look at the projected jerk with the arm's true motion; as :func:`exact`."""
    if np.isnan(told["slack"]):
        return codes.UNSOLVED
    _, left = look_ahead(robot, settings, proposal, memory, work.wanted, work, told, e)
    if left <= TOLERANCE or not told["kept"]:
        return _finish(left, told)
    told["attempt"] += 1
    return _linearise(robot, settings, proposal, ALL, work, told)
