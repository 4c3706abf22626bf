"""Jerks after which every joint can still stop within its limits."""

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import advance
from jssa_gym.kernels.stopping import parts_keep, step_keeps, stop_joint

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
    complete = True
    for i in range(lower.shape[0]):
        q, v, a = state[0, i], state[1, i], state[2, i]
        limits = (bounds[0, i], bounds[1, i], bounds[2, i], bounds[3, i], bounds[4, i])
        A, J = bounds[3, i], bounds[4, i]
        least, most = max(-J, (-A - a) / tau), min(J, (A - a) / tau)  # the acceleration limit is known exactly
        least_keeps, most_keeps = recoverable(q, v, a, least, limits, tau), recoverable(q, v, a, most, limits, tau)
        if not (least_keeps and most_keeps):
            brake = stop_joint(v, a, J, A, tau)[3]
            good = min(max(brake, least), most)  # rounding may have put it outside
            if not recoverable(q, v, a, good, limits, tau):
                if not (least_keeps or most_keeps):
                    lower[i] = upper[i] = min(max(brake, -J), J) if np.isfinite(brake) else 0.0
                    complete = False
                    continue
                good = least if least_keeps else most
            least = least if least_keeps else _edge(q, v, a, good, least, limits, tau)
            most = most if most_keeps else _edge(q, v, a, good, most, limits, tau)
        lower[i], upper[i] = least, most
    return complete
