r"""Motion along a plan at a pace of its own: the plan's path is kept, its clock is not.

Path time :math:`s` [s] runs over the plan, at a pace :math:`\dot s` that is 1 where the plan is played as it is. With
derivatives by path time :math:`q', q'', q'''` the joints move by

.. math:: \dot q = q' \dot s,\quad \ddot q = q'' \dot s^2 + q' \ddot s,\quad
          \dddot q = q''' \dot s^3 + 3 q'' \dot s \ddot s + q' \dddot s .
"""

import numpy as np

from jssa_gym.kernels.jit import jit, jit_owning
from jssa_gym.kernels.motion import advance
from jssa_gym.kernels.rest import REST_JOINTS
from jssa_gym.kernels.vector import copy, copy_rows
from jssa_gym.kernels.viability import recoverable

PULL = 10.0
"""How fast the pace follows the one that is asked for: its acceleration by their difference [1/s]."""

CREEP = 1e-4
"""A pace below this one that is to become 0 is 0."""

STIFFNESS = 25.0
"""Poles of the error that a motion along a path is left with [1/s]; slower than the tick allows they are stable."""

STIFFEST = 0.25
"""Poles times tick at most, so that they stay stable on any grid."""

AHEAD = 64
"""For how many ticks a change of pace is followed: it is over by then, or as good as."""

SETTLED = 1e-3
"""A pace this near to the one that is wished for, with an acceleration as small, has got there [1, 1/s]."""

ALIKE = 1e-7
"""Two paces that differ by less are one [1, 1/s]."""

ROUNDING = 1e-9
"""Share of a limit that rounding may cost."""


@jit
def along(plan, s, out):
    """A plan's position and its first three derivatives at path time s [s], into ``out`` (4, n); at rest after its end.

    Args:
        plan: Its jerks, shape (H, n) [rad/s³], its states, shape (H + 1, 3, n), and its tick [s].
        s: Path time, not negative [s].
        out: Result [rad, rad/s, rad/s², rad/s³].
    """
    jerks, states, tau = plan
    H = jerks.shape[0]
    k = int(s / tau)
    for i in range(out.shape[1]):
        if k >= H:
            out[0, i], out[1, i], out[2, i], out[3, i] = states[H, 0, i], 0.0, 0.0, 0.0
        else:
            out[3, i] = jerks[k, i]
            q, v, a = states[k, 0, i], states[k, 1, i], states[k, 2, i]
            out[0, i], out[1, i], out[2, i] = advance(q, v, a, jerks[k, i], s - k * tau)


@jit
def room(point, rate, acceleration, bounds, most, sharpest):
    r"""How hard the pace may change here: :math:`|\ddot s|` [1/s] and :math:`|\dddot s|` [1/s²], 0 where it may not.

    From :math:`|q''| \dot s^2 + |q'| |\ddot s| \le A` and
    :math:`|q'''| \dot s^3 + 3 |q''| \dot s |\ddot s| + |q'| |\dddot s| \le J`; the acceleration is also such that five
    times as much is left for its change, since a pace that its jerk cannot follow in time falls below 0.

    Args:
        point: Position and derivatives by path time, shape (4, n).
        rate, acceleration: Of path time [1, 1/s].
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        most, sharpest: What neither may exceed [1/s, 1/s²].
    """
    a, j = most, sharpest
    for i in range(point.shape[1]):
        slope, bend, twist = abs(point[1, i]), abs(point[2, i]), abs(point[3, i])
        pull, jerk = bounds[3, i] - bend * rate**2, bounds[4, i] - twist * rate**3
        if slope > 0.0:
            a = min(a, pull / slope)
            j = min(j, (jerk - 3.0 * bend * rate * abs(acceleration)) / slope)
        both = 3.0 * bend * rate + 5.0 * slope
        if both > 0.0:
            a = min(a, jerk / both)
    return max(a, 0.0), max(j, 0.0)


@jit
def next_pace(s, rate, acceleration, target, a, j, tau):
    r"""One tick of :math:`\ddot s \to \mathrm{sat}(10 (\sigma - \dot s), \pm a)` with :math:`|\dddot s| \le j`.

    Path time never runs backwards: a pace that would become negative is 0.

    Returns:
        Path time, its rate and its acceleration one tick later.
    """
    wanted = min(max(PULL * (target - rate), -a), a)
    u = min(max((wanted - acceleration) / tau, -j), j)
    after, faster, more = advance(s, rate, acceleration, u, tau)
    if not faster > 0.0 or (target == 0.0 and faster < CREEP):
        return max(after, s), 0.0, 0.0
    return max(after, s), faster, more


@jit
def _pull(point, rate, acceleration, i):
    """Acceleration of one joint at a point of a path [rad/s²]."""
    return point[2, i] * rate**2 + point[1, i] * acceleration


@jit
def pace_keeps(plan, pace, wish, bounds, point):
    """Whether the joints keep velocity, acceleration and jerk limits until the pace is the one that is wished for.

    The joints' jerks are averages over the ticks, exact, as those that are to be applied are constant over a tick.

    Args:
        plan: As of :func:`along`.
        pace: Path time, its rate and its acceleration, shape (3,) [s, 1, 1/s].
        wish: Pace, and what its acceleration and jerk may not exceed, shape (3,) [1, 1/s, 1/s²].
        bounds: Rows as of :func:`room`, shape (5, n).
        point: Room to work in, shape (2, 4, n).
    """
    s, rate, acceleration = pace[0], pace[1], pace[2]
    more = 1.0 + ROUNDING
    tau = plan[2]
    end = plan[0].shape[0] * tau
    now, then = point[0], point[1]
    along(plan, s, now)
    for _ in range(AHEAD):
        a, j = room(now, rate, acceleration, bounds, wish[1], wish[2])
        after, faster, grown = next_pace(s, rate, acceleration, wish[0], a, j, tau)
        along(plan, after, then)
        for i in range(then.shape[1]):
            velocity, pull = then[1, i] * faster, _pull(then, faster, grown, i)
            change = pull - _pull(now, rate, acceleration, i)
            if not (abs(velocity) <= bounds[2, i] * more and abs(pull) <= bounds[3, i] * more):
                return False
            if not abs(change) <= bounds[4, i] * tau * more:
                return False
        s, rate, acceleration = after, faster, grown
        copy_rows(then, now)
        if s >= end or (abs(rate - wish[0]) < SETTLED and abs(acceleration) < SETTLED):
            return True
    return True


@jit
def track(plan, pace, following, state, bounds, point, out):
    r"""The jerk of one tick that brings the joints along a path, and how far they may be off: into ``out`` (n,).

    .. math:: u = \Delta\ddot q_d / \tau + 3 \omega (\ddot q_d - \ddot q) + 3 \omega^2 (\dot q_d - \dot q)
                  + \omega^3 (q_d - q),

    clipped to acceleration and jerk limits.

    Args:
        plan: As of :func:`along`.
        pace, following: Path time, its rate and its acceleration now and a tick later, shape (3,).
        state: Rows position, velocity, acceleration, shape (3, n).
        bounds: Rows as of :func:`room`, shape (5, n).
        point: Room to work in, shape (2, 4, n).
        out: Result, shape (n,) [rad/s³].

    Returns:
        Whether every joint keeps its limits during the tick and in a stop after it; NaN does not.
    """
    tau = plan[2]
    w = min(STIFFNESS, STIFFEST / tau)
    along(plan, pace[0], point[0])
    along(plan, following[0], point[1])
    good, now, then = True, point[0], point[1]
    for i in range(out.shape[0]):
        q, v, a = state[0, i], state[1, i], state[2, i]
        wanted = _pull(now, pace[1], pace[2], i)
        later = _pull(then, following[1], following[2], i)
        u = (later - wanted) / tau + 3.0 * w * (wanted - a)
        u += 3.0 * w**2 * (now[1, i] * pace[1] - v) + w**3 * (now[0, i] - q)
        limits = (bounds[0, i], bounds[1, i], bounds[2, i], bounds[3, i], bounds[4, i])
        A, J = limits[3], limits[4]
        out[i] = min(max(u, max(-J, (-A - a) / tau)), min(J, (A - a) / tau))
        good = good and recoverable(q, v, a, out[i], limits, tau)
    return good


@jit
def _still(point):
    """Whether nothing moves at a point of a path, whatever the pace."""
    most = 0.0
    for i in range(point.shape[1]):
        most = max(most, abs(point[1, i]), abs(point[2, i]))
    return most <= REST_JOINTS


@jit_owning
def propose(plan, pace, wishes, state, bounds, point, out):
    """Jerks for paces that are wished for, in their order, without those that limits forbid and those that are alike.

    Args:
        plan: As of :func:`along`.
        pace: Path time, its rate and its acceleration, shape (3,) [s, 1, 1/s].
        wishes: Paces, and what their acceleration and jerk may not exceed, shape (m, 3) [1, 1/s, 1/s²].
        state: Rows position, velocity, acceleration of the joints, shape (3, n).
        bounds: Rows as of :func:`room`, shape (5, n).
        point: Room to work in, shape (2, 4, n).
        out: The jerks [rad/s³], the paces a tick later and the numbers of the wishes that they are for, of shapes
            (m, n), (m, 3) and (m,), or fewer rows if the first ones will do.

    Returns:
        How many there are.
    """
    offered, paces, numbers = out
    tau, count = plan[2], 0
    ended = pace[0] >= plan[0].shape[0] * tau
    begun = np.empty(3)
    for m in range(wishes.shape[0]):
        if count == offered.shape[0]:
            break
        along(plan, pace[0], point[0])
        copy(pace, begun)
        if _still(point[0]):  # the plan begins at rest: any pace will do, at once
            begun[1], begun[2] = wishes[m, 0], 0.0
        a, j = room(point[0], begun[1], begun[2], bounds, wishes[m, 1], wishes[m, 2])
        following = paces[count]
        following[0], following[1], following[2] = next_pace(begun[0], begun[1], begun[2], wishes[m, 0], a, j, tau)
        known = ended and count > 0
        for other in range(count):
            if abs(paces[other, 1] - following[1]) < ALIKE and abs(paces[other, 2] - following[2]) < ALIKE:
                known = True
        if known or not pace_keeps(plan, begun, wishes[m], bounds, point):
            continue
        if track(plan, begun, following, state, bounds, point, offered[count]):
            numbers[count] = m
            count += 1
    return count
