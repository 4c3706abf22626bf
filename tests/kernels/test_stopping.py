"""Stops on the time grid: they end at rest, soon, and what is said of them in between is true (T4)."""

import functools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.optimize import linprog

from jssa_gym.kernels import lanes, stopping
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import (
    parts_keep,
    peak_speed,
    plan_stop,
    stop_at,
    stop_jerk,
    stop_joint,
)
from jssa_gym.robots import lr_mate_200id_7l

TAU = 0.008
FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=500)
LOOSE = (-1e9, 1e9, 1e9, 1e9, 1e9)
"""Lower and upper position, velocity, acceleration and jerk limits that nothing meets."""


@pytest.fixture(params=[1, pytest.param(200, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


described = functools.cache(lr_mate_200id_7l)
"""An arm's file takes longer to read than most of these tests."""


def moving(rng, count):
    """States (3, count) of joints within their velocity and acceleration limits, and the limits (5, count).

    The arm's limits scaled by 0.1 to 1; fast and slow joints, some at rest, at constant speed, on a limit, or just
    where the ramp of the acceleration to zero ends at rest.
    """
    columns = []
    for name in ("paper", "stream"):
        limit = described(name).limits
        columns.append(np.array([*limit.position.T, limit.velocity, limit.acceleration, limit.jerk]))
    bounds = np.hstack(columns)[:, rng.integers(0, 12, count)]
    bounds[2:] *= rng.uniform(0.1, 1.0, (3, count))
    _, _, V, A, J = bounds
    state = rng.uniform(-1.0, 1.0, (3, count)) * 10.0 ** rng.choice([0.0, 0.0, 0.0, -1.0, -3.0, -9.0], (3, count))
    state[1:] *= bounds[2:4]
    kind = rng.integers(0, 12, count)
    state[1, kind == 0] = 0.0
    state[2, kind == 1] = 0.0
    state[2] = np.where(kind == 2, np.copysign(A, state[2]), state[2])
    state[1] = np.where(kind == 3, np.copysign(V, state[1]), state[1])
    state[1] = np.where(kind == 4, -state[2] * abs(state[2]) / (2.0 * J), state[1])
    return state, bounds


@njit(error_model="numpy")
def step_keeps_in_lanes(q, v, a, u, low, high, V, A, J, tau, tolerance):
    slack, more = tolerance * (high - low), 1.0 + tolerance
    return lanes.keeps(q, v, a, u, tau, low - slack, high + slack, V * more, A * more, J * more)


@njit(error_model="numpy")
def stop_keeps_in_lanes(q, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, V, A, J, tau, tolerance):
    slack, more = tolerance * (high - low), 1.0 + tolerance
    limits = low - slack, high + slack, V * more, A * more, J * more
    return lanes.stop_keeps(q, v, a, ramp, hold, release, jerk_in, jerk_out, *limits, tau)


def step_keeps(*case):
    """What is said of a step of one joint, which is the same in lanes."""
    case = np.array(case, float)
    kept = stopping.step_keeps(*case)
    assert step_keeps_in_lanes(*case) == kept
    return kept


def stop_keeps(q, v, a, stop, *limits):
    """What is said of a stop of one joint, which is the same in lanes."""
    case = np.array([q, v, a, *stop.item(), *limits], float)
    kept = parts_keep(*case)
    assert stop_keeps_in_lanes(*case) == kept
    return kept


def planned(state, bounds):
    plan = records(state.shape[1], STOP)
    ticks = plan_stop(state, bounds, TAU, plan)
    assert ticks == (plan["ramp"] + plan["hold"] + plan["release"]).max()
    return plan


def lengths(plan):
    return plan["ramp"] + plan["hold"] + plan["release"]


def stop_of(v, a, J, A):
    plan = records(1, STOP)
    plan[0] = stop_joint(v, a, J, A, TAU)
    return plan[0]


def shortest(v, a, A, J):
    """Shortest time [s] to rest in continuous time with |jerk| <= J and |acceleration| <= A, arrays of cases.

    Not by phases: among all accelerations that start at a and end at zero after the time T, the lowest is
    max(a - J t, -A, -J (T - t)) at every t, the highest is its mirror image, and everything between them can be
    reached. So T is long enough if -v lies between their integrals (and a can be taken to zero at all).
    """

    def lowest(a, T):
        # straight between the times where two of the three lines cross
        t = np.array([0.0 * T, (a + A) / J, (T + a / J) / 2.0, T - A / J, T])
        t = np.sort(np.clip(t, 0.0, T), axis=0)
        return np.trapezoid(np.maximum(np.maximum(a - J * t, -A), -J * (T - t)), t, axis=0)

    low, high = abs(a) / J, abs(a) / J + 2.0 * abs(v) / A + 4.0 * A / J
    for _ in range(60):
        T = (low + high) / 2.0
        enough = (lowest(a, T) <= -v) & (-v <= -lowest(-a, T))
        low, high = np.where(enough, low, T), np.where(enough, T, high)
    return high


def trace(q, v, a, pieces, samples=20001):
    """Dense samples (4, ...) of position, velocity, acceleration and jerk: each is the running integral of the next.

    Simpson's rule is exact for these cubics; nothing here knows where the extremes are.
    """
    parts = []
    for jerk, time in pieces:
        if time <= 0.0:
            continue
        h = time / (samples - 1)
        rate = a + jerk * h * np.arange(samples)
        speed = v + np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) * h / 2.0)])
        middle = (speed[1:] + speed[:-1]) / 2.0 - jerk * h * h / 8.0
        step = (speed[1:] + 4.0 * middle + speed[:-1]) * h / 6.0
        position = q + np.concatenate([[0.0], np.cumsum(step)])
        q, v, a = position[-1], speed[-1], rate[-1]
        parts.append(np.array([position, speed, rate, np.full(samples, jerk)]))
    return np.hstack(parts)


def pieces_of(stop):
    return (
        (float(stop["jerk_in"]), int(stop["ramp"]) * TAU),
        (0.0, int(stop["hold"]) * TAU),
        (float(stop["jerk_out"]), int(stop["release"]) * TAU),
    )


def test_every_stop_ends_at_rest_soon_and_keeps_jerk_and_acceleration(times):
    """Ticks are executed as the arm would: jerk by jerk. Length against an optimum found by another argument."""
    rng = np.random.default_rng(1)
    for _ in range(times):
        state, bounds = moving(rng, 4000)
        plan = planned(state, bounds)
        longest = shortest(state[1], state[2], bounds[3], bounds[4])
        assert np.all(lengths(plan) * TAU <= longest + 3.0 * TAU + 1e-6)
        jerk = np.empty(state.shape[1])
        for tick in range(lengths(plan).max()):
            stop_jerk(plan, tick, jerk)
            integrate(state, jerk, TAU, state)
            assert np.all(np.abs(jerk) <= bounds[4] * (1.0 + 1e-9))
            assert np.all(np.abs(state[2]) <= bounds[3] * (1.0 + 1e-9))
        assert np.abs(state[1:]).max() <= 1e-10
        stop_jerk(plan, lengths(plan).max(), jerk)
        np.testing.assert_array_equal(jerk, 0.0)


def test_a_stop_is_hardly_longer_than_the_best_on_the_grid():
    """The best is found by linear programming over all jerks that change once a tick."""
    rng = np.random.default_rng(2)
    state, bounds = moving(rng, 16)
    plan = planned(state, bounds)

    def possible(v, a, A, J, n):
        x, b = v / TAU, a / (J * TAU)  # jerks in shares of J
        left = np.arange(n - 1, -1, -1)
        sums = np.tril(np.ones((n, n)))
        free = linprog(
            np.zeros(n),
            A_ub=np.vstack([sums, -sums]),
            b_ub=np.concatenate([np.full(n, A / (J * TAU)) - b, np.full(n, A / (J * TAU)) + b]) + 1e-9,
            A_eq=np.vstack([np.ones(n), left + 0.5]),
            b_eq=[-b, -x / (J * TAU) - n * b],
            bounds=(-1.0, 1.0),
        )
        return free.status == 0

    excess = []
    for i in range(state.shape[1]):
        n = int(lengths(plan)[i])
        limits = (state[1, i], state[2, i], bounds[3, i], bounds[4, i])
        assert n == 0 or possible(*limits, n)
        excess.append(0)
        while n > excess[-1] + 1 and possible(*limits, n - excess[-1] - 1):
            excess[-1] += 1
    assert max(excess) <= 2
    assert np.mean(excess) < 1.0


def test_what_remains_of_a_kept_stop_is_kept():
    """The induction of the safety proof: cut off any number of ticks and the rest still keeps every limit."""
    rng = np.random.default_rng(3)
    state, bounds = moving(rng, 300)
    plan, jerk, seen = planned(state, bounds), np.empty(300), 0
    keeps = np.array([stop_keeps(*state[:, i], plan[i], *bounds[:, i], TAU, 0.0) for i in range(300)])
    for tick in range(lengths(plan).max()):
        stop_jerk(plan, tick, jerk)
        integrate(state, jerk, TAU, state)
        rest = plan.copy()
        rest["ramp"] = np.maximum(plan["ramp"] - tick - 1, 0)
        rest["hold"] = np.clip(plan["ramp"] + plan["hold"] - tick - 1, 0, plan["hold"])
        rest["release"] = np.clip(lengths(plan) - tick - 1, 0, plan["release"])
        for i in np.flatnonzero(keeps & (tick < lengths(plan))):
            assert stop_keeps(*state[:, i], rest[i], *bounds[:, i], TAU, 1e-11), (i, tick)
            seen += 1
    assert seen > 3000


def test_a_stop_is_where_it_is_said_to_be():
    """Positions at any time against jerk-by-jerk execution; at rest exactly, and for ever, after the end."""
    rng = np.random.default_rng(4)
    state, bounds = moving(rng, 100)
    plan, start = planned(state, bounds), state.copy()
    jerk, between = np.empty(100), np.empty_like(state)
    for tick in range(lengths(plan).max()):
        stop_jerk(plan, tick, jerk)
        part = rng.uniform(0.0, 1.0) * TAU
        integrate(state, jerk, part, between)
        integrate(state, jerk, TAU, state)
        for t, expected in ((tick * TAU + part, between), ((tick + 1) * TAU, state)):
            found = np.array([stop_at(*start[:, i], plan[i], TAU, t) for i in range(100)]).T
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10)
    for i in range(100):
        for t in (lengths(plan)[i] * TAU, lengths(plan)[i] * TAU + 0.3, 1e6):
            q, v, a = stop_at(*start[:, i], plan[i], TAU, t)
            assert abs(q - state[0, i]) < 1e-10
            assert (v, a) == (0.0, 0.0)
        np.testing.assert_array_equal(stop_at(*start[:, i], plan[i], TAU, 0.0), start[:, i])


def test_the_peak_speed_is_the_peak_of_what_is_still_to_come():
    """Upper bound and tight, from every moment of the stop on."""
    rng = np.random.default_rng(5)
    state, bounds = moving(rng, 300)
    plan = planned(state, bounds)
    for i in range(300):
        end = lengths(plan)[i] * TAU
        assert peak_speed(state[1, i], state[2, i], plan[i], TAU, end) == 0.0
        if end == 0.0:
            continue
        speed = abs(trace(*state[:, i], pieces_of(plan[i]), 2001)[1])
        time = np.concatenate([at + np.linspace(0.0, t, 2001) for at, t in spans(plan[i]) if t > 0.0])
        for t in (0.0, *rng.uniform(0.0, 1.1 * end, 4)):
            expected = speed[time >= t].max(initial=0.0)
            peak = peak_speed(state[1, i], state[2, i], plan[i], TAU, t)
            assert expected <= peak * (1.0 + 1e-12) + 1e-13
            assert peak <= expected + bounds[3, i] * end / 2000.0


def spans(stop):
    """Beginning and length [s] of the three parts."""
    parts = [time for _, time in pieces_of(stop)]
    return zip(np.cumsum([0.0, *parts[:2]]), parts, strict=True)


def check_limits(extremes, keeps):
    """``keeps(low, high, V, A, J)`` has to turn just at the extremes of the densely sampled motion."""
    low, high, V, A, J = extremes
    for name, limit, outward in (("low", low, -1), ("high", high, 1), ("V", V, 1), ("A", A, 1), ("J", J, 1)):
        at = ("low", "high", "V", "A", "J").index(name)
        margin = 1e-6 * (1.0 + abs(limit))
        for more, expected in ((margin, True), (-margin, False)):
            if at >= 2 and limit + more <= 0.0:
                continue
            limits = list(LOOSE)
            limits[at] = limit + outward * more
            assert keeps(*limits) == expected, (name, more)


def extremes_of(samples):
    position, speed, rate, jerk = samples
    return position.min(), position.max(), abs(speed).max(), abs(rate).max(), abs(jerk).max()


def test_the_limits_of_a_stop_are_checked_all_the_way():
    """A stop passes a limit that it just keeps and fails one that it exceeds by 1e-6 anywhere, at any time."""
    rng = np.random.default_rng(6)
    state, bounds = moving(rng, 400)
    plan = planned(state, bounds)
    for i in np.flatnonzero(lengths(plan) > 0):
        check_limits(
            extremes_of(trace(*state[:, i], pieces_of(plan[i]))),
            lambda *limits, i=i: stop_keeps(*state[:, i], plan[i], *limits, TAU, 0.0),
        )


def test_the_limits_of_a_step_are_checked_all_the_way():
    """Long steps, so that position and speed turn once or twice within one; and steps of one tick."""
    rng = np.random.default_rng(7)
    turns = np.zeros(3, int)
    for tau in np.concatenate([np.full(100, TAU), rng.uniform(0.1, 1.0, 500)]):
        q, v, a = rng.normal(size=3) * np.array([1.0, 0.3, 3.0])
        u = 0.0 if rng.random() < 0.1 else rng.normal() * 15.0
        samples = trace(q, v, a, [(u, tau)])
        turns[np.count_nonzero(np.diff(np.sign(samples[1])))] += 1
        check_limits(
            extremes_of(samples),
            lambda *limits, q=q, v=v, a=a, u=u, tau=tau: step_keeps(q, v, a, u, *limits, tau, 0.0),
        )
    assert np.all(turns > 20)  # no turn, one, two: none of the cases is missing


def test_the_tolerance_is_a_share_of_each_limit():
    """As for ``motion.violates``: of the range for positions, of the limit for everything else."""
    stop, at = records(1, STOP)[0], (0.0, 0.0, 0.0)
    for low, high in ((1e-4, 1.0), (-1.0, -1e-4)):
        assert stop_keeps(*at, stop, low, high, 1.0, 1.0, 1.0, TAU, 2e-4)
        assert not stop_keeps(*at, stop, low, high, 1.0, 1.0, 1.0, TAU, 0.5e-4)
        assert step_keeps(*at, 0.0, low, high, 1.0, 1.0, 1.0, TAU, 2e-4)
        assert not step_keeps(*at, 0.0, low, high, 1.0, 1.0, 1.0, TAU, 0.5e-4)
    for index in range(2, 5):
        limits = [*LOOSE]
        state = [0.0, 0.0, 0.0, 0.0]
        state[index - 1], limits[index] = 2.001, 2.0
        assert step_keeps(*state, *limits, 1e-9, 1e-3)
        assert not step_keeps(*state, *limits, 1e-9, 0.4e-3)


def test_a_plan_that_does_not_end_at_rest_keeps_nothing():
    """A stop that belongs to another state, or that was cut short, is no stop, however wide the limits."""
    stop = stop_of(1.0, 2.0, 60.0, 10.0)
    assert stop_keeps(0.0, 1.0, 2.0, stop, *LOOSE, TAU, 0.0)
    assert not stop_keeps(0.0, 1.0 + 1e-6, 2.0, stop, *LOOSE, TAU, 0.0)
    assert not stop_keeps(0.0, 1.0, 2.0 - 1e-6, stop, *LOOSE, TAU, 0.0)
    for name in ("ramp", "hold", "release"):
        for more in (-1, 1):
            other = stop.copy()
            other[name] += more
            assert not stop_keeps(0.0, 1.0, 2.0, other, *LOOSE, TAU, 0.0)


WIDE = st.one_of(
    st.floats(-1e3, 1e3),
    st.sampled_from([0.0, -0.0, 1e-12, -1e-12, 5e-324, -5e-324, 1e-300, 1.0, -1.0]),
    st.floats(-1e-9, 1e-9),
)


@FIXED
@given(WIDE, WIDE, st.floats(10.0, 1e4), st.floats(0.05, 1e3), st.sampled_from([0.001, 0.008, 0.1]))
@example(0.0, 1e3, 10.0, 0.05, 0.008)
@example(-1e3, -1e3, 10.0, 0.05, 0.1)
def test_any_state_stops(v, a, J, A, tau):
    """Also from beyond the limits: jerk-limited always, and the acceleration never beyond A or where it began."""
    ramp, hold, release, jerk_in, jerk_out = stop_joint(v, a, J, A, tau)
    assert min(ramp, hold, release) >= 0
    assert (ramp + hold + release == 0) == (v == 0.0 and a == 0.0)
    assert max(abs(jerk_in), abs(jerk_out)) <= J * (1.0 + 1e-9)
    size = abs(v) + abs(a) + 1e-6
    for jerk, ticks in ((jerk_in, ramp), (0.0, hold), (jerk_out, release)):
        t = ticks * tau
        v, a, before = v + t * a + t * t / 2.0 * jerk, a + t * jerk, a
        assert abs(a) <= max(A, abs(before)) * (1.0 + 1e-9)
    assert abs(a) <= 1e-12 * size
    assert abs(v) <= 1e-9 * size


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(9))
def test_what_is_not_a_number_keeps_nothing(index, bad):
    """NaN and infinity, in the state or in a limit, never read as safe."""
    good = [0.1, 0.2, 0.3, -1.0, 1.0, 2.0, 10.0, 60.0, TAU]
    stop = stop_of(0.2, 0.3, 60.0, 10.0)
    assert stop_keeps(*good[:3], stop, *good[3:], 0.0)
    assert step_keeps(*good[:3], 1.0, *good[3:], 0.0)
    case = list(good)
    case[index] = bad
    harmless = (index == 3 and bad == -math.inf) or (index in (4, 5, 6, 7) and bad == math.inf)
    if not harmless:
        assert not stop_keeps(*case[:3], stop, *case[3:], 0.0)
        assert not step_keeps(*case[:3], 1.0, *case[3:], 0.0)
    ticks = stop_joint(*case[1:3], case[7], case[6], case[8])
    if index in (1, 2, 7, 8) or (index == 6 and bad != math.inf):
        assert ticks[:3] == (0, 0, 0)
        assert math.isnan(ticks[3])
        assert not stop_keeps(*good[:3], stop_of(*case[1:3], case[7], case[6]), *good[3:], 0.0) or index == 8
    assert not step_keeps(*good[:3], bad, *good[3:], 0.0)
    other = stop.copy()
    other["jerk_in"] = bad
    assert not stop_keeps(*good[:3], other, *good[3:], 0.0)
    other = stop.copy()
    other["jerk_out"] = bad
    assert not stop_keeps(*good[:3], other, *good[3:], 0.0)
    if math.isnan(bad) and index in (1, 2):
        assert peak_speed(*case[1:3], stop, TAU, 0.0) == math.inf


@pytest.mark.parametrize(("J", "A"), [(0.0, 10.0), (-60.0, 10.0), (60.0, 0.0), (60.0, -10.0)])
def test_a_limit_that_is_not_positive_allows_no_stop(J, A):
    """A moving joint that may not be driven cannot stop, and no plan pretends that it does; one at rest rests."""
    stop = stop_of(0.2, 0.3, J, A)
    assert math.isnan(stop["jerk_in"])
    assert not stop_keeps(0.0, 0.2, 0.3, stop, *LOOSE, TAU, 0.0)
    assert stop_joint(0.0, 0.0, J, A, TAU) == (0, 0, 0, 0.0, 0.0)


def test_speeds_beyond_all_bounds_are_no_stop_rather_than_nonsense():
    """Numbers of ticks that an integer cannot hold."""
    for v, a, J, A in (
        (1e308, 0.0, 60.0, 10.0),
        (1e20, 1.0, 60.0, 10.0),
        (1.0, 1e300, 60.0, 10.0),
        (1.0, 1.0, 1e-12, 1.0),
    ):
        ramp, hold, release, jerk_in, jerk_out = stop_joint(v, a, J, A, TAU)
        assert ramp == hold == release == 0
        assert math.isnan(jerk_in)
        assert math.isnan(jerk_out)
