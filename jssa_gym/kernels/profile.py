"""Whole motions: a jerk for every tick."""

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import advance, integrate
from jssa_gym.kernels.stopping import step_keeps


@jit
def follow(jerks, tau, states):
    """The states that jerks lead to, by Eq. (1).

    Args:
        jerks: Shape (H, n) [rad/s³].
        tau: Tick [s].
        states: Rows position, velocity, acceleration; the first is given, the others are filled: shape (H + 1, 3, n).
    """
    for k in range(jerks.shape[0]):
        integrate(states[k], jerks[k], tau, states[k + 1])


@jit
def keeps(jerks, tau, states, bounds, joint, tolerance):
    """Whether one joint keeps its limits at all ticks and between them; ``bounds`` (5, n) as for ``plan_stop``."""
    low, high, V, A, J = bounds[0, joint], bounds[1, joint], bounds[2, joint], bounds[3, joint], bounds[4, joint]
    for k in range(jerks.shape[0]):
        q, v, a = states[k, 0, joint], states[k, 1, joint], states[k, 2, joint]
        if not step_keeps(q, v, a, jerks[k, joint], low, high, V, A, J, tau, tolerance):
            return False
    return True


@jit
def all_keep(jerks, tau, states, bounds, tolerance):
    """:func:`keeps` of all joints."""
    for j in range(bounds.shape[1]):
        kept = keeps(jerks, tau, states, bounds, j, tolerance)
        if not kept:
            return False
    return True


@jit
def peaks(jerks, states, out):
    """Largest speed, acceleration and jerk of each joint, into ``out``, shape (3, n), which is not negative."""
    for k in range(states.shape[0]):
        for j in range(out.shape[1]):
            out[0, j], out[1, j] = max(out[0, j], abs(states[k, 1, j])), max(out[1, j], abs(states[k, 2, j]))
            if k < jerks.shape[0]:
                out[2, j] = max(out[2, j], abs(jerks[k, j]))


@jit
def may_join(state, target, inverse, tau, bounds, tolerance):
    """Whether jerks of least norm from one joint state to another keep the limits, but for a generous tolerance.

    Far cheaper than to compute them to the last digit, which need not be done where they do not.

    Args:
        state, target: Rows position, velocity, acceleration, shape (3, n).
        inverse: Maps what they have to bring about, in ticks, to jerks, shape (H, 3).
        tau: Tick [s].
        bounds: Shape (5, n) as for ``plan_stop``.
        tolerance: Share of each limit (of the range for positions).
    """
    H = inverse.shape[0]
    for j in range(state.shape[1]):
        q, v, a = state[0, j], state[1, j], state[2, j]
        low, high, V, A, J = bounds[0, j], bounds[1, j], bounds[2, j], bounds[3, j], bounds[4, j]
        far = target[0, j] - (q + H * tau * v + (H * tau) ** 2 / 2.0 * a)
        faster, harder = tau * (target[1, j] - v - H * tau * a), tau**2 * (target[2, j] - a)
        for k in range(H):
            u = (inverse[k, 0] * far + inverse[k, 1] * faster + inverse[k, 2] * harder) / tau**3
            if not step_keeps(q, v, a, u, low, high, V, A, J, tau, tolerance):
                return False
            q, v, a = advance(q, v, a, u, tau)
    return True
