"""A path at a pace of its own, played to shields that take, refuse and brake."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jssa_gym.control import plan_move, plan_waypoints
from jssa_gym.control.path import ASTRAY, FASTER, HURRY, SLOWER, PacedPath
from jssa_gym.control.plan import Plan
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.override import along
from jssa_gym.kernels.stopping import step_keeps
from jssa_gym.kernels.viability import recoverable
from jssa_gym.robots import JointLimits, lr_mate_200id_7l
from jssa_gym.types import JointState

DT = 0.008
ROBOT = lr_mate_200id_7l()
LIMITS = ROBOT.limits
BOUNDS = LIMITS.bounds()
TIGHT = JointLimits(LIMITS.position, LIMITS.velocity, 0.7 * LIMITS.acceleration, 0.7 * LIMITS.jerk)


def drawn(seed):
    """A plan from home within 0.7 of acceleration and jerk limits, away from the ends of the range."""
    rng = np.random.default_rng(seed)
    low, high = LIMITS.position.T
    home = np.array(ROBOT.home)
    points = home + rng.uniform(-0.25, 0.25, (3, 6)) * (high - low)
    points = np.clip(points, low + 0.2, high - 0.2)
    if seed % 2:
        return plan_move(home, points[0], TIGHT, DT)
    return plan_waypoints(JointState(home, np.zeros(6), np.zeros(6)), points, 1.0, TIGHT, DT, stretch=True)


PLANS = [drawn(seed) for seed in range(6)]


class Arm:
    """Moves as it is told, and sees to it that limits are kept in every tick and between them."""

    def __init__(self, plan):
        self.state = plan.states[0].copy()

    def apply(self, jerk):
        q, v, a = self.state
        for j in range(6):
            assert step_keeps(q[j], v[j], a[j], jerk[j], *BOUNDS[:, j], DT, 1e-9)
        self.state = self.state.copy()
        integrate(self.state, np.ascontiguousarray(jerk), DT, self.state)


def play(path, arm, margins, choose=lambda count: 0):
    """Ticks until the path has ended or the margins have; every tick's pace."""
    paces = []
    for margin in margins:
        jerks = path.alternatives(arm.state, margin)
        assert 1 <= len(jerks) <= 8
        choice = choose(len(jerks))
        arm.apply(jerks[choice])
        path.took(choice)
        paces.append(path.pace)
        assert path.pace >= 0.0
        assert not path.astray(arm.state)
        if path.ended:
            break
    return paces


def test_derivatives_are_those_of_the_plan() -> None:
    plan, point = PLANS[0], np.empty((4, 6))
    played = plan.jerk, plan.states, plan.dt
    step = 1e-4
    for s in (0.5 * DT, 0.3011, 1.7):
        along(played, s, point)
        sides = np.empty((2, 4, 6))
        along(played, s - step, sides[0])
        along(played, s + step, sides[1])
        np.testing.assert_allclose((sides[1, :3] - sides[0, :3]) / (2.0 * step), point[1:], rtol=1e-4, atol=1e-4)
    along(played, 1e6, point)
    np.testing.assert_array_equal(point[0], plan.states[-1, 0])
    np.testing.assert_array_equal(point[1:], 0.0)


@pytest.mark.parametrize("plan", PLANS)
def test_at_full_pace_it_is_the_plan(plan) -> None:
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    for k in range(len(plan)):
        (jerk, *_) = path.alternatives(arm.state, np.inf)
        np.testing.assert_allclose(jerk, plan.jerk[k], atol=1e-5)
        arm.apply(jerk)
        path.took(0)
        np.testing.assert_allclose(arm.state, plan.states[k + 1], atol=1e-7)
    assert path.ended
    assert path.override == 1.0


margins = st.lists(
    st.tuples(st.sampled_from([np.inf, 1.0, 0.1, 0.07, 0.04, 0.01, 0.0, -0.2, -np.inf, np.nan]), st.integers(1, 120)),
    min_size=1,
    max_size=12,
)


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(margins, st.sampled_from(PLANS), st.booleans(), st.integers(0, 2**32 - 1))
def test_limits_are_kept_and_the_path_too_whatever_the_margin_and_the_choice(parts, plan, schedule, seed) -> None:
    path, arm, rng = PacedPath(plan, LIMITS, schedule=schedule), Arm(plan), np.random.default_rng(seed)
    sequence = [margin for margin, ticks in parts for _ in range(ticks)]
    play(path, arm, sequence, lambda count: 0 if rng.random() < 0.8 else int(rng.integers(count)))
    off = np.abs(arm.state - path.reference).max(axis=1)
    assert np.all(off < 0.3 * ASTRAY[:, 0])
    # free again it gets to the end, which takes what is left of it and what speeding up takes
    if not path.ended:
        play(path, arm, [np.inf] * (len(plan) + 300))
    assert path.ended


@pytest.mark.sampled(17)
@pytest.mark.parametrize("margin", [0.0, -0.1, -np.inf, np.nan])
@pytest.mark.parametrize("plan", PLANS)
def test_without_a_margin_the_arm_rests_on_its_path(plan, margin) -> None:
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    play(path, arm, [np.inf] * (len(plan) // 2))
    play(path, arm, [margin] * 250)
    assert path.override == 0.0
    assert path.pace == 0.0
    assert not path.ended
    assert np.abs(arm.state[1]).max() < 1e-6
    assert np.abs(arm.state[0] - path.reference[0]).max() < 1e-6
    nearest = np.abs(plan.states[:, 0] - arm.state[0]).max(axis=1).min()
    assert nearest < np.abs(np.diff(plan.states[:, 0], axis=0)).max()


def test_the_pace_that_is_asked_for_follows_the_margin_no_faster_than_it_may() -> None:
    plan = PLANS[0]
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    asked = [1.0]
    for margin in [0.04] * 30 + [0.08] * 60:
        jerks = path.alternatives(arm.state, margin)
        arm.apply(jerks[0])
        path.took(0)
        asked.append(path.override)
    change = np.diff(asked) / DT
    assert change.min() == pytest.approx(-SLOWER)
    assert change.max() == pytest.approx(FASTER)
    assert asked[30] == pytest.approx(0.4)
    assert asked[-1] == pytest.approx(0.8)
    assert path.pace == pytest.approx(0.8, abs=0.05)


def test_later_alternatives_are_slower() -> None:
    plan = PLANS[0]
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    play(path, arm, [np.inf] * 100)
    jerks = path.alternatives(arm.state, np.inf)
    assert len(jerks) >= 3
    along_path = [jerk @ path.reference[1] for jerk in jerks]
    assert all(later < earlier for earlier, later in itertools.pairwise(along_path))
    before = path.pace
    path.took(len(jerks) - 1)
    assert path.pace < before


def test_asking_twice_does_no_harm() -> None:
    plan = PLANS[0]
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    play(path, arm, [np.inf] * 100 + [0.05] * 3)
    once = path.alternatives(arm.state, 0.02)
    again = path.alternatives(arm.state, 0.02)
    np.testing.assert_array_equal(once, again)


def test_who_was_given_another_jerk_is_off_the_path_and_offers_nothing() -> None:
    plan = PLANS[0]
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    play(path, arm, [np.inf] * 100)
    path.alternatives(arm.state, np.inf)
    for _ in range(3):
        arm.apply(-0.1 * LIMITS.jerk)
        path.took(-1)
    assert path.astray(arm.state)
    assert path.alternatives(arm.state, np.inf).shape == (0, 6)
    path.took(0)  # nothing was offered, so nothing can have been taken
    assert path.astray(arm.state)


def test_a_state_that_is_no_number_offers_nothing() -> None:
    path = PacedPath(PLANS[0], LIMITS)
    state = PLANS[0].states[0].copy()
    state[1, 2] = np.nan
    assert len(path.alternatives(state, np.inf)) == 0


def test_lost_time_is_made_up_for_by_a_schedule_alone() -> None:
    plan = PLANS[0]
    took = {}
    for schedule in (False, True):
        path, arm = PacedPath(plan, LIMITS, schedule=schedule), Arm(plan)
        paces = play(path, arm, [np.inf] * 60 + [0.02] * 60 + [np.inf] * 1000)
        took[schedule] = len(paces)
        assert max(paces) <= (HURRY if schedule else 1.0) + 1e-6
    assert took[True] < took[False]


def test_from_rest_a_plan_begins_at_the_pace_that_was_asked_for() -> None:
    plan = PLANS[0]
    assert PacedPath(plan, LIMITS, pace=0.3).pace == 0.3
    moving = Plan.follow(plan.states[50], plan.jerk[50:], DT, (len(plan) - 50,))
    assert PacedPath(moving, LIMITS, pace=0.3).pace == 1.0


def test_a_plan_without_ticks_holds_its_place() -> None:
    plan = plan_move(np.array(ROBOT.home), np.array(ROBOT.home), LIMITS, DT)
    path, arm = PacedPath(plan, LIMITS), Arm(plan)
    assert path.ended
    jerks = path.alternatives(arm.state, np.inf)
    np.testing.assert_array_equal(jerks, np.zeros((1, 6)))


def test_it_refuses_what_does_not_fit() -> None:
    plan = PLANS[0]
    few = JointLimits(LIMITS.position[:2], LIMITS.velocity[:2], LIMITS.acceleration[:2], LIMITS.jerk[:2])
    with pytest.raises(ParameterError, match="joints"):
        PacedPath(plan, few)
    for pace in (-0.1, 2.0, np.nan):
        with pytest.raises(ParameterError, match="pace"):
            PacedPath(plan, LIMITS, pace=pace)


def test_at_the_end_of_the_range_only_what_can_still_be_stopped_is_offered() -> None:
    end = np.array(ROBOT.home)
    end[0] = LIMITS.position[0, 1] - 1e-4
    plan = plan_move(end - np.eye(6)[0], end, TIGHT, DT)
    ahead = 9e-4 * np.eye(6)[0]  # nearer to the end of the range than the path is, and not yet astray
    refused = 0
    for k in range(len(plan)):
        path = PacedPath(Plan.follow(plan.states[k], plan.jerk[k:], DT, (len(plan) - k,)), LIMITS)
        state = plan.states[k] + np.array([ahead, 0.0 * ahead, 0.0 * ahead])
        jerks = path.alternatives(state, np.inf)
        refused += len(jerks) == 0
        for jerk in jerks:
            for j in range(6):
                assert recoverable(*state[:, j], jerk[j], tuple(BOUNDS[:, j]), DT)
    assert 0 < refused < len(plan)


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(
    arrays(np.float64, (3, 6), elements=st.floats(allow_nan=True, allow_infinity=True)),
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(-3, 12),
)
def test_garbage_is_offered_nothing_and_garbage_that_was_taken_moves_nothing(state, margin, choice) -> None:
    path = PacedPath(PLANS[0], LIMITS)
    jerks = path.alternatives(state, margin)
    assert len(jerks) == 0 or not path.astray(state)
    path.took(choice)
    if not 0 <= choice < len(jerks):
        assert path.ticks == 0
        assert path.reference[0] == pytest.approx(PLANS[0].states[0, 0], abs=0.0)
    offered = path.alternatives(PLANS[0].states[0], np.inf)
    assert (np.abs(offered) <= LIMITS.jerk * (1 + 1e-9)).all()
    path.took(len(offered))
    assert path.ticks == 0
