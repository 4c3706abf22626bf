"""Jerks after which every joint can still stop within its limits."""

import numpy as np

from jssa_gym.kernels import lanes as together
from jssa_gym.kernels.jit import inlined, jit
from jssa_gym.kernels.lanes import LANES, lanes
from jssa_gym.kernels.motion import advance
from jssa_gym.kernels.stopping import parts_keep, rounded_stop, step_keeps, stop_joint

TOLERANCE = 1e-10
"""Share of a limit that rounding may cost; a state that came to lie on a limit is not outside it."""
HALVINGS = 10
"""The interval's ends are found to within a thousandth of the jerk limit or so, always from the safe side."""


@jit
def recoverable(q, v, a, u, limits, tau):
    """Whether one joint keeps its limits during a tick at jerk u and in the stop on the grid after it.

    ``limits`` are its lower and upper position, velocity, acceleration and jerk limits.
    """
    low, high, V, A, J = limits
    if not step_keeps(q, v, a, u, low, high, V, A, J, tau, TOLERANCE):
        return False
    q, v, a = advance(q, v, a, u, tau)
    ramp, hold, release, jerk_in, jerk_out = stop_joint(v, a, J, A, tau)
    return parts_keep(q, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, V, A, J, tau, TOLERANCE)


@jit
def _edge(q, v, a, good, bad, limits, tau):
    """The last jerk from a recoverable one towards one that is not that was seen to be recoverable."""
    for _ in range(HALVINGS):
        middle = (good + bad) / 2.0
        if recoverable(q, v, a, middle, limits, tau):
            good = middle
        else:
            bad = middle
    return good


@jit
def jerk_box(state, bounds, tau, lower, upper):
    """State-dependent jerk interval that keeps position, velocity, acceleration and jerk limits recoverable.

    Both ends of a joint's interval are verified: after one tick at that jerk its stop on the grid keeps every
    limit. Between them this holds nearly always, so the jerk that is chosen has to be verified once more.

    Args:
        state: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        tau: Tick [s].
        lower, upper: Result, shape (n,) [rad/s³]; the braking jerk in both where a joint has no interval.

    Returns:
        Whether every joint has an interval.
    """
    q, v, a, low, high = lanes(), lanes(), lanes(), lanes(), lanes()
    V, A, J, least, most, sure = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    complete, count = True, lower.shape[0]
    for first in range(0, count, LANES):
        for i in range(LANES):
            joint = min(first + i, count - 1)
            q[i], v[i], a[i] = state[0, joint], state[1, joint], state[2, joint]
            low[i], high[i] = bounds[0, joint], bounds[1, joint]
            V[i], A[i], J[i] = bounds[2, joint], bounds[3, joint], bounds[4, joint]
        for i in range(LANES):
            least[i], most[i] = _range_of_jerks(a[i], A[i], J[i], tau)
            sure[i] = 1.0
        for end in range(2):  # one loop for both, as it is long and would be compiled twice
            for i in range(LANES):
                u = least[i] if end == 0 else most[i]
                keeps = _surely_recoverable(q[i], v[i], a[i], u, low[i], high[i], V[i], A[i], J[i], tau)
                sure[i] = sure[i] if keeps else 0.0
        for i in range(min(LANES, count - first)):
            joint, found = first + i, True
            lower[joint], upper[joint] = least[i], most[i]
            if sure[i] == 0.0:
                limits = (low[i], high[i], V[i], A[i], J[i])
                lower[joint], upper[joint], found = _interval(q[i], v[i], a[i], limits, tau)
            complete = complete and found
    return complete


@inlined
def _range_of_jerks(a, A, J, tau):
    """The least and the largest jerk that jerk and acceleration limit leave a joint: these limits are known exactly."""
    return max(-J, (-A - a) / tau), min(J, (A - a) / tau)


@inlined
def _surely_recoverable(q, v, a, u, low, high, V, A, J, tau):
    """:func:`recoverable` without branches; False also where the stop would have to be searched for."""
    slack, more = TOLERANCE * (high - low), 1.0 + TOLERANCE
    low, high, most_v, most_a, most_u = low - slack, high + slack, V * more, A * more, J * more
    kept = together.keeps(q, v, a, u, tau, low, high, most_v, most_a, most_u)
    q, v, a = advance(q, v, a, u, tau)
    ramp, hold, release, jerk_in, jerk_out, fits = rounded_stop(v, a, J, A, tau)
    return fits & kept & together.stop_keeps(
        q, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, most_v, most_a, most_u, tau
    )  # fmt: skip


@jit
def _interval(q, v, a, limits, tau):
    """The jerk interval of one joint; the braking jerk twice, and False, if it has none."""
    _, _, _, A, J = limits
    least, most = _range_of_jerks(a, A, J, tau)
    least_keeps, most_keeps = recoverable(q, v, a, least, limits, tau), recoverable(q, v, a, most, limits, tau)
    if least_keeps and most_keeps:
        return least, most, True
    brake = stop_joint(v, a, J, A, tau)[3]
    good = min(max(brake, least), most)  # rounding may have put it outside
    if not recoverable(q, v, a, good, limits, tau):
        if not (least_keeps or most_keeps):
            brake = min(max(brake, -J), J) if np.isfinite(brake) else 0.0
            return brake, brake, False
        good = least if least_keeps else most
    least = least if least_keeps else _edge(q, v, a, good, least, limits, tau)
    most = most if most_keeps else _edge(q, v, a, good, most, limits, tau)
    return least, most, True
