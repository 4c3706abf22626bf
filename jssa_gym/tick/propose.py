"""What the compiled filters propose: a jerk, and what is known of it."""

import numpy as np

from jssa_gym.kernels.capsules import nearest
from jssa_gym.kernels.index import advance, assess, exact_rows
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.printed import measure_present, printed_rows
from jssa_gym.kernels.projection import project_row, project_rows, violation
from jssa_gym.kernels.vector import copy
from jssa_gym.tick import codes
from jssa_gym.tick.layout import JSSA, NONE, PRINTED

PROJECT = 1
"""Rows have been made: a jerk has to be projected onto them."""

TOLERANCE = 1e-6
"""Index [m²] up to which a row counts as kept once the arm's true motion is computed."""

LINEARISATIONS = 3
"""How often the exact row is linearised anew at the projected jerk; once is the rule."""


@jit
def project(settings, nominal, count, work):
    """Nearest jerk to the nominal (n,) in box and the first rows, into ``work.wanted``; feasible, violation left."""
    if count == 1 and settings.diagonal:
        row, right = work.L[0], work.S[0]
        left = project_row(nominal, row, right, work.lower, work.upper, settings.weight, work.wanted)
        # a violation of rounding size is no infeasibility
        return left < np.inf and left <= 1e-12 * max(1.0, abs(right)), max(left, 0.0)
    return project_rows(
        nominal, work.L, work.S, count, work.lower, work.upper, settings.inverse,
        work.multipliers, work.active, work.relief, work.wanted,
    )  # fmt: skip


@jit
def look_ahead(robot, settings, state, jerk, humans, rows, work, told):
    """Index of every pair at the end of the step under ``jerk``, and the closest human pair; ``told`` takes them down.

    ``work.agents`` are at the end of the step.

    Returns:
        The largest index [m²]; by how much the pairs of the first ``rows`` rows exceed what these ask for [m²].
    """
    pairs = work.pairs
    worst, _, _ = assess(
        robot.links, robot.capsules, state, jerk, work.agents, work.planes, settings.dt, settings.index,
        work.after, work.frames, work.segments, pairs,
    )  # fmt: skip
    kept = -np.inf
    for k in range(rows):
        i, j = work.owner[k] // pairs.shape[1], work.owner[k] % pairs.shape[1]
        excess = pairs[i, j]["phi"] - work.target[k]
        if not (excess <= kept):
            kept = excess
    told["phi"] = worst
    told["row"], told["column"], told["distance"] = nearest(pairs, humans)
    return worst, kept


@jit
def look_back(robot, settings, state, work):
    """Index of every pair at the beginning of the step, from ``work.agents`` at its end."""
    advance(work.agents, -settings.dt)
    assess(
        robot.links, robot.capsules, state, state[0], work.agents, work.planes, 0.0, settings.index,
        work.before, work.frames_now, work.segments_now, work.pairs_now,
    )  # fmt: skip
    advance(work.agents, settings.dt)


@jit
def rows_at(robot, settings, jerk, only, work):
    """Make the rows, linearised at ``jerk`` after :func:`look_ahead` at it.

    Args:
        only: Row-major number of the only pair to look at, or -1 for all.

    Returns:
        Their number, their largest violation at ``jerk`` [m²], and whether one asks for less than 0 at once.
    """
    count = exact_rows(
        work.frames, work.segments, work.agents, work.planes, work.pairs, jerk, work.lower, work.upper,
        settings.dt, settings.index, only, robot.limits[4], settings.authority, settings.recovery,
        work.pairs_now, work.L, work.S, work.owner, work.target,
    )  # fmt: skip
    recovering = False
    for k in range(count):
        recovering = recovering or work.target[k] > 0.0
    return count, violation(work.L, work.S, count, jerk), recovering


@part
def solve(robot, settings, state, nominal, humans, work, told):
    r"""Keep :math:`\phi_{k+1} \le 0` (Eq. 6) by the nearest jerk in rows and box, Eq. (14), into ``work.wanted``.

    The nominal, clipped to the box, is kept if it satisfies the rows. Else the rows are linearised at it, the
    projection is computed, and the index is evaluated again with the arm's true motion; what linearisation missed is
    projected once more. Rows as printed are of the present and projected once.

    Returns:
        0, or what failed, as a code.
    """
    stage = begin_rows(robot, settings, state, humans, work, told)
    while stage == PROJECT:
        feasible, left = project(settings, nominal, told["rows"], work)
        stage = after_projection(robot, settings, state, humans, feasible, left, work, told)
    return stage


@jit
def begin_rows(robot, settings, state, humans, work, told):
    """Look at the clipped nominal: 0 if it is kept, ``PROJECT`` if it is to be projected onto the rows that were made.

    Returns:
        That, or what failed, as a code.
    """
    copy(work.clipped, work.wanted)
    told["rows"], told["attempt"], told["recovering"], told["kept"], told["slack"] = 0, 0, False, True, 0.0
    if settings.proposal == PRINTED:
        return _printed(robot, settings, state, humans, work, told)
    worst, _ = look_ahead(robot, settings, state, work.wanted, humans, 0, work, told)
    if not worst < np.inf:
        return codes.INDEX
    if worst > 0.0:
        if settings.recovery > 0.0:
            look_back(robot, settings, state, work)
        return _linearise(robot, settings, work, told)
    return 0


@jit
def _linearise(robot, settings, work, told):
    """Make rows at ``work.wanted``; ``PROJECT`` unless they are kept, or there were enough."""
    only = told["row"] * work.pairs.shape[1] + told["column"] if settings.closest else -1
    count, left, recovering = rows_at(robot, settings, work.wanted, only, work)
    if left <= (TOLERANCE if told["attempt"] > 0 else 0.0) or told["attempt"] == LINEARISATIONS:
        return _finish(left, work, told)
    told["rows"], told["recovering"] = count, recovering
    return PROJECT


@jit
def _finish(left, work, told):
    """Take down what is left of the rows [m²]; 0, or the code of an index that is none."""
    told["slack"] = max(left, 0.0)
    told["kept"] = told["kept"] and left <= TOLERANCE
    return 0 if left < np.inf and told["phi"] < np.inf else codes.INDEX


@jit
def after_projection(robot, settings, state, humans, feasible, left, work, told):
    """Look at the projected jerk, ``work.wanted``; returns as :func:`begin_rows`.

    Args:
        feasible: Whether rows and box have a common point.
        left: What is left of the rows [m²]; NaN for no projection.
    """
    if settings.proposal == PRINTED:
        told["kept"], told["slack"] = feasible, max(left, 0.0)
        return _index_of_printed(left, work, told)
    if np.isnan(left):
        return codes.UNSOLVED
    told["kept"] = feasible
    _, left = look_ahead(robot, settings, state, work.wanted, humans, told["rows"], work, told)
    if left <= TOLERANCE or not feasible:
        return _finish(left, work, told)
    told["attempt"] += 1
    return _linearise(robot, settings, work, told)


@jit
def _printed(robot, settings, state, humans, work, told):
    """Make the rows of Eq. (13) as printed, from the present; returns as :func:`begin_rows`."""
    agents = work.agents[:humans]
    told["phi"], told["attempt"] = -np.inf, 0
    row, column, told["distance"] = measure_present(
        robot.links, robot.capsules, state, agents, work.frames, work.segments, work.pairs
    )
    told["row"], told["column"] = row, column
    if row < 0:
        return 0
    only = row * humans + column if settings.closest else -1
    authority = 0.0 if settings.closest else settings.authority
    count = printed_rows(
        work.frames, work.segments, agents, work.pairs, work.lower, work.upper, settings.dt, settings.index,
        only, authority, work.L, work.S, work.owner,
    )  # fmt: skip
    told["attempt"] = count
    left = violation(work.L, work.S, count, work.wanted)
    if left <= 0.0:
        told["slack"] = max(left, 0.0)
        return _index_of_printed(left, work, told)
    told["rows"] = count
    return PROJECT


@jit
def _index_of_printed(left, work, told):
    """The index as printed is its own row's S - L u; 0, or the code of one that is none."""
    for k in range(told["attempt"]):
        gap = work.S[k]
        for j in range(work.wanted.shape[0]):
            gap -= work.L[k, j] * work.wanted[j]
        if not gap <= told["phi"]:
            told["phi"] = gap
            if np.isnan(gap):
                break
    return 0 if left < np.inf and told["phi"] < np.inf else codes.PRINTED_ROW


@jit
def meet(settings, memory, scene, work, e):
    """Let rows see what stands still too, if asked for, and for exact rows everybody at the end of the step.

    Returns 0, or ``FIXTURES`` if what stands still is no such thing.
    """
    people = memory.tracks.shape[1]
    if settings.static_rows:
        if not scene.now[e]["fixtures"]:
            return codes.FIXTURES
        for k in range(scene.static_radius.shape[1]):
            agent, total = work.agents[people + k], 0.0
            for i in range(3):
                agent["start"][i], agent["end"][i] = scene.static_ends[e, 0, k, i], scene.static_ends[e, 1, k, i]
                agent["start_velocity"][i] = scene.static_ends[e, 2, k, i]
                agent["end_velocity"][i] = scene.static_ends[e, 3, k, i]
                total += agent["start"][i] + agent["end"][i] + agent["start_velocity"][i] + agent["end_velocity"][i]
            agent["radius"] = scene.static_radius[e, k]
            if not (np.isfinite(total) and 0.0 < agent["radius"] < np.inf):
                return codes.FIXTURES
        for k in range(scene.offset.shape[1]):
            plane, length2 = work.planes[k], 0.0
            for i in range(3):
                plane["normal"][i] = scene.normal[e, k, i]
                length2 += plane["normal"][i] ** 2
            plane["offset"] = scene.offset[e, k]
            if not (abs(np.sqrt(length2) - 1.0) < 1e-6 and np.isfinite(plane["offset"])):
                return codes.FIXTURES
    if settings.proposal == JSSA:
        advance(work.agents, settings.dt)
    return 0


@part
def propose(robot, settings, memory, scene, nominal, work, answer, e):
    """A jerk into ``work.wanted``; what is known of it into ``answer``: status FAULT and a code if there is none."""
    told, fault = answer.told[e], 0
    if settings.proposal == NONE:
        copy(work.clipped, work.wanted)
        told["slack"], told["kept"] = 0.0, True
    else:
        fault = meet(settings, memory, scene, work, e)
    if fault == 0 and settings.proposal != NONE:
        fault = solve(robot, settings, memory.state[e], nominal, memory.tracks.shape[1], work, told)
    name_status(robot, nominal, fault, work, told)


@jit
def name_status(robot, nominal, fault, work, told):
    """Say what became of the nominal; ``fault`` is the code of what failed, or 0."""
    if fault:
        told["status"], told["code"] = codes.FAULT, fault
    elif not told["kept"]:
        told["status"], told["code"] = codes.RELAXED, codes.INFEASIBLE
    elif told["rows"] == 0:
        told["status"], told["code"] = codes.NOMINAL, 0
        if not told["inside"]:
            told["status"], told["code"] = codes.PROJECTED, of_clipping(robot, nominal, work)
    elif told["recovering"]:
        told["status"], told["code"] = codes.RELAXED, codes.RECOVERING
    else:
        told["status"], told["code"] = codes.PROJECTED, codes.ROWS


@jit
def of_clipping(robot, nominal, work):
    """Why the nominal was clipped: by the jerk bounds alone, or by the viability box in some joint."""
    for j in range(nominal.shape[0]):
        bound = robot.limits[4, j]
        if work.clipped[j] != max(min(nominal[j], bound), -bound):
            return codes.UNRECOVERABLE
    return codes.CLIPPED


@part
def propose_held(robot, settings, memory, nominal, held, work, answer, e):
    """Another jerk, into ``work.wanted``, if the first ``held`` joints have to go on with the stored stop's."""
    halt, wanted, box, humans = work.halt, work.wanted, work.spare, memory.tracks.shape[1]
    if settings.proposal == JSSA:
        # in a box that leaves those joints no choice
        copy(work.lower, box[0])
        copy(work.upper, box[1])
        for j in range(held):
            work.lower[j] = work.upper[j] = halt[j]
        clip_to_box(nominal, work)
        fault = solve(robot, settings, memory.state[e], nominal, humans, work, work.told[0])
        copy(box[0], work.lower)
        copy(box[1], work.upper)
        if fault == 0:
            return
    copy(answer.jerk[e], wanted)
    for j in range(held):
        wanted[j] = halt[j]


@jit
def clip_to_box(nominal, work):
    """The nominal in the box, into ``work.clipped``; whether it lay inside."""
    inside = True
    for j in range(nominal.shape[0]):
        work.clipped[j] = min(max(nominal[j], work.lower[j]), work.upper[j])
        inside = inside and work.clipped[j] == nominal[j]
    return inside


@part
def foresee(robot, settings, memory, jerk, work, told, e):
    """Index, distance and pair at the end of the step under another jerk than was proposed."""
    if settings.proposal == JSSA:
        look_ahead(robot, settings, memory.state[e], jerk, memory.tracks.shape[1], 0, work, told)
    elif settings.proposal == PRINTED:
        told["phi"], told["distance"] = np.nan, np.nan
        told["row"], told["column"] = -1, -1
