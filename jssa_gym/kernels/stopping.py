"""Stops of a joint on the time grid: constant jerk for whole ticks, then rest.

A stop has three parts: ``jerk_in`` for ``ramp`` ticks takes the acceleration to its braking value, zero jerk
holds it for ``hold`` ticks, ``jerk_out`` for ``release`` ticks takes it back to zero, where the speed vanishes too.
Because it lies on the grid, a stop cut off at any tick is still a stop: what remains of a verified one is verified.
"""

import numpy as np

from jssa_gym.kernels.jit import inlined, jit
from jssa_gym.kernels.lanes import LANES, lanes
from jssa_gym.kernels.motion import advance, representable
from jssa_gym.kernels.rest import REST_PLANNED

ROUNDING = 1e-12
"""What is lost to rounding when a state comes to lie on the grid, as a share (of a limit, or of a tick)."""
LONGEST = 1e9
"""No stop takes more ticks than this (92 days): an integer always holds their number."""


@inlined
def _hold(x, a, ramp, release, step, A):
    """Fewest ticks to hold between a given ramp and release, negative if no number of them keeps the limits.

    Speed ``x`` is per tick, ``step`` the largest change of acceleration in one tick, all in [rad/s²]; the braking
    acceleration is ``-area / (ramp / 2 + hold + release / 2)``.
    """
    area = x + a * ramp / 2.0
    sign = -1.0 if area < 0.0 else 1.0
    most = min(A, step * release)
    middle = (ramp + release) / 2.0
    hold = 0.0
    if sign * area > most * middle:
        hold = np.ceil(sign * area / most - middle - ROUNDING)
    # an acceleration that already brakes harder must not be let go of faster than the jerk allows
    return hold if abs(area / (middle + hold) + a) <= step * ramp * (1.0 + ROUNDING) else -1.0


@jit
def stop_joint(v, a, J, A, tau):
    r"""Stop of one joint on the time grid, at most three ticks longer than the shortest stop in continuous time.

    The shortest stop is known in closed form: full jerk up to the acceleration :math:`p`, which is
    :math:`\sqrt{Jv + a^2/2}` or the limit :math:`A`, for :math:`|a + p|/J`; then back for :math:`p/J`. Its parts
    are rounded up to :math:`n_1` and :math:`n_3` ticks, with as many ticks :math:`n_2` between as the limits ask for,

    .. math:: \alpha = \frac{v + a n_1 \tau / 2}{\tau (n_1/2 + n_2 + n_3/2)}, \quad
        j_1 = -\frac{\alpha + a}{n_1 \tau}, \quad j_3 = \frac{\alpha}{n_3 \tau}.

    Args:
        v: Velocity [rad/s].
        a: Acceleration [rad/s²]; beyond A the stop is as good, and its acceleration never grows.
        J: Jerk limit [rad/s³].
        A: Acceleration limit [rad/s²].
        tau: Tick [s].

    Returns:
        Ticks of ramp, hold and release; jerks of ramp and release [rad/s³]. If there is no stop (a limit that is
        not positive, a number that is not finite): no ticks, and jerks NaN, which keep no limit.
    """
    if v == 0.0 and a == 0.0:
        return 0, 0, 0, 0.0, 0.0
    ramp, hold, release, jerk_in, jerk_out, fits = rounded_stop(v, a, J, A, tau)
    if not fits:
        ramp, hold, release, jerk_in, jerk_out = _searched_stop(v, a, J, A, tau)
    return int(ramp), int(hold), int(release), jerk_in, jerk_out


@inlined
def rounded_stop(v, a, J, A, tau):
    """The shortest stop with its parts rounded up; as of :func:`stop_joint`, but in numbers that are not integers.

    Returns:
        Ticks, jerks, and whether that is the stop: nearly always, unless there is none, or nothing to stop.
    """
    sign, x, a, rise, cruise, fall = _shortest(v, a, J, A, tau)
    step = J * tau
    # rounding must not cost a tick where the parts are whole numbers of them; whether it does harm, _hold sees
    ramp, release = max(np.ceil(rise - 1e-6), 1.0), max(np.ceil(fall - 1e-6), 1.0)
    hold = _hold(x, a, ramp, release, step, A)
    ticks = ramp + hold + release
    fits = (hold >= 0.0) & (ticks <= rise + cruise + fall + 2.0) & (ticks <= LONGEST)
    fits &= (step > 0.0) & (step < np.inf) & (A > 0.0) & (tau > 0.0) & ((v != 0.0) | (a != 0.0))
    jerk_in, jerk_out = _jerks(sign, x, a, ramp, hold, release, tau)
    return ramp, hold, release, jerk_in, jerk_out, fits


@inlined
def _shortest(v, a, J, A, tau):
    """The shortest stop in continuous time: its direction, speed per tick, acceleration, and its parts in ticks."""
    step = J * tau
    sign = -1.0 if v + a * abs(a) / (2.0 * J) < 0.0 else 1.0
    x, a = sign * v / tau, sign * a
    peak = min(np.sqrt(max(step * x + a * a / 2.0, 0.0)), A)
    rise, fall = abs(a + peak) / step, peak / step
    cruise = max((x + (a - peak) / 2.0 * rise) / peak - fall / 2.0, 0.0) if peak > 0.0 else 0.0
    return sign, x, a, rise, cruise, fall


@inlined
def _jerks(sign, x, a, ramp, hold, release, tau):
    """Jerks of ramp and release."""
    alpha = (x + a * ramp / 2.0) / (ramp / 2.0 + hold + release / 2.0)
    return -sign * (alpha + a) / (ramp * tau), sign * alpha / (release * tau)


@jit
def _searched_stop(v, a, J, A, tau):
    """The stop where the shortest one, rounded up, does not fit, or only with many ticks to hold; or none.

    Of the neighbours of its parts, and of one slow ramp instead of ramp and release, the shortest: a ramp of
    :math:`|a| / step + 1` ticks always will do.
    """
    step = J * tau
    if not (step > 0.0 and A > 0.0 and tau > 0.0 and np.isfinite(v) and np.isfinite(a) and np.isfinite(step)):
        return 0.0, 0.0, 0.0, np.nan, np.nan
    sign, x, a, rise, cruise, fall = _shortest(v, a, J, A, tau)
    first, last = max(np.ceil(rise - 1e-6), 1.0), max(np.ceil(fall - 1e-6), 1.0)
    ramp, release = first, last
    hold = _hold(x, a, ramp, release, step, A)
    best = ramp + hold + release if hold >= 0.0 else np.inf
    for more in range(1, 5 if not best <= rise + cruise + fall + 2.0 else 1):
        for start, end in ((first + more, last), (first, last + more), (first + last - 2.0 + more, 1.0)):
            middle = _hold(x, a, start, end, step, A)
            if middle >= 0.0 and start + middle + end < best:
                ramp, hold, release = start, middle, end
                best = start + middle + end
    if not (hold >= 0.0 and ramp + hold + release <= LONGEST):
        return 0.0, 0.0, 0.0, np.nan, np.nan
    jerk_in, jerk_out = _jerks(sign, x, a, ramp, hold, release, tau)
    return ramp, hold, release, jerk_in, jerk_out


@jit
def stop_length(plan):
    """Number of ticks until the last joint rests."""
    ticks = 0
    for i in range(plan.shape[0]):
        ticks = max(ticks, plan[i]["ramp"] + plan[i]["hold"] + plan[i]["release"])
    return ticks


@jit
def plan_stop(state, bounds, tau, plan):
    """Stops of all joints.

    Args:
        state: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        tau: Tick [s].
        plan: Result, shape (n,) of ``STOP``.

    Returns:
        Number of ticks until the last joint rests.
    """
    v, a, J, A = lanes(), lanes(), lanes(), lanes()
    ramp, hold, release, jerk_in, jerk_out, fits = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    count = plan.shape[0]
    for first in range(0, count, LANES):
        for i in range(LANES):
            joint = min(first + i, count - 1)
            v[i], a[i], A[i], J[i] = state[1, joint], state[2, joint], bounds[3, joint], bounds[4, joint]
        for i in range(LANES):
            ramp[i], hold[i], release[i], jerk_in[i], jerk_out[i], fit = rounded_stop(v[i], a[i], J[i], A[i], tau)
            fits[i] = 1.0 if fit else 0.0
        for i in range(min(LANES, count - first)):
            stop = plan[first + i]
            if fits[i] == 1.0:
                stop["ramp"], stop["hold"], stop["release"] = int(ramp[i]), int(hold[i]), int(release[i])
                stop["jerk_in"], stop["jerk_out"] = jerk_in[i], jerk_out[i]
            else:
                stop["ramp"], stop["hold"], stop["release"], stop["jerk_in"], stop["jerk_out"] = stop_joint(
                    v[i], a[i], J[i], A[i], tau
                )
    return stop_length(plan)


@jit
def make_plan_representable(plan, bounds):
    """The same stops by jerks that shares of the jerk limits give exactly; ``bounds`` (5, n) as of :func:`plan_stop`.

    They end as much in rest as rounding lets them.
    """
    for i in range(plan.shape[0]):
        plan[i]["jerk_in"] = representable(plan[i]["jerk_in"], bounds[4, i])
        plan[i]["jerk_out"] = representable(plan[i]["jerk_out"], bounds[4, i])


@jit
def stop_jerk(plan, tick, out):
    """The jerks of tick number ``tick`` (0 first) of a plan, shape (n,) [rad/s³]; zero after its end."""
    for i in range(plan.shape[0]):
        stop = plan[i]
        left = tick - stop["ramp"]
        if left < 0:
            out[i] = stop["jerk_in"]
        elif stop["hold"] <= left < stop["hold"] + stop["release"]:
            out[i] = stop["jerk_out"]
        else:
            out[i] = 0.0


@jit
def stop_at(q, v, a, stop, tau, t):
    """Position, velocity and acceleration of one joint the time t [s] after it began its stop; rest after the end."""
    ramp, hold, release = stop["ramp"] * tau, stop["hold"] * tau, stop["release"] * tau
    over = t >= (stop["ramp"] + stop["hold"] + stop["release"]) * tau
    t = ramp + hold + release if over else max(t, 0.0)
    q, v, a = advance(q, v, a, stop["jerk_in"], min(t, ramp))
    if t > ramp:
        q, v, a = advance(q, v, a, 0.0, min(t - ramp, hold))
    if t > ramp + hold:
        q, v, a = advance(q, v, a, stop["jerk_out"], t - ramp - hold)
    return (q, 0.0, 0.0) if over else (q, v, a)


@jit
def peak_speed(v, a, stop, tau, t):
    """Largest speed [rad/s] of one joint from the time t [s] of its stop on; NaN reads as infinite.

    After the ramp the speed only falls, so that it is largest at t, at the end of the ramp or where the ramp's
    acceleration passes zero.
    """
    return peak_from(stop_at(0.0, v, a, stop, tau, t)[1], v, a, stop, tau, t)


@jit
def peak_from(now, v, a, stop, tau, t):
    """:func:`peak_speed`, if the velocity ``now`` [rad/s] at the time t is known already; 0 after the stop's end."""
    peak = abs(now)
    end = stop["ramp"] * tau
    if t < end:
        peak = max(peak, abs(advance(0.0, v, a, stop["jerk_in"], end)[1]))
        if stop["jerk_in"] != 0.0 and t < -a / stop["jerk_in"] < end:
            peak = max(peak, abs(v - a * a / (2.0 * stop["jerk_in"])))
    return peak if peak >= 0.0 else np.inf


@jit
def _stays(q, v, a, u, t, low, high, V, A, J):
    """Whether one joint keeps its limits for the time t at jerk u: ends, speed's turning point, turning points."""
    end_q, end_v, end_a = advance(q, v, a, u, t)
    if not (abs(u) <= J and abs(a) <= A and abs(end_a) <= A and abs(v) <= V and abs(end_v) <= V):
        return False
    if not (low <= q <= high and low <= end_q <= high):
        return False
    turn = v
    if a * end_a < 0.0:
        turn = v - a * a / (2.0 * u)
        if not (abs(turn) <= V):
            return False
    if v * turn < 0.0 or turn * end_v < 0.0:
        # roots of v + a t + u t^2 / 2, in the form that neither cancels nor needs u != 0
        root = a + np.copysign(np.sqrt(max(a * a - 2.0 * u * v, 0.0)), a)
        late = -2.0 * v / root
        if 0.0 < late < t and not (low <= advance(q, v, a, u, late)[0] <= high):
            return False
        if u != 0.0 and 0.0 < -root / u < t and not (low <= advance(q, v, a, u, -root / u)[0] <= high):
            return False
    return True


@jit
def step_keeps(q, v, a, u, low, high, V, A, J, tau, tolerance):
    """Whether one joint keeps its limits during one tick at jerk u, not only at its ends; NaN does not.

    Limits may be exceeded by a share ``tolerance`` of each (of the range for positions), as in ``motion.violates``.
    """
    slack, more = tolerance * (high - low), 1.0 + tolerance
    return _stays(q, v, a, u, tau, low - slack, high + slack, V * more, A * more, J * more)


@jit
def parts_keep(q, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, V, A, J, tau, tolerance):
    """Whether one joint keeps its limits all the way through its stop and is at rest after it; NaN does not.

    The parts, given as ``stop_joint`` returns them, are cubics whose extremes are computed, not sampled. Limits may be
    exceeded by a share ``tolerance`` of each (of the range for positions), as in ``motion.violates``.
    """
    slack, more = tolerance * (high - low), 1.0 + tolerance
    low, high, V, A, J = low - slack, high + slack, V * more, A * more, J * more
    if not _stays(q, v, a, jerk_in, ramp * tau, low, high, V, A, J):
        return False
    q, v, a = advance(q, v, a, jerk_in, ramp * tau)
    if not _stays(q, v, a, 0.0, hold * tau, low, high, V, A, J):
        return False
    q, v, a = advance(q, v, a, 0.0, hold * tau)
    if not _stays(q, v, a, jerk_out, release * tau, low, high, V, A, J):
        return False
    _, v, a = advance(q, v, a, jerk_out, release * tau)
    return abs(v) <= REST_PLANNED and abs(a) <= REST_PLANNED
