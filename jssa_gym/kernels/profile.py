"""Whole motions: a jerk for every tick."""

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate
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
