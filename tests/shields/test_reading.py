"""What scenes, filters and copies of others do to a shield that reads them."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from strollers import ball

import jssa_gym
from jssa_gym.humans import together
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.projectors import OSQPProjector
from jssa_gym.shields import JSSAFilter, NoFilter, StopFilter, make_filter
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.tick import loop
from jssa_gym.tick.move import move
from jssa_gym.types import Decision, Status

DT = 0.008


class Unspeakable(Exception):
    """An error that does not say what it is."""

    def __str__(self):
        raise RuntimeError("even this")


class Torn:
    """People of whom some parts raise when they are looked at."""

    def __init__(self, people, error):
        self.people, self.error = people, error

    def __getattr__(self, name):
        if name == "radius":
            raise self.error
        return getattr(self.people, name)

    def __iter__(self):
        raise self.error


def at_rest(robot):
    return np.array([robot.home, np.zeros(robot.n), np.zeros(robot.n)])


@pytest.mark.parametrize("error", [TimeoutError("late"), Unspeakable(), ValueError()], ids=["slow", "mute", "empty"])
def test_ticks_whose_people_cannot_be_read_count_as_ticks(robot, make_scene, error):
    """Else a scene that is late for good would seem to catch up by one tick in each of them."""
    believed = {}
    for torn in (0, 12):
        filter, state = make_filter("stop", robot, DT, failsafe=FailsafeParams()), at_rest(robot)
        filter.reset(make_scene(state, ball([2.0, 0.0, 1.2])))
        believed[torn] = 0
        for k in range(120):
            late = 8 if k >= 3 else 0
            scene = make_scene(state, ball([2.0 - 1e-4 * k, 0.0, 1.2]), time=(k - late) * DT)
            if 20 <= k < 20 + torn:
                scene = scene._replace(human=Torn(scene.human, error))
            decision = filter.decide(scene, np.zeros(robot.n))
            believed[torn] += decision.status != Status.FAULT
            assert k < 20 or k >= 20 + torn or decision.status == Status.FAULT
    assert believed[0] == believed[12] == 3


@pytest.mark.parametrize("part", ["human", "robot", "static"])
@pytest.mark.parametrize("failsafe", [None, FailsafeParams()])
def test_errors_that_do_not_say_what_they_are_are_faults(robot, make_scene, part, failsafe):
    scene = make_scene(at_rest(robot), ball([2.0, 0.0, 1.2]))
    filter = make_filter("none", robot, DT, failsafe=failsafe)
    torn = scene._replace(**{part: Torn(scene.human, Unspeakable())})
    filter.reset(torn)
    filter.reset(scene)
    decision = filter.decide(torn, np.zeros(robot.n))
    if part != "static" or failsafe is not None:
        assert decision.status == Status.FAULT
    assert "control step failed" not in decision.reason


def test_a_filter_that_raises_what_cannot_be_said_brakes(robot, make_scene):
    class Mute(NoFilter):
        def respond(self, tick):
            raise Unspeakable

    scene = make_scene(at_rest(robot))
    for failsafe in (None, FailsafeParams()):
        filter = Mute(robot, DT, failsafe=failsafe)
        filter.reset(scene)
        assert filter.decide(scene, np.zeros(robot.n)).reason == "the filter failed: Unspeakable: Unspeakable"


def test_who_was_seen_is_not_forgotten_for_a_clock_that_was_none(robot, make_scene):
    two = together([ball([2.0, 0.0, 1.2]), ball([3.0, 0.0, 1.2])])
    filter, state = make_filter("stop", robot, DT), at_rest(robot)
    filter.reset(make_scene(state, two))
    assert filter.decide(make_scene(state, two, time=np.nan), np.zeros(robot.n)).status == Status.FAULT
    for k in (1, 2, 3):
        alone = make_scene(state, ball([2.0, 0.0, 1.2]), time=k * DT)
        assert "1 capsules instead of 2" in filter.decide(alone, np.zeros(robot.n)).reason
    assert filter.decide(make_scene(state, two, time=4 * DT), np.zeros(robot.n)).status == Status.NOMINAL


@pytest.mark.parametrize("name", ["stop", "jssa", "none"])
@pytest.mark.parametrize("failsafe", [None, FailsafeParams()])
def test_a_filter_that_was_never_reset_decides(robot, make_scene, name, failsafe):
    filter = make_filter(name, robot, DT, failsafe=failsafe)
    for k in range(3):
        scene = make_scene(at_rest(robot), ball([2.0, 0.0, 1.2]), time=k * DT)
        assert filter.decide(scene, np.zeros(robot.n)).status == Status.NOMINAL


@pytest.mark.parametrize("again", [copy.deepcopy, lambda thing: pickle.loads(pickle.dumps(thing))])
def test_copies_have_nothing_to_compile(again):
    """Half a minute in the middle of an episode would be no control step."""
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="walk_by"))
    env.reset(seed=0)
    env.step(np.zeros(6))
    compiled = loop.decide_all, loop.start, move
    before = [len(kernel.signatures) for kernel in compiled]
    other = again(env)
    other.step(np.zeros(6))
    other.reset(seed=0)
    assert [len(kernel.signatures) for kernel in compiled] == before


@pytest.mark.parametrize("name", ["_filter", "_amended", "_respond", "_foresee", "_coefficients"])
@pytest.mark.parametrize("kind", [NoFilter, StopFilter, JSSAFilter, PairFilter, jssa_gym.SafetyFilter])
def test_what_filters_implemented_before_is_not_passed_over_in_silence(kind, name):
    with pytest.raises(TypeError, match=f"Mine.{name} would never be asked: a filter implements"):
        type("Mine", (kind,), {name: lambda *_: None})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("viability", True),
        ("failsafe", None),
        ("static_rows", True),
        ("gradient", "printed"),
        ("recovery", 0.0),
        ("projector", OSQPProjector(6)),
    ],
)
def test_how_a_filter_looks_after_an_arm_is_fixed(robot, name, value):
    filter = JSSAFilter(robot, DT)
    with pytest.raises(AttributeError, match=f"{name} of a filter is fixed when it is made"):
        setattr(filter, name, value)
    copy.deepcopy(filter)


def test_a_projector_that_is_asked_can_be_replaced(robot):
    filter = JSSAFilter(robot, DT, projector="osqp")
    filter.projector = other = OSQPProjector(robot.n)
    assert filter.projector is other


@pytest.mark.parametrize("changes", [{"rows": None}, {"rows": "x"}, {"rows": 10**30}, {"pair": (10**30, 0)}], ids=repr)
def test_numbers_that_are_none_are_no_answer(robot, make_scene, changes):
    class Odd(jssa_gym.SafetyFilter):
        def respond(self, tick):
            decision = Decision(tick.clipped, tick.nominal, Status.NOMINAL, "", 0.0, 1.0, (0, 0), 0.0, 0)
            return decision._replace(**changes)

    filter, scene = Odd(robot, DT, failsafe=FailsafeParams()), make_scene(at_rest(robot))
    filter.reset(scene)
    decision = filter.decide(scene, np.zeros(robot.n))
    assert decision.status == Status.FAULT
    assert decision.reason.startswith("the filter failed: ")


def test_what_fails_after_the_decision_takes_no_second_tick_of_the_stop(robot, make_scene, monkeypatch, caplog):
    filter, state = make_filter("stop", robot, DT), at_rest(robot)
    filter.reset(make_scene(state))
    nominal = 0.3 * np.array(robot.limits.jerk)
    monkeypatch.setattr(filter, "_answer", lambda *_: 1 / 0)
    decision = filter.decide(make_scene(state), nominal)
    assert decision.status == Status.FAULT
    # what was decided is what the arm does, and what is expected of it
    np.testing.assert_array_equal(decision.jerk, nominal)
    assert filter.records.memory.arm[0]["step"] == 0
    np.testing.assert_allclose(filter.expected[2], DT * nominal, rtol=1e-12)


def test_what_fails_after_the_decision_reckons_the_arm_on_by_one_tick_only(robot, make_scene, monkeypatch, caplog):
    filter, state = NoFilter(robot, DT), at_rest(robot)
    state[1] = 0.1
    filter.reset(make_scene(state))
    monkeypatch.setattr(filter, "_answer", lambda *_: 1 / 0)
    assert filter.decide(make_scene(state)._replace(robot=None), np.zeros(robot.n)).status == Status.FAULT
    np.testing.assert_allclose(filter.records.memory.state[0, 0], robot.home + DT * 0.1, rtol=0.0, atol=1e-12)
