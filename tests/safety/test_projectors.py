"""What every projector keeps to, and that no solver's word is taken for it."""

from types import SimpleNamespace

import numpy as np
import osqp
import pytest
import reference as ref
from projections import box, feasible_rows, kkt_residual, positive_definite

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.projectors import PROJECTORS, ExactProjector, OSQPProjector
from jssa_gym.types import HalfSpaces

JERK = lr_mate_200id_7l().limits.jerk

OSQP_WARNING = "ignore:The default value of raise_error:PendingDeprecationWarning"


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


@pytest.mark.parametrize("name", PROJECTORS)
def test_a_single_joint_with_many_rows(name):
    """The smallest arm there is: the nearest point of an interval."""
    rows = HalfSpaces(np.array([[1.0], [-1.0], [0.5]]), np.array([0.7, -0.9, 0.1]))
    for nominal, expected in ((0.5, 0.7), (0.8, 0.8), (2.0, 0.9)):
        found = PROJECTORS[name](1).project(np.array([nominal]), rows, -np.ones(1), np.ones(1))
        assert found.feasible
        assert found.jerk[0] == pytest.approx(expected, abs=1e-6)
