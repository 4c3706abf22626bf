r"""Distances of all pairs at the present and their derivatives up to the third, which the jerk enters.

At the closest points, taken as fixed to their bodies, with :math:`p` from the agent to the robot,
:math:`d = |p|`, :math:`n = p/d` and everything across :math:`n` marked :math:`\perp`:

.. math:: \dot d = n\cdot v, \quad \ddot d = n\cdot a + \frac{|v_\perp|^2}{d}, \quad
   \dddot d = n\cdot j + \frac{3 v_\perp\cdot a_\perp}{d} - \frac{3\dot d |v_\perp|^2}{d^2}, \quad
   j = Ju + \ddot J\dot\theta + 2\dot J\ddot\theta

with Eq. (10) for :math:`j`; agents keep their velocity. That the closest points slide along the axes is left out.
"""

from jssa_gym.kernels.capsules import measure_agents, nearest
from jssa_gym.kernels.chain import drift_of, forward, place, point_on
from jssa_gym.kernels.index import approach, index_of, index_value
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import cross, dot, put, subtract


@jit
def derivatives(links, capsules, state, agents, parameters, frames, segments, pairs, motion, rows, normals):
    """:func:`pair_motion` with the parameters of the index as an array, shape (6,)."""
    index = index_of(parameters)
    return pair_motion(links, capsules, state, agents, index, frames, segments, pairs, motion, rows, normals)


@jit
def pair_motion(links, capsules, state, agents, index, frames, segments, pairs, motion, rows, normals):
    r"""Distances, their derivatives and the index of all pairs, row-major.

    Args:
        links, capsules: The robot, shape (n,) of ``LINK`` and (m,) of ``CAPSULE``.
        state: Joint state, shape (3, n) [rad, rad/s, rad/s²].
        agents: At the present, shape (k,) of ``AGENT``.
        index: Parameters, without the sliding term.
        frames, segments, pairs: Results, shape (n,) of ``FRAME``, (m,) of ``SEGMENT``, (m, k) of ``PAIR``.
        motion: Result, shape (m k, 4): D [m], its first and second derivative [m/s, m/s²] and the third at zero
            joint jerk [m/s³].
        rows: Result :math:`n^\top J`, shape (m k, n) [m/rad]: what a joint jerk adds to the third derivative.
        normals: Result n, shape (m k, 3), unit vectors.

    Returns:
        Row and column of the closest pair, and its distance [m] (NaN if any is NaN); -1, -1, inf without agents.
    """
    forward(links, state, frames)
    place(frames, capsules, segments)
    measure_agents(segments, agents, pairs)
    for i in range(segments.shape[0]):
        segment = segments[i]
        frame = frames[segment["link"]]
        for j in range(agents.shape[0]):
            pair, number = pairs[i, j], i * agents.shape[0] + j
            at = approach(segment, agents[j], pair["s"], pair["r"], pair["distance"], index)
            n, d, rate = at.n, at.d, at.rate
            point, _, _ = point_on(segment, pair["s"])
            drift = dot(n, drift_of(frame, subtract(point, frame["origin"])))
            # v across n is at right angles to n, so a need not be split
            drift += 3.0 * dot(at.v_side, at.a) / d - 3.0 * rate * dot(at.v_side, at.v_side) / d**2
            pair["phi"] = index_value(pair["distance"], rate, at.curvature, index)
            out = motion[number]
            out[0], out[1], out[2], out[3] = pair["distance"], rate, at.curvature, drift
            put(normals[number], n)
            for k in range(frames.shape[0]):
                row = 0.0
                if k <= segment["link"]:
                    row = dot(n, cross(frames[k]["axis"], subtract(point, frames[k]["origin"])))
                rows[number, k] = row
    return nearest(pairs, agents.shape[0])
