r"""The row of Eq. (13) as the paper prints it, to be compared with."""

import numpy as np

from jssa_gym.kernels.capsules import measure_agents, nearest
from jssa_gym.kernels.chain import acceleration_of, drift_of, forward, place, velocity_of
from jssa_gym.kernels.index import direction
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import add, along, cross, dot, scale, subtract

_SURFACE_TOUCHING = 1e-3
"""Surface distance [m] below which the printed row, which divides by it, uses the axis direction."""


@jit
def printed_row(frames, segment, agent, s, r, tau, index, row):
    r"""The row of Eq. (13) to the letter, for the closest *surface* points of one pair.

    :math:`\Delta = A^C M + B^C(\ddot J\dot\theta + 2\dot J\ddot\theta) - H_{k+1}` (Eq. 11), plain square, and
    :math:`L = 2(\lambda_1\Delta^\top U_2 + \lambda_2\Delta^\top U_3 + \lambda_2\Delta^\top U_4) B^C J`, which is about
    twice the true gradient because :math:`U_2` and :math:`U_4` are not symmetric. Within 1 mm of contact, where the
    formula divides by zero, the direction between the axes is used.

    Args:
        frames, segment, agent: At the *present* time.
        s, r: Fractions of the closest axis points.
        tau: Step [s].
        index: Parameters; the sliding term plays no part here.
        row: Result :math:`L`, shape (n,) [m³/(rad/s³)].

    Returns:
        :math:`S` [m³], and the surface distance it was multiplied by [m].
    """
    axis_point = along(segment["start"], segment["end"], s)
    agent_axis = along(agent["start"], agent["end"], r)
    w = subtract(axis_point, agent_axis)
    middle = subtract(along(segment["start"], segment["end"], 0.5), along(agent["start"], agent["end"], 0.5))
    n = direction(w, np.sqrt(dot(w, w)), middle)
    point = subtract(axis_point, scale(n, segment["radius"]))
    agent_velocity = along(agent["start_velocity"], agent["end_velocity"], r)
    agent_point = add(add(agent_axis, scale(n, agent["radius"])), scale(agent_velocity, tau))

    frame = frames[segment["link"]]
    lever = subtract(point, frame["origin"])
    v0, a0 = velocity_of(frame, lever), acceleration_of(frame, lever)
    j0 = drift_of(frame, lever)
    p = add(point, add(scale(v0, tau), add(scale(a0, tau**2 / 2.0), scale(j0, tau**3 / 6.0))))
    v = add(v0, add(scale(a0, tau), scale(j0, tau**2 / 2.0)))
    a = add(a0, scale(j0, tau))
    p, v = subtract(p, agent_point), subtract(v, agent_velocity)
    d = np.sqrt(dot(p, p))
    if d < _SURFACE_TOUCHING:
        p, d = scale(n, _SURFACE_TOUCHING), _SURFACE_TOUCHING

    u1, u2, u3, u4 = d * d, dot(p, v), dot(v, v), dot(p, a)
    lambda1, lambda2 = index.lambda1, index.lambda2
    S = index.d_min**2 * d - d**3 - lambda1 * u2 + lambda2 * (u2**2 / u1 - u3 - u4)
    # (lambda1 D'U2 + lambda2 D'U3 + lambda2 D'U4) has p in the velocity slot twice and in the acceleration slot once
    c = add(scale(p, tau * lambda2), scale(add(scale(p, lambda1), scale(v, lambda2)), tau**2 / 2.0))
    for j in range(frames.shape[0]):
        if j > segment["link"]:
            row[j] = 0.0
        else:
            column = cross(frames[j]["axis"], subtract(point, frames[j]["origin"]))
            row[j] = 2.0 * dot(c, column)
    return S, d


@jit
def measure_present(links, capsules, state, agents, frames, segments, pairs):
    """The robot and its distances to the agents at the present time: what :func:`printed_rows` reads.

    Returns:
        Row and column of the closest pair, and its distance [m] (NaN if any is NaN).
    """
    forward(links, state, frames)
    place(frames, capsules, segments)
    measure_agents(segments, agents, pairs)
    return nearest(pairs, agents.shape[0])


@jit
def printed_rows(frames, segments, agents, pairs, lower, upper, tau, index, only, authority, L, S, owner):
    """Rows as printed, Eq. (13), divided by d so that they are in m² like the exact ones.

    Arguments as of :func:`exact_rows`, at the present time (:func:`measure_present`). Nothing is pruned but the
    pairs without authority.

    Returns:
        The number of rows.
    """
    used, columns = 0, agents.shape[0]
    for i in range(segments.shape[0]):
        for j in range(columns):
            if only >= 0 and i * columns + j != only:
                continue
            row = L[used]
            pair = pairs[i, j]
            right, d = printed_row(frames, segments[i], agents[j], pair["s"], pair["r"], tau, index, row)
            span = 0.0
            for k in range(row.shape[0]):
                row[k] /= d
                span += abs(row[k]) * (upper[k] - lower[k]) / 2.0
            if span < authority:
                continue
            S[used] = right / d
            owner[used] = i * columns + j
            used += 1
    return used
