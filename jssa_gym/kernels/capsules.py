"""Distances between capsules, and between capsules and half-spaces."""

import numpy as np

from jssa_gym.kernels.jit import inlined, jit, part
from jssa_gym.kernels.vector import add, along, cross, dot, subtract

_POINT = 1e-30
"""Squared length [m²] under which a segment is a point."""

STANDING = 1e-5
"""How far a joint can move a capsule to a half-space on which it stands nevertheless: axes are written roundly [m]."""

_PARALLEL = 1e-12
"""sin² of the angle under which two segments count as parallel."""


@inlined
def _unit(x):
    return min(max(x, 0.0), 1.0)


@jit
def _closest_of_parallel(w, e, f, ee, ff, ef, ew, fw):
    """Closest points of parallel segments: an end of one of them takes part."""
    best_s, best_r, best = 0.0, 0.0, np.inf
    for k in range(4):
        if k < 2:
            s = float(k)
            r = _unit((ef * s + fw) / ff)
        else:
            r = float(k - 2)
            s = _unit((ef * r - ew) / ee)
        gap = (w[0] + s * e[0] - r * f[0], w[1] + s * e[1] - r * f[1], w[2] + s * e[2] - r * f[2])
        length2 = dot(gap, gap)
        if not (length2 >= best):
            best_s, best_r, best = s, r, length2
    return best_s, best_r


@jit
def closest_points(a, b, c, d):
    r"""Fractions :math:`s, r` of the closest points of the segments a–b and c–d.

    Minimises the convex :math:`|(a + sE) - (c + rF)|^2` over the unit square: stationary point, clamped in
    one variable, projected in the other, clamped again. Points, parallel and crossing segments included.
    NaN in, NaN out.
    """
    e, f, w = subtract(b, a), subtract(d, c), subtract(a, c)
    ee, ff, fw = dot(e, e), dot(f, f), dot(f, w)
    if ee <= _POINT:
        if ff <= _POINT:
            return 0.0, 0.0
        return 0.0, _unit(fw / ff)
    ew = dot(e, w)
    if ff <= _POINT:
        return _unit(-ew / ee), 0.0
    ef = dot(e, f)
    det = ee * ff - ef * ef
    if not (det > _PARALLEL * ee * ff):
        return _closest_of_parallel(w, e, f, ee, ff, ef, ew, fw)
    return _closest_of_lines(ee, ff, ef, ew, fw, det)


@inlined
def _closest_of_lines(ee, ff, ef, ew, fw, det):
    """Closest points of segments that are neither points nor parallel."""
    s = _unit((ef * fw - ew * ff) / det)
    r = (ef * s + fw) / ff
    before, beyond = r < 0.0, r > 1.0
    s = _unit(-ew / ee) if before else _unit((ef - ew) / ee) if beyond else s
    r = 0.0 if before else 1.0 if beyond else r
    return s, r


@inlined
def common_pair(a, b, c, d, radii):
    """:func:`capsule_pair` without branches, and whether it holds: not of points, nor of parallel segments."""
    e, f, w = subtract(b, a), subtract(d, c), subtract(a, c)
    ee, ff, fw, ew, ef = dot(e, e), dot(f, f), dot(f, w), dot(e, w), dot(e, f)
    det = ee * ff - ef * ef
    s, r = _closest_of_lines(ee, ff, ef, ew, fw, det)
    w = subtract(along(a, b, s), along(c, d, r))
    holds = (ee > _POINT) & (ff > _POINT) & (det > _PARALLEL * ee * ff)
    return np.sqrt(dot(w, w)) - radii, s, r, holds


@jit
def capsule_pair(a, b, c, d, radii):
    """Signed surface distance of two capsules and the fractions of the closest axis points.

    Negative in penetration; ``radii`` is the sum of both radii [m].
    """
    s, r = closest_points(a, b, c, d)
    w = subtract(along(a, b, s), along(c, d, r))
    return np.sqrt(dot(w, w)) - radii, s, r


@part
def pair_of(one, other, radii):
    """:func:`capsule_pair` of records with ``start`` and ``end``, put into its callers: they ask for many pairs."""
    a, b = one["start"], one["end"]
    c, d = other["start"], other["end"]
    gap, s, r, holds = common_pair(
        (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]), (d[0], d[1], d[2]), radii
    )  # fmt: skip
    if not holds:
        gap, s, r = capsule_pair(a, b, c, d, radii)
    return gap, s, r


@jit
def ball_around(one):
    """The ball around a capsule's axis: twice its middle, and its diameter [m]."""
    way = subtract(one["end"], one["start"])
    return add(one["start"], one["end"]), np.sqrt(dot(way, way))


@jit
def put_balls(agents, balls):
    """:func:`ball_around` of all, into ``balls`` (k, 4) [m]."""
    for k in range(agents.shape[0]):
        middle, diameter = ball_around(agents[k])
        balls[k, 0], balls[k, 1], balls[k, 2], balls[k, 3] = middle[0], middle[1], middle[2], diameter


@jit
def put_axes(agents, axes):
    """All starts, ends and radii number by number, into ``axes`` (7, at least k) [m]; the last one fills what is left.

    So they can be loaded into :data:`~jssa_gym.kernels.lanes.LANES`.
    """
    last = agents.shape[0] - 1
    for k in range(axes.shape[1] if last >= 0 else 0):
        agent = agents[min(k, last)]
        for i in range(3):
            axes[i, k], axes[3 + i, k] = agent["start"][i], agent["end"][i]
        axes[6, k] = agent["radius"]


@jit
def apart(ball, other, far):
    """Whether a ball is farther than ``far`` [m] from another of :func:`put_balls`: then so are the axes in them."""
    middle, diameter = ball
    way = subtract(middle, other)
    return dot(way, way) > (2.0 * far + diameter + other[3]) ** 2


@jit
def plane_pair(a, b, radius, plane):
    """Signed surface distance of a capsule to a solid half-space, and the fraction of its lowest axis point."""
    height_a, height_b = dot(plane["normal"], a), dot(plane["normal"], b)
    s, lowest = (1.0, height_b) if height_b < height_a else (0.0, height_a)
    if np.isnan(height_a + height_b):
        lowest = np.nan
    return lowest - plane["offset"] - radius, s


@jit
def stands(segment, plane):
    """Whether no joint can change a capsule's distance to a half-space: it may stand on it, and in it.

    Of the first link only: a column whose axis is the half-space's normal, or what is thick about the axis itself.
    """
    if segment["link"] != 0:
        return False
    change = cross(segment["swing"], plane["normal"])
    return dot(change, change) <= STANDING**2


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
def measure_agents(segments, agents, pairs):
    """Distances of all robot capsules to all agents.

    Args:
        segments: Robot capsules in the world, shape (m,) of ``SEGMENT``.
        agents: Shape (k,) of ``AGENT``.
        pairs: Result, shape (m, k) of ``PAIR``: ``distance``, ``s``, ``r``.
    """
    for i in range(segments.shape[0]):
        robot = segments[i]
        for j in range(agents.shape[0]):
            agent, pair = agents[j], pairs[i, j]
            radii = robot["radius"] + agent["radius"]
            pair["distance"], pair["s"], pair["r"] = capsule_pair(
                robot["start"], robot["end"], agent["start"], agent["end"], radii
            )


@jit
def measure_planes(segments, planes, pairs):
    """Distances of the robot capsules to half-spaces, into ``pairs`` of shape (m, k) of ``PAIR``.

    The distance of a capsule that :func:`stands` on a half-space is inf.
    """
    for i in range(segments.shape[0]):
        robot = segments[i]
        for j in range(planes.shape[0]):
            pair = pairs[i, j]
            pair["r"] = 0.0
            distance, pair["s"] = plane_pair(robot["start"], robot["end"], robot["radius"], planes[j])
            pair["distance"] = np.inf if stands(robot, planes[j]) else distance


@jit
def measure_self(segments, self_pairs, distances):
    """Distances of the robot capsule pairs ``self_pairs`` (p, 2), into ``distances`` (p,) [m]."""
    for k in range(self_pairs.shape[0]):
        one, two = segments[self_pairs[k, 0]], segments[self_pairs[k, 1]]
        radii = one["radius"] + two["radius"]
        distances[k], _, _ = capsule_pair(one["start"], one["end"], two["start"], two["end"], radii)


@jit
def nearest(pairs, columns):
    """Row, column and distance of the closest pair in the first columns.

    A NaN distance wins, so that it is never overlooked. Without columns: -1, -1, inf.
    """
    row, column, smallest = -1, -1, np.inf
    for i in range(pairs.shape[0]):
        for j in range(columns):
            distance = pairs[i, j]["distance"]
            if not (distance >= smallest):
                row, column, smallest = i, j, distance
                if np.isnan(distance):
                    return row, column, smallest
    return row, column, smallest
