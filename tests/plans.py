"""What the tests of plans share: their states written out, and what each of them promises."""

import numpy as np

from jssa_gym.control import Plan
from jssa_gym.robots import JointLimits
from jssa_gym.types import JointState

DT = 0.008


def one_joint(limits, j):
    return JointLimits(limits.position[[j]], limits.velocity[[j]], limits.acceleration[[j]], limits.jerk[[j]])


def rest(position):
    return JointState(np.array(position, float), np.zeros(len(position)), np.zeros(len(position)))


def played(state, jerk, parts=1):
    """States (H parts + 1, 3, n) that jerks lead to, by Eq. (1) written out; ``parts`` samples a tick."""
    q, v, a = (np.array(x, float) for x in state)
    states, t = [np.array([q, v, a])], DT / parts
    for u in jerk:
        for _ in range(parts):
            q, v, a = q + t * v + t**2 / 2 * a + t**3 / 6 * u, v + t * a + t**2 / 2 * u, a + t * u
            states.append(np.array([q, v, a]))
    return np.array(states)


def assert_kept(plan: Plan, state, waypoints, limits, each):
    """What a plan promises, judged by other code."""
    assert np.all(np.abs(plan.jerk) <= limits.jerk * (1 + 1e-9))
    fine = played(state, plan.jerk, parts=5)
    low, high = limits.position.T
    slack = 1e-9 * (high - low)
    assert np.all((fine[:, 0] >= low - slack) & (fine[:, 0] <= high + slack))
    assert np.all(np.abs(fine[:, 1]) <= limits.velocity * (1 + 1e-9))
    assert np.all(np.abs(fine[:, 2]) <= limits.acceleration * (1 + 1e-9))
    states = played(state, plan.jerk)
    np.testing.assert_allclose(plan.states, states, atol=1e-11)
    assert np.abs(states[-1, 1:]).max() <= 1e-9
    assert plan.marks == tuple(each * (k + 1) for k in range(len(waypoints)))
    assert np.abs(states[list(plan.marks), 0] - waypoints).max() <= 1e-6
