"""Plans: limits at and between the ticks, end conditions, optimality, the shortest period."""

import itertools

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse
from plans import DT, assert_kept, one_joint, played, rest

from jssa_gym.control import plan_move, plan_waypoints
from jssa_gym.control.least_jerk import corrected, equalities, required
from jssa_gym.exceptions import InfeasibleError, ParameterError
from jssa_gym.types import JointState

ZERO = np.zeros(6)


def random_task(rng, limits, count, spread=0.15):
    """A posture and waypoints that wander from it; now and then on the very end of a joint's range."""
    low, high = limits.position.T
    edge = 0.0 if rng.random() < 0.2 else 0.01
    low, high = low + edge * (high - low), high - edge * (high - low)
    start = rng.uniform(low, high)
    steps = spread * (high - low) * rng.uniform(-1.0, 1.0, (count, len(low)))
    return start, np.clip(start + np.cumsum(steps, axis=0), low, high)


@pytest.mark.long
def test_random_waypoints_within_all_limits(robot, request):
    run_random_waypoints(robot.limits, 250)


@pytest.mark.slow
def test_many_random_waypoints_within_all_limits(robot):
    run_random_waypoints(robot.limits, 10_000)


def run_random_waypoints(limits, count):
    rng = np.random.default_rng(7)
    planned = refused = in_motion = bound = 0
    for _ in range(count):
        K = int(rng.integers(1, 6))
        start, waypoints = random_task(rng, limits, K)
        state = rest(start)
        if rng.random() < 0.3:  # somewhere on another move
            move = plan_move(start, random_task(rng, limits, 1)[1][0], limits, DT)
            if len(move):
                state = JointState(*move.states[rng.integers(len(move))])
                in_motion += 1
        legs = [state.position, *waypoints]
        slowest = max(len(plan_move(a, b, limits, DT)) for a, b in itertools.pairwise(legs))
        each = max(4, round(slowest * rng.uniform(0.6, 1.5)))
        try:
            plan = plan_waypoints(state, waypoints, each * DT, limits, DT, shortest=False)
        except InfeasibleError:
            refused += 1
            continue
        assert_kept(plan, state, waypoints, limits, each)
        planned += 1
        used = np.abs(plan.states).max(axis=0)
        bound += bool(
            np.any(np.abs(plan.jerk).max(axis=0) > 0.999 * limits.jerk)
            or np.any(used[1] > 0.999 * limits.velocity)
            or np.any(used[2] > 0.999 * limits.acceleration)
        )
    # not vacuous: many were made, many at a limit, many from motion, some refused
    assert planned > 0.5 * count
    assert min(bound, in_motion) > 0.1 * count
    assert refused > 0


def unit_responses(H, marks):
    """Position at marks, end speed, end acceleration of a unit jerk in each tick: by simulation, in ticks."""
    A = np.zeros((len(marks) + 2, H))
    for i in range(H):
        q = v = a = 0.0
        for k in range(H):
            u = float(k == i)
            q, v, a = q + v + a / 2 + u / 6, v + a + u / 2, a + u
            for row, mark in enumerate(marks):
                if mark == k + 1:
                    A[row, i] = q
        A[-2, i], A[-1, i] = v, a
    return A


@pytest.mark.parametrize("ticks", [(9,), (12, 12), (20, 20, 20, 20), (30, 30)])
def test_the_least_norm_solution_is_lstsqs(ticks):
    rng = np.random.default_rng(1)
    marks = np.cumsum(ticks)
    H = int(marks[-1])
    A = unit_responses(H, marks)
    state, waypoints = rng.normal(size=(3, 2)), rng.normal(size=(len(ticks), 2))
    state[2] *= 0.1
    q, v, a = state
    goal = np.vstack([[p - (q + m * v + m**2 / 2 * a) for p, m in zip(waypoints, marks, strict=True)]])
    right = np.vstack([goal, -(v + H * a), -a])
    expected, *_ = np.linalg.lstsq(A, right, rcond=None)
    equal = equalities(ticks)
    np.testing.assert_allclose(equal.matrix, A, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(required(equal, state, waypoints), right, atol=1e-9)
    jerk = corrected(equal, right, np.zeros((H, 2)))
    np.testing.assert_allclose(jerk, expected, atol=1e-8 * np.abs(expected).max())


def test_with_room_the_plan_is_the_least_norm_solution(robot):
    start = np.array(robot.home)
    waypoints = start + np.array([[0.2, 0.1, -0.1, 0.3, 0.2, 0.5], [0.0, 0.2, 0.1, 0.1, -0.2, 0.0]])
    plan = plan_waypoints(rest(start), waypoints, 1.2, robot.limits, DT)
    A = unit_responses(300, (150, 300))
    right = np.vstack([waypoints - start, np.zeros((2, 6))])
    expected = np.linalg.lstsq(A, right, rcond=None)[0] / DT**3
    np.testing.assert_allclose(plan.jerk, expected, atol=1e-7 * np.abs(expected).max())
    # rest to rest in T: peak jerk 60 Δ/T³, acceleration 5.774 Δ/T², speed 1.875 Δ/T
    move = plan_waypoints(rest(start), waypoints[:1], 2.0, robot.limits, DT)
    way = np.abs(waypoints[0] - start)
    np.testing.assert_allclose(np.abs(move.jerk).max(axis=0), 60 * way / 8.0, rtol=0.02)
    np.testing.assert_allclose(np.abs(move.states[:, 2]).max(axis=0), 5.774 * way / 4.0, rtol=0.02)
    np.testing.assert_allclose(np.abs(move.states[:, 1]).max(axis=0), 1.875 * way / 2.0, rtol=0.02)


def full_problem(limits, j, state, waypoints, each):
    """One joint's programme with every equality and limit as a row, in shares of the jerk limit: A, r, G, h."""
    J = limits.jerk[j] * DT**3
    marks = each * np.arange(1, len(waypoints) + 1)
    H = int(marks[-1])
    zero = played([[0.0]] * 3, np.zeros((H, 1)))[:, :, 0]
    columns = [played([[0.0]] * 3, np.eye(H)[:, [i]] / DT**3 * J)[:, :, 0] - zero for i in range(H)]
    response = np.stack(columns, axis=-1)  # (H + 1, 3, H)
    free = played([[x[j]] for x in state], np.zeros((H, 1)))[:, :, 0]
    A = np.vstack([response[marks, 0], response[-1:, 1] * DT, response[-1:, 2] * DT**2])
    r = np.concatenate([waypoints[:, j] - free[marks, 0], -free[-1:, 1] * DT, -free[-1:, 2] * DT**2])
    G, h = [np.eye(H), -np.eye(H)], [np.ones(H), np.ones(H)]
    for kind, (low, high) in enumerate(
        [
            limits.position[j],
            (-limits.velocity[j], limits.velocity[j]),
            (-limits.acceleration[j], limits.acceleration[j]),
        ]
    ):
        inner = response[1:-1, kind]
        G += [inner / high, -inner / high]
        h += [(high - free[1:-1, kind]) / high, (free[1:-1, kind] - low) / high]
    return A, r, np.vstack(G), np.concatenate(h), J


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(6))
def test_the_programme_is_solved_to_the_optimum(robot, seed):
    osqp = pytest.importorskip("osqp")
    rng, limits = np.random.default_rng(seed), robot.limits
    each, j = 22, seed % 6
    start, waypoints = random_task(rng, limits, 2, spread=0.02)
    plan = plan_waypoints(rest(start), waypoints, 0.04, limits, DT, stretch=True)
    each = plan.marks[0]
    A, r, G, h, J = full_problem(limits, j, rest(start), waypoints, each)
    solver = osqp.OSQP()
    H = A.shape[1]
    # rows of unit length, as OSQP likes them
    rows = np.vstack([A, G])
    length = np.linalg.norm(rows, axis=1)
    solver.setup(
        scipy.sparse.eye(H, format="csc"),
        np.zeros(H),
        scipy.sparse.csc_matrix(rows / length[:, None]),
        np.concatenate([r, np.full(len(h), -np.inf)]) / length,
        np.concatenate([r, h]) / length,
        verbose=False,
        eps_abs=1e-10,
        eps_rel=1e-10,
        max_iter=200_000,
        polishing=True,
    )
    answer = solver.solve(raise_error=False)
    ours = plan.jerk[:, j] * DT**3 / J
    assert np.abs(A @ ours - r).max() <= 1e-9
    assert (G @ ours - h).max() <= 1e-8
    least = float(answer.x @ answer.x)
    assert float(ours @ ours) == pytest.approx(least, rel=1e-4)
    free = np.linalg.lstsq(A, r, rcond=None)[0]
    assert float(ours @ ours) >= float(free @ free) * (1 - 1e-9)


@pytest.mark.long
def test_optimality_by_its_conditions(robot):
    """The gradient of the squared jerk is a combination of equalities and, with the right sign, of active limits."""
    rng, limits, bound = np.random.default_rng(3), robot.limits, 0
    for _ in range(4):
        start, waypoints = random_task(rng, limits, 2, spread=0.03)
        plan = plan_waypoints(rest(start), waypoints, 0.04, limits, DT, stretch=True)
        each = plan.marks[0] + 2
        plan = plan_waypoints(rest(start), waypoints, each * DT, limits, DT)
        for j in range(6):
            A, _, G, h, J = full_problem(limits, j, rest(start), waypoints, each)
            u = plan.jerk[:, j] * DT**3 / J
            active = G[h - G @ u < 1e-5]
            bound += len(active) > 0
            normals = np.vstack([A, -A, active])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            _, left = scipy.optimize.nnls(-normals.T, u, maxiter=20 * len(normals))
            assert left <= 2e-3 * max(np.linalg.norm(u), 1e-3)
    assert bound >= 4


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(5))
def test_a_period_that_is_too_short_is_refused_with_the_shortest(robot, seed):
    rng, limits = np.random.default_rng(seed), robot.limits
    start, waypoints = random_task(rng, limits, int(rng.integers(1, 6)))
    with pytest.raises(InfeasibleError, match="shortest") as caught:
        plan_waypoints(rest(start), waypoints, 0.08, limits, DT)
    shortest = caught.value.shortest
    assert shortest is not None
    plan = plan_waypoints(rest(start), waypoints, shortest, limits, DT)
    assert_kept(plan, rest(start), waypoints, limits, round(shortest / DT))
    with pytest.raises(InfeasibleError) as again:
        plan_waypoints(rest(start), waypoints, shortest - DT, limits, DT)
    assert again.value.shortest == pytest.approx(shortest)
    stretched = plan_waypoints(rest(start), waypoints, 0.08, limits, DT, stretch=True)
    assert stretched.duration == pytest.approx(shortest * len(waypoints))


@pytest.mark.long
def test_a_tick_less_than_the_shortest_period_is_infeasible_for_a_linear_programme_too(robot):
    rng = np.random.default_rng(5)
    for j in range(6):
        limits = one_joint(robot.limits, j)
        start, waypoints = random_task(rng, robot.limits, 2, spread=0.04)
        start, waypoints = start[[j]], waypoints[:, [j]]
        each = plan_waypoints(rest(start), waypoints, 0.04, limits, DT, stretch=True).marks[0]
        for ticks, feasible in ((each, True), (each - 1, False)):
            A, r, G, h, _ = full_problem(limits, 0, rest(start), waypoints, ticks)
            found = scipy.optimize.linprog(
                np.zeros(A.shape[1]), A_ub=G, b_ub=h + 1e-9, A_eq=A, b_eq=r, bounds=(None, None), method="highs"
            )
            assert found.success == feasible


@pytest.mark.long
def test_a_longer_period_is_never_refused(robot):
    rng, limits = np.random.default_rng(11), robot.limits
    for _ in range(6):
        start, waypoints = random_task(rng, limits, 4)
        each = plan_waypoints(rest(start), waypoints, 0.04, limits, DT, stretch=True).marks[0]
        for longer in (1, 2, 7, 30, 200):
            plan = plan_waypoints(rest(start), waypoints, (each + longer) * DT, limits, DT, shortest=False)
            assert_kept(plan, rest(start), waypoints, limits, each + longer)


def test_a_start_too_fast_to_be_stopped_has_no_period(robot):
    limits = robot.limits
    fast = JointState(np.array(robot.home), 0.999 * limits.velocity, 0.9 * limits.acceleration)
    with pytest.raises(InfeasibleError, match="too fast") as caught:
        plan_waypoints(fast, [robot.home], 1.0, limits, DT)
    assert caught.value.shortest is None
    near_the_end = np.array(robot.home)
    near_the_end[1] = limits.position[1, 1] - 0.01
    moving = JointState(near_the_end, np.eye(6)[1] * 2.0, ZERO)
    with pytest.raises(InfeasibleError, match="too fast"):
        plan_waypoints(moving, [robot.home], 1.0, limits, DT)


def test_no_way_at_all_needs_no_jerk(robot):
    plan = plan_waypoints(rest(robot.home), [robot.home, robot.home], 0.4, robot.limits, DT)
    np.testing.assert_array_equal(plan.jerk, 0.0)
    assert len(plan) == 100


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"waypoints": [0.0] * 6}, "shape"),
        ({"waypoints": np.zeros((0, 6))}, "shape"),
        ({"waypoints": np.zeros((2, 5))}, "shape"),
        ({"waypoints": [[np.nan] * 6]}, "finite"),
        ({"waypoints": [[9.0] + [0.0] * 5]}, "joint 0"),
        ({"period": 0.5001}, "nearest: 0.504|nearest: 0.496|nearest: 0.5"),
        ({"period": 0.008}, "at least 4"),
        ({"period": -1.0}, "positive"),
        ({"period": np.nan}, "positive"),
        ({"dt": 0.0}, "positive"),
        ({"state": JointState(ZERO, ZERO, np.full(6, np.inf))}, "acceleration"),
        ({"state": JointState(ZERO[:5], ZERO, ZERO)}, "position"),
    ],
)
def test_bad_arguments_are_refused(robot, changes, message):
    arguments = {"state": rest(ZERO), "waypoints": [[0.1] * 6], "period": 0.8, "limits": robot.limits, "dt": DT}
    with pytest.raises(ParameterError, match=message):
        plan_waypoints(**(arguments | changes))


def test_a_plan_cannot_be_changed(robot):
    plan = plan_move(robot.home, np.array(robot.home) + 0.1, robot.limits, DT)
    with pytest.raises(ValueError, match="read-only"):
        plan.jerk[0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        plan.states[0] = 0.0


@pytest.mark.parametrize(
    "spoil", [lambda jerk: jerk * (1.0 + 1e-4), lambda jerk: jerk + 1e-3, lambda jerk: jerk * np.nan]
)
def test_what_the_solver_gives_is_not_believed(robot, monkeypatch, spoil):
    """A plan that misses its waypoint, or rest, is none, whoever made it."""
    state, goal = rest(robot.home), [np.array(robot.home) + 0.2]
    plan_waypoints(state, goal, 1.6, robot.limits, DT, shortest=False)
    monkeypatch.setattr("jssa_gym.control.plan.corrected", lambda *problem: spoil(corrected(*problem)))
    with pytest.raises(InfeasibleError):
        plan_waypoints(state, goal, 1.6, robot.limits, DT, shortest=False)
