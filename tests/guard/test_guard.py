"""The guard: the same decisions as in an environment, and what it does with all that a controller can get wrong."""

import copy
import gc
import logging
import pickle
import re
import runpy
import tracemalloc

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT

import jssa_gym
from jssa_gym import (
    Guard,
    JointJerk,
    JointPosition,
    JointVelocity,
    JSSAShield,
    MeasuredPeople,
    Status,
    TipVelocity,
    Twist,
)
from jssa_gym.exceptions import JSSAGymError, NotStartedError, ParameterError, RobotModelError
from jssa_gym.humans import make_human, nobody
from jssa_gym.kernels.motion import integrate
from jssa_gym.types import CapsuleSet, JointState, Planes

DT = 0.008
STILL = JointVelocity(np.zeros(6))
NAN = np.full(6, np.nan)


def started(**kwargs):
    guard = Guard(**kwargs)
    guard.start(guard.robot.home)
    return guard


def ball(x=3.0, velocity=0.0, names=("body",)):
    """A person far away, or near: a sphere at (x, 0, 1.2) that moves along x."""
    at, v = np.array([[x, 0.0, 1.2]]), np.array([[velocity, 0.0, 0.0]])
    return CapsuleSet(at, at.copy(), v, v.copy(), np.array([0.1]), names, np.zeros(1, np.int64))


def run(guard, ticks, command=None, people=None, begin=0, measured=None):
    """Tick a guard evenly; all its answers."""
    command = JointVelocity(0.3 * np.array(guard.robot.limits.velocity)) if command is None else command
    people = nobody() if people is None else people
    answers = []
    for k in range(begin, begin + ticks):
        joints = None if measured is None else measured(guard)
        answers.append(guard.tick(command, people, k * guard.dt, joints))
    return answers


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("task", "human", "options"),
    [
        ("Reach", "pursuit", {}),
        ("Home", "walk_by", {"profile": "work"}),
        ("Home", "hand", {"rows": "closest", "failsafe": {"position_error": 0.01, "graded": True}}),
    ],
)
def test_it_decides_as_a_shield_does_to_the_bit(task, human, options):
    env = JSSAShield(gym.make(f"jssa_gym/{task}-v0", human=human, terminate_on=()), **options)
    env.reset(seed=3)
    base, rng = env.unwrapped, np.random.default_rng(1)
    guard = started(**options)
    bound, statuses = np.array(base.robot.limits.jerk), set()
    for k in range(400):
        if k % 15 == 0:
            action = np.sign(rng.normal(size=6))
        scene = base.scene
        answer = guard.tick(JointJerk(action * bound), scene.human, scene.time)
        env.step(action)
        decision, state = env.last_decision, base.scene.robot
        np.testing.assert_array_equal(answer.jerk, decision.jerk)
        assert answer[4:7] == (decision.status, decision.reason, decision.margin)
        for mine, theirs in zip(answer[:3], state, strict=True):
            np.testing.assert_array_equal(mine, theirs)
        statuses.add(answer.status)
    assert Status.FAILSAFE in statuses
    assert Status.FAULT not in statuses


@pytest.mark.parametrize("dt", [0.001, 0.004, 0.01, 0.02])
def test_it_decides_as_a_shield_does_at_any_rate(dt):
    env = JSSAShield(gym.make("jssa_gym/Home-v0", human="pursuit", terminate_on=(), dt=dt))
    env.reset(seed=1)
    base, guard = env.unwrapped, started(dt=dt)
    bound, stops = np.array(base.robot.limits.jerk), 0
    for k in range(100):
        action = np.full(6, 1.0 if k % 40 < 20 else -1.0)
        scene = base.scene
        answer = guard.tick(JointJerk(action * bound), scene.human, scene.time)
        *_, info = env.step(action)
        np.testing.assert_array_equal(answer.jerk, env.last_decision.jerk)
        np.testing.assert_array_equal(answer.position, base.scene.robot.position)
        assert answer.status == env.last_decision.status != Status.FAULT
        assert not info["limit_violation"]
        stops += answer.status == Status.FAILSAFE
    assert base.scene.time == pytest.approx(100 * dt)


@pytest.mark.parametrize("dt", [0.0009, 0.021, 0.0, -0.008, np.nan, "fast", None, True])
def test_another_rate_is_refused(dt):
    with pytest.raises(ParameterError, match="dt has to be"):
        Guard(dt=dt)


@pytest.mark.parametrize(
    ("kwargs", "error", "word"),
    [
        ({"robot": "r2d2"}, JSSAGymError, "r2d2"),
        ({"profile": "brave"}, ParameterError, "profile"),
        ({"failsafe": False}, ParameterError, "always verifies"),
        ({"failsafe": 3}, ParameterError, "failsafe"),
        ({"failsafe": {"human_sped": 1.0}}, ParameterError, "human_sped"),
        ({"scene": "moon"}, ParameterError, "scene"),
        ({"share": 0.0}, ParameterError, "share"),
        ({"static": [1]}, ParameterError, "static has to be a CapsuleSet"),
        ({"d_min": -1.0}, ParameterError, "d_min"),
        ({"profile": "work", "lambda1": 1.0}, ParameterError, "does not take"),
        ({"options": {"gradient": "none"}}, ParameterError, "gradient"),
    ],
)
def test_wrong_construction_is_refused(kwargs, error, word):
    with pytest.raises(error, match=word):
        Guard(**kwargs)


def test_it_has_to_be_started_where_the_arm_can_rest(robot):
    guard = Guard()
    with pytest.raises(NotStartedError, match="start"):
        guard.tick(STILL, nobody(), 0.0)
    for position in (np.zeros(5), NAN, "home", None, [[0.0] * 6]):
        with pytest.raises(ParameterError, match="position"):
            guard.start(position)
    with pytest.raises(ParameterError, match=r"J2 is at 9 rad, outside"):
        guard.start([0.0, 9.0, 0.0, 0.0, 0.0, 0.0])
    guard.start(list(robot.home))
    np.testing.assert_array_equal(guard.state.position, robot.home)
    assert guard.rests
    assert guard.tick(STILL, nobody(), 5.0).status == Status.NOMINAL


COMMANDS = {
    "none": (None, "there is no command"),
    "a word": ("go", "got str"),
    "an array": (np.zeros(6), "got ndarray"),
    "too short": (JointPosition(np.zeros(5)), r"its position has shape \(5,\), expected \(6,\)"),
    "a number": (JointVelocity(1.0), r"shape \(\), expected \(6,\)"),
    "a column": (JointJerk(np.zeros((6, 1))), r"shape \(6, 1\)"),
    "masked": (JointVelocity(np.ma.masked_array(np.zeros(6))), "masked"),
    "complex": (JointVelocity(np.zeros(6, complex)), "real numbers"),
    "words": (JointPosition(["a"] * 6), "real numbers"),
    "no number": (JointPosition(NAN), "not finite"),
    "no velocity": (JointPosition(np.zeros(6), velocity=NAN), "not finite"),
    "endless": (JointJerk(np.full(6, np.inf)), "not finite"),
    "half a twist": (Twist(np.zeros(3), np.zeros(2)), r"its angular has shape \(2,\)"),
    "no rotation": (jssa_gym.ToolPose(np.zeros(3), 2.0 * np.eye(3)), "no rotation matrix"),
    "a mirror": (jssa_gym.ToolPose(np.zeros(3), -np.eye(3)), "no rotation matrix"),
    "ragged": (TipVelocity([[1.0], [2.0, 3.0]]), "the command cannot be read"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_what_is_no_command_ends_in_the_stored_stop(name):
    command, word = COMMANDS[name]
    guard = started()
    assert run(guard, 40)[-1].status == Status.NOMINAL
    answers = (
        run(guard, 120, command, begin=40)
        if command is not None
        else [guard.tick(None, nobody(), k * DT) for k in range(40, 160)]
    )
    for answer in answers:
        assert answer.status == Status.FAULT
        assert answer.override == 0.0
        assert re.search(word, answer.reason), answer.reason
    assert guard.rests
    assert np.abs(np.diff([a.acceleration for a in answers], axis=0)).max() > 0.0


PEOPLE = {
    "nobody knows": (lambda p: None, "there are none in this tick"),
    "a word": (lambda p: "Ann", "no MeasuredPeople and no CapsuleSet"),
    "not finite": (lambda p: p._replace(start=p.start * np.nan), "not finite"),
    "one more": (lambda p: nobody(), "0 capsules instead of 1"),
    "another name": (lambda p: p._replace(names=("arm",)), "other names"),
    "another shape": (lambda p: p._replace(start=p.start[0]), "shapes do not fit"),
    "lists": (lambda p: p._replace(radius=[0.1]), "people cannot be read"),
    "no radius": (lambda p: p._replace(radius=np.zeros(1)), "without a radius"),
    "another person": (lambda p: p._replace(person=np.ones(1, np.int64)), "another person"),
    "elsewhere": (lambda p: p._replace(start=p.start - 1.0, end=p.end - 1.0), "jumped"),
    "an old age": (lambda p: MeasuredPeople(p, 0.5), "too old"),
    "no age": (lambda p: MeasuredPeople(p, np.nan), "not finite"),
    "ages for others": (lambda p: MeasuredPeople(p, np.zeros(3)), "shapes do not fit"),
    "from the future": (lambda p: MeasuredPeople(p, -0.1), "from the future"),
    "an age in words": (lambda p: MeasuredPeople(p, "old"), "people cannot be read"),
    "not seen": (lambda p: MeasuredPeople(p, 0.0, np.zeros(1, np.bool_)), "not measured"),
    "validity in words": (lambda p: MeasuredPeople(p, 0.0, "yes"), "people cannot be read"),
}


@pytest.mark.parametrize("name", PEOPLE)
def test_people_that_cannot_be_believed_end_in_the_stored_stop(name):
    told, word = PEOPLE[name]
    guard = started(failsafe={"max_age": 0.05})
    assert run(guard, 40, people=ball())[-1].status == Status.NOMINAL
    for k in range(40, 160):
        answer = guard.tick(JointVelocity(np.ones(6)), told(ball()), k * DT)
    assert answer.status == Status.FAULT
    assert word in answer.reason
    assert guard.rests
    assert run(guard, 20, people=ball(), begin=160)[-1].status == Status.NOMINAL or name in ("elsewhere",)


def test_how_old_people_are_has_to_be_said():
    with pytest.raises(TypeError, match="age"):
        MeasuredPeople(ball())


def test_a_measurement_ages_with_the_ticks_that_bring_no_new_one():
    guard = started(failsafe={"max_age": 0.1})
    people, reasons = ball(), []
    for k in range(30):  # measured once, and shown again with its age
        reasons.append(guard.tick(STILL, MeasuredPeople(people, k * DT), k * DT).reason)
    assert reasons[:13] == [""] * 13
    assert "too old" in reasons[13]


STAMPS = {
    "stands still": (lambda t: 0.4, "stands still"),
    "goes back": (lambda t: 0.4 - t / 10.0, "went back"),
    "no number": (lambda t: np.nan, "the time is nan"),
    "a word": (lambda t: "noon", "clock cannot be read"),
    "nothing": (lambda t: None, "clock cannot be read"),
}


@pytest.mark.parametrize("name", STAMPS)
def test_a_clock_that_does_not_go_on_ends_in_the_stored_stop(name):
    told, word = STAMPS[name]
    guard = started()
    for k in range(51):
        assert guard.tick(JointVelocity(np.ones(6)), ball(), k * DT).status == Status.NOMINAL
    reasons = [guard.tick(JointVelocity(np.ones(6)), ball(), told(k * DT)).reason for k in range(51, 171)]
    assert all("clock" in reason or "time" in reason for reason in reasons)
    assert word in reasons[-1]
    assert guard.rests


def test_a_tick_that_came_late_is_one_fault_and_the_arm_goes_on_from_where_it_was():
    guard = started()
    before = run(guard, 50)[-1]
    late = guard.tick(JointVelocity(np.ones(6)), nobody(), (49 + 4) * DT)
    assert late.status == Status.FAULT
    assert late.reason == "the clock leapt ahead of the arm"
    out = np.empty((3, 6))
    integrate(np.array(before[:3]), np.array(late.jerk), DT, out)
    np.testing.assert_array_equal(out, late[:3])  # no more than one tick's way, whatever was missed
    assert run(guard, 1, begin=54)[0].status == Status.NOMINAL


def test_after_a_late_tick_a_reading_further_along_the_stop_is_not_believed():
    """Who is asked once a tick has commanded nothing in between: an arm that went on by itself is astray."""
    guard = started()
    before = run(guard, 51, measured=lambda guard: guard.state)[-1]
    ahead = copy.deepcopy(guard)
    for k in range(51, 54):
        ahead.tick(None, nobody(), k * DT, ahead.state)
    assert np.abs(ahead.state.position - before.position).max() > 5.0 * guard.state_tolerance[0]
    late = guard.tick(JointVelocity(np.ones(6)), nobody(), 54 * DT, ahead.state)
    assert late.status == Status.FAULT
    out = np.empty((3, 6))
    integrate(np.array(before[:3]), np.array(late.jerk), DT, out)
    np.testing.assert_array_equal(out, late[:3])  # the stop's next tick, none is skipped


def test_a_doubled_tick_is_one_fault():
    guard = started()
    run(guard, 50, people=ball())
    assert run(guard, 1, people=ball(), begin=49)[0].reason.startswith("the clock stands still")
    # the reading before it was right, five have to be again
    statuses = [a.status for a in run(guard, 10, people=ball(), begin=50)]
    assert statuses[-1] == Status.NOMINAL


def test_a_loop_that_catches_up_does_not_move_the_arm_any_faster():
    guard = started()
    run(guard, 50, people=ball())
    late = guard.tick(JointVelocity(np.ones(6)), ball(), (49 + 7) * DT)
    assert late.reason == "the clock leapt ahead of the arm"
    assert np.abs(late.velocity).max() > 0.1
    for k in range(1, 7):
        again = guard.tick(JointVelocity(np.ones(6)), ball(), (49 + 7) * DT + k * 1e-6)
        assert again.status == Status.FAULT
        assert "less than half a tick after the last one" in again.reason
        np.testing.assert_array_equal(again[:4], late[:4])
        np.testing.assert_array_equal(guard.state, late[:3])
        assert (again.override, np.isnan(again.margin)) == (0.0, True)
    after = run(guard, 10, people=ball(), begin=57)
    assert {a.status for a in after} == {Status.NOMINAL}
    assert np.abs(after[0].position - late.position).max() < 2.0 * DT * np.abs(late.velocity).max()


def test_calls_at_twice_the_rate_and_more_move_the_arm_at_no_more_than_its_own():
    guard, places = started(), []
    for k in range(400):
        places.append(guard.tick(JointVelocity(np.ones(6)), nobody(), k * DT / 4.0).position)
    assert len({p.tobytes() for p in places}) <= 201


@pytest.mark.parametrize("spread", [0.0, 0.05])
def test_ticks_that_all_come_half_a_tick_late_are_no_jitter(spread):
    guard, rng, stamp, faults = started(), np.random.default_rng(0), 0.0, 0
    for _ in range(60):
        answer = guard.tick(JointVelocity(0.1 * np.ones(6)), nobody(), stamp)
        faults += "ticks come at" in answer.reason
        stamp += DT * (1.5 + spread * rng.uniform(-1.0, 1.0))
    assert faults > 40


@pytest.mark.parametrize("jitter", [0.1, 0.3])
def test_jitter_is_no_fault(jitter):
    guard, rng, stamp = started(), np.random.default_rng(0), 0.0
    human = make_human("walk_by")
    people = human.reset(rng)
    for _ in range(3000):
        answer = guard.tick(JointVelocity(0.1 * np.ones(6)), people, stamp)
        assert answer.status != Status.FAULT, answer.reason
        gap = DT * (1.0 + jitter * rng.uniform(-1.0, 1.0))
        stamp, people = stamp + gap, human.step(gap, nobody())


def test_with_jitter_who_is_as_fast_as_is_assumed_is_no_faster():
    """Ticks go by their stamps: time that a late one makes up for would have people cover their way in less of it."""
    guard, rng, stamp = started(), np.random.default_rng(0), 0.0
    speed = guard.failsafe.human_speed
    for _ in range(400):
        answer = guard.tick(STILL, ball(3.0 + speed * stamp, speed, ("torso",)), stamp)
        assert answer.status != Status.FAULT, answer.reason
        stamp += DT * (1.0 + 0.3 * rng.uniform(-1.0, 1.0))


@pytest.mark.parametrize(
    ("rate", "word"), [(1.4, "ticks come at 8"), (0.6, "ticks come at 2"), (0.93, "ticks come at 1")]
)
def test_another_rate_than_the_guards_is_a_fault(rate, word):
    guard = started()
    for k in range(1000):
        answer = guard.tick(JointVelocity(np.ones(6)), nobody(), k * rate * DT)
    assert answer.status == Status.FAULT
    assert word in answer.reason
    assert "made for 125" in answer.reason
    assert guard.rests


def test_noise_of_a_tenth_of_a_milliradian_is_no_fault(robot):
    rng = np.random.default_rng(0)
    guard = started()
    wave = 0.3 * np.sin(np.arange(1500) * DT * 2.0)
    moved = 0.0
    for k, w in enumerate(wave):
        joints = guard.state.position + 1e-4 * rng.normal(size=6)
        answer = guard.tick(JointPosition(robot.home + w), ball(), k * DT, joints)
        assert answer.status != Status.FAULT, (k, answer.reason)
        moved = max(moved, np.abs(answer.velocity).max())
    assert moved > 0.5


def test_a_tolerance_that_is_stated_holds_for_all_that_is_measured():
    guard = started(failsafe={"state_tolerance": (2e-4, 0.01, np.inf)})

    def off(position, velocity):
        return lambda g: JointState(g.state.position + position, g.state.velocity + velocity, NAN)

    assert run(guard, 40, measured=off(1e-4, 5e-3))[-1].status == Status.NOMINAL
    assert run(guard, 1, begin=40, measured=off(3e-4, 0.0))[0].reason.startswith("the joint state is not where")
    guard.start(guard.robot.home)
    run(guard, 40, measured=off(1e-4, 5e-3))
    assert run(guard, 1, begin=40, measured=off(0.0, 0.02))[0].status == Status.FAULT


MEASURED = {
    "elsewhere": (lambda g, first: g.state.position + 0.1, "not where"),
    "frozen": (lambda g, first: first, "frozen"),
    "missing": (lambda g, first: None, "nothing was measured in this tick"),
    "no number": (lambda g, first: NAN, "not finite"),
    "another arm's": (lambda g, first: np.zeros(7), "expected (6,)"),
    "a word": (lambda g, first: "here", "cannot be read"),
    "masked": (lambda g, first: np.ma.masked_array(g.state.position), "masked"),
}


@pytest.mark.parametrize("name", MEASURED)
def test_a_measured_state_that_cannot_be_believed_ends_in_the_stored_stop(name):
    told, word = MEASURED[name]
    guard = started()
    assert run(guard, 40, measured=lambda g: g.state.position)[-1].status == Status.NOMINAL
    first, reasons = guard.state.position, []
    for k in range(40, 160):
        answer = guard.tick(JointVelocity(np.ones(6)), nobody(), k * DT, told(guard, first))
        reasons.append(answer.reason)
        if k == 42:
            assert answer.status == Status.FAULT, answer
    assert any(word in reason for reason in reasons), set(reasons)
    assert guard.rests
    assert answer.status == (Status.FAULT if name != "frozen" else answer.status)


def test_measuring_may_begin_where_the_arm_rests_only():
    guard = started()
    run(guard, 40)
    late = run(guard, 1, begin=40, measured=lambda g: g.state.position)[0]
    assert late.status == Status.FAULT
    assert "began while the arm moves" in late.reason
    answers = run(guard, 200, STILL, begin=41, measured=lambda g: g.state.position)
    assert answers[-1].status == Status.NOMINAL  # it came to rest, and they are compared now
    assert run(guard, 1, begin=241)[0].reason == "the joint state cannot be read: nothing was measured in this tick"


def test_states_that_are_not_measured_cost_no_distance():
    plain, measured = started(), started()
    for guard, joints in ((plain, None), (measured, lambda g: g.state.position)):
        guard.margins = [a.margin for a in run(guard, 60, people=ball(1.3), measured=joints)]
    finite = np.isfinite(plain.margins) & np.isfinite(measured.margins)
    assert finite.any()
    assert np.all(np.array(plain.margins)[finite] > np.array(measured.margins)[finite])


def test_limits_hold_whatever_is_commanded(robot):
    guard, rng = started(), np.random.default_rng(2)
    bounds, state, after = robot.limits.bounds(), np.array(guard_state(robot)), np.empty((3, 6))
    for k in range(1500):
        if k % 40 == 0:
            command = (
                JointJerk(1e6 * rng.normal(size=6)),
                JointVelocity(1e6 * rng.normal(size=6)),
                JointPosition(1e3 * rng.normal(size=6)),
                TipVelocity(1e3 * rng.normal(size=3)),
                Twist(1e200 * rng.normal(size=3), rng.normal(size=3)),
            )[k // 40 % 5]
        answer = guard.tick(command, nobody(), k * DT)
        integrate(state, np.array(answer.jerk), DT, after)
        np.testing.assert_array_equal(after, answer[:3])
        state[:] = after
        over = 1.0 + 1e-9
        rounding = 1e-9 * (bounds[1] - bounds[0])
        assert np.all(state[0] >= bounds[0] - rounding)
        assert np.all(state[0] <= bounds[1] + rounding)
        for values, bound in zip((state[1], state[2], answer.jerk), bounds[2:], strict=True):
            assert np.all(np.abs(values) <= over * bound)


def guard_state(robot):
    return np.array([robot.home, np.zeros(6), np.zeros(6)])


def test_it_stops_for_somebody_and_says_how_much_room_there_is():
    guard = started()
    command = JointPosition(guard.robot.home + np.eye(6)[0])
    x, answers = 1.8, []
    for k in range(150):
        x -= 1.6 * DT * (k > 0)
        answers.append(guard.tick(command, ball(x, -1.6), k * DT))
    assert answers[0].override == 1.0
    assert min(a.override for a in answers) == 0.0
    slow = [a for a in answers if 0.0 < a.margin < 0.1]
    assert slow
    assert all(a.override == a.margin / 0.1 for a in slow)
    assert any("can reach" in a.reason for a in answers)


def test_it_stays_off_the_table_and_what_it_is_told_stands_there():
    floor = started(scene=Planes(np.array([[0.0, 0.0, 1.0]]), np.array([-5.0]), ("cellar",)))
    table = started()
    assert table.robot.mount[2] == 0.87
    assert floor.robot.mount[2] == 0.0
    fixture = CapsuleSet(
        *(np.array([[1.0, 0.0, 1.3]]),) * 2,
        *(np.zeros((1, 3)),) * 2,
        np.array([0.25]),
        ("post",),
        np.zeros(1, np.int64),
    )
    for kwargs, word in (({}, "would meet table"), ({"static": fixture}, "would meet post")):
        guard = started(**kwargs)
        down = TipVelocity([0.0, 0.0, -0.5]) if not kwargs else TipVelocity([0.5, 0.0, 0.0])
        assert any(word in a.reason for a in run(guard, 400, down)), word


def test_kept_answers_stay_as_they_are_and_others_are_used_again():
    guard = started()
    kept = run(guard, 30)
    assert len({a.position.ctypes.data for a in kept}) == 30
    assert len({a.position.tobytes() for a in kept[3:]}) == 27
    one = guard.tick(STILL, nobody(), 30 * DT)
    part, before = one.position[2:4], one.position[2:4].copy()
    del one
    for k in range(31, 40):
        guard.tick(JointVelocity(np.ones(6)), nobody(), k * DT)
    np.testing.assert_array_equal(part, before)
    with pytest.raises(ValueError, match="read-only"):
        kept[0].position[0] = 1.0
    with pytest.raises(AttributeError):
        kept[0].position = kept[1].position


@pytest.mark.long
@pytest.mark.parametrize("measured", [False, True])
def test_nothing_is_allocated_for_good(measured):
    grown, peak = allocated(2000, measured)
    assert grown < 20_000  # one array a tick would be 200,000
    assert peak < 60_000


@pytest.mark.slow
@pytest.mark.parametrize("measured", [False, True])
def test_nothing_is_allocated_for_good_in_a_long_run(measured, monkeypatch):
    monkeypatch.setattr(logging.getLogger("jssa_gym"), "disabled", True)  # pytest keeps what is said
    grown, _ = allocated(100_000, measured, begun=20_000)  # until then small objects of the interpreter are kept
    assert grown < 20_000  # one array a tick would be ten million


def allocated(ticks, measured, begun=1000):
    """Bytes that so many ticks keep, after so many before them, and most that they needed meanwhile."""
    guard, rng = started(), np.random.default_rng(0)
    human = make_human("random")
    people = human.reset(rng)
    commands = [
        JointPosition(np.array(guard.robot.home)),
        Twist(np.full(3, 0.1), np.zeros(3)),
        JointPosition(NAN),
        STILL,
    ]
    joints = np.array(guard.robot.home)
    first = 0
    tracemalloc.start()
    try:
        for k in range(begun + ticks):
            if k == begun:
                gc.collect()
                tracemalloc.reset_peak()
                first = tracemalloc.get_traced_memory()[0]
            answer = guard.tick(commands[k // 25 % 4], people, k * DT, joints if measured else None)
            joints[:] = answer.position
            people = human.step(DT, people)
        gc.collect()
        now, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return now - first, most - first


def test_a_copy_goes_on_as_the_guard_does():
    guard = started()
    run(guard, 30, people=ball(1.6))
    others = [copy.deepcopy(guard), pickle.loads(pickle.dumps(guard))]
    wanted = run(guard, 60, STILL, people=ball(1.6), begin=30)
    for other in others:
        for mine, theirs in zip(wanted, run(other, 60, STILL, people=ball(1.6), begin=30), strict=True):
            assert mine[4:7] == theirs[4:7]
            np.testing.assert_array_equal(mine[:4], theirs[:4])


def test_it_can_begin_anew_anywhere():
    guard = started()
    run(guard, 40, people=ball())
    guard.start(guard.robot.home + 0.1)
    answers = run(guard, 20, people=nobody(), begin=3)  # other people, another time
    assert {a.status for a in answers} == {Status.NOMINAL}


def test_the_control_step_itself_may_fail(monkeypatch):
    guard = started()
    run(guard, 40)
    moving = guard.state.velocity.copy()

    def broken(arms, nominal, asked):
        raise MemoryError("no room")

    monkeypatch.setattr(jssa_gym.shields.inplace.loop, "decide_all", broken)
    answers = run(guard, 120, begin=40)
    assert np.abs(moving).max() > 0.1
    assert guard.rests
    assert {a.status for a in answers} == {Status.FAULT}
    assert "MemoryError: no room" in answers[0].reason


def test_a_filter_that_is_not_compiled_will_do():
    guard = started(options={"projector": "osqp"})
    assert {a.status for a in run(guard, 30, people=ball())} == {Status.NOMINAL}


def test_robots_that_cannot_be_modelled_are_refused(tmp_path):
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    with pytest.raises(RobotModelError):
        Guard(tmp_path / "arm.xml")


def test_what_the_ros_node_does_without_ros():
    loop = runpy.run_path(str(ROOT / "examples" / "ros2_node.py"))["Loop"]()
    assert loop.tick(0.0) is None
    names = ("J6", "J1", "J2", "J3", "J4", "J5")
    home = loop.guard.robot.home
    loop.on_joints(names, [home[5], *home[:5]])
    person = [[2.0, y, 0.3, 2.0, y, 1.5, 0.0, 0.0, 0.0, 0.1, 0.01] for y in (0.0, 0.3, -0.3)]
    loop.on_people(np.ravel(person).tolist(), 0.0)
    for k in range(40):
        loop.on_command(home + 0.2, k * DT)
        answer = loop.tick(k * DT)
        loop.on_joints(loop.guard.robot.joint_names, answer.position)
        assert answer.status != Status.FAULT, answer.reason
        loop.on_people(np.ravel(person).tolist(), k * DT) if k % 4 == 0 else None
    for k in range(40, 50):  # the sender has died
        answer = loop.tick(k * DT)
        loop.on_joints(loop.guard.robot.joint_names, answer.position)
    assert answer.reason == "there is no command"
