"""Joint motion: the triple integrator, braking to rest, and bodies carried across the floor."""

import math

import numpy as np
import pytest
import reference as ref
from hypothesis import given, settings
from hypothesis import strategies as st

from jssa_gym.kernels.motion import brake, integrate, translate
from jssa_gym.robots import lr_mate_200id_7l

TAU = 0.008
FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=200)


@pytest.fixture(params=[1, pytest.param(50, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def stop_time(v, a, bound):
    """Shortest time [s] in which |jerk| <= bound brings velocity v and acceleration a to zero.

    Velocity and acceleration are a double integrator (v' = a, a' = u), whose time-optimal stop has at
    most one switch (Pontryagin). If the ramp of a to zero at full jerk leaves a velocity
    w = v + a|a|/2J > 0, the jerk is -J until the acceleration is -p, then +J until it is zero. The velocity
    left by the two ramps, v + (a^2 - p^2)/2J - p^2/2J, vanishes for p = sqrt(J v + a^2/2), and the ramps
    take (a + p)/J and p/J. Mirrored for w < 0; |a|/J for w = 0.
    """
    w = v + a * abs(a) / (2.0 * bound)
    if w == 0.0:
        return abs(a) / bound
    sign = math.copysign(1.0, w)
    peak = math.sqrt(max(bound * sign * v + a * a / 2.0, 0.0))
    return (sign * a + 2.0 * peak) / bound


def braking(state, lower, upper, tau):
    out = np.empty(state.shape[1])
    brake(state, lower, upper, tau, out)
    return out


@FIXED
@given(
    st.integers(1, 8),
    st.floats(1e-4, 0.1),
    st.integers(0, 2**32 - 1),
)
def test_one_step_is_eq_1(n, tau, seed):
    """The state that every safety check looks at is the paper's exact step, for any number of joints."""
    state = np.random.default_rng(seed).normal(size=(3, n)) * np.array([[2.0], [5.0], [30.0]])
    jerk = np.random.default_rng(seed + 1).normal(size=n) * 100.0
    out = np.empty((3, n))
    integrate(state, jerk, tau, out)
    expected = np.array(ref.triple_integrator(*state, jerk, tau))
    np.testing.assert_allclose(out, expected, rtol=1e-14, atol=1e-13)


def test_a_step_may_overwrite_its_own_state():
    """Filters integrate in place; a value read after it was written would corrupt the state."""
    rng = np.random.default_rng(1)
    state, jerk = rng.normal(size=(3, 6)), rng.normal(size=6)
    apart, kept = np.empty((3, 6)), state.copy()
    integrate(state, jerk, TAU, apart)
    np.testing.assert_array_equal(state, kept)
    integrate(state, jerk, TAU, state)
    np.testing.assert_array_equal(state, apart)


def test_the_optimal_stop_really_stops():
    """The yardstick of the braking test is right: its two ramps take no negative time and end at rest."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        v, a, bound = rng.normal() * 3.0, rng.normal() * 10.0, rng.uniform(10.0, 100.0)
        sign = math.copysign(1.0, v + a * abs(a) / (2.0 * bound))
        peak = math.sqrt(bound * sign * v + a * a / 2.0)
        expected, total = stop_time(v, a, bound), 0.0
        for jerk, time in (
            (-sign * bound, (sign * a + peak) / bound),
            (sign * bound, peak / bound),
        ):
            assert time >= 0.0
            total += time
            v, a = v + a * time + jerk * time**2 / 2.0, a + jerk * time
        assert abs(v) < 1e-12
        assert abs(a) < 1e-12
        assert abs(total - expected) < 1e-12


@pytest.mark.parametrize("limits", ["paper", "stream"])
def test_braking_comes_to_rest_in_little_more_than_the_shortest_time(limits, times):
    """FAULT brakes with this jerk: from any speed and acceleration the arm stops soon, and stays."""
    limit = lr_mate_200id_7l(limits).limits
    rng = np.random.default_rng(3)
    J = np.tile(limit.jerk, 100 * times)
    n = len(J)
    state = np.zeros((3, n))
    state[1] = rng.uniform(-1.0, 1.0, n) * np.tile(limit.velocity, 100 * times)
    state[2] = rng.uniform(-1.0, 1.0, n) * np.tile(limit.acceleration, 100 * times)
    state[1, : n // 4] *= 1e-3  # slow joints: the grid matters there
    state[2, n // 8 : n // 3] = 0.0
    shortest = np.array([stop_time(v, a, j) for v, a, j in zip(state[1], state[2], J, strict=True)])
    allowed = 1.05 * shortest / TAU + 6.0  # measured: 1.05 and 4.92 ticks, 1.3 and 4.1 ticks
    ticks = np.zeros(n)
    for tick in range(1, int(allowed.max()) + 100):
        jerk = braking(state, -J, J, TAU)
        assert np.all(np.abs(jerk) <= J)
        integrate(state, jerk, TAU, state)
        moving = (np.abs(state[1]) >= 1e-9) | (np.abs(state[2]) >= 1e-9)
        ticks[moving] = tick + 1  # at rest after the next one at the earliest
    assert np.all(ticks <= allowed), (ticks - 1.05 * shortest / TAU).max()


def test_an_arm_at_rest_is_not_moved_by_the_brake():
    """At rest the braking jerk is exactly zero, so that a stopped arm never creeps."""
    state = np.zeros((3, 6))
    state[0] = np.arange(6.0)
    limit = lr_mate_200id_7l().limits.jerk
    np.testing.assert_array_equal(braking(state, -limit, limit, TAU), np.zeros(6))


def test_braking_with_an_unequal_box_still_comes_to_rest():
    """A box need not be symmetric; the brake has to respect the tighter side and still stop."""
    rng = np.random.default_rng(4)
    n = 200
    lower, upper = -rng.uniform(20.0, 200.0, n), rng.uniform(20.0, 200.0, n)
    state = np.zeros((3, n))
    state[1], state[2] = rng.uniform(-3.0, 3.0, n), rng.uniform(-10.0, 10.0, n)
    for _ in range(500):
        jerk = braking(state, lower, upper, TAU)
        assert np.all((lower <= jerk) & (jerk <= upper))
        integrate(state, jerk, TAU, state)
    assert np.abs(state[1:]).max() < 1e-9


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(0.0, 0.0), (-5.0, -5.0), (3.0, 3.0), (-5.0, 0.0), (0.0, 5.0), (1.0, 5.0), (-5.0, -1.0)],
)
def test_braking_in_a_degenerate_box_stays_in_it(lower, upper):
    """A box of zero width, or one that does not contain zero, gives a finite jerk of that box."""
    rng = np.random.default_rng(5)
    state = np.vstack([np.zeros(50), rng.normal(size=(2, 50))])
    state[1:, 0] = 0.0
    jerk = braking(state, np.full(50, lower), np.full(50, upper), TAU)
    assert np.all(np.isfinite(jerk))
    assert np.all((lower <= jerk) & (jerk <= upper))


def test_translate_carries_a_body_with_its_root():
    """Human capsules stand where the root is and move with it; heights do not change."""
    rng = np.random.default_rng(6)
    start, end = rng.normal(size=(2, 6, 3))
    x, y, vx, vy = rng.normal(size=4)
    out = np.full((4, 6, 3), np.nan)
    translate(start, end, x, y, vx, vy, out)
    np.testing.assert_array_equal(out[0], start + np.array([x, y, 0.0]))
    np.testing.assert_array_equal(out[1], end + np.array([x, y, 0.0]))
    np.testing.assert_array_equal(out[2:], np.tile([vx, vy, 0.0], (2, 6, 1)))
