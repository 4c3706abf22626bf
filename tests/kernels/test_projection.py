"""Projection of a jerk onto rows and box: nearest, inside, and honest about what it could not satisfy."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import osqp
import pytest
import reference as ref
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import config
from scipy.optimize import linprog

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.projection import clip, project_row, project_rows, scratch, violation
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.projectors import PROJECTORS, ExactProjector, OSQPProjector
from jssa_gym.types import HalfSpaces

FIXED = settings(deadline=None, derandomize=True, database=None, max_examples=300)
JERK = lr_mate_200id_7l().limits.jerk


OSQP_WARNING = "ignore:The default value of raise_error:PendingDeprecationWarning"


@pytest.fixture(params=[1, pytest.param(100, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def positive_definite(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.2 * np.eye(n)


def box(rng, n):
    return -rng.uniform(20.0, 200.0, n), rng.uniform(20.0, 200.0, n)


def feasible_rows(rng, lower, upper, m):
    """Rows of the size that the safety index makes, all kept by one jerk of the box; up to n - 1 just so."""
    L = 1e-3 * rng.normal(size=(m, len(lower)))
    room = 0.05 * rng.uniform(0.0, 1.0, m)
    room[: rng.integers(0, min(m, len(lower) - 1) + 1)] = 0.0
    return L, L @ rng.uniform(lower, upper) - room


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


def row_scale(L, S, lower, upper):
    """Size of the numbers that cancel in S - L u."""
    most = np.abs(L).reshape(-1, len(lower)) @ np.maximum(np.abs(lower), np.abs(upper))
    return float(max(np.max(np.abs(S), initial=0.0), np.max(most, initial=0.0), 1e-300))


def kkt_residual(u, nominal, L, S, lower, upper, V):
    """How far V (u - nominal) is from a non-negative combination of active normals, relative to its terms."""
    gradient = V @ (u - nominal)
    L, S = np.reshape(L, (-1, len(u))), np.reshape(S, -1)
    scale = row_scale(L, S, lower, upper)
    length = np.linalg.norm(L, axis=1)
    rows = L[(np.abs(L @ u - S) <= 1e-9 * scale) & (length > 0.0)]
    eye = np.eye(len(u))
    unit = np.max(np.abs([lower, upper]))
    near = 1e-12 * unit
    normals = np.vstack([rows, eye[u <= lower + near], -eye[u >= upper - near]])
    size = float(np.max(np.abs(V) @ np.maximum(np.abs(u - nominal), 1e-4 * unit)))
    if len(normals) == 0:
        return float(np.linalg.norm(gradient)) / size
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    _, residual = ref.scipy.optimize.nnls(normals.T, gradient / size, maxiter=1000)
    return float(residual)


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


@pytest.mark.parametrize("name", PROJECTORS)
def test_a_single_joint_with_many_rows(name):
    """The smallest arm there is: the nearest point of an interval."""
    rows = HalfSpaces(np.array([[1.0], [-1.0], [0.5]]), np.array([0.7, -0.9, 0.1]))
    for nominal, expected in ((0.5, 0.7), (0.8, 0.8), (2.0, 0.9)):
        found = PROJECTORS[name](1).project(np.array([nominal]), rows, -np.ones(1), np.ones(1))
        assert found.feasible
        assert found.jerk[0] == pytest.approx(expected, abs=1e-6)


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


# ---- the contract of every projector ---------------------------------------------------------------------


def problems():
    """Name: (nominal, L, S, lower, upper, weight)."""
    rng = np.random.default_rng(11)
    wide, eye = np.full(6, 100.0), np.eye(6)
    nominal = rng.uniform(-90.0, 90.0, 6)
    L = 1e-3 * rng.normal(size=(5, 6))
    S = L @ rng.uniform(-90.0, 90.0, 6) - 1e-3
    row = L[0]
    reach = np.abs(row) @ wide
    full = positive_definite(rng, 6)
    narrow = wide.copy()
    narrow[[1, 4]] = -20.0
    diagonal = 10.0 ** rng.uniform(-1.0, 1.0, 6)
    none = (np.zeros((0, 6)), np.zeros(0))
    yield "no rows", (nominal, *none, -wide, wide, None)
    yield "no rows, nominal outside", (3.0 * nominal, *none, -wide, wide, None)
    yield "one row kept", (nominal, row[None], [row @ nominal - 0.1], -wide, wide, None)
    yield "one row", (nominal, row[None], [row @ nominal + 0.02], -wide, wide, None)
    yield "one row, diagonal weight", (nominal, row[None], [row @ nominal + 0.02], -wide, wide, diagonal)
    yield "one row, full weight", (nominal, row[None], [row @ nominal + 0.02], -wide, wide, full)
    yield "one row, nominal outside", (3.0 * nominal, row[None], [0.5 * reach], -wide, wide, None)
    yield "one row, only a face keeps it", (nominal, 1e-3 * eye[2:3], [0.1], -wide, wide, None)
    yield "one row, nearly the corner", (nominal, row[None], [0.999 * reach], -wide, wide, None)
    yield "one impossible row", (nominal, row[None], [reach + 0.05], -wide, wide, None)
    yield "one joint", (np.array([5.0]), np.array([[2e-3]]), [0.05], [-40.0], [60.0], None)
    yield "five rows", (nominal, L, S, -wide, wide, None)
    yield "five rows, diagonal weight", (nominal, L, S, -wide, wide, diagonal)
    yield "five rows, full weight", (nominal, L, S, -wide, wide, full)
    yield "five rows, the arm's box", (nominal, L, S, -JERK, JERK, None)
    yield (
        "duplicated row",
        (nominal, np.tile(row, (4, 1)), np.full(4, row @ nominal + 0.02), -wide, wide, None),
    )
    parallel = np.outer([1.0, 2.0, 0.5], row)
    yield "parallel rows", (nominal, parallel, parallel @ nominal + [0.02, 0.01, 0.02], -wide, wide, None)
    yield (
        "zero rows that hold",
        (nominal, np.vstack([row, 0 * row]), [row @ nominal + 0.02, -1.0], -wide, wide, None),
    )
    yield "only zero rows", (nominal, np.zeros((2, 6)), [-1.0, 0.0], -wide, wide, None)
    yield "a zero row that cannot hold", (nominal, np.zeros((2, 6)), [-1.0, 0.25], -wide, wide, None)
    opposite = np.vstack([row, -row])
    yield "a slab", (nominal, opposite, [0.02, -0.03], -wide, wide, None)
    yield "a slab of no width", (nominal, opposite, [0.02, -0.02], -wide, wide, None)
    yield "opposite rows in conflict", (nominal, opposite, [0.05, 0.03], -wide, wide, None)
    yield "only a corner keeps them", (nominal, 1e-3 * eye, np.full(6, 0.1), -wide, wide, None)
    yield (
        "some joints held",
        (nominal, L[:3], S[:3] * 0.1 - 0.05, np.where(narrow < 0, narrow, -wide), narrow, None),
    )
    yield "all joints held", (nominal, L, L @ wide / 2 - 0.01, wide / 2, wide / 2, None)
    yield "all joints held, in conflict", (nominal, L, L @ wide / 2 + 0.01, wide / 2, wide / 2, None)
    yield (
        "a box that excludes zero",
        (nominal, L[:2], L[:2] @ np.full(6, 45.0) - 1e-3, 0.4 * wide, 0.5 * wide, None),
    )
    yield "six rows in conflict", (nominal, np.vstack([L, -L[:1]]), np.full(6, 0.2), -wide, wide, full)


PROBLEMS = {name: tuple(None if x is None else np.asarray(x, float) for x in problem) for name, problem in problems()}


@pytest.mark.filterwarnings(OSQP_WARNING)
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("name", PROJECTORS)
def test_every_projector_solves_every_problem(name, problem):
    """Contract: inside the box, rows kept if possible, the nearest such jerk, else the least violation."""
    nominal, L, S, lower, upper, weight = PROBLEMS[problem]
    n = len(nominal)
    V = np.eye(n) if weight is None else np.diag(weight) if weight.ndim == 1 else weight
    arguments = [x.copy() for x in (nominal, L, S, lower, upper)]
    projector = PROJECTORS[name](n, weight)
    found = projector.project(nominal, HalfSpaces(L, S), lower, upper)
    for before, after in zip(arguments, (nominal, L, S, lower, upper), strict=True):
        np.testing.assert_array_equal(before, after)
    assert found.jerk.shape == (n,)
    assert np.all((lower <= found.jerk) & (found.jerk <= upper))
    assert found.violation == pytest.approx(max(0.0, *(S - L @ found.jerk), 0.0), abs=1e-15)
    expected = ref.project_reference(nominal, L, S, lower, upper, V)
    assert found.feasible == (expected is not None)
    if expected is not None:
        assert found.violation <= 1e-9
        scale = max(1.0, float((expected - nominal) @ V @ (expected - nominal)))
        cost = (found.jerk - nominal) @ V @ (found.jerk - nominal)
        assert cost <= (expected - nominal) @ V @ (expected - nominal) + 1e-5 * scale
        if name == "exact":
            np.testing.assert_allclose(found.jerk, expected, rtol=0, atol=1e-5)
            assert kkt_residual(found.jerk, nominal, L, S, lower, upper, V) <= 1e-9
    else:
        least, _ = ref.least_violation(L, S, lower, upper)
        assert found.violation == pytest.approx(least, rel=1e-6)
    again = projector.project(nominal, HalfSpaces(L, S), lower, upper)
    np.testing.assert_array_equal(again.jerk, found.jerk)  # no memory of the last problem
    assert not np.shares_memory(again.jerk, found.jerk)
    assert not np.shares_memory(found.jerk, nominal)


@pytest.mark.filterwarnings(OSQP_WARNING)
@pytest.mark.parametrize("name", PROJECTORS)
def test_one_projector_solves_problem_after_problem(name):
    """The workspace of one problem leaves no trace in the next, whatever its number of rows was."""
    used = PROJECTORS[name](6)
    for nominal, L, S, lower, upper, weight in PROBLEMS.values():
        if len(nominal) != 6 or weight is not None:
            continue
        fresh = PROJECTORS[name](6).project(nominal, HalfSpaces(L, S), lower, upper)
        found = used.project(nominal, HalfSpaces(L, S), lower, upper)
        assert found.feasible == fresh.feasible
        np.testing.assert_allclose(found.jerk, fresh.jerk, rtol=0, atol=1e-12 if name == "exact" else 0.1)


@pytest.mark.filterwarnings(OSQP_WARNING)
@pytest.mark.parametrize("name", PROJECTORS)
@pytest.mark.parametrize("count", [1, 2, 5])
def test_rows_that_are_no_numbers_are_never_feasible(name, count):
    """A NaN in a row must not read as kept."""
    rng = np.random.default_rng(12)
    lower, upper = -JERK, JERK
    projector = PROJECTORS[name](6)
    for row in range(count):
        for part in ("S", "L", "one of L"):
            L, S = 1e-3 * rng.normal(size=(count, 6)), rng.normal(size=count) * 0.1
            if part == "S":
                S[row] = np.nan
            else:
                L[row, slice(None) if part == "L" else 2] = np.nan
            found = projector.project(rng.uniform(lower, upper), HalfSpaces(L, S), lower, upper)
            assert not found.feasible
            assert np.isnan(found.violation)


@pytest.mark.parametrize("name", PROJECTORS)
@pytest.mark.parametrize(
    "count",
    [
        1,
        2,
        5,
    ],
)
def test_rows_that_are_no_numbers_still_give_a_jerk_of_the_box(name, count):
    """What a projector returns is always a jerk of the box, even when the rows are rubbish."""
    rng = np.random.default_rng(12)
    for _ in range(20):
        L, S = 1e-3 * rng.normal(size=(count, 6)), rng.normal(size=count) * 0.1
        L[rng.integers(count), rng.integers(6)] = np.nan
        found = PROJECTORS[name](6).project(rng.uniform(-JERK, JERK), HalfSpaces(L, S), -JERK, JERK)
        assert np.all(np.abs(found.jerk) <= JERK)


@pytest.mark.parametrize("name", PROJECTORS)
@pytest.mark.parametrize(
    "weight",
    [
        np.ones(5),
        np.ones((6, 5)),
        np.ones((1, 6)),
        1.0,
        np.zeros(6),
        -np.ones(6),
        [1.0, 1.0, 1.0, 1.0, 1.0, 0.0],
        [1.0, 1.0, 1.0, 1.0, 1.0, np.nan],
        [1.0, 1.0, 1.0, 1.0, 1.0, np.inf],
        np.ones((6, 6)),
        np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]),
        np.eye(6) + np.diag(np.ones(5), 1),
        np.full((6, 6), np.nan),
    ],
)
def test_bad_weights_are_refused(name, weight):
    """A metric that is none would make 'nearest' meaningless: refused at construction."""
    with pytest.raises(ParameterError, match="weight has to be"):
        PROJECTORS[name](6, weight)


# ---- a solver that fails ---------------------------------------------------------------------------------


SOLVE = osqp.OSQP.solve


def answer(x):
    return lambda self, *arguments, **options: SimpleNamespace(x=x, y=None)


def corner(self, *arguments, **options):
    """Answers another question: a corner of rows and box, nearest to a nominal far away, with its multipliers."""
    self.update(q=np.full(6, 5.0))
    return SOLVE(self, *arguments, **options)


def with_multipliers(change):
    """The right jerk, but its multipliers prove nothing."""

    def solve(self, *arguments, **options):
        found = SOLVE(self, *arguments, **options)
        return SimpleNamespace(x=found.x, y=change(found.y))

    return solve


def raising(error):
    def solve(self, *arguments, **options):
        raise error

    return solve


FAULTS = {
    "NaN": ("solve", answer(np.full(6, np.nan)), "no finite answer"),
    "one NaN": ("solve", answer(np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])), "no finite answer"),
    "infinite": ("solve", answer(np.array([np.inf, 0.0, 0.0, 0.0, 0.0, 0.0])), "no finite answer"),
    "nothing": ("solve", answer(None), "no finite answer"),
    "wrong, called solved": ("solve", answer(np.zeros(6)), "osqp left"),
    "far outside the box": ("solve", answer(np.full(6, -1e9)), "osqp left"),
    "feasible but not nearest": ("solve", corner, "osqp may be"),
    "multipliers of the wrong sign": ("solve", with_multipliers(np.negative), "osqp may be"),
    "multipliers too small": ("solve", with_multipliers(lambda y: 0.9 * y), "osqp may be"),
    "huge multipliers": ("solve", with_multipliers(lambda y: np.full_like(y, 1e200)), "osqp may be"),
    "infinite multipliers": ("solve", with_multipliers(lambda y: np.full_like(y, np.inf)), "no finite multipliers"),
    "no multipliers": ("solve", with_multipliers(lambda y: None), "no finite multipliers"),
    "exception": ("solve", raising(RuntimeError("solver died")), "osqp raised RuntimeError"),
    "out of memory": ("solve", raising(MemoryError()), "osqp raised MemoryError"),
    "update fails": ("update", raising(ValueError("bad data")), "osqp raised ValueError"),
    "warm start fails": ("warm_start", raising(ValueError("bad data")), "osqp raised ValueError"),
    "setup fails": ("setup", raising(TypeError("unknown option")), "osqp raised TypeError"),
    "too short": ("solve", answer(np.zeros(5)), ""),
    "too long": ("solve", answer(np.zeros(12)), ""),
}


@pytest.mark.filterwarnings(OSQP_WARNING)
@pytest.mark.parametrize("rows", [1, 3])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_failing_solver_is_never_trusted(monkeypatch, fault, rows):
    """T14: whatever OSQP does, the answer keeps the rows, and the note says what happened."""
    rng = np.random.default_rng(13)
    lower, upper = -JERK, JERK
    nominal = rng.uniform(lower, upper)
    L = 1e-3 * rng.normal(size=(rows, 6))
    S = np.abs(L) @ upper * 0.3 / rows
    assert ref.project_reference(nominal, L, S, lower, upper, np.eye(6)) is not None
    projector = OSQPProjector(6)
    method, broken, note = FAULTS[fault]
    with monkeypatch.context() as patch:
        patch.setattr(osqp.OSQP, method, broken)
        found = projector.project(nominal, HalfSpaces(L, S), lower, upper)
    assert np.all((lower <= found.jerk) & (found.jerk <= upper))
    assert np.all(S - L @ found.jerk <= 1e-12)
    assert found.feasible
    assert found.violation <= 1e-12
    assert note in found.note
    assert "repaired" in found.note
    exact = ExactProjector(6).project(nominal, HalfSpaces(L, S), lower, upper)
    np.testing.assert_array_equal(found.jerk, exact.jerk)
    # the next tick finds a working solver again
    after = projector.project(nominal, HalfSpaces(L, S), lower, upper)
    assert after.note == ""
    np.testing.assert_allclose(after.jerk, exact.jerk, rtol=0, atol=1e-2)


@pytest.mark.filterwarnings(OSQP_WARNING)
def test_what_osqp_may_answer_is_near_the_nearest(monkeypatch):
    """However far the answer is moved into the feasible set: what passes without a note is as near as promised."""
    rng = np.random.default_rng(15)
    root = rng.normal(size=(6, 6))
    weight = root @ root.T + np.eye(6)
    projector, exact, passed = OSQPProjector(6, weight), ExactProjector(6, weight), []
    moved = np.zeros(6)

    def towards(self, *arguments, **options):
        found = SOLVE(self, *arguments, **options)
        return SimpleNamespace(x=(1.0 - share) * found.x + share * moved, y=found.y)

    monkeypatch.setattr(osqp.OSQP, "solve", towards)
    for _ in range(25):
        lower, upper = box(rng, 6)
        L, S = feasible_rows(rng, lower, upper, int(rng.integers(1, 12)))
        rows, unit = HalfSpaces(L, S), np.max(np.abs([lower, upper]))
        nominal, other = (1.3 * rng.uniform(lower, upper) for _ in range(2))
        nearest = exact.project(nominal, rows, lower, upper).jerk
        moved = exact.project(other, rows, lower, upper).jerk / unit
        for share in (0.0, 1e-6, 1e-4, 1e-2, 1.0):
            found = projector.project(nominal, rows, lower, upper)
            if not found.note:
                off = (found.jerk - nearest) / unit
                assert np.sqrt(off @ weight @ off / (np.trace(weight) / 6)) <= projector.nearness
                passed.append(share)
    assert min(passed.count(share) for share in (0.0, 1e-6)) >= 10
    assert passed.count(1.0) <= 2  # the nominal's and the other's nearest can be one corner


def test_a_failing_solver_and_conflicting_rows(monkeypatch):
    """A fault while no jerk keeps all rows: the least violation, declared infeasible."""
    row = np.full((1, 6), 1e-3)
    rows = HalfSpaces(np.vstack([row, -row]), np.array([0.05, 0.03]))
    monkeypatch.setattr(osqp.OSQP, "solve", answer(np.zeros(6)))
    found = OSQPProjector(6).project(np.zeros(6), rows, -JERK, JERK)
    assert not found.feasible
    assert found.violation == pytest.approx(0.04, rel=1e-6)
    assert "repaired" in found.note


def test_osqp_runs_without_a_warning():
    """A solver that warns at every tick is, with warnings as errors, never used at all."""
    rows = HalfSpaces(np.full((1, 6), 1e-3), np.array([0.1]))
    assert OSQPProjector(6).project(np.zeros(6), rows, -JERK, JERK).note == ""


@pytest.mark.filterwarnings(OSQP_WARNING)
def test_osqp_itself_does_the_work():
    """On sound problems of the shield's size the supervised solver is right; repair is the exception."""
    rng = np.random.default_rng(14)
    projector, repaired = OSQPProjector(6), 0
    for _ in range(100):
        lower, upper = box(rng, 6)
        nominal = 1.3 * rng.uniform(lower, upper)
        L, S = feasible_rows(rng, lower, upper, int(rng.integers(1, 12)))
        found = projector.project(nominal, HalfSpaces(L, S), lower, upper)
        assert np.all((lower <= found.jerk) & (found.jerk <= upper))
        assert found.feasible
        assert found.violation <= 1e-9
        repaired += found.note != ""
        if not found.note:
            expected = ref.project_reference(nominal, L, S, lower, upper, np.eye(6))
            np.testing.assert_allclose(found.jerk, expected, rtol=0, atol=0.1)
    assert repaired <= 50
