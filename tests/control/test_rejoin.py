"""Ways back to a path, and what a motion is checked by."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jssa_gym.control import plan_waypoints
from jssa_gym.control.inverse import path_is_clear
from jssa_gym.control.rejoin import Route, rejoin
from jssa_gym.humans import nobody
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.stopping import stop_joint
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.robots import JointLimits, lr_mate_200id_7l
from jssa_gym.safety.postures import clearances, tool_point
from jssa_gym.types import CapsuleSet, JointState, Planes

DT = 0.008
ROBOT = lr_mate_200id_7l()
LIMITS = ROBOT.limits
HOME = np.array(ROBOT.home)
SPARING = JointLimits(LIMITS.position, LIMITS.velocity, 0.7 * LIMITS.acceleration, 0.7 * LIMITS.jerk)
POINTS = HOME + np.random.default_rng(1).uniform(-0.4, 0.4, (3, 6))
HOST = plan_waypoints(JointState(HOME, np.zeros(6), np.zeros(6)), POINTS, 1.2, SPARING, DT)
TABLE = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.0]), ("table",))


def everything_is(positions):
    return True


def thrown(begin, ticks, brakes, seed):
    """Where the arm is after something else has commanded it for some ticks."""
    state, rng = HOST.states[begin].copy(), np.random.default_rng(seed)
    lower, upper = np.empty(6), np.empty(6)
    for _ in range(ticks):
        jerk = rng.uniform(-0.3, 0.3, 6) * LIMITS.jerk
        if brakes:
            jerk = np.array([stop_joint(v, a, J, A, DT)[3] for _, v, a, J, A in
                             zip(*state, LIMITS.jerk, LIMITS.acceleration, strict=True)])  # fmt: skip
        jerk_box(state, LIMITS.bounds(), DT, lower, upper)
        integrate(state, np.clip(jerk, lower, upper), DT, state)
    return state


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(st.integers(0, 440), st.integers(1, 40), st.booleans(), st.integers(0, 2**32 - 1))
def test_a_way_back_keeps_all_limits_leaves_out_no_waypoint_and_meets_the_path(begin, ticks, brakes, seed) -> None:
    state = thrown(begin, ticks, brakes, seed)
    route = Route(HOST, HOST)
    found = rejoin(route, begin, state, LIMITS, everything_is)
    if found is None:  # the arm may have been thrown too far off; where it was braked it was not
        assert not brakes
        return
    np.testing.assert_array_equal(found.plan.states[0], state)
    assert found.plan.keeps(LIMITS)
    assert begin <= found.meets <= min(mark for mark in HOST.marks if mark > begin)
    np.testing.assert_allclose(found.plan.states[found.entry :], HOST.states[found.meets :], atol=1e-6)
    left = [mark for mark in HOST.marks if mark > begin]
    assert len(found.plan.marks) == len(left)
    for mark, old in zip(found.plan.marks, left, strict=True):
        np.testing.assert_allclose(found.plan.states[mark, 0], HOST.states[old, 0], atol=1e-6)


def test_it_meets_a_point_that_moves() -> None:
    begin = 60
    found = rejoin(Route(HOST, HOST), begin, thrown(begin, 6, True, 0), LIMITS, everything_is)
    assert found is not None
    assert np.abs(found.plan.states[found.entry, 1]).max() > 0.1
    # nowhere on the way does the arm come to rest
    assert np.abs(found.plan.states[: found.entry, 1]).max(axis=1).min() > 0.02


def test_thrown_off_again_it_is_where_it_is_nearest_to_and_never_beyond_a_waypoint_it_has_to_meet() -> None:
    first = rejoin(Route(HOST, HOST), 100, thrown(100, 5, True, 0), LIMITS, everything_is)
    assert first is not None
    assert first.at(0, first.plan.states[0, 0]) in range(100, first.meets)
    assert first.at(first.entry - 1, HOST.states[first.meets, 0]) < first.meets
    assert first.at(first.entry, first.plan.states[first.entry, 0]) == first.meets
    assert first.at(10**6, first.plan.states[-1, 0]) == len(HOST)
    again = rejoin(first, first.at(3, first.plan.states[3, 0]), first.plan.states[3], LIMITS, everything_is)
    assert again is not None
    assert again.host is HOST


def test_a_way_back_that_is_not_clear_is_none() -> None:
    state = thrown(100, 5, True, 0)
    asked = []

    def nothing_is(positions):
        asked.append(positions.shape)
        return False

    assert rejoin(Route(HOST, HOST), 100, state, LIMITS, nothing_is) is None
    assert asked
    assert all(shape[1] == 6 for shape in asked)


def test_an_arm_outside_its_limits_has_no_way_back() -> None:
    state = HOST.states[100].copy()
    state[1] = 2.0 * LIMITS.velocity
    assert rejoin(Route(HOST, HOST), 100, state, LIMITS, everything_is) is None


class TestClear:
    def way(self, goal, count=120):
        return HOME + np.linspace(0.0, 1.0, count)[:, None] * (goal - HOME)

    def test_a_motion_into_the_table_is_not(self) -> None:
        down = HOME.copy()
        while clearances(ROBOT, down, TABLE)[0] > -0.05:
            down[1] += 0.05
        assert clearances(ROBOT, HOME, TABLE)[0] > 0.05
        assert path_is_clear(ROBOT, self.way(HOME), TABLE, nobody(), 0.01)
        assert not path_is_clear(ROBOT, self.way(down), TABLE, nobody(), 0.01)
        # the middle counts, not only the ends
        there_and_back = np.concatenate([self.way(down), self.way(down)[::-1]])
        assert not path_is_clear(ROBOT, there_and_back, TABLE, nobody(), 0.01)
        # however few ticks it takes
        assert not path_is_clear(ROBOT, there_and_back[::119], TABLE, nobody(), 0.01)

    @pytest.mark.parametrize("wrong", [np.nan, np.inf])
    def test_what_is_no_number_is_not(self, wrong) -> None:
        way = self.way(HOME)
        way[-1, 0] = wrong
        assert not path_is_clear(ROBOT, way, TABLE, nobody(), 0.01)

    def test_capsules_that_stand_there_count(self) -> None:
        turned = HOME.copy()
        turned[0] += 0.8
        point = tool_point(ROBOT, (HOME + turned) / 2.0)[None]
        still = np.zeros((1, 3))
        post = CapsuleSet(
            point, point + np.array([0.0, 0.0, 0.1]), still, still, np.array([0.03]), ("post",), np.array([0])
        )
        assert path_is_clear(ROBOT, self.way(turned), TABLE, nobody(), 0.01)
        assert not path_is_clear(ROBOT, self.way(turned), TABLE, post, 0.01)

    def test_who_begins_too_close_may_leave(self) -> None:
        down = HOME.copy()
        while clearances(ROBOT, down, TABLE)[0] > 0.004:
            down[1] += 0.005
        assert path_is_clear(ROBOT, self.way(down)[::-1], TABLE, nobody(), 0.01)
        assert not path_is_clear(ROBOT, self.way(down), TABLE, nobody(), 0.01)

    def test_a_motion_of_one_posture_is_clear_of_itself(self) -> None:
        assert path_is_clear(ROBOT, HOME[None], TABLE, nobody(), 0.01)


def test_a_route_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Route(HOST, HOST).meets = 3  # type: ignore[misc]
