"""Projection of a jerk onto rows and box: nearest, inside, and honest about what it could not satisfy."""

import os
import subprocess
import sys

import numpy as np
import pytest
import reference as ref
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config
from projections import box, feasible_rows, kkt_residual, positive_definite, row_scale
from scipy.optimize import linprog

from jssa_gym.kernels.projection import clip, project_row, project_rows, scratch, violation
from jssa_gym.robots import lr_mate_200id_7l

FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=300)
JERK = lr_mate_200id_7l().limits.jerk


@pytest.fixture(params=[1, pytest.param(100, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def one_row(nominal, row, right, lower, upper, weight):
    out = np.full(len(nominal), np.nan)
    left = project_row(nominal, row, right, lower, upper, weight, out)
    return out, left


def many_rows(nominal, L, S, lower, upper, V):
    n = len(nominal)
    out = np.full(n, np.nan)
    floats, active, relief = scratch(n, len(S))
    floats[:], active[:], relief[:] = np.nan, -7, np.nan  # what the last problem left in it must not matter
    feasible, left = project_rows(nominal, L, S, len(S), lower, upper, np.linalg.inv(V), floats, active, relief, out)
    return out, feasible, left


# ---- one row ---------------------------------------------------------------------------------------------


def test_one_row_is_optimal(times):
    """Eq. (14) with one row: inside the box, row kept to rounding, and no nearer jerk exists (KKT)."""
    rng = np.random.default_rng(1)
    touched = 0
    for _ in range(2000 * times):
        n = int(rng.integers(1, 8))
        lower, upper = box(rng, n)
        nominal = 1.3 * rng.uniform(lower, upper)
        L, S = feasible_rows(rng, lower, upper, 1)
        weight = 10.0 ** rng.uniform(-2.0, 2.0, n)
        u, left = one_row(nominal, L[0], S[0], lower, upper, weight)
        scale = row_scale(L, S, lower, upper)
        assert np.all((lower <= u) & (u <= upper))
        assert left <= 1e-12 * scale
        assert S[0] - L[0] @ u <= 1e-12 * scale
        assert kkt_residual(u, nominal, L, S, lower, upper, np.diag(weight)) <= 1e-9
        touched += abs(L[0] @ u - S[0]) <= 1e-9 * scale
    assert touched >= 500 * times  # the row bites in a good part of the cases


def test_one_row_equals_enumeration(times):
    """Against every combination of active constraints, tried one after the other."""
    rng = np.random.default_rng(2)
    for _ in range(100 * times):
        n = int(rng.integers(1, 5))
        lower, upper = box(rng, n)
        nominal = 1.3 * rng.uniform(lower, upper)
        L, S = feasible_rows(rng, lower, upper, 1)
        weight = 10.0 ** rng.uniform(-1.0, 1.0, n)
        u, _ = one_row(nominal, L[0], S[0], lower, upper, weight)
        expected = ref.project_brute(nominal, L, S, lower, upper, np.diag(weight))
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-8 * max(upper.max(), -lower.min()))


small = st.integers(-2, 2).map(float)


@pytest.mark.long
@FIXED
@given(
    st.integers(1, 3).flatmap(
        lambda n: st.tuples(*[st.lists(small, min_size=n, max_size=n).map(np.array) for _ in range(4)])
    ),
    small,
)
def test_one_row_in_degenerate_boxes(arrays, right):
    """Small integers make ties common: zero rows, boxes of no width, corners, nominals on the faces."""
    nominal, row, one, two = arrays
    lower, upper = np.minimum(one, two), np.maximum(one, two)
    weight = np.arange(1.0, len(row) + 1.0)
    u, left = one_row(nominal, row, right, lower, upper, weight)
    assert np.all((lower <= u) & (u <= upper))
    most = float(np.maximum(row * lower, row * upper).sum())
    if right <= most:
        expected = ref.project_brute(nominal, row[None], [right], lower, upper, np.diag(weight))
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-9)
        assert left <= 1e-12
    else:  # no jerk of the box keeps the row: the least violation, joints without a part in it left alone
        assert left == pytest.approx(right - most, abs=1e-12)
        idle = row == 0.0
        np.testing.assert_array_equal(u[idle], np.clip(nominal, lower, upper)[idle])


def test_one_row_keeps_a_safe_nominal_bit_for_bit():
    """Where nothing is to be done nothing is done: no rounding leaks into a safe jerk. Once is enough."""
    rng = np.random.default_rng(3)
    for _ in range(500):
        lower, upper = box(rng, 6)
        nominal, row, weight = rng.uniform(lower, upper), rng.normal(size=6), rng.uniform(0.1, 3.0, 6)
        u, left = one_row(nominal, row, row @ nominal - 0.1, lower, upper, weight)
        np.testing.assert_array_equal(u, nominal)
        assert left == 0.0
        right = row @ rng.uniform(lower, upper)
        once, left = one_row(nominal, row, right, lower, upper, weight)
        if left == 0.0:
            twice, _ = one_row(once, row, right, lower, upper, weight)
            np.testing.assert_array_equal(twice, once)


def test_one_impossible_row_is_violated_least():
    """A row that excludes the whole box: as near to it as the box allows, and the violation is reported."""
    rng = np.random.default_rng(4)
    for _ in range(200):
        lower, upper = box(rng, 6)
        row, weight = 1e-3 * rng.normal(size=6), rng.uniform(0.1, 3.0, 6)
        most = np.maximum(row * lower, row * upper).sum()
        u, left = one_row(rng.uniform(lower, upper), row, most + 0.3, lower, upper, weight)
        np.testing.assert_array_equal(u, np.where(row > 0.0, upper, lower))
        assert left == pytest.approx(0.3, abs=1e-12)


# ---- many rows -------------------------------------------------------------------------------------------


def test_many_rows_equal_enumeration(times):
    """The active-set method against every combination of active constraints, full weights included."""
    rng = np.random.default_rng(5)
    for _ in range(60 * times):
        n, m = int(rng.integers(1, 4)), int(rng.integers(1, 4))
        lower, upper = box(rng, n)
        nominal = 1.3 * rng.uniform(lower, upper)
        L, S = feasible_rows(rng, lower, upper, m)
        V = positive_definite(rng, n)
        u, feasible, left = many_rows(nominal, L, S, lower, upper, V)
        assert feasible
        assert left <= 1e-9 * row_scale(L, S, lower, upper)
        expected = ref.project_brute(nominal, L, S, lower, upper, V)
        unit = max(upper.max(), -lower.min())
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-7 * unit)


def test_many_rows_are_optimal(times):
    """The shield's sizes, 6 joints and up to 30 rows: rows kept, inside the box, no nearer jerk (KKT)."""
    rng = np.random.default_rng(6)
    for case in range(400 * times):
        n, m = int(rng.choice([2, 4, 6, 7])), int(rng.choice([1, 2, 5, 12, 30]))
        lower, upper = box(rng, n)
        nominal = 1.3 * rng.uniform(lower, upper)
        L, S = feasible_rows(rng, lower, upper, m)
        V = positive_definite(rng, n) if case % 2 else np.diag(10.0 ** rng.uniform(-1.0, 1.0, n))
        u, feasible, left = many_rows(nominal, L, S, lower, upper, V)
        scale = row_scale(L, S, lower, upper)
        assert feasible
        assert np.all((lower <= u) & (u <= upper))
        assert left <= 1e-9 * scale
        assert left == max(0.0, violation(L, S, m, u))
        assert kkt_residual(u, nominal, L, S, lower, upper, V) <= 1e-9
        if case % 10 == 0:
            expected = ref.project_reference(nominal, L, S, lower, upper, V)
            np.testing.assert_allclose(u, expected, rtol=0, atol=1e-6 * max(upper.max(), -lower.min()))


def test_conflicting_rows_are_violated_least(times):
    """No jerk keeps all rows: the largest violation is the least possible (linear program), and reported."""
    rng = np.random.default_rng(7)
    conflicts = 0
    for _ in range(150 * times):
        n, m = int(rng.choice([2, 4, 6])), int(rng.choice([1, 2, 5, 12]))
        lower, upper = box(rng, n)
        nominal = rng.uniform(lower, upper)
        L = 1e-3 * rng.normal(size=(m, n))
        S = 0.15 * rng.normal(size=m)
        least, _ = ref.least_violation(L, S, lower, upper)
        if abs(least) < 1e-6:
            continue
        V = positive_definite(rng, n)
        u, feasible, left = many_rows(nominal, L, S, lower, upper, V)
        assert feasible == (least < 0.0)
        assert np.all((lower <= u) & (u <= upper))
        assert left == max(0.0, violation(L, S, m, u))
        if not feasible:
            conflicts += 1
            assert left == pytest.approx(least, rel=1e-6, abs=1e-12)
            # of all jerks with this violation it is the nearest
            nearest = ref.project_reference(nominal, L, S - left * (1.0 + 1e-9), lower, upper, V)
            assert nearest is not None
            cost = (u - nominal) @ V @ (u - nominal)
            assert cost <= (nearest - nominal) @ V @ (nearest - nominal) * (1.0 + 1e-4) + 1e-6
    assert conflicts >= 30 * times


def rows_nearly_twice(rng):
    """Rows that nearly repeat each other and hardly move some joints, as an arm inside somebody gives them."""
    m = rng.integers(2, 5)
    L = rng.normal(size=(m, 6)) * np.array([1e-4, 1e-4, 3e-4, 1e-20, 1e-20, 0.0])
    L[:, 0] *= 10.0 ** rng.uniform(-6.0, 0.0)
    L = np.concatenate([L, L * (1.0 + 10.0 ** rng.uniform(-9.0, -4.0) * rng.normal(size=(m, 6)))])
    S = 0.01 * rng.normal(size=m)
    S = np.concatenate([S, S * (1.0 + 10.0 ** rng.uniform(-12.0, -2.0) * rng.normal(size=m))])
    upper = np.array([66.0, 59.0, 61.0, 122.0, 122.0, 187.0])
    lower = np.where(np.arange(6) == 1, -(10.0 ** rng.uniform(-16.0, 2.0)), -upper)
    return np.clip(rng.uniform(-upper, upper), lower, upper), L, S, lower, upper


@pytest.mark.long
def test_rows_that_nearly_repeat_each_other_are_solved(times):
    """Here rounding undoes what the active set has found: a solution has to come out all the same."""
    rng, hard = np.random.default_rng(0), 0
    count = 2_000 if config.DISABLE_JIT else 20_000 * times
    for _ in range(count):
        nominal, L, S, lower, upper = rows_nearly_twice(rng)
        u, feasible, left = many_rows(nominal, L, S, lower, upper, np.eye(6))
        assert np.isfinite(left)
        assert np.all((lower <= u) & (u <= upper))
        assert left == max(0.0, violation(L, S, len(S), u))
        if not feasible:
            hard += 1
            if hard % 20 == 0:
                assert left == pytest.approx(ref.least_violation(L, S, lower, upper)[0], rel=1e-5, abs=1e-8)
    assert hard >= count / 20


def test_a_box_a_few_roundings_wide_is_a_point():
    rng = np.random.default_rng(5)
    for k in range(3000):
        nominal, L, S, lower, upper = rows_nearly_twice(rng)
        at = rng.uniform(-0.9, 0.9, 6) * JERK
        narrow = rng.random(6) < 0.5
        lower = np.where(narrow, at, lower)
        upper = np.where(narrow, at + (1e-16, 1e-15, 1e-14)[k % 3] * np.abs(at), upper)
        u, _, left = many_rows(nominal, L, S, lower, upper, np.eye(6))
        assert np.isfinite(left)
        assert np.all((lower <= u) & (u <= upper))


def room_below_least(L, S, least, lower, upper):
    """How much less than the least violation each row can do with while none needs more: a linear program a row.

    A row without room decides about the least violation.
    """
    width, options = upper - lower, {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    room = []
    for row, right in zip(L, S, strict=True):
        bound = L @ lower - S + least * (1.0 + 1e-9)
        best = linprog(-row * width, -L * width, bound, bounds=[(0.0, 1.0)] * len(lower), options=options)
        assert best.success
        room.append(row @ lower - best.fun - right + least)
    return np.array(room)


def least_of_others(L, S, least, decide, lower, upper):
    """Least violation of the rows that do not decide while the others keep to theirs, as a linear program."""
    width, n = upper - lower, len(lower)
    best = linprog(
        np.append(np.zeros(n), 1.0),
        np.column_stack([-L * width, np.where(decide, 0.0, -1.0)]),
        L @ lower - S + np.where(decide, least * (1.0 + 1e-9), 0.0),
        bounds=[(0.0, 1.0)] * n + [(0.0, None)],
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert best.success
    return best.fun


@pytest.mark.long
def test_rows_that_do_not_decide_are_violated_least_too(times):
    """Beside rows in conflict, the others do with the least that those leave them; a doubled row is no other row.

    The first rows are about the first joints only and demand most, so that the others have joints of their own left.
    """
    rng = np.random.default_rng(16)
    compared = violated = 0
    for case in range(60 * times):
        n, m = int(rng.choice([4, 6])), int(rng.choice([5, 8, 12]))
        lower, upper = box(rng, n)
        L, S = 1e-3 * rng.normal(size=(m, n)), 0.2 * rng.normal(size=m)
        L[:3, n // 2 :] = 0.0
        L[3:, : n // 2] = 0.0
        S[:3] += 0.3
        if case % 2:
            L[2], S[2] = L[0], S[0]
        nominal = rng.uniform(lower, upper)
        least, _ = ref.least_violation(L, S, lower, upper)
        if least < 1e-3:
            continue
        room = room_below_least(L, S, least, lower, upper)
        decide = room < 1e-8
        if np.all(decide) or np.any(~decide & (room < 1e-4)):  # too close for the programs' tolerance
            continue
        u, feasible, left = many_rows(nominal, L, S, lower, upper, np.eye(n))
        assert not feasible
        assert left == pytest.approx(least, rel=1e-6)
        expected = least_of_others(L, S, least, decide, lower, upper)
        others = np.max((S - L @ u)[~decide])
        assert max(0.0, others) == pytest.approx(expected, rel=1e-6, abs=1e-4 * least)
        # and of all jerks like that it is the nearest
        granted = np.where(decide, left, max(0.0, others)) * (1.0 + 1e-9) + 1e-12
        nearest = ref.project_reference(nominal, L, S - granted, lower, upper, np.eye(n))
        assert nearest is not None
        assert np.sum((u - nominal) ** 2) <= np.sum((nearest - nominal) ** 2) * (1.0 + 1e-4) + 1e-6
        compared += 1
        violated += expected > 1e-3
    assert compared >= 30 * times
    assert violated >= 10 * times


def test_rows_that_meet_in_one_point_are_feasible(times):
    """A feasible set without any width is one: found, and said to be feasible."""
    rng = np.random.default_rng(15)
    for _ in range(300 * times):
        n, m = int(rng.choice([2, 6])), int(rng.choice([3, 7, 12, 30]))
        lower, upper = box(rng, n)
        L = 1e-3 * rng.normal(size=(m, n))
        S = L @ rng.uniform(lower, upper)
        u, feasible, left = many_rows(rng.uniform(lower, upper), L, S, lower, upper, np.eye(n))
        assert feasible
        assert np.all((lower <= u) & (u <= upper))
        assert left == max(0.0, violation(L, S, m, u))
        assert left <= 1e-9 * max(1.0, np.max(np.abs(S)))


def test_many_rows_twice_is_once():
    """Projecting what was projected changes nothing beyond rounding."""
    rng = np.random.default_rng(8)
    for _ in range(100):
        lower, upper = box(rng, 6)
        L, S = feasible_rows(rng, lower, upper, 5)
        V = positive_definite(rng, 6)
        once, _, _ = many_rows(rng.uniform(lower, upper), L, S, lower, upper, V)
        twice, _, _ = many_rows(once, L, S, lower, upper, V)
        np.testing.assert_allclose(twice, once, rtol=0, atol=1e-9 * upper.max())


def test_many_rows_keep_a_safe_nominal_bit_for_bit():
    """Where nothing is to be done nothing is done: no rounding leaks into a safe jerk."""
    rng = np.random.default_rng(9)
    for _ in range(200):
        lower, upper = box(rng, 6)
        nominal, L = rng.uniform(lower, upper), 1e-3 * rng.normal(size=(4, 6))
        u, feasible, left = many_rows(nominal, L, L @ nominal - 0.01, lower, upper, np.eye(6))
        assert feasible
        assert left == 0.0
        np.testing.assert_array_equal(u, nominal)


def test_many_rows_keep_a_safe_nominal_to_rounding():
    """What the exact version of this test asks for, to one unit in the last place."""
    rng = np.random.default_rng(9)
    for _ in range(200):
        lower, upper = box(rng, 6)
        nominal, L = rng.uniform(lower, upper), 1e-3 * rng.normal(size=(4, 6))
        u, feasible, left = many_rows(nominal, L, L @ nominal - 0.01, lower, upper, np.eye(6))
        assert feasible
        assert left == 0.0
        np.testing.assert_array_max_ulp(u, nominal, maxulp=1)


CHECKED = """
import numpy as np
from jssa_gym.kernels.projection import project_rows, scratch
rng = np.random.default_rng(10)
for n in (1, 2, 3, 6, 7, 9):
    for m in (0, 1, 4, 12):
        for S in (rng.normal(size=m), np.full(m, 1e3)):
            upper = rng.uniform(20.0, 200.0, n)
            nominal, L = 2.0 * rng.uniform(-upper, upper), rng.normal(size=(m, n))
            project_rows(nominal, L, S, m, -upper, upper, np.eye(n), *scratch(n, m), np.empty(n))
"""


def test_no_kernel_writes_behind_its_scratch():
    """Compiled kernels do not check bounds; interpreted, numpy does, at every index."""
    run = subprocess.run(
        [sys.executable, "-c", CHECKED],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


ALLOCATIONS = """
import numpy as np
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from jssa_gym.kernels.projection import project_rows, scratch
rtsys.initialize(cpu_target.target_context)
rng, bound, memory = np.random.default_rng(11), np.ones(6), scratch(6, 8)
L = rng.normal(size=(8, 6))
def allocations(S, expected):
    nominal, out = rng.uniform(-bound, bound), np.empty(6)
    before = rtsys.get_allocation_stats().alloc
    feasible, _ = project_rows(nominal, L, S, 8, -bound, bound, np.eye(6), *memory, out)
    assert feasible == expected
    return rtsys.get_allocation_stats().alloc - before
possible, hopeless = L @ np.full(6, 0.5), np.full(8, 1e3)
allocations(possible, True)
print(allocations(possible, True), allocations(hopeless, False))
"""


@pytest.mark.long
def test_rows_that_exclude_each_other_cost_no_memory():
    """Whatever the rows are, nothing is allocated but what handing arrays to a kernel takes."""
    run = subprocess.run(
        [sys.executable, "-c", ALLOCATIONS],
        env={**os.environ, "NUMBA_NRT_STATS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    possible, hopeless = run.stdout.split()
    assert possible == hopeless


def test_violation_and_clip():
    """The two numbers that every decision reports are computed from the jerk itself; NaN is never 'kept'."""
    L, S = np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]]), np.array([0.0, 3.0, 100.0])
    u = np.array([1.0, 1.0])
    assert violation(L, S, 0, u) == 0.0
    assert violation(L, S, 1, u) == 0.0
    assert violation(L, S, 2, u) == 1.0
    assert violation(L, S, 3, u) == 98.0
    for k in range(2):
        broken = S.copy()
        broken[k] = np.nan
        assert np.isnan(violation(L, broken, 2, u))
        jerk = u.copy()
        jerk[k] = np.nan
        assert np.isnan(violation(L, S, 2, jerk))
    out = np.empty(2)
    assert clip(u, -u, u, out)
    np.testing.assert_array_equal(out, u)
    assert not clip(np.array([3.0, 0.0]), -u, u, out)
    np.testing.assert_array_equal(out, [1.0, 0.0])
    assert not clip(np.array([np.nan, 0.0]), -u, u, out)
