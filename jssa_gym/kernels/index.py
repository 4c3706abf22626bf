r"""The safety index and its rows, Eq. (6), (9)-(13).

:math:`\phi = d_{min}^2 - D|D| - \lambda_1 \dot D - \lambda_2 \ddot D` with the surface distance
:math:`D = d - R`. The axis points give :math:`d`, so that :math:`\dot D = \dot d` and
:math:`\ddot D = \ddot d` hold exactly; the signed square keeps a deep penetration unsafe.

Exact row: :math:`S - L u` is the linearisation of :math:`\phi_{k+1}(u)` at a given jerk, with the arm propagated
in joint space. From :math:`\partial \ddot p/\partial\dot q_j = 2\dot J_j`, :math:`\partial\dot p/\partial q_j
= \dot J_j`, :math:`\partial\ddot p/\partial q_j = \ddot J_j`:

.. math:: \frac{\partial \phi_{k+1}}{\partial u_j} = c_0 \cdot J_j + c_1 \cdot \dot J_j + c_2 \cdot \ddot J_j,
   \quad c_0 = \tau g_a + \tfrac{\tau^2}{2} g_v + \tfrac{\tau^3}{6} g_p,\;
   c_1 = \tau^2 g_a + \tfrac{\tau^3}{6} g_v,\; c_2 = \tfrac{\tau^3}{6} g_a

where :math:`g_p, g_v, g_a` are the gradients of :math:`\phi` by position, velocity, acceleration.
"""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair, common_pair, plane_pair, stands
from jssa_gym.kernels.chain import forward, move_axes, place, point_on, set_moving
from jssa_gym.kernels.jit import inlined, jit, part
from jssa_gym.kernels.lanes import LANES, lanes
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.vector import add, along, cross, dot, scale, subtract

_TOUCHING = 1e-3
"""Axis distance [m] below which 1/d is held: the axes cross, the bodies overlap by both radii."""

_CROSSING = 1e-9
"""Axis distance [m] below which its direction is none."""


class Index(NamedTuple):
    """Parameters of the index as the kernels see them (SI units)."""

    d_min: float
    lambda1: float
    lambda2: float
    sliding: bool
    """Whether the curvature of the closest-point motion along the axes is taken off the distance's."""
    sin2_floor: float
    """Smallest sin² of the angle between two axes that the sliding term resolves."""
    sliding_limit: float
    """Largest sliding term [m/s²]."""


@jit
def index_of(parameters):
    """Parameters from an array, which crosses the border from Python four times faster than a named tuple."""
    p = parameters
    return Index(p[0], p[1], p[2], p[3] != 0.0, p[4], p[5])


class Gradient(NamedTuple):
    """Gradients of the index at one pair; see the module's docstring."""

    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    acceleration: tuple[float, float, float]
    turn: tuple[float, float, float]
    """By the rate of the axis' direction, as a moment: the joint's part is its dot product with the joint axis."""


@jit
def direction(w, d, fallback):
    """Unit vector from the agent to the robot; where the axes cross, the direction between midpoints, else up."""
    if not (d < _CROSSING):
        return scale(w, 1.0 / d)
    length = np.sqrt(dot(fallback, fallback))
    if length > 1e-9:
        return scale(fallback, 1.0 / length)
    return (0.0, 0.0, 1.0)


class Approach(NamedTuple):
    """How the closest points of a robot capsule and an agent move against each other."""

    n: tuple[float, float, float]
    """Unit vector from the agent to the robot."""
    d: float
    """Axis distance, held above 1 mm [m]."""
    rate: float
    """Rate of the distance [m/s]."""
    curvature: float
    """Second derivative of the distance [m/s²]."""
    v_side: tuple[float, float, float]
    """Relative velocity across n [m/s]."""
    a: tuple[float, float, float]
    """Relative acceleration [m/s²]."""
    slide_robot: float
    """Rate at which the closest point slides along the robot's axis, as a fraction of it [1/s]; 0 if not resolved."""
    slide_agent: float
    """The same on the agent's axis [1/s]."""


@jit
def approach(segment, agent, s, r, distance, index):
    r"""Distance rates at the closest points :math:`P(s)` on the robot and :math:`Q(r)` on the agent.

    :math:`\ddot d = n\cdot a + |v_\perp|^2/d - b^\top H^{-1} b/d`, where the last term, the sliding of the closest
    points along the axes, is there for each axis on which the closest point lies inside. Leaving it out always
    over-states :math:`\ddot d`. Its sin² floor and its limit keep it finite where the axes are nearly parallel.
    """
    p, v, a = point_on(segment, s)
    w = subtract(p, along(agent["start"], agent["end"], r))
    v = subtract(v, along(agent["start_velocity"], agent["end_velocity"], r))
    d = distance + segment["radius"] + agent["radius"]
    if d < _CROSSING:
        middle = subtract(along(segment["start"], segment["end"], 0.5), along(agent["start"], agent["end"], 0.5))
        n = direction(w, d, middle)
    else:
        n = scale(w, 1.0 / d)
    d = max(d, _TOUCHING)
    rate, v_side, curvature = _rates(n, d, v, a)
    slide_robot, slide_agent = 0.0, 0.0
    inside_robot, inside_agent = 0.0 < s < 1.0, 0.0 < r < 1.0
    if index.sliding and (inside_robot or inside_agent):
        e = subtract(segment["end"], segment["start"])
        e_dot = subtract(segment["end_velocity"], segment["start_velocity"])
        f = subtract(agent["end"], agent["start"])
        f_dot = subtract(agent["end_velocity"], agent["start_velocity"])
        ee, ff, ef = dot(e, e), dot(f, f), dot(e, f)
        b_robot = dot(v, e) + dot(w, e_dot)
        b_agent = -(dot(v, f) + dot(w, f_dot))
        if inside_robot and inside_agent:
            det = max(ee * ff - ef * ef, index.sin2_floor * ee * ff)
            slide_robot = (ff * b_robot + ef * b_agent) / det
            slide_agent = (ef * b_robot + ee * b_agent) / det
        elif inside_robot:
            slide_robot = b_robot / ee
        else:
            slide_agent = b_agent / ff
        sliding = (slide_robot * b_robot + slide_agent * b_agent) / d
        if sliding < index.sliding_limit:
            curvature -= sliding
        else:
            # held: its gradient is none
            curvature -= index.sliding_limit
            slide_robot, slide_agent = 0.0, 0.0
    return Approach(n, d, rate, curvature, v_side, a, slide_robot, slide_agent)


@inlined
def _rates(n, d, v, a):
    """Rate of a distance d along n, the velocity across it, and its second derivative for fixed closest points."""
    rate = dot(n, v)
    v_side = subtract(v, scale(n, rate))
    return rate, v_side, dot(n, a) + dot(v_side, v_side) / d


@inlined
def index_value(distance, rate, curvature, index):
    r""":math:`\phi` of Eq. (6) with the signed square [m²]."""
    return index.d_min**2 - distance * abs(distance) - index.lambda1 * rate - index.lambda2 * curvature


@jit
def index_values(motion, parameters, out):
    r""":math:`\phi` of pairs whose distance [m] and its first and second derivative begin the rows of ``motion``.

    Args:
        motion: Shape (p, at least 3).
        parameters: See :func:`index_of`, shape (6,).
        out: Result, shape (p,) [m²].
    """
    index = index_of(parameters)
    for i in range(motion.shape[0]):
        out[i] = index_value(motion[i, 0], motion[i, 1], motion[i, 2], index)


@jit
def evaluate(segment, agent, s, r, distance, index):
    r"""Index and its gradients at the closest points :math:`P(s)` on the robot and :math:`Q(r)` on the agent.

    Returns:
        :math:`\phi`, :math:`\dot d`, :math:`\ddot d` and the :class:`Gradient`.
    """
    at = approach(segment, agent, s, r, distance, index)
    n, d, v_side = at.n, at.d, at.v_side
    a_side = subtract(at.a, scale(n, dot(n, at.a)))
    g_a = scale(n, -index.lambda2)
    g_v = add(scale(n, -index.lambda1), scale(v_side, -2.0 * index.lambda2 / d))
    curl = subtract(
        scale(a_side, 1.0 / d),
        add(scale(n, dot(v_side, v_side) / d**2), scale(v_side, 2.0 * at.rate / d**2)),
    )
    g_p = add(
        scale(n, -2.0 * abs(distance)),
        add(scale(v_side, -index.lambda1 / d), scale(curl, -index.lambda2)),
    )
    turn = (0.0, 0.0, 0.0)
    if at.slide_robot != 0.0 or at.slide_agent != 0.0:
        e, f = subtract(segment["end"], segment["start"]), subtract(agent["end"], agent["start"])
        w = subtract(along(segment["start"], segment["end"], s), along(agent["start"], agent["end"], r))
        k = 2.0 * index.lambda2 / d
        g_v = add(g_v, subtract(scale(e, k * at.slide_robot), scale(f, k * at.slide_agent)))
        turn = scale(cross(e, w), k * at.slide_robot)
    phi = index_value(distance, at.rate, at.curvature, index)
    return phi, at.rate, at.curvature, Gradient(g_p, g_v, g_a, turn)


@jit
def evaluate_plane(segment, plane, s, distance, index):
    """Index and gradients of one end of a robot capsule over a solid half-space: no curvature terms."""
    _, v, a = point_on(segment, s)
    n = (plane["normal"][0], plane["normal"][1], plane["normal"][2])
    d_dot, d_ddot = dot(n, v), dot(n, a)
    phi = index_value(distance, d_dot, d_ddot, index)
    gradient = Gradient(
        scale(n, -2.0 * abs(distance)),
        scale(n, -index.lambda1),
        scale(n, -index.lambda2),
        (0.0, 0.0, 0.0),
    )
    return phi, d_dot, d_ddot, gradient


@jit
def assess(links, capsules, state, jerk, agents, planes, tau, index, after, frames, segments, pairs):
    r"""Index of every pair one step ahead, :math:`\phi_{k+1}(u)`: arm by Eq. (1), agents at constant velocity.

    Args:
        links, capsules: The robot, shape (n,) of ``LINK`` and (m,) of ``CAPSULE``.
        state: Joint state, shape (3, n) [rad, rad/s, rad/s²].
        jerk: Joint jerk :math:`u`, shape (n,) [rad/s³].
        agents: Capsules where they are at the end of the step (:func:`advance`), shape (k,) of ``AGENT``.
        planes: Shape (p,) of ``PLANE``.
        tau: Step [s].
        index: Parameters.
        after: Result, joint state one step later, shape (3, n).
        frames, segments: Results, the robot one step later.
        pairs: Result, shape (m, k + p) of ``PAIR``, agents first.

    Returns:
        The largest index [m²], and row and column of its pair; those of the first NaN, if there is one.
    """
    integrate(state, jerk, tau, after)
    forward(links, after, frames)
    place(frames, capsules, segments)
    _put_agents_indices(segments, agents, planes, index, pairs)
    worst, row, column = -np.inf, -1, -1
    for i in range(segments.shape[0]):
        for j in range(agents.shape[0] + planes.shape[0]):
            pair = pairs[i, j]
            if j >= agents.shape[0]:
                pair["distance"], pair["s"], pair["r"], pair["phi"] = _pair_index(segments[i], agents, planes, j, index)
            phi = pair["phi"]
            if not (phi <= worst):
                worst, row, column = phi, i, j
                if np.isnan(phi):
                    return worst, row, column
    return worst, row, column


@jit
def _put_agents_indices(segments, agents, planes, index, pairs):
    """:func:`_pair_index` of all robot capsules and agents, of these :data:`~jssa_gym.kernels.lanes.LANES` at once."""
    sx, sy, sz, ex, ey, ez = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    sx_dot, sy_dot, sz_dot, ex_dot, ey_dot, ez_dot = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    radius, distance, s, r, phi, holds = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    count = agents.shape[0]
    for first in range(0, count, LANES):
        for k in range(LANES):
            agent = agents[min(first + k, count - 1)]
            radius[k] = agent["radius"]
            sx[k], sy[k], sz[k] = agent["start"][0], agent["start"][1], agent["start"][2]
            ex[k], ey[k], ez[k] = agent["end"][0], agent["end"][1], agent["end"][2]
            v, w = agent["start_velocity"], agent["end_velocity"]
            sx_dot[k], sy_dot[k], sz_dot[k], ex_dot[k], ey_dot[k], ez_dot[k] = v[0], v[1], v[2], w[0], w[1], w[2]
        for i in range(segments.shape[0]):
            robot = segments[i]
            thick, axis = robot["radius"], _axis(robot)
            for k in range(LANES):
                start, end = (sx[k], sy[k], sz[k]), (ex[k], ey[k], ez[k])
                start_dot, end_dot = (sx_dot[k], sy_dot[k], sz_dot[k]), (ex_dot[k], ey_dot[k], ez_dot[k])
                distance[k], s[k], r[k], phi[k], common = _common_index(
                    axis, (start, end, start_dot, end_dot), thick, radius[k], index
                )
                holds[k] = 1.0 if common else 0.0
            for k in range(min(LANES, count - first)):
                pair = pairs[i, first + k]
                if holds[k] == 1.0 and not index.sliding:
                    pair["distance"], pair["s"], pair["r"], pair["phi"] = distance[k], s[k], r[k], phi[k]
                else:
                    pair["distance"], pair["s"], pair["r"], pair["phi"] = _pair_index(
                        robot, agents, planes, first + k, index
                    )


@inlined
def _axis(robot):
    """Ends of a robot capsule's axis, their velocities and accelerations."""
    return (
        _vector(robot["start"]), _vector(robot["end"]), _vector(robot["start_velocity"]),
        _vector(robot["end_velocity"]), _vector(robot["start_acceleration"]), _vector(robot["end_acceleration"]),
    )  # fmt: skip


@inlined
def _common_index(axis, other, thick, radius, index):
    """:func:`_pair_index` without branches and without the sliding term, and whether it holds."""
    a, b, a_dot, b_dot, a_ddot, b_ddot = axis
    start, end, start_dot, end_dot = other
    distance, s, r, common = common_pair(a, b, start, end, thick + radius)
    w = subtract(along(a, b, s), along(start, end, r))
    d = distance + thick + radius
    rate, _, curvature = _rates(
        scale(w, 1.0 / d), max(d, _TOUCHING), subtract(along(a_dot, b_dot, s), along(start_dot, end_dot, r)),
        along(a_ddot, b_ddot, s),
    )  # fmt: skip
    return distance, s, r, index_value(distance, rate, curvature, index), common & (d >= _CROSSING)


@inlined
def _vector(x):
    return x[0], x[1], x[2]


@jit
def _pair_index(robot, agents, planes, j, index):
    """Distance [m], fractions of the closest points and index [m²] of a capsule and the j-th of agents, then planes."""
    count = agents.shape[0]
    if j < count:
        agent = agents[j]
        radii = robot["radius"] + agent["radius"]
        distance, s, r = capsule_pair(robot["start"], robot["end"], agent["start"], agent["end"], radii)
        moving = approach(robot, agent, s, r, distance, index)
        return distance, s, r, index_value(distance, moving.rate, moving.curvature, index)
    plane = planes[j - count]
    if stands(robot, plane):
        return np.inf, 0.0, 0.0, -np.inf
    distance, s = plane_pair(robot["start"], robot["end"], robot["radius"], plane)
    phi, _, _, _ = evaluate_plane(robot, plane, s, distance, index)
    return distance, s, 0.0, phi


@part
def reassess(links, capsules, state, agents, planes, index, above, ahead, frames, segments, now):
    """Index at a joint state (3, n) of the pairs that one step ahead is above a level.

    Args:
        links, capsules, state, agents, planes, index: As of :func:`assess`.
        above: The level [m²].
        ahead: From :func:`assess`.
        frames, segments: Where the robot is at that state, of :func:`~jssa_gym.kernels.chain.pose` and
            :func:`~jssa_gym.kernels.chain.place_axes`; how it moves becomes known.
        now: Result, shape (m, k + p) of ``PAIR``: ``phi`` of these pairs.
    """
    set_moving(links, state, frames)
    move_axes(frames, capsules, segments)
    for i in range(segments.shape[0]):
        robot = segments[i]
        for j in range(agents.shape[0] + planes.shape[0]):
            if ahead[i, j]["phi"] <= above:
                continue
            common, phi = False, np.nan
            if j < agents.shape[0] and not index.sliding:
                agent = agents[j]
                _, _, _, phi, common = _common_index(
                    _axis(robot),
                    (
                        _vector(agent["start"]), _vector(agent["end"]),
                        _vector(agent["start_velocity"]), _vector(agent["end_velocity"]),
                    ),
                    robot["radius"], agent["radius"], index,
                )  # fmt: skip
            if not common:
                _, _, _, phi = _pair_index(robot, agents, planes, j, index)
            now[i, j]["phi"] = phi


@jit
def advance(agents, tau):
    """Move capsules by their velocities for one step, in place."""
    for j in range(agents.shape[0]):
        agent = agents[j]
        for k in range(3):
            agent["start"][k] += tau * agent["start_velocity"][k]
            agent["end"][k] += tau * agent["end_velocity"][k]


@part
def _exact_row(frames, segment, s, gradient, tau, row):
    """Minus the derivative of the index one step ahead by the joint jerks, into ``row`` (n,)."""
    p, v, a = point_on(segment, s)
    g_p, g_v, g_a = gradient.position, gradient.velocity, gradient.acceleration
    c0 = add(scale(g_a, tau), add(scale(g_v, tau**2 / 2.0), scale(g_p, tau**3 / 6.0)))
    c1 = add(scale(g_a, tau**2), scale(g_v, tau**3 / 6.0))
    c2 = scale(g_a, tau**3 / 6.0)
    turn = scale(gradient.turn, tau**2 / 2.0)
    for j in range(frames.shape[0]):
        if j > segment["link"]:
            row[j] = 0.0
            continue
        frame = frames[j]
        z = frame["axis"]
        # z turns with the link before; the joint's own rate about z changes neither of these
        z_dot = cross(frame["omega"], z)
        if j > 0:
            before = frames[j - 1]
            z_ddot = add(cross(before["alpha"], z), cross(before["omega"], z_dot))
        else:
            z_ddot = (0.0, 0.0, 0.0)
        r = subtract(p, frame["origin"])
        r_dot = subtract(v, frame["velocity"])
        r_ddot = subtract(a, frame["acceleration"])
        # c · (z × r) = z · (r × c), so that each product of axis and lever needs one cross product
        on_z = add(cross(r, c0), add(cross(r_dot, c1), cross(r_ddot, c2)))
        on_z_dot = add(cross(r, c1), scale(cross(r_dot, c2), 2.0))
        slope = dot(z, on_z) + dot(z_dot, on_z_dot) + dot(z_ddot, cross(r, c2)) + dot(z, turn)
        row[j] = -slope


@jit
def exact_rows(
    frames,
    segments,
    agents,
    planes,
    pairs,
    jerk,
    lower,
    upper,
    tau,
    index,
    only,
    above,
    bound,
    authority,
    recovery,
    now,
    L,
    S,
    owner,
    target,
):
    r"""Rows :math:`L u \ge S` of the pairs that some jerk of the box could violate.

    A row asks for :math:`\phi_{k+1} \le \max(0, \phi_k - \varrho\, s)`, where :math:`s = \sum_j |L_j| U_j` is how
    much the jerk bounds :math:`U` can change the index in one step, its authority: an index that a step cannot bring
    back to 0 has to fall at a share of the rate at which it can. With :math:`\varrho = 0` it asks for 0 at once.

    Exact pruning: a pair whose linearised index stays within that on the whole box makes no row. Pairs with less
    than ``authority`` make none either: no jerk changes them noticeably, and as rows they would only make the
    problem infeasible.

    Args:
        frames, segments, agents, planes, pairs: From :func:`assess` at ``jerk``.
        jerk: Where the index is linearised, shape (n,) [rad/s³].
        lower, upper: Jerk bounds, shape (n,) [rad/s³].
        tau: Step [s].
        index: Parameters.
        only: Row-major number ``i * columns + j`` of the only pair to look at, or -1 for all.
        above: Only pairs whose index is above this are looked at [m²].
        bound: Jerk limits :math:`U`, shape (n,) [rad/s³].
        authority: Smallest authority [m²].
        recovery: :math:`\varrho`, from 0 to 1.
        now: Index of every pair at the beginning of the step, shape (m, k + p) of ``PAIR``; read if ``recovery`` > 0.
        L: Result, shape (rows, n) [m²/(rad/s³)].
        S: Result, shape (rows,) [m²].
        owner: Result, the pair of each row, shape (rows,).
        target: Result, what each row asks the index to be at most, shape (rows,) [m²].

    Returns:
        The number of rows.
    """
    count, used = agents.shape[0], 0
    columns = count + planes.shape[0]
    for i in range(segments.shape[0]):
        robot = segments[i]
        for j in range(columns):
            if only >= 0 and i * columns + j != only:
                continue
            if j >= count and stands(robot, planes[j - count]):
                continue
            pair = pairs[i, j]
            if pair["phi"] <= above:
                continue
            if j < count:
                phi, _, _, gradient = evaluate(robot, agents[j], pair["s"], pair["r"], pair["distance"], index)
            else:
                plane = planes[j - count]
                phi, _, _, gradient = evaluate_plane(robot, plane, pair["s"], pair["distance"], index)
            row = L[used]
            _exact_row(frames, robot, pair["s"], gradient, tau, row)
            at_jerk, reach, span = 0.0, phi, 0.0
            for k in range(row.shape[0]):
                at_jerk += row[k] * jerk[k]
                reach += max(-row[k] * (lower[k] - jerk[k]), -row[k] * (upper[k] - jerk[k]))
                span += abs(row[k]) * bound[k]
            least = max(0.0, now[i, j]["phi"] - recovery * span) if recovery > 0.0 else 0.0
            if reach <= least or span < authority:
                continue
            S[used] = phi - least + at_jerk
            target[used] = least
            owner[used] = i * columns + j
            used += 1
    return used
