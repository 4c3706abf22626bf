"""Moves from rest to rest and from motion, stops, and inverse kinematics."""

import dataclasses
import tracemalloc

import mujoco
import numpy as np
import pytest
import scipy.optimize
import scipy.sparse
from plans import DT, assert_kept, one_joint, played, rest

from jssa_gym.control import Plan, moves, plan_approach, plan_brake, plan_move, plan_waypoints
from jssa_gym.control.inverse import descend, postures_for, way_is_clear
from jssa_gym.control.moves import brake_jerk, fewest_ticks
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import InfeasibleError, ParameterError, UnreachableError
from jssa_gym.safety.postures import clearances, farther_than_stretched, tool_point
from jssa_gym.types import JointState, Planes

TABLE = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.87]), ("table",))


def reachable(limits, distance, ticks):
    """Whether a linear programme with a free jerk in every tick makes the move from rest to rest of one joint."""
    V, A, J = limits
    unit = J * DT**3
    zero = played([[0.0]] * 3, np.zeros((ticks, 1)))
    columns = [played([[0.0]] * 3, np.eye(ticks)[:, [i]] * J)[:, :, 0] - zero[:, :, 0] for i in range(ticks)]
    R = np.stack(columns, axis=-1) / unit
    rows = [R[-1, 0], R[-1, 1] * DT, R[-1, 2] * DT**2]
    G = np.vstack([R[1:, 1], -R[1:, 1], R[1:, 2], -R[1:, 2]])
    h = np.concatenate([np.full(2 * ticks, V / unit), np.full(2 * ticks, A / unit)])
    scale = np.abs(G).max(axis=1)
    found = scipy.optimize.linprog(
        np.zeros(ticks),
        A_ub=G / scale[:, None],
        b_ub=h / scale,
        A_eq=np.array(rows),
        b_eq=[distance / unit, 0.0, 0.0],
        bounds=(-1.0, 1.0),
        method="highs",
    )
    return found.success


@pytest.mark.sampled(2)
@pytest.mark.parametrize("distance", [1e-5, 1e-3, 0.02, 0.1, 0.4, 1.0])
def test_no_move_on_the_grid_is_much_shorter(robot, distance):
    limits = robot.limits
    for j in (0, 5):
        V, A, J = limits.velocity[j], limits.acceleration[j], limits.jerk[j]
        n_j, n_a, n_v = fewest_ticks(distance, V, A, J, DT)
        ticks = 4 * n_j + 2 * n_a + n_v
        assert reachable((V, A, J), distance, ticks)
        # four ticks are the shape's shortest; else it loses two to a linear programme with every jerk free at most
        assert ticks <= 4 or not reachable((V, A, J), distance, ticks - 3)


@pytest.mark.long
def test_moves_keep_all_limits_and_end_together(robot):
    rng, limits = np.random.default_rng(0), robot.limits
    low, high = limits.position.T
    straight = at_limit = 0
    for k in range(300):
        start, goal = rng.uniform(low, high), rng.uniform(low, high)
        if k % 3 == 0:
            goal = np.clip(start + rng.uniform(-1, 1, 6) * 10 ** rng.uniform(-7, 0), low, high)
        if k % 10 == 0:
            start, goal = np.where(rng.random(6) < 0.5, low, high), np.where(rng.random(6) < 0.5, low, high)
        plan = plan_move(start, goal, limits, DT)
        if len(plan) == 0:
            np.testing.assert_allclose(start, goal, atol=1e-12)
            continue
        assert_kept(plan, rest(start), goal[None], limits, len(plan))
        assert np.abs(plan.states[-1, 0] - goal).max() <= 1e-9
        way = goal - start
        share = (plan.states[:, 0] - start) @ way / (way @ way)
        straight += bool(np.abs(plan.states[:, 0] - start - share[:, None] * way).max() < 1e-9)
        fastest = np.abs(plan.states).max(axis=0)
        # the slowest joint is at one of its limits, or as near as whole ticks let it come
        at_limit += bool(
            max(
                np.max(fastest[1] / limits.velocity),
                np.max(fastest[2] / limits.acceleration),
                np.max(np.abs(plan.jerk) / limits.jerk),
            )
            > 0.9
        )
    assert straight > 100
    assert at_limit > 230  # very short moves take four ticks whatever the limits


def test_no_way_takes_no_ticks(robot):
    plan = plan_move(robot.home, robot.home, robot.limits, DT)
    assert len(plan) == 0
    assert plan.duration == 0.0
    np.testing.assert_array_equal(plan.states[-1, 0], robot.home)


def test_a_goal_outside_the_range_is_refused(robot):
    with pytest.raises(InfeasibleError, match="position limits"):
        plan_move(robot.home, np.array(robot.home) + 10.0, robot.limits, DT)
    with pytest.raises(InfeasibleError, match="position limits"):
        plan_move(np.array(robot.home) + 10.0, robot.home, robot.limits, DT)
    with pytest.raises(ParameterError, match="goal"):
        plan_move(robot.home, [0.0] * 5, robot.limits, DT)


def test_an_arm_that_was_thrown_far_away_gets_no_plan_at_once(robot):
    """A plan for it would be as long as the way: terabytes."""
    far = np.array(robot.home) + 1e5
    with pytest.raises(InfeasibleError, match="position limits"):
        plan_move(far, robot.home, robot.limits, DT)
    rest = np.zeros(robot.n)
    for speed in (0.0, 300.0):
        with pytest.raises(InfeasibleError, match="position limits"):
            plan_approach(JointState(far, rest + speed, rest), robot.home, robot.limits, DT)
    with pytest.raises(ParameterError, match="goal"):
        plan_approach(JointState(np.array(robot.home), rest + 0.1, rest), [0.0] * 5, robot.limits, DT)


def test_an_approach_may_begin_in_motion(robot):
    rng, limits = np.random.default_rng(2), robot.limits
    low, high = 0.9 * limits.position.T
    for _ in range(12):
        start, goal = rng.uniform(low, high), rng.uniform(low, high)
        move = plan_move(start, goal, limits, DT)
        tick = int(rng.integers(1, len(move)))
        state = JointState(*move.states[tick])
        new = np.clip(goal + rng.uniform(-0.2, 0.2, 6), low, high)
        plan = plan_approach(state, new, limits, DT)
        assert_kept(plan, state, new[None], limits, len(plan))


def test_an_approach_from_any_state_that_can_be_stopped(robot):
    """A stop and a move are its last resort: it neither gives up nor takes longer than these."""
    rng, limits = np.random.default_rng(1), robot.limits
    low, high = limits.position.T
    stopped = refused = 0
    for _ in range(25):
        rates = rng.uniform(-1.0, 1.0, (2, 6)) * rng.uniform(0.0, 0.7)
        state = JointState(rng.uniform(low, high), rates[0] * limits.velocity, rates[1] * limits.acceleration)
        goal, brake = rng.uniform(low, high), plan_brake(state, limits, DT)
        if brake.keeps(limits):
            plan = plan_approach(state, goal, limits, DT)
            assert plan.keeps(limits)
            assert plan.marks == (len(plan),)
            assert len(plan) <= len(brake) + len(plan_move(brake.states[-1, 0], goal, limits, DT))
            np.testing.assert_allclose(plan.states[-1], [goal, np.zeros(6), np.zeros(6)], atol=1e-6)
            stopped += 1
        elif np.any(np.abs(brake.states[-1, 0] - (low + high) / 2.0) > 0.51 * (high - low)):
            with pytest.raises(InfeasibleError, match="keeps the limits"):
                plan_approach(state, goal, limits, DT)
            refused += 1
    assert stopped > 3
    assert refused > 3


def test_an_approach_that_no_programme_makes_is_a_stop_and_a_move(robot, monkeypatch):
    def fails(*args, **options):
        raise InfeasibleError("none")

    monkeypatch.setattr(moves, "plan_waypoints", fails)
    rest = np.zeros(6)
    state = JointState(np.array(robot.home), 0.3 * robot.limits.velocity, rest)
    plan = plan_approach(state, robot.home, robot.limits, DT)
    assert plan.keeps(robot.limits)
    np.testing.assert_allclose(plan.states[-1], [robot.home, rest, rest], atol=1e-6)
    assert plan.marks == (len(plan),)


def test_plans_can_be_put_one_after_the_other(robot):
    one = plan_move(robot.home, np.array(robot.home) + 0.2, robot.limits, DT)
    two = plan_move(np.array(robot.home) + 0.2, robot.home, robot.limits, DT)
    both = one.then(two)
    assert both.marks == (len(one), len(one) + len(two))
    np.testing.assert_allclose(both.states[list(both.marks), 0], [np.array(robot.home) + 0.2, robot.home], atol=1e-9)
    assert both.keeps(robot.limits)


def test_a_brake_is_a_stop_within_the_limits(robot):
    limits = robot.limits
    state = JointState(np.array(robot.home), 0.5 * limits.velocity, -0.3 * limits.acceleration)
    plan = plan_brake(state, limits, DT)
    assert plan.keeps(limits)
    states = played(state, plan.jerk)
    assert np.abs(states[-1, 1:]).max() < 1e-9
    assert len(plan_brake(rest(robot.home), limits, DT)) == 0


def test_the_tip_is_mujocos(robot):
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(10):
        data.qpos[:] = rng.uniform(*robot.limits.position.T)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(tool_point(robot, data.qpos), data.site("tcp").xpos + robot.mount, atol=1e-9)


def test_every_reachable_point_is_reached_clear_of_table_and_arm(robot):
    env, rng = ArmEnv("reach", human="none"), np.random.default_rng(0)
    low, high = robot.limits.position.T
    for seed in range(40):
        env.reset(seed=seed)
        postures = postures_for(robot, env.goal, TABLE, np.array(robot.home), rng)
        times = [np.max(np.abs(p - robot.home) / robot.limits.velocity) for p in postures]
        assert times == sorted(times)
        for posture in postures:
            assert np.linalg.norm(tool_point(robot, posture) - env.goal) <= 1e-5
            assert np.all((low <= posture) & (posture <= high))
            assert min(clearances(robot, posture, TABLE)) >= 0.01


def test_a_seed_fixes_the_postures(robot):
    one, two = (
        postures_for(robot, [0.5, 0.2, 1.3], TABLE, np.array(robot.home), np.random.default_rng(4)) for _ in range(2)
    )
    np.testing.assert_array_equal(one, two)


def test_many_descents_at_once_are_those_of_each_seed(robot):
    rng, home, (low, high) = np.random.default_rng(0), np.array(robot.home), robot.limits.position.T
    ended = []
    for point in ([0.5, 0.2, 1.3], [0.3, -0.3, 1.1], [0.9, 0.1, 1.6]):  # the last one is hardly reached
        seeds = np.concatenate([[home], rng.uniform(low, high, (8, robot.n))])
        together = descend(robot, np.array(point), seeds, home, 1e-3)
        for seed, one in zip(seeds, together, strict=True):
            (alone,) = descend(robot, np.array(point), seed[None], home, 1e-3)
            np.testing.assert_array_equal(np.array(one, float), np.array(alone, float))
            ended.append(one is not None)
    assert 0 < sum(ended) < len(ended)


@pytest.mark.parametrize("point", [[2.0, 0.0, 1.2], [0.5, 0.0, 0.80], [0.0, 0.0, 1.0]])
def test_what_cannot_be_reached_is_said_to_be(robot, point):
    with pytest.raises(UnreachableError, match="no posture"):
        postures_for(robot, point, TABLE, np.array(robot.home), np.random.default_rng(0))


def test_no_posture_reaches_farther_than_the_stretched_arm(robot):
    """The bound that spares a search is above what any posture reaches, and not far above."""
    rng, (low, high) = np.random.default_rng(0), robot.limits.position.T
    tips = np.array([tool_point(robot, rng.uniform(low, high)) for _ in range(3000)])
    assert not any(farther_than_stretched(robot, tip) for tip in tips)
    shoulder = robot.links["offset"][0]
    beyond = shoulder + 1.35 * (tips - shoulder)
    assert farther_than_stretched(robot, beyond[np.argmax(np.linalg.norm(tips - shoulder, axis=1))])


def test_the_first_jerk_of_a_brake_is_the_brake_s_first(robot):
    rng, limits = np.random.default_rng(1), robot.limits
    for _ in range(200):
        state = JointState(
            rng.uniform(*limits.position.T), *(rng.uniform(-x, x) for x in (limits.velocity, limits.acceleration))
        )
        np.testing.assert_array_equal(brake_jerk(state, limits, DT), plan_brake(state, limits, DT).jerk[0])
    rest = np.zeros(robot.n)
    np.testing.assert_array_equal(brake_jerk(JointState(np.array(robot.home), rest, rest), limits, DT), rest)


def test_a_point_is_three_numbers(robot):
    with pytest.raises(ParameterError, match="point"):
        postures_for(robot, [0.5, 0.2], TABLE, np.array(robot.home), np.random.default_rng(0))


def test_a_way_through_a_wall_is_seen(robot):
    wall = Planes(np.array([[0.0, 1.0, 0.0]]), np.array([-0.35]), ("wall",))
    home = np.array(robot.home)
    left, right = home.copy(), home.copy()
    left[0], right[0] = 2.9, -2.9
    for posture in (home, left, right):
        assert min(clearances(robot, posture, wall)) > 0.02
    assert way_is_clear(robot, home, left, wall, 0.01)
    assert not way_is_clear(robot, home, right, wall, 0.01)


@pytest.mark.long
def test_a_way_is_as_clear_as_it_looks(robot):
    rng = np.random.default_rng(1)
    low, high = robot.limits.position.T
    blocked = 0
    for _ in range(40):
        one = np.array(robot.home)
        two = rng.uniform(low, high)
        least = min(min(clearances(robot, one + s * (two - one), TABLE)) for s in np.linspace(0.0, 1.0, 400))
        clear = way_is_clear(robot, one, two, TABLE, 0.01)
        assert clear == (least >= 0.01) or abs(least - 0.01) < 0.01
        blocked += not clear
    assert 5 <= blocked <= 35


def test_one_joint_alone_gets_there_sooner_or_as_soon(robot):
    rng, limits = np.random.default_rng(9), robot.limits
    for _ in range(10):
        start, goal = rng.uniform(*limits.position.T), rng.uniform(*limits.position.T)
        together = len(plan_move(start, goal, limits, DT))
        alone = [len(plan_move(start[[j]], goal[[j]], one_joint(limits, j), DT)) for j in range(6)]
        assert together == max(alone)


# ---- what no plan can be made of ---------------------------------------------------------------------------


UNUSABLE = [np.nan, np.inf, -np.inf]


@pytest.mark.parametrize("part", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("value", UNUSABLE)
def test_states_that_are_no_numbers_are_refused(robot, part, value):
    """Not planned from: a stop without ticks would look like one that keeps every limit."""
    limits, numbers = robot.limits, np.zeros(robot.n)
    numbers[2] = value
    state = rest(robot.home)._replace(**{part: numbers})
    with pytest.raises(ParameterError, match=f"{part} has to be a joint state, finite"):
        plan_brake(state, limits, DT)
    with pytest.raises(ParameterError, match=f"{part} has to be a joint state, finite"):
        plan_approach(state, robot.home, limits, DT)
    with pytest.raises(ParameterError, match="finite"):
        plan_move(state.position if part == "position" else numbers, robot.home, limits, DT)


@pytest.mark.parametrize("dt", [0.0, -0.008, *UNUSABLE, True, None])
def test_ticks_that_are_no_times_are_refused(robot, dt):
    limits, moving = robot.limits, rest(robot.home)._replace(velocity=0.1 * np.ones(robot.n))
    for plan in (
        lambda: plan_brake(moving, limits, dt),
        lambda: plan_approach(moving, robot.home + 0.1, limits, dt),
        lambda: plan_approach(rest(robot.home), robot.home + 0.1, limits, dt),
        lambda: plan_move(robot.home, robot.home, limits, dt),
        lambda: plan_move(robot.home, robot.home + 0.1, limits, dt),
        lambda: fewest_ticks(0.1, 1.0, 1.0, 1.0, dt),
    ):
        with pytest.raises(ParameterError, match="dt has to be a positive number"):
            plan()


@pytest.mark.parametrize("speed", [1e7, 1e10, 1e300, 1e307])
def test_what_would_take_for_ever_is_refused(robot, speed):
    limits, fast = robot.limits, rest(robot.home)._replace(velocity=np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ParameterError, match="more than 2097152"):
        plan_brake(fast, limits, DT)
    with pytest.raises(ParameterError, match="more than 2097152"):
        plan_move(robot.home, robot.home + 0.1, limits, DT / speed)
    with pytest.raises(ParameterError, match="more than 2097152"):
        plan_waypoints(rest(robot.home), [robot.home + 0.1], speed, limits, DT)


def test_an_empty_plan_keeps_what_its_state_keeps(robot):
    limits, stays = robot.limits, np.zeros((0, robot.n))
    for state, kept in (
        ([robot.home, 0.9 * limits.velocity, 0.9 * limits.acceleration], True),
        ([robot.home, 1.1 * limits.velocity, 0.0 * limits.acceleration], False),
        ([robot.home, 0.0 * limits.velocity, -1.1 * limits.acceleration], False),
        ([limits.position[:, 1] + 0.1, 0.0 * limits.velocity, 0.0 * limits.acceleration], False),
        ([robot.home, np.nan * limits.velocity, 0.0 * limits.acceleration], False),
    ):
        assert Plan.follow(np.array(state), stays, DT, (0,)).keeps(limits) == kept


def test_plans_of_other_ticks_or_arms_are_not_joined(robot):
    plan = plan_move(robot.home, robot.home + 0.1, robot.limits, DT)
    with pytest.raises(ParameterError, match="another tick"):
        plan.then(plan_move(robot.home + 0.1, robot.home, robot.limits, DT / 2.0))


def test_a_slow_move_takes_memory_for_its_ticks_alone(robot):
    """0.3 % of the speed at 1 kHz took 2.5 GiB, at 0.1 % it ended for want of memory."""
    limits = robot.limits
    slow = dataclasses.replace(limits, velocity=0.02 * limits.velocity, acceleration=0.02 * limits.acceleration)
    tracemalloc.start()
    plan = plan_move(robot.home, robot.home + 1.0, slow, 0.001)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(plan) > 8000
    assert peak < 1000 * len(plan)


def test_the_fewest_ticks_are_those_of_a_search_through_all():
    """Against every choice of ramps and holds, the one of least jerk of the fewest ticks."""
    rng = np.random.default_rng(8)
    for k in range(60):
        V, A, J, distance = (10.0 ** rng.uniform(*span) for span in ((-1, 1), (0, 2), (1, 4), (-3, 0.3)))
        if k % 3 == 0:
            V, A, J, distance = (max(round(x, 1), 0.1) for x in (V, A, J, distance))
        n_j, n_a, n_v = fewest_ticks(distance, V, A, J, 0.05)
        total = 4 * n_j + 2 * n_a + n_v
        for ticks in (total - 1, total):
            fit = []
            for j in range(1, ticks // 4 + 1):
                for a in range((ticks - 4 * j) // 2 + 1):
                    jerk = distance / (0.05**3 * j * (j + a) * (ticks - 2 * j - a))
                    if jerk <= J and jerk * j * 0.05 <= A and jerk * j * (j + a) * 0.05**2 <= V:
                        fit.append((jerk, j, a))
            assert bool(fit) == (ticks == total)
        assert min(fit)[1:] == (n_j, n_a)
