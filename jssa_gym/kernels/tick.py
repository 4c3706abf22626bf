"""Whole control steps in one call each: what an environment and a filter do in every tick."""

import numpy as np

from jssa_gym.kernels.capsules import nearest
from jssa_gym.kernels.chain import tool_motion
from jssa_gym.kernels.contact import observe, unsound
from jssa_gym.kernels.index import advance, assess, exact_rows, index_of
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate, representable, violates
from jssa_gym.kernels.projection import clip, violation
from jssa_gym.kernels.viability import jerk_box


@jit
def load_agents(start, end, start_velocity, end_velocity, radius, agents):
    """Capsules as separate arrays into records."""
    for j in range(radius.shape[0]):
        agent = agents[j]
        for k in range(3):
            agent["start"][k] = start[j, k]
            agent["end"][k] = end[j, k]
            agent["start_velocity"][k] = start_velocity[j, k]
            agent["end_velocity"][k] = end_velocity[j, k]
        agent["radius"] = radius[j]


@jit
def tick(
    links,
    capsules,
    tool_link,
    tool_offset,
    before,
    jerk,
    dt,
    bounds,
    tolerance,
    start,
    end,
    start_velocity,
    end_velocity,
    radius,
    parameters,
    after,
    agents,
    frames,
    segments,
    pairs,
    near,
    parts,
    tip,
):
    """Move the arm by one step of Eq. (1) and look at it beside people, who have moved already.

    Arguments as of :func:`~jssa_gym.kernels.motion.integrate`, :func:`load_agents`,
    :func:`~jssa_gym.kernels.contact.observe`, :func:`~jssa_gym.kernels.chain.tool_motion` and
    :func:`~jssa_gym.kernels.motion.violates`.

    Returns:
        Row and column of the closest pair, its distance [m], the largest speed of a touching point and the speed of
        the tool centre point [m/s], whether a limit is exceeded.
    """
    integrate(before, jerk, dt, after)
    load_agents(start, end, start_velocity, end_velocity, radius, agents)
    index = index_of(parameters)
    row, column = observe(links, capsules, after, agents, index, frames, segments, pairs, near, parts)
    speed = tool_motion(frames, tool_link, tool_offset, tip)
    return row, column, near[0], near[3], speed, violates(after, jerk, bounds, tolerance)


@jit
def fill_observation(state, tip, near, parts, goal, scaling, out):
    """Observation in the order of the feature table: arm, tip, people, goal.

    Each raw value becomes (value - shift) gain, clipped to low and high: the rows of ``scaling``, shape (4, size).
    """
    n = state.shape[1]
    for i in range(out.shape[0]):
        if i < 3 * n:
            raw = state[i // n, i % n]
        elif i < 3 * n + 3:
            raw = tip[0, i - 3 * n]
        elif i < 3 * n + 12:
            raw = near[4 + i - 3 * n - 3]
        elif i < 3 * n + 12 + parts.shape[0]:
            raw = parts[i - 3 * n - 12]
        else:
            raw = goal[i - 3 * n - 12 - parts.shape[0]]
        # min and max in float64, so that a bound is met exactly after rounding
        out[i] = min(max((raw - scaling[0, i]) * scaling[1, i], scaling[2, i]), scaling[3, i])


@jit
def take_in(
    start,
    end,
    start_velocity,
    end_velocity,
    radius,
    valid,
    nominal,
    bounds,
    dt,
    viability,
    state,
    agents,
    lower,
    upper,
    clipped,
):
    """Read people into ``agents``, check them and the joint state (3, n), and clip the nominal to the box.

    The box, into ``lower`` and ``upper``, is the jerk bounds of ``bounds`` (5, n), or with ``viability`` what
    :func:`~jssa_gym.kernels.viability.jerk_box` leaves of them.

    Returns:
        A fault code (0 none, 1 nominal, 2 joint state, 3 agents not finite, 4 an agent not measured), whether the
        nominal lies in the box, and whether the box has room for a choice.
    """
    load_agents(start, end, start_velocity, end_velocity, radius, agents)
    fault = unsound(state, nominal, agents)
    for j in range(valid.shape[0]):
        if fault == 0 and not valid[j]:
            fault = 4
    room = True
    if viability and fault == 0:
        room = jerk_box(state, bounds, dt, lower, upper)
    return fault, clip(nominal, lower, upper, clipped), room


@jit
def look_ahead(
    links,
    capsules,
    state,
    jerk,
    agents,
    planes,
    humans,
    dt,
    parameters,
    move,
    after,
    frames,
    segments,
    pairs,
    owner,
    target,
    rows,
):
    """:func:`~jssa_gym.kernels.index.assess`, moving the agents to the end of the step first if asked to.

    Returns:
        The largest index [m²]; by how much the pairs ``owner[:rows]`` exceed their ``target`` [m²]; row, column and
        distance of the closest pair among the first ``humans`` agents.
    """
    if move:
        advance(agents, dt)
    index = index_of(parameters)
    worst, _, _ = assess(links, capsules, state, jerk, agents, planes, dt, index, after, frames, segments, pairs)
    kept = -np.inf
    for k in range(rows):
        i, j = owner[k] // pairs.shape[1], owner[k] % pairs.shape[1]
        excess = pairs[i, j]["phi"] - target[k]
        if not (excess <= kept):
            kept = excess
    row, column, distance = nearest(pairs, humans)
    return worst, kept, row, column, distance


@jit
def look_back(links, capsules, state, agents, planes, dt, parameters, after, frames, segments, pairs):
    """Index of every pair at the beginning of the step, from ``agents`` at its end; into ``pairs``."""
    advance(agents, -dt)
    index = index_of(parameters)
    assess(links, capsules, state, state[0], agents, planes, 0.0, index, after, frames, segments, pairs)
    advance(agents, dt)


@jit
def rows_ahead(
    frames,
    segments,
    agents,
    planes,
    pairs,
    jerk,
    lower,
    upper,
    dt,
    parameters,
    only,
    bound,
    authority,
    recovery,
    now,
    L,
    S,
    owner,
    target,
):
    """:func:`~jssa_gym.kernels.index.exact_rows` after :func:`look_ahead` at the same jerk.

    Returns:
        The number of rows, their largest violation at ``jerk`` [m²], and whether one asks for less than 0 at once.
    """
    index = index_of(parameters)
    count = exact_rows(
        frames,
        segments,
        agents,
        planes,
        pairs,
        jerk,
        lower,
        upper,
        dt,
        index,
        only,
        bound,
        authority,
        recovery,
        now,
        L,
        S,
        owner,
        target,
    )
    recovering = False
    for k in range(count):
        recovering = recovering or target[k] > 0.0
    return count, violation(L, S, count, jerk), recovering


@jit
def unfit(jerk, nominal, lower, upper, forwarded, bound, out):
    """What is wrong with a filter's answer: 0 nothing, 1 not finite, 2 outside the box, 3 not the nominal it claims.

    What is to be applied goes into ``out`` (n,): the answer, :func:`~jssa_gym.kernels.motion.representable` unless it
    is the nominal.
    """
    for k in range(jerk.shape[0]):
        u = jerk[k]
        if not np.isfinite(u):
            return 1
        if not lower[k] <= u <= upper[k]:
            return 2
        if forwarded and u != nominal[k]:
            return 3
        out[k] = u if forwarded else representable(u, bound[k])
    return 0
