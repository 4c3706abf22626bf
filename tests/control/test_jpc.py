"""The controller's state machine, against hosts that are slow, silent or confused and a shield that interferes."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jssa_gym.control import JPC, Event, Phase, Plan, plan_approach, plan_move
from jssa_gym.control.jpc import DISTURBED, TRANSITIONS, Request
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.motion import integrate
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.types import JointState

DT = 0.008
ROBOT = lr_mate_200id_7l()
LIMITS, HOME = ROBOT.limits, np.array(ROBOT.home)
GOAL = HOME + np.array([0.3, 0.2, -0.1, 0.3, 0.2, 0.4])


class Arm:
    """An arm that obeys the controller unless somebody interferes; checks what has to hold in every tick."""

    def __init__(self, **options):
        self.jpc = JPC(LIMITS, DT, **options)
        self.state = np.array([HOME, np.zeros(6), np.zeros(6)])
        self.phases = [self.jpc.phase]
        self.tick = 0
        self.asked: list[Request] = []

    def step(self, push=None):
        before, jpc = self.jpc.phase, self.jpc
        jerk = jpc.step(self.state.copy())
        self.tick += 1
        request = jpc.request
        if request is not None and (not self.asked or request.number != self.asked[-1].number):
            assert not self.asked or request.number > self.asked[-1].number
            self.asked.append(request)
        assert jerk.shape == (6,)
        assert np.all(np.abs(jerk) <= LIMITS.jerk * (1 + 1e-9))
        # the phase follows from the one before by the table, in a few events at most
        assert jpc.phase in reachable(before)
        if jpc.phase in (Phase.IDLE, Phase.WAITING):
            np.testing.assert_array_equal(jerk, 0.0)
            assert np.abs(self.state[1:]).max() <= 2e-3
        if jpc.phase is Phase.YIELDING:
            assert request is None
        self.phases.append(jpc.phase)
        applied = jerk if push is None else push
        after = np.empty_like(self.state)
        integrate(self.state, applied, DT, after)
        self.state = after
        return jerk

    def plan(self, request, goal=GOAL):
        return plan_approach(JointState(*request.state), goal, LIMITS, DT)

    def host(self, goal=GOAL):
        """Answers at once whatever is asked."""
        request = self.jpc.request
        if request is not None:
            self.jpc.deliver(request.number, self.plan(request, goal))

    def push(self, ticks, share=0.3):
        """Somebody else commands the arm, to and fro, and leaves it in motion."""
        for k in range(ticks):
            self.step(push=share * LIMITS.jerk * (1.0 if k % 4 < 2 else -1.0))

    def until(self, phase, most=2000, host=True):
        for _ in range(most):
            if self.jpc.phase is phase:
                return
            if host:
                self.host()
            self.step()
        raise AssertionError(f"never {phase}; {self.jpc.phase}")


def reachable(phase):
    """Phases that one tick may lead to."""
    found, border = {phase}, {phase}
    for _ in range(3):
        border = {to for (of, _), to in TRANSITIONS.items() if of in border}
        found |= border
    return found


def test_the_table_has_every_phase_and_no_dead_end():
    assert {of for of, _ in TRANSITIONS} == set(Phase)
    assert set(TRANSITIONS.values()) == set(Phase)
    assert {event for _, event in TRANSITIONS} == set(Event)
    # interference is noticed in every phase but the one that it leads to
    assert {of for of, event in TRANSITIONS if event is Event.DISTURBED} == set(Phase) - {Phase.YIELDING}


def test_it_tracks_a_plan_to_the_goal():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    assert arm.jpc.phase is Phase.WAITING
    plan = plan_move(HOME, GOAL, LIMITS, DT)
    assert arm.jpc.deliver(arm.jpc.request.number, plan)
    jerks = [arm.step() for _ in range(len(plan))]
    np.testing.assert_array_equal(jerks, plan.jerk)
    arm.step()
    assert arm.jpc.phase is Phase.IDLE
    assert not arm.jpc.open
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-9)
    assert len(arm.asked) == 1


def test_without_a_task_it_rests():
    arm = Arm()
    for _ in range(20):
        arm.step()
    assert set(arm.phases) == {Phase.IDLE}
    assert arm.asked == []


@pytest.mark.parametrize("when", [1, 10, 30])
def test_interference_makes_the_plan_void_and_the_task_is_resumed(when):
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    for _ in range(when):
        arm.step()
    arm.push(8)
    assert arm.jpc.phase is Phase.YIELDING
    arm.until(Phase.SETTLING, host=False)
    # asked at once, for a plan from where the internal stop will end
    assert arm.jpc.request is not None
    np.testing.assert_array_equal(arm.jpc.request.state[1:], 0.0)
    early = arm.jpc.deliver(arm.jpc.request.number, arm.plan(arm.jpc.request))
    assert early
    arm.until(Phase.TRACKING, host=False)
    arm.until(Phase.IDLE, host=False)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-4)


def test_while_somebody_interferes_it_offers_a_brake():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    for _ in range(20):
        arm.step()
    arm.push(3)
    speeds = []
    for _ in range(60):
        speeds.append(np.abs(arm.state[1]).max())
        arm.step()
    assert max(speeds) > 0.1
    assert speeds[-1] < 1e-6


def test_short_obedience_is_not_enough():
    arm = Arm(quiet=6)
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    arm.push(3)
    for _ in range(5):
        for _ in range(4):
            arm.step()
        assert arm.jpc.phase is Phase.YIELDING
        arm.push(1)


def test_a_missing_answer_is_asked_for_again_ever_less_often():
    arm = Arm(patience=0.08)
    arm.jpc.assign()
    for _ in range(200):
        arm.step()
    numbers = [request.number for request in arm.asked]
    assert numbers == sorted(set(numbers))
    assert 3 <= len(numbers) <= 5  # after 10, 20, 40, 80 ticks
    arm.until(Phase.IDLE)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_late_and_repeated_answers_are_dropped():
    arm = Arm(patience=0.08)
    arm.jpc.assign()
    arm.step()
    old = arm.jpc.request
    for _ in range(12):
        arm.step()
    new = arm.jpc.request
    assert new.number != old.number
    assert not arm.jpc.deliver(old.number, arm.plan(old, HOME + 0.5))
    assert arm.jpc.deliver(new.number, arm.plan(new))
    assert not arm.jpc.deliver(new.number, arm.plan(new, HOME - 0.5))
    arm.until(Phase.IDLE, host=False)
    assert not arm.jpc.deliver(new.number, arm.plan(new))
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_an_answer_from_before_an_interference_is_dropped():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    old = arm.jpc.request
    arm.push(5)
    assert not arm.jpc.deliver(old.number, arm.plan(old))
    arm.until(Phase.SETTLING, host=False)
    assert not arm.jpc.deliver(old.number, arm.plan(old))
    arm.until(Phase.IDLE)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_a_host_without_a_plan_is_asked_again():
    arm = Arm(patience=0.08)
    arm.jpc.assign()
    arm.step()
    assert arm.jpc.deliver(arm.jpc.request.number, None)
    assert arm.jpc.phase is Phase.WAITING
    for _ in range(15):
        arm.step()
    assert len(arm.asked) == 2
    arm.until(Phase.IDLE)


def test_a_new_task_in_motion_is_taken_up_in_motion():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    for _ in range(20):
        arm.step()
    other = GOAL + 0.2
    arm.jpc.assign()
    arm.step()
    request = arm.jpc.request
    assert request.begins == arm.tick - 1 + arm.jpc.lead
    assert arm.jpc.deliver(request.number, arm.plan(request, other))
    speeds = []
    while arm.jpc.phase is not Phase.IDLE:
        arm.step()
        speeds.append(np.abs(arm.state[1]).max())
    assert min(speeds[:10]) > 0.05  # it did not stop in between
    np.testing.assert_allclose(arm.state[0], other, atol=1e-6)


@pytest.mark.parametrize("late", [6, 20, 100])
def test_a_replan_that_comes_too_late_is_asked_for_further_ahead(late):
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    for _ in range(5):
        arm.step()
    other = GOAL + 0.2
    arm.jpc.assign()
    waiting: list[tuple[int, Request]] = []
    seen, ahead = None, []
    for _ in range(1000):
        request = arm.jpc.request
        if request is not None and request is not seen:
            waiting.append((arm.tick + late, request))
            seen = request
            if np.any(request.state[1]):  # begins on the plan being tracked, and was asked for a tick ago at most
                ahead.append(request.begins - arm.tick)
        for due, request in list(waiting):
            if arm.tick >= due:
                arm.jpc.deliver(request.number, arm.plan(request, other))
                waiting.remove((due, request))
        arm.step()
        if arm.jpc.phase is Phase.IDLE:
            break
    assert arm.jpc.phase is Phase.IDLE
    np.testing.assert_allclose(arm.state[0], other, atol=1e-6)
    assert ahead[0] <= arm.jpc.lead
    assert len(ahead) > 1 or late > 20
    for one, two in itertools.pairwise(ahead):
        assert abs(two - 2 * one) <= 2


def test_waypoints_that_were_met_are_not_asked_for_again():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    middle = HOME + 0.2
    plan = plan_move(HOME, middle, LIMITS, DT).then(plan_move(middle, GOAL, LIMITS, DT))
    arm.jpc.deliver(arm.jpc.request.number, plan)
    for _ in range(plan.marks[0] + 10):
        arm.step()
    assert arm.jpc.met == 1
    arm.push(5)
    arm.until(Phase.SETTLING, host=False)
    assert arm.jpc.request.met == 1
    arm.until(Phase.IDLE)
    assert arm.jpc.met == 2


def test_waypoints_count_as_met_by_others_only_while_somebody_commands_the_arm():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    arm.jpc.count(1)
    assert arm.jpc.met == 0
    arm.push(5)
    assert arm.jpc.phase is Phase.YIELDING
    arm.jpc.count(2)
    arm.jpc.count(1)
    arm.until(Phase.SETTLING, host=False)
    assert arm.jpc.request.met == 2


def test_pushed_from_the_goal_it_returns():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    arm.until(Phase.IDLE)
    arm.push(6)
    assert np.abs(arm.state[0] - GOAL).max() > 1e-4
    arm.until(Phase.WAITING, host=False)
    arm.until(Phase.IDLE)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_pushed_from_a_goal_that_it_began_at_it_returns():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.WAITING)
    for _ in range(5):
        arm.host(HOME)
        arm.step()
    assert arm.jpc.phase is Phase.IDLE
    arm.push(6)
    assert np.abs(arm.state[0] - HOME).max() > 1e-4
    for _ in range(300):
        arm.host(HOME)
        arm.step()
    assert arm.jpc.phase is Phase.IDLE
    np.testing.assert_allclose(arm.state[0], HOME, atol=1e-6)


def test_a_withdrawn_task_is_not_resumed():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    arm.until(Phase.IDLE)
    arm.jpc.withdraw()
    asked = len(arm.asked)
    arm.push(6)
    for _ in range(100):
        arm.step()
    assert arm.jpc.phase is Phase.IDLE
    assert len(arm.asked) == asked


@pytest.mark.parametrize("rates", [(8e-6, 0.0), (8e-6, 8e-4), (0.0, -8e-4)])
@pytest.mark.parametrize("phase", [Phase.IDLE, Phase.WAITING])
def test_what_creeps_is_stopped_and_the_task_goes_on(phase, rates):
    """Less than interference in a single tick, but a plan from rest cannot begin in it."""
    arm = Arm()
    arm.step()
    if phase is Phase.WAITING:
        arm.jpc.assign()
        arm.step()
    assert arm.jpc.phase is phase
    for _ in range(5):
        arm.state[1:] += np.array(rates)[:, None]
        arm.step()
    for _ in range(400):  # no answer meanwhile
        arm.step()
    assert np.abs(arm.state[1:]).max() < 1e-5
    arm.jpc.assign()
    asked = len(arm.asked)
    arm.until(Phase.WAITING, host=False)
    arm.until(Phase.TRACKING)
    arm.until(Phase.IDLE)
    assert len(arm.asked) == asked + 1
    np.testing.assert_allclose(arm.state[0], GOAL, atol=2e-5)


def test_numbers_that_are_none_are_answered_with_rest_and_forgotten():
    arm = Arm()
    arm.jpc.assign()
    arm.until(Phase.TRACKING)
    for _ in range(3):
        np.testing.assert_array_equal(arm.jpc.step(np.full((3, 6), np.nan)), 0.0)
    assert arm.jpc.phase is Phase.YIELDING
    arm.until(Phase.TRACKING)
    arm.until(Phase.IDLE)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_a_withdrawn_task_ends_where_the_arm_is():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    arm.jpc.withdraw()
    arm.until(Phase.IDLE, host=False)
    np.testing.assert_array_equal(arm.state[0], HOME)


def test_a_start_in_motion_is_braked_first():
    arm = Arm()
    arm.state[1] = 0.3 * LIMITS.velocity
    arm.jpc.assign()
    arm.step()
    assert arm.jpc.phase is Phase.YIELDING
    arm.until(Phase.TRACKING)
    arm.until(Phase.IDLE)
    np.testing.assert_allclose(arm.state[0], GOAL, atol=1e-6)


def test_reset_forgets_everything_but_the_numbers_of_requests():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    number = arm.jpc.request.number
    arm.jpc.reset()
    assert arm.jpc.phase is Phase.IDLE
    assert arm.jpc.request is None
    arm.jpc.assign()
    arm.step()
    assert arm.jpc.request.number > number


def test_a_plan_from_elsewhere_is_refused():
    arm = Arm()
    arm.jpc.assign()
    arm.step()
    number = arm.jpc.request.number
    with pytest.raises(ParameterError, match="begin"):
        arm.jpc.deliver(number, plan_move(HOME + 0.1, GOAL, LIMITS, DT))
    with pytest.raises(ParameterError, match="tick"):
        arm.jpc.deliver(number, plan_move(HOME, GOAL, LIMITS, 0.004))
    assert arm.jpc.deliver(number, plan_move(HOME, GOAL, LIMITS, DT))


@pytest.mark.parametrize("options", [{"quiet": 0}, {"patience": 0.0}, {"lead": -1}, {"patience": np.nan}])
def test_bad_options_are_refused(options):
    with pytest.raises(ParameterError):
        JPC(LIMITS, DT, **options)


def test_rounding_of_actions_is_no_interference():
    """What float32 does to an action stays below what counts, for the longest moves."""
    low, high = LIMITS.position.T
    plan = plan_move(low, high, LIMITS, DT)
    rounded = (plan.jerk / LIMITS.jerk).astype(np.float32).astype(float) * LIMITS.jerk
    states = Plan.follow(plan.states[0], rounded, DT, plan.marks).states
    assert np.all(np.abs(states - plan.states) < DISTURBED)


HAPPENINGS = st.sampled_from(["go", "go", "go", "push", "answer", "answer", "none", "old", "twice", "assign"])


@pytest.mark.long
@settings(max_examples=120)
@given(st.lists(st.tuples(HAPPENINGS, st.integers(1, 25)), min_size=1, max_size=25))
def test_whatever_happens_the_task_is_finished_once_it_ends(story):
    arm = Arm(patience=0.2)
    arm.jpc.assign()
    for what, ticks in story:
        request = arm.jpc.request
        if what == "push":
            arm.push(min(ticks, 8))
            continue
        if what == "assign":
            arm.jpc.assign()
        elif what == "old":
            for old in arm.asked[:-1]:
                assert not arm.jpc.deliver(old.number, arm.plan(old)) or old.number == arm.jpc.request.number
        elif request is not None and what != "go":
            plan = None if what == "none" else arm.plan(request)
            taken = arm.jpc.deliver(request.number, plan)
            if what == "twice" and taken:
                assert not arm.jpc.deliver(request.number, plan)
        for _ in range(ticks):
            arm.step()
    for _ in range(2500):
        arm.host()
        arm.step()
        if arm.jpc.phase is Phase.IDLE and not arm.jpc.open:
            break
    assert arm.jpc.phase is Phase.IDLE
    np.testing.assert_allclose(arm.state[0], GOAL, atol=2e-5)
    assert np.abs(arm.state[1:]).max() < 1e-3
