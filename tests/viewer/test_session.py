"""What is played behind the page, without a page."""

import time

import numpy as np
import pytest

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.trace import load_trace, save_trace
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.types import JointState
from jssa_gym.viewer.choices import Choices, ShieldChoice
from jssa_gym.viewer.overlays import PLACES, arm_capsules, reachable, swept_stop
from jssa_gym.viewer.playback import Playback
from jssa_gym.viewer.runner import Runner
from jssa_gym.viewer.session import Session
from jssa_gym.viewer.side import LONGEST

DT = 0.008


def session_of(*shields, **choices):
    return Session(Choices(shields=tuple(ShieldChoice(name) for name in shields) or (ShieldChoice(),), **choices))


def stepped(session, seconds):
    for _ in range(round(seconds / DT)):
        session.step()
    return session.snapshot()


def dragged_into_the_arm(session):
    """The person is drawn into the moving arm, and keeps at it."""
    session.drag("core_body", (0.55, 0.0))
    return stepped(session, 4.0)


@pytest.mark.parametrize("human", ["dragged", "pursuit"])
def test_two_arms_are_beside_the_same_person(human):
    session = session_of("yield", "jssa_published", human=human)
    session.drag("core_body", (0.9, 0.3))
    differed = False
    for _ in range(150):
        session.step()
        one, other = (side.base.scene.human for side in session.sides)
        for field in ("start", "end", "start_velocity", "end_velocity"):
            assert np.array_equal(getattr(one, field), getattr(other, field))
        views = session.snapshot().arms
        differed = differed or not np.array_equal(views[0].position, views[1].position)
    assert differed


def test_a_shielded_arm_evades_who_is_dragged_into_it_and_a_bare_one_does_not():
    seen = dragged_into_the_arm(session_of("yield", UNSHIELDED, policy="random", task="home"))
    shielded, bare = seen.arms
    assert shielded.moving_contacts == 0
    assert shielded.promised
    assert bare.moving_contacts > 0
    assert not bare.promised
    assert "no verified stop" in bare.promise


def test_who_is_not_clamped_takes_the_promise_away_until_the_next_episode():
    session = session_of()
    assert session.snapshot().arms[0].promised
    session.clamp(False)
    seen = stepped(session, DT)
    assert not seen.clamped
    assert "faster" in seen.arms[0].promise
    session.drag("core_body", (0.8, 0.0))
    stepped(session, 0.5)
    session.clamp(True)
    seen = stepped(session, 1.0)
    assert not seen.arms[0].promised  # it was broken in this episode
    assert "m/s fast" in seen.arms[0].promise
    session.reset()
    assert stepped(session, DT).arms[0].promised


def test_the_clamp_is_what_the_shields_assume():
    session = session_of("yield", "jssa+stop")
    session.choose(Choices(shields=(ShieldChoice("yield", {"human_speed": 0.5, "limb_speed": 0.7}), ShieldChoice())))
    assert (session.dragged.speed, session.dragged.limb_speed) == (0.5, 0.7)
    session.drag("core_body", (0.8, 0.0))
    seen = [stepped(session, DT) for _ in range(100)]
    assert max(np.linalg.norm(one.people.start_velocity, axis=1).max() for one in seen) <= 0.5 * (1.0 + 1e-9)
    assert all(arm.promised for arm in seen[-1].arms)


def test_people_who_are_faster_than_assumed_take_the_promise_away():
    assert "are" not in session_of(human="pursuit").snapshot().arms[0].promise
    assert not session_of(human="pursuit x2").snapshot().arms[0].promised


def test_numbers_of_a_shield_can_be_changed_and_are_told():
    session = session_of("shielded", task="home")
    own = dict(session.snapshot().arms[0].numbers)
    assert own == {"lambda1": 2.0, "lambda2": 0.25, "d_min": 0.05, "human_speed": 1.6, "limb_speed": 2.0}
    changed = ShieldChoice("shielded", {"lambda1": 1.5, "human_speed": 1.2, "horizon": 0.4})
    session.choose(Choices(task="home", shields=(changed,)))
    numbers = session.snapshot().arms[0].numbers
    assert numbers == own | {"lambda1": 1.5, "human_speed": 1.2}  # it has no horizon
    session.choose(Choices(task="home", shields=(ShieldChoice("work", changed.changes),)))
    numbers = session.snapshot().arms[0].numbers
    assert numbers["horizon"] == 0.4
    assert "lambda1" not in numbers
    # the shield itself, not only what is told
    assert session.sides[0].assumed.human_speed == 1.2
    assert session.sides[0].assumed.graded


def test_the_shield_of_a_task_stays_what_it_is_where_one_number_is_changed():
    session = session_of("shielded", task="handover")
    session.choose(Choices(task="handover", shields=(ShieldChoice("shielded", {"d_min": 0.06}),)))
    side = session.sides[0]
    assert side.assumed.contact_speed_of("right_arm") == 0.1
    assert side.numbers["lambda1"] == 1.0
    assert side.numbers["d_min"] == 0.06


def test_what_cannot_be_changes_nothing():
    session = session_of("jssa+stop")
    before, number = session.choices, session.number
    impossible = ShieldChoice("jssa+stop", {"lambda1": 0.1, "lambda2": 2.0})
    for choices in (
        lambda: Choices(shields=(impossible,)),
        lambda: Choices(task="track", policy="reach-ppo"),  # trained for another task
        lambda: Choices(robot="no_such_robot"),
        lambda: Choices(task="no_such_task"),
        lambda: Choices(human="nobody of that name"),
        lambda: Choices(policy="no_such_policy"),
        lambda: Choices(shields=()),
    ):
        with pytest.raises(ParameterError):
            session.choose(choices())
    assert session.choices is before
    stepped(session, 2 * DT)
    assert session.number == number + 2


def without_goals(monkeypatch):
    def no_goal(self, *_):
        raise ParameterError("found no goal")

    monkeypatch.setattr(TASKS["reach"], "draw_goal", no_goal)


def test_a_task_that_finds_no_goal_changes_nothing(monkeypatch):
    session = session_of("yield", task="home")
    before, sides, speed = session.choices, session.sides, session.dragged.speed
    without_goals(monkeypatch)
    with pytest.raises(ParameterError, match="found no goal"):
        session.choose(Choices(task="reach", shields=(ShieldChoice("yield", {"human_speed": 0.5}),)))
    assert session.choices is before
    assert session.sides is sides
    assert session.dragged.speed == speed
    number = session.number
    stepped(session, 2 * DT)
    assert session.number == number + 2


@pytest.mark.parametrize("open_one", [UNSHIELDED, "none", "jssa_published", "ssa", "jssa"])
def test_a_saved_policy_is_never_without_a_verified_stop(open_one):
    for shields in ((ShieldChoice(open_one),), (ShieldChoice("yield"), ShieldChoice(open_one))):
        with pytest.raises(ParameterError, match="verified stop"):
            Choices(policy="reach-ppo", shields=shields)
    for whole in ("shielded", "yield", "jssa+stop", "stop"):
        assert Choices(policy="reach-ppo", shields=(ShieldChoice(whole),)).shields[0].whole


def test_every_shield_that_is_called_whole_has_a_verified_stop():
    for name in ("shielded", "yield", "jssa+stop", "stop", "jssa", "jssa_published"):
        assert (session_of(name).sides[0].assumed is not None) == ShieldChoice(name).whole


def test_the_next_episode_begins_after_success(monkeypatch):
    session = session_of()
    first = session.snapshot().arms[0].goal
    for _ in range(round(12.0 / DT)):
        session.step()
        if session.seed == 1:
            break
    assert session.seed == 1
    assert not np.array_equal(session.snapshot().arms[0].goal, first)
    again = session_of()
    again.again = False
    stepped(again, 6.0)
    assert again.seed == 0


def test_an_episode_is_kept_whole_and_mujoco_agrees(tmp_path):
    session = session_of("yield", "shielded")
    session.drag("core_body", (0.9, 0.1))
    stepped(session, 1.5)
    for trace, name in zip(session.traces(), ("yield", "shielded"), strict=True):
        assert trace.name == name
        save_trace(trace, tmp_path / f"{name}.npz")
        kept = load_trace(tmp_path / f"{name}.npz")
        assert len(kept.time) == round(1.5 / DT)
        assert judge(kept, session.robot).agrees


def test_of_a_long_episode_the_last_part_is_kept_as_if_it_began_there(monkeypatch):
    monkeypatch.setattr("jssa_gym.viewer.side.LONGEST", 50 * DT)
    session = session_of("yield")
    session.roll()
    session.drag("core_body", (0.9, 0.1))
    stepped(session, 1.0)
    (trace,) = session.cut()
    assert len(trace.time) == 50
    np.testing.assert_allclose(trace.time, DT * np.arange(1, 51))
    assert judge(trace, session.robot).agrees
    assert LONGEST / DT > 50


def test_a_film_has_the_same_length_of_every_arm():
    session = session_of("yield", "work")
    stepped(session, 0.2)
    assert session.cut() == []
    session.roll()
    assert stepped(session, 0.4).recording == pytest.approx(0.4)
    one, other = session.cut()
    assert len(one.time) == len(other.time) == 50
    assert session.snapshot().recording is None


def test_the_swept_stop_goes_from_here_to_rest_and_people_grow_by_what_they_can_move():
    robot = make_robot("lr_mate_200id_7l")
    velocity, acceleration = 0.3 * robot.limits.velocity, np.zeros(robot.n)
    state = JointState(np.array(robot.home), velocity, acceleration)
    stop, took = swept_stop(robot, state, DT)
    m = len(robot.capsules)
    assert len(stop.radius) == PLACES * m
    here = arm_capsules(robot, state)
    np.testing.assert_allclose(stop.start[:m], here.start)
    # a joint that brakes moves by less than its speed times the time
    assert 0.05 < took < 1.0
    assert not np.allclose(stop.end[-m:], here.end)
    still, none = swept_stop(robot, JointState(np.array(robot.home), acceleration, acceleration), DT)
    assert none == 0.0
    np.testing.assert_allclose(still.end[-m:], here.end)
    people = session_of().snapshot().people
    grown = reachable(people, FailsafeParams(position_error=0.01), 0.5)
    hands = np.array(["arm" in name for name in people.names])
    np.testing.assert_allclose(grown.radius - people.radius, np.where(hands, 1.01, 0.81))


def test_overlays_are_there_when_they_are_asked_for():
    session = session_of("yield", "none")
    assert stepped(session, DT).arms[0].stop is None
    session.overlays = (True, True)
    for arm in stepped(session, DT).arms:
        assert arm.stop is not None
        assert arm.reach is not None


def test_a_saved_episode_is_shown_moment_by_moment(tmp_path):
    session = session_of("yield")
    session.drag("core_body", (0.9, 0.1))
    live = [stepped(session, DT) for _ in range(60)]
    save_trace(session.traces()[0], tmp_path / "one.npz")
    saved = Playback(tmp_path / "one.npz", session.choices, session.robot)
    assert saved.length == pytest.approx(60 * DT)
    for k in (0, 17, 59):
        seen, was = saved.at((k + 1) * DT), live[k]
        assert seen.time == was.time
        np.testing.assert_array_equal(seen.arms[0].position, was.arms[0].position)
        np.testing.assert_array_equal(seen.people.start, was.people.start)
        np.testing.assert_allclose(seen.arms[0].capsules.end, was.arms[0].capsules.end, atol=1e-12)
        assert seen.arms[0].distance == was.arms[0].distance
        np.testing.assert_allclose(seen.arms[0].line, was.arms[0].line, atol=1e-9)
        assert seen.arms[0].closest == was.arms[0].closest
    assert saved.at(1e9).time == saved.length
    assert saved.at(-1.0).time == pytest.approx(DT)


def test_an_episode_of_a_robot_that_only_the_file_names_is_not_opened(tmp_path):
    session = session_of("yield")
    stepped(session, 3 * DT)
    trace = session.traces()[0]
    object.__setattr__(trace, "robot", "/tmp/some_arm.xml")
    save_trace(trace, tmp_path / "one.npz")
    with pytest.raises(ParameterError, match="--robot FILE"):
        Playback(tmp_path / "one.npz", session.choices, session.robot)


# ---- at the clock's pace -------------------------------------------------------------------------------


@pytest.fixture
def running():
    runner = Runner(session_of("yield"))
    runner.start()
    yield runner
    runner.close()


def seen_by(runner, asked):
    end = time.monotonic() + 60.0
    while runner.snapshot.answered < asked and time.monotonic() < end:
        time.sleep(0.01)
    assert runner.snapshot.answered >= asked
    return runner.snapshot


def test_commands_are_done_in_their_order_and_refusals_are_told(running):
    running.submit(lambda session: setattr(session, "paused", True))
    seen = seen_by(running, running.submit(lambda session: session.clamp(False)))
    assert seen.paused
    assert not seen.clamped
    assert seen.message == ""
    seen = seen_by(running, running.submit(lambda session: session.choose(Choices(robot="no_such_robot"))))
    assert "no_such_robot" in seen.message
    number = seen.number
    seen = seen_by(running, running.submit(lambda session: session.step()))
    assert (seen.number, seen.message) == (number + 1, "")


@pytest.mark.long
def test_steps_come_at_the_pace_that_was_asked_for(running):
    def far():
        return running.punctuality().steps > 40

    end = time.monotonic() + 60.0
    while not far() and time.monotonic() < end:
        time.sleep(0.05)
    told = running.punctuality()
    assert told.steps > 40
    assert told.rate <= 1.2  # never faster than the clock
    assert 0.0 <= told.late_median <= told.late_p99 <= told.late_most
    before, begin = running.snapshot.number, time.monotonic()
    running.submit(lambda session: setattr(session, "factor", 0.1))
    time.sleep(1.0)
    slow = (running.snapshot.number - before) * DT / (time.monotonic() - begin)
    assert slow < 0.3


def test_a_session_that_breaks_says_so_and_stops(running, caplog):
    def broken(session):
        raise RuntimeError("something gave way")

    running.submit(broken)
    end = time.monotonic() + 60.0
    while running.failure is None and time.monotonic() < end:
        time.sleep(0.01)
    assert "something gave way" in running.snapshot.message
    assert running.snapshot.paused


def test_an_episode_that_cannot_begin_is_told_and_waits(running, monkeypatch):
    def no_goal(self):
        raise ParameterError("found no goal")

    monkeypatch.setattr(Session, "step", no_goal)
    end = time.monotonic() + 60.0
    while not running.snapshot.message and time.monotonic() < end:
        time.sleep(0.01)
    assert (running.snapshot.message, running.snapshot.paused) == ("found no goal", True)
    assert running.failure is None
    monkeypatch.undo()
    running.submit(lambda session: setattr(session, "paused", False))
    number = running.snapshot.number
    while running.snapshot.number <= number and time.monotonic() < end:
        time.sleep(0.01)
    assert running.snapshot.number > number


def test_what_is_asked_while_too_many_wait_is_forgotten():
    runner = Runner(session_of("yield"))  # nobody does anything
    asked = [runner.submit(lambda session: None) for _ in range(1500)]
    assert asked[999] == asked[-1] == 1000
    runner.close()
