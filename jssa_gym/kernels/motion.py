"""Joint motion under piecewise-constant jerk."""

import numpy as np

from jssa_gym.kernels.jit import jit


@jit
def advance(q, v, a, u, t):
    """Position, velocity and acceleration of one joint after the time t [s] at jerk u [rad/s³], exact."""
    return q + t * v + t**2 / 2.0 * a + t**3 / 6.0 * u, v + t * a + t**2 / 2.0 * u, a + t * u


@jit
def integrate(state, jerk, tau, out):
    r"""One step of the triple integrator, Eq. (1), exact for jerk held over the step.

    Args:
        state: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        jerk: Joint jerk :math:`u`, shape (n,) [rad/s³].
        tau: Step :math:`\tau` [s].
        out: The state one step later, shape (3, n); may be ``state`` itself.
    """
    for i in range(jerk.shape[0]):
        out[0, i], out[1, i], out[2, i] = advance(state[0, i], state[1, i], state[2, i], jerk[i], tau)


@jit
def brake(state, lower, upper, tau, out):
    r"""Jerk that brings every joint to rest fast, inside the box.

    Steers the next acceleration :math:`a'` so that a ramp of it to zero at the joint's jerk bound :math:`J`
    ends with zero velocity on the time grid: with :math:`w = v + \tau a/2`,
    :math:`|a'| = J(\sqrt{\tau^2 + 2|w|/J} - \tau)` against the motion. From rest it returns zero.

    Args:
        state: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        lower: Lower jerk bound, shape (n,) [rad/s³].
        upper: Upper jerk bound, shape (n,) [rad/s³].
        tau: Step [s].
        out: The braking jerk, shape (n,) [rad/s³].
    """
    for i in range(out.shape[0]):
        a = state[2, i]
        w = state[1, i] + tau * a / 2.0
        bound = min(-lower[i], upper[i])
        if bound > 0.0:
            target = bound * (np.sqrt(tau**2 + 2.0 * abs(w) / bound) - tau)
        else:
            target = 0.0
        target = -target if w > 0.0 else target
        out[i] = min(max((target - a) / tau, lower[i]), upper[i])


@jit
def translate(start, end, x, y, vx, vy, out):
    """A rigid body of capsules at (x, y) on the floor, moving at (vx, vy).

    Args:
        start, end: Capsule ends relative to the body's root, shape (m, 3) [m].
        x, y: Root [m].
        vx, vy: Velocity [m/s].
        out: Result, shape (4, m, 3): start, end [m], their velocities [m/s].
    """
    for i in range(start.shape[0]):
        out[0, i, 0], out[0, i, 1], out[0, i, 2] = start[i, 0] + x, start[i, 1] + y, start[i, 2]
        out[1, i, 0], out[1, i, 1], out[1, i, 2] = end[i, 0] + x, end[i, 1] + y, end[i, 2]
        out[2, i, 0], out[2, i, 1], out[2, i, 2] = vx, vy, 0.0
        out[3, i, 0], out[3, i, 1], out[3, i, 2] = vx, vy, 0.0


@jit
def violates(state, jerk, bounds, tolerance):
    """Whether a joint exceeds a limit by more than ``tolerance``, a share of the limit (of the range for positions).

    ``bounds`` has the rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n). NaN does.
    """
    for i in range(jerk.shape[0]):
        slack = tolerance * (bounds[1, i] - bounds[0, i])
        if not (bounds[0, i] - slack <= state[0, i] <= bounds[1, i] + slack):
            return True
        more = 1.0 + tolerance
        if not (abs(state[1, i]) <= bounds[2, i] * more and abs(state[2, i]) <= bounds[3, i] * more):
            return True
        if not (abs(jerk[i]) <= bounds[4, i] * more):
            return True
    return False


@jit
def scale_action(fraction, bound, jerk):
    """Clip an action to [-1, 1] in place and scale it by the jerk bounds; False, and nothing done, if not finite."""
    for i in range(fraction.shape[0]):
        if not np.isfinite(fraction[i]):
            return False
    for i in range(fraction.shape[0]):
        fraction[i] = min(max(fraction[i], -1.0), 1.0)
        jerk[i] = fraction[i] * bound[i]
    return True


@jit
def representable(jerk, bound):
    """The nearest jerk that a share of the bound gives when it is multiplied with it: what an environment integrates.

    Never beyond the bound, where rounding may have brought a jerk; NaN stays NaN.
    """
    share = jerk / bound
    if share > 1.0:
        share = 1.0
    elif share < -1.0:
        share = -1.0
    return share * bound


@jit
def make_representable(jerk, bound):
    """:func:`representable` of all joints, in place."""
    for i in range(jerk.shape[0]):
        jerk[i] = representable(jerk[i], bound[i])


@jit
def to_shares(jerk, bound, share):
    """Shares of the bounds that give exactly these jerks, into ``share`` (n,), as far as :func:`representable`."""
    for i in range(jerk.shape[0]):
        share[i] = jerk[i] / bound[i]
        # what was a share times the bound, divided by it, is that share or a neighbour of it
        for near in (np.nextafter(share[i], np.inf), np.nextafter(share[i], -np.inf)):
            if share[i] * bound[i] != jerk[i] and near * bound[i] == jerk[i]:
                share[i] = near


@jit
def scale_nominal(fraction, bound, jerk):
    """Scale an action by the jerk bounds; finite shares are kept within ±1000, NaN and infinity as they are."""
    for i in range(fraction.shape[0]):
        share = fraction[i]
        if np.isfinite(share):
            share = min(max(share, -1e3), 1e3)
        jerk[i] = share * bound[i]
