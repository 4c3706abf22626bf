"""The jerk interval and the recursion on it: limits are kept against any policy, for ever (T3)."""

import functools

import numpy as np
import pytest
from numba import config

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import parts_keep, plan_stop, step_keeps, stop_jerk, stop_joint
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.robots import lr_mate_200id_7l

TAU = 0.008
TOLERANCE = 1e-9
"""Share of a limit by which a verified stop may exceed it."""
ADVERSARIES = ("bang-bang", "random", "resonance", "limit-seeking", "constant", "edges")


@pytest.fixture(params=[1, pytest.param(100, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


described = functools.cache(lr_mate_200id_7l)
"""An arm's file takes longer to read than the arm to simulate."""


def arm_limits(name):
    limit = described(name).limits
    return np.array([*limit.position.T, limit.velocity, limit.acceleration, limit.jerk])


def scaled_limits(rng, arms):
    """Limits (5, 6 arms): both sets of the arm, as they are and each scaled by 0.1 to 1."""
    bounds = np.hstack([arm_limits(("paper", "stream")[i % 2]) for i in range(arms)])
    bounds[:, 12:] *= rng.uniform(0.1, 1.0, (5, 6 * arms))[:, 12:]
    return bounds


def box_of(state, bounds):
    lower, upper = np.full((2, state.shape[1]), np.nan)
    return jerk_box(state, bounds, TAU, lower, upper), lower, upper


@jit
def verified(state, after, jerk, plan, bounds, tau, tolerance, i):
    """Whether joint i keeps its limits during this tick and in the stop after it."""
    low, high, V, A, J = bounds[0, i], bounds[1, i], bounds[2, i], bounds[3, i], bounds[4, i]
    stop = plan[i]
    return step_keeps(
        state[0, i], state[1, i], state[2, i], jerk[i], low, high, V, A, J, tau, tolerance
    ) and parts_keep(
        after[0, i], after[1, i], after[2, i],
        stop["ramp"], stop["hold"], stop["release"], stop["jerk_in"], stop["jerk_out"],
        low, high, V, A, J, tau, tolerance,
    )  # fmt: skip


@jit
def shield(state, jerk, group, bounds, tau, tolerance, after, fresh, stored, age, tail):
    """Joints in groups (arms) of a size: a group's jerks if they are verified, its stored stop's next ones if not."""
    integrate(state, jerk, tau, after)
    plan_stop(after, bounds, tau, fresh)
    for start in range(0, jerk.shape[0], group):
        good = True
        for i in range(start, start + group):
            good = good and verified(state, after, jerk, fresh, bounds, tau, tolerance, i)
        for i in range(start, start + group):
            tail[i] = not good
            if good:
                stored[i], age[i] = fresh[i], 0
            else:
                stop_jerk(stored[i : i + 1], age[i], jerk[i : i + 1])
                age[i] += 1


def adversary(rng, tick, memory, bounds):
    """Jerks of all joints, each kind of policy for one joint in six (the kind turns over from arm to arm)."""
    J, n = bounds[4], bounds.shape[1]
    kind = (np.arange(n) + np.arange(n) // 6) % len(ADVERSARIES)
    memory["sign"][rng.random(n) < np.where(kind == 0, 0.05, 0.004)] *= -1.0
    change = rng.random(n) < 0.005
    memory["level"][change] = rng.uniform(-1.0, 1.0, change.sum())
    choices = (
        memory["sign"],
        rng.uniform(-1.0, 1.0, n),
        np.sign(np.sin(2.0 * np.pi * memory["frequency"] * tick * TAU)),
        memory["sign"],
        memory["level"],
        10.0 * rng.choice([-1.0, 1.0], n),
    )
    return np.choose(kind, choices) * J, kind


def overshoot(state, jerk, bounds):
    """Largest exceedance of position, velocity, acceleration, jerk, each a share of its limit."""
    low, high, V, A, J = bounds
    position = np.maximum(low - state[0], state[0] - high) / (high - low)
    return np.array([x.max() for x in (position, abs(state[1]) / V - 1, abs(state[2]) / A - 1, abs(jerk) / J - 1)])


def simulate(seed, arms, ticks, group):
    rng = np.random.default_rng(seed)
    bounds = scaled_limits(rng, arms)
    n = 6 * arms
    state = np.zeros((3, n))
    state[0] = bounds[0] + rng.uniform(0.0, 1.0, n) * (bounds[1] - bounds[0])
    memory = {
        "sign": rng.choice([-1.0, 1.0], n),
        "level": rng.uniform(-1.0, 1.0, n),
        "frequency": rng.uniform(0.1, 6.0, n),
    }
    fresh, stored = records(n, STOP), records(n, STOP)  # at rest, the stop of no ticks
    age, tail = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    after, between = np.empty_like(state), np.empty_like(state)
    worst, tails, reached = np.full(4, -np.inf), np.zeros(len(ADVERSARIES)), np.zeros((3, n))
    for tick in range(ticks):
        jerk, kind = adversary(rng, tick, memory, bounds)
        _, lower, upper = box_of(state, bounds)
        assert np.all(lower <= upper)
        jerk = np.clip(jerk, lower, upper)
        shield(state, jerk, group, bounds, TAU, TOLERANCE, after, fresh, stored, age, tail)
        tails += np.bincount(kind, tail, len(ADVERSARIES))
        for part in (0.3, 0.7):
            integrate(state, jerk, part * TAU, between)
            worst = np.maximum(worst, overshoot(between, jerk, bounds))
        integrate(state, jerk, TAU, state)
        worst = np.maximum(worst, overshoot(state, jerk, bounds))
        middle = (bounds[0] + bounds[1]) / 2.0
        shares = np.array([2.0 * abs(state[0] - middle) / (bounds[1] - bounds[0]), *(abs(state[1:]) / bounds[2:4])])
        reached = np.maximum(reached, shares)
    return worst, tails / (n / len(ADVERSARIES) * ticks), reached


@pytest.mark.parametrize("group", [1, 6])
def test_limits_are_kept_against_any_policy(group, times):
    """The theorem's core: verify the chosen jerk, else follow the stored stop; nothing is ever exceeded.

    Sub-tick samples too. A shield that stands still would pass this: see the next test.
    """
    arms = 8 if config.DISABLE_JIT else 40
    for seed in range(times):
        worst, tails, _ = simulate(100 * group + seed, arms, 600, group)
        assert np.all(worst <= 1e-9), worst
        assert np.all(tails <= 0.003 * group), dict(zip(ADVERSARIES, tails, strict=True))


def test_the_limits_are_used():
    """Joints that are driven to their limits get there: the shield is not safe by being timid."""
    _, _, reached = simulate(7, 5 if config.DISABLE_JIT else 20, 1000, 1)
    assert np.mean(reached[0] > 0.99) > 0.6
    assert np.mean(reached[2] > 0.99) > 0.7
    roomy = simulate_alone(arm_limits("paper") * np.array([[50.0], [50.0], [1.0], [1.0], [1.0]]))
    assert np.all(roomy > 0.999)


def simulate_alone(bounds):
    """Share of the velocity limit that joints reach at full jerk, as far as the interval allows."""
    state, reached = np.zeros((3, bounds.shape[1])), np.zeros(bounds.shape[1])
    for _ in range(300):
        complete, _, upper = box_of(state, bounds)
        assert complete
        integrate(state, upper, TAU, state)
        reached = np.maximum(reached, state[1] / bounds[2])
    return reached


def test_without_the_interval_and_the_stop_limits_are_exceeded():
    """The same policies, unshielded: the recursion test would notice."""
    rng = np.random.default_rng(3)
    bounds = scaled_limits(rng, 10)
    state = np.zeros((3, 60))
    memory = {"sign": np.ones(60), "level": rng.uniform(-1.0, 1.0, 60), "frequency": rng.uniform(0.1, 6.0, 60)}
    worst = np.full(4, -np.inf)
    for tick in range(1000):
        jerk, _ = adversary(rng, tick, memory, bounds)
        integrate(state, np.clip(jerk, -bounds[4], bounds[4]), TAU, state)
        worst = np.maximum(worst, overshoot(state, jerk, bounds))
    assert np.all(worst[:3] > 1.0)


def visited(seed, arms=20, ticks=250):
    """States that a shielded, hard-driven arm comes to, and their limits."""
    rng = np.random.default_rng(seed)
    bounds = scaled_limits(rng, arms)
    state, sign = np.zeros((3, 6 * arms)), rng.choice([-1.0, 1.0], 6 * arms)
    state[0] = bounds[0] + rng.uniform(0.0, 1.0, 6 * arms) * (bounds[1] - bounds[0])
    for _ in range(ticks):
        sign[rng.random(6 * arms) < 0.02] *= -1.0
        _, lower, upper = box_of(state, bounds)
        integrate(state, np.where(sign > 0.0, upper, lower), TAU, state)
        yield state, bounds


def recoverable(state, jerk, bounds, tolerance=1e-9):
    """Per joint: the tick and the stop after it keep all limits, by the kernels that test_stopping.py checks."""
    after, plan = np.empty_like(state), records(state.shape[1], STOP)
    integrate(state, jerk, TAU, after)
    plan_stop(after, bounds, TAU, plan)
    return np.array(
        [verified(state, after, jerk, plan, bounds, TAU, tolerance, i) for i in range(state.shape[1])], np.bool_
    )


def test_the_interval_is_what_can_be_recovered_from():
    """Its ends are recoverable, nearly all of its inside is, and nearly nothing outside is."""
    rng = np.random.default_rng(5)
    inside, outside, cut = [], [], 0
    for state, bounds in visited(5):
        J = bounds[4]
        _, lower, upper = box_of(state, bounds)
        open_ = lower < upper
        assert np.all(recoverable(state, lower, bounds)[open_])
        assert np.all(recoverable(state, upper, bounds)[open_])
        inside.extend(recoverable(state, rng.uniform(lower, upper), bounds)[open_])
        above = upper + 0.003 * J + rng.uniform(0.0, 1.0, len(J)) * (J - upper)
        below = lower - 0.003 * J - rng.uniform(0.0, 1.0, len(J)) * (J + lower)
        for jerk in (above, below):
            within = abs(jerk) <= J
            outside.extend(recoverable(state, np.clip(jerk, -J, J), bounds)[within])
            cut += np.count_nonzero(within)
    assert cut > 3000
    assert np.mean(inside) > 0.998
    assert np.mean(outside) < 0.01


def test_a_state_with_room_has_the_full_interval():
    """Far from every limit nothing is taken away, to the last bit."""
    for name in ("paper", "stream"):
        bounds = arm_limits(name)
        state = np.zeros((3, 6))
        state[0] = bounds[:2].mean(axis=0)
        complete, lower, upper = box_of(state, bounds)
        assert complete
        np.testing.assert_array_equal(lower, -bounds[4])
        np.testing.assert_array_equal(upper, bounds[4])


def test_a_joint_at_a_limit_is_not_pushed_further():
    """At rest on a position limit: away from it only; at full acceleration: no more of it."""
    bounds = arm_limits("paper")
    state = np.zeros((3, 6))
    state[0] = bounds[1]
    complete, lower, upper = box_of(state, bounds)
    assert complete
    assert np.all(lower == -bounds[4])
    assert np.all((upper <= 0.0) & (upper > -1e-2 * bounds[4]))
    state[0], state[2] = 0.0, -bounds[3]
    complete, lower, upper = box_of(state, bounds)
    assert complete
    np.testing.assert_array_equal(lower, 0.0)
    np.testing.assert_array_equal(upper, bounds[4])
    complete, lower, upper = box_of(-state, bounds)
    assert complete
    np.testing.assert_array_equal(lower, -bounds[4])
    np.testing.assert_array_equal(upper, 0.0)


@pytest.mark.parametrize(("row", "value"), [(0, 9.0), (0, -9.0), (1, 20.0), (1, -20.0), (2, 40.0), (2, -40.0)])
def test_beyond_a_limit_the_joint_brakes_and_the_others_do_not_mind(row, value):
    """No interval: the first jerk of the stop in both ends, for this joint alone."""
    bounds, state = arm_limits("paper"), np.zeros((3, 6))
    state[1:] = 0.1
    state[row, 2] = value
    complete, lower, upper = box_of(state, bounds)
    assert not complete
    brake = stop_joint(state[1, 2], state[2, 2], bounds[4, 2], bounds[3, 2], TAU)[3]
    assert lower[2] == upper[2] == brake
    others = np.arange(6) != 2
    np.testing.assert_array_equal(lower[others], -bounds[4, others])
    np.testing.assert_array_equal(upper[others], bounds[4, others])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", range(3))
def test_a_state_that_is_no_number_has_no_interval(row, bad):
    """NaN never reads as room; what is written is finite and within the jerk limit."""
    bounds, state = arm_limits("paper"), np.zeros((3, 6))
    state[row, 1] = bad
    complete, lower, upper = box_of(state, bounds)
    assert not complete
    assert np.all(np.isfinite(lower) & (abs(lower) <= bounds[4]))
    assert np.all(np.isfinite(upper) & (abs(upper) <= bounds[4]))
    assert lower[1] == upper[1]
    state[row, 1], bounds[row + 2, 1] = 0.0, np.nan
    assert not box_of(state, bounds)[0]
