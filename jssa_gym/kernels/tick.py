"""Whole control steps in one call each: what an environment and a filter do in every tick."""

from jssa_gym.kernels.chain import tool_motion
from jssa_gym.kernels.contact import observe
from jssa_gym.kernels.index import index_of
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate, violates


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
