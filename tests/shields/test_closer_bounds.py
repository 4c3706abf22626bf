"""Speeds by end and accelerations: a filter's verified stop lets pass what they say, and no more."""

import json

import gymnasium as gym
import numpy as np
import pytest
import reference as ref

import jssa_gym
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS, Body, Hand, HumanMotion, Receive, Recorded, Recording, Steered
from jssa_gym.humans.body import NAMES
from jssa_gym.safety.failsafe import ARM_SPEEDS, LEG_SPEEDS, FailsafeParams
from jssa_gym.shields import NoFilter
from jssa_gym.shields import people as told_of
from jssa_gym.tick import layout
from jssa_gym.tick.assumed import assume
from jssa_gym.types import CapsuleSet, Status

DT = 0.008
PARAMS = FailsafeParams()
ENDS = FailsafeParams(end_speeds={"left_arm": (0.5, 2.0), "right_arm": (0.1, 0.1)})

CHAIN = [ref.lr_mate_chain()[0]._replace(offset=np.array([0.0, 0.0, 0.330 + 0.87])), *ref.lr_mate_chain()[1:]]
TIP = ref.point(CHAIN, np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0]), 5, (0.16, 0.0, 0.0))
"""The lowest end of the wrist's axis at home [m]; the wrist points down."""


def rejected_limb(robot, make_scene, params, end, distance, *, age=0.0, lied=False):
    """Whether a slow step is overruled, of an arm whose ``end`` (0 start, 1 end) is is before the tool; seen twice."""
    state, away = np.array([robot.home, np.zeros(6), np.zeros(6)]), np.array([0.0, 0.0, 0.0])
    tip, far = TIP + np.array([0.06 + 0.1 + distance, 0.0, 0.0]), np.array([3.0, 0.0, 0.0])
    ends = np.array([[tip], [tip + far]])[:: 1 if end == 0 else -1]
    human = CapsuleSet(*ends, *np.tile(away, (2, 1, 1)), np.array([0.1]), ("left_arm",), np.zeros(1, np.int64))
    filter = NoFilter(robot, DT, viability=True, failsafe=params)
    filter.reset(make_scene(state, human))
    filter.decide(make_scene(state, human), np.zeros(6))
    nominal = np.zeros(6)
    nominal[1] = 0.02 * robot.limits.jerk[1]
    scene = make_scene(state, human, time=DT)._replace(age=np.array([age]))
    if lied:
        way = np.array([0.0, DT, 0.0])
        scene = scene._replace(human=human._replace(start=human.start + way, end=human.end + way))
    decision = filter.decide(scene, nominal)
    assert decision.status in (Status.NOMINAL, Status.FAILSAFE)
    if decision.status == Status.FAILSAFE:
        assert decision.reason.startswith("left_arm can reach ")
    return decision.status == Status.FAILSAFE


def limb_edge(robot, make_scene, params, end, **options):
    low, high = 0.0, 2.0
    for _ in range(14):
        middle = (low + high) / 2.0
        rejected = rejected_limb(robot, make_scene, params, end, middle, **options)
        low, high = (middle, high) if rejected else (low, middle)
    return high


def test_each_end_of_a_limb_comes_as_fast_as_its_own_bound(robot, make_scene):
    both = limb_edge(robot, make_scene, PARAMS, 0)
    assert limb_edge(robot, make_scene, ENDS, 1) == pytest.approx(both, abs=1e-3)
    # the piece of the shoulder ends a quarter of the way to the hand
    slow = limb_edge(robot, make_scene, ENDS, 0)
    assert slow == pytest.approx(both * (0.5 + 1.5 / 4) / 2.0, abs=2e-3)
    reverse = FailsafeParams(end_speeds={"left_arm": (2.0, 0.5)})
    assert limb_edge(robot, make_scene, reverse, 1) == pytest.approx(slow, abs=1e-3)
    assert limb_edge(robot, make_scene, reverse, 0) == pytest.approx(both, abs=1e-3)
    late = limb_edge(robot, make_scene, ENDS, 0, age=0.0) + 0.1 * (0.5 + 1.5 / 4)
    lagging = FailsafeParams(end_speeds={"left_arm": (0.5, 2.0)}, actuation_lag=0.1)
    assert limb_edge(robot, make_scene, lagging, 0) == pytest.approx(late, abs=2e-3)


def test_an_acceleration_bound_moves_the_edge_by_what_it_says(robot, make_scene):
    fast = limb_edge(robot, make_scene, PARAMS, 0)
    time = fast / 2.0
    for bound, off, lag in ((4.0, 0.0, 0.0), (4.0, 0.3, 0.0), (4.0, 0.1, 0.05), ({"left_arm": 4.0}, 0.0, 0.0)):
        params = FailsafeParams(human_acceleration=bound, velocity_error=off, actuation_lag=lag)
        expected = off * (time + lag) + 4.0 * (time + lag) ** 2 / 2.0
        assert limb_edge(robot, make_scene, params, 0) == pytest.approx(expected, abs=2e-3)
    # of another part it says nothing; nor of one that moves though it says that it stands
    other = FailsafeParams(human_acceleration={"head": 4.0})
    assert limb_edge(robot, make_scene, other, 0) == pytest.approx(fast, abs=1e-3)
    bounded = FailsafeParams(human_acceleration=4.0)
    assert limb_edge(robot, make_scene, bounded, 0, lied=True) == pytest.approx(fast, abs=2e-3)


def test_without_closer_bounds_nothing_is_confined(robot):
    filter = NoFilter(robot, DT, failsafe=PARAMS)
    assumed = filter.assumed(("head", "left_arm"))
    np.testing.assert_array_equal(assumed.speed, [[1.6, 1.6], [2.0, 2.0]])
    np.testing.assert_array_equal(assumed.growth, assumed.speed)
    np.testing.assert_array_equal(assumed.acceleration, [0.0, 0.0])
    memory = layout.memory(3, 6, 2, 0, 0)
    assume(memory, assumed)
    np.testing.assert_array_equal(memory.growth, [[1.6, 2.0]] * 3)
    assert not memory.tracks["slower"].any()
    assume(memory, NoFilter(robot, DT, failsafe=ENDS).assumed(("head", "left_arm")))
    np.testing.assert_allclose(memory.tracks["slower"], [[[0.0, 0.0], [1.5, 0.0]]] * 3)


# ---- feet that swing ------------------------------------------------------------------------------------


@pytest.fixture
def untold():
    """Nothing has been said of anybody yet."""
    told_of.say_once.cache_clear()


def walker(names=NAMES, fastest=3.5):
    """Somebody who walks past; the right foot swings at up to ``fastest`` m/s, the hip does not."""
    time, body = np.linspace(0.0, 4.0, 201), Body.facing()
    root = np.array([1.8, -2.0, 0.0]) + 1.0 * time[:, None] * np.array([0.0, 1.0, 0.0])
    start, end = root[:, None] + body.start, root[:, None] + body.end
    end[:, 4, 1] += (fastest - 1.0) / 8.0 * np.sin(8.0 * time)
    return Recorded(Recording(time, start, end, body.radius, names), turn=(0.0, 0.0), offset=((0.0, 0.0), (0.0, 0.0)))


FOOT = tuple("right_foot" if name == "right_leg" else name for name in NAMES)


@pytest.mark.parametrize(
    ("names", "params", "believed"),
    [
        (NAMES, PARAMS, False),
        (FOOT, PARAMS, True),
        (FOOT, FailsafeParams(foot_speed=1.7), False),
        (NAMES, FailsafeParams(end_speeds=LEG_SPEEDS), True),
        (NAMES, FailsafeParams(end_speeds={"right_leg": (4.8, 1.6)}), False),
    ],
    ids=["a leg", "a foot", "a slow foot", "a leg by its ends", "upside down"],
)
def test_feet_that_swing_are_believed_if_they_are_said_to_be_feet(names, params, believed, untold, caplog):
    """Or else they are no feet: said at once, and then by faults."""
    env = jssa_gym.Shield(gym.make("jssa_gym/Home-v0", human=walker(names), terminate_on=()), "none", stop=params)
    assert caplog.text.count("m/s is assumed") == (not believed)
    if not believed:
        assert f"{names[4]} moves at 3.5 m/s, {params.end_speeds_of(names[4])[1]:g} m/s is assumed" in caplog.text
    _, info = env.reset(seed=0)
    told = []
    for _ in range(250):
        *_, info = env.step(np.zeros(6))
        told.append(info["shield/status"])
    assert (told.count(Status.FAULT) == 0) == believed


@pytest.mark.parametrize(("speed", "stop", "told"), [(3.0, True, True), (3.0, False, False), (2.0, True, False)])
def test_people_who_are_too_fast_are_told_of_when_a_verified_stop_is_built(speed, stop, told, untold, caplog):
    env = gym.make("jssa_gym/Home-v0", human=["walk_by", walker(FOOT), Hand(speed=(1.0, speed))])
    for _ in range(2):
        jssa_gym.Shield(env, "jssa", stop=stop)
    assert ("people may move at 3 m/s, 2 m/s is assumed" in caplog.text) == told
    assert caplog.text.count("m/s is assumed") == told


class Stroller(HumanMotion):
    """Says how fast it is, or nothing; the names of its capsules are the user's own."""

    def __init__(self, names=("Left_Hand", "RightFoot"), speed=None, acceleration=None):
        self.names = names
        if speed is not None:
            self.speed_bound = speed
        if acceleration is not None:
            self.acceleration = acceleration

    def reset(self, rng, start=None, person=0):
        ends, n = np.tile([2.0, 0.0, 1.0], (len(self.names), 1)), len(self.names)
        still = np.zeros((n, 3))
        return CapsuleSet(ends, ends, still, still, np.full(n, 0.1), self.names, np.full(n, person))

    def step(self, dt, robot):
        return self.reset(None)


def shielded(human, params=PARAMS):
    env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
    return jssa_gym.Shield(env, "none", stop=params)


@pytest.mark.parametrize(
    ("human", "told"),
    [
        (Stroller(speed=4.0), "people may move at 4 m/s, 2 m/s is assumed"),
        (Stroller(speed=2.0), ""),
        (Stroller(("RightFoot",), speed=4.0), ""),
        (Stroller((*NAMES, "RightFoot"), speed=1.7), "people may move at 1.7 m/s, 1.6 m/s is assumed"),
        (Receive(speed=(0.5, 2.0)), ""),
        (Receive(speed=(0.5, 2.1)), "people may move at 2.1 m/s, 2 m/s is assumed"),
        (Steered([[1.0, 0.0, 1.0]], limb_speed=2.0), ""),
        (Steered([[1.0, 0.0]], speed=1.9), "people may move at 1.9 m/s, 1.6 m/s is assumed"),
        (Steered([[1.0, 0.0, 1.0]], speed=1.9), "people may move at 1.9 m/s, 1.6 m/s is assumed"),
    ],
)
def test_people_whose_parts_nobody_tells_apart_are_as_fast_as_the_slowest_may_be(human, told, untold, caplog):
    shielded([human, "walk_by"])
    assert caplog.text.count("is assumed") == bool(told)
    assert told in caplog.text


def test_nothing_is_said_of_this_packages_people(untold, caplog):
    for params in (PARAMS, FailsafeParams(end_speeds=ARM_SPEEDS, human_acceleration={"head": 5.0, "core_body": 5.0})):
        for name in HUMANS:
            shielded(name, params).reset(seed=0)
    assert caplog.text == ""


@pytest.mark.parametrize("speed", [None, 0.0, float("nan"), "fast"])
def test_people_of_no_speed_are_told_of_once(speed, untold, caplog):
    for _ in range(2):
        shielded(Stroller(speed=speed))
    assert caplog.text.count("Stroller does not say how fast its people are") == 1
    assert "is assumed" not in caplog.text


@pytest.mark.parametrize(
    ("human", "bound", "told"),
    [
        ("pursuit", 4.0, "head may change its velocity at 5 m/s², 4 m/s² is assumed"),
        ("pursuit", 5.0, ""),
        ("pursuit", None, ""),
        ("hand", 4.0, "left_arm may change its velocity at 30 m/s², 4 m/s² is assumed"),
        ("hand", {"head": 4.0}, ""),
        (Receive(acceleration=None), {"RIGHT_ARM": 40.0}, "right_arm may change its velocity at inf m/s²"),
        (Steered([[1.0, 0.0, 1.0]]), {"right_arm": 37.0}, "right_arm may change its velocity at 38 m/s²"),
        (Stroller(speed=1.0, acceleration=9.0), 8.0, "RightFoot may change its velocity at 9 m/s²"),
        (Stroller(speed=1.0, acceleration="much"), 8.0, ""),
    ],
)
def test_people_who_may_accelerate_faster_are_told_of_once(human, bound, told, untold, caplog):
    for _ in range(2):
        shielded(human, FailsafeParams(human_acceleration=bound))
    assert len(caplog.records) == bool(told)
    assert told in caplog.text


def test_names_that_nobody_has_are_told_of_once(untold, caplog):
    params = FailsafeParams(
        end_speeds={"left_amr": (1.6, 2.0), "Right_Arm": (1.6, 2.0)},
        human_acceleration={"head": 3.0},
        contact_speed={"tail": 0.1, "fin": 0.1},
    )
    shielded("none", params).reset(seed=0)
    assert caplog.text == ""
    env = shielded("walk_by", params)
    for _ in range(3):
        env.reset(seed=0)
    assert len(caplog.records) == 1
    told = "FailsafeParams: end_speeds names 'left_amr'; contact_speed names 'tail', 'fin', which no capsule is called"
    assert told in caplog.text


def test_bounds_by_name_count_in_any_case():
    params = FailsafeParams(
        end_speeds={"Left_ARM": (0.5, 1.0)}, human_acceleration={"HEAD": 3.0}, contact_speed={"left_arm": 0.1}
    )
    assert params.end_speeds_of("left_arm") == params.end_speeds_of("LEFT_ARM") == (0.5, 1.0)
    assert params.acceleration_of("Head") == 3.0
    assert params.contact_speed_of("Left_Arm") == 0.1
    assert params.end_speeds_of("right_arm") == (2.0, 2.0)
    for field, value in (("end_speeds", (1.0, 1.0)), ("human_acceleration", 1.0), ("contact_speed", 1.0)):
        with pytest.raises(ParameterError, match=f"{field} has to name each body part once"):
            FailsafeParams(**{field: {"head": value, "Head": value}})


def test_bounds_by_end_survive_json():
    values = {"end_speeds": dict(ARM_SPEEDS), "human_acceleration": {"head": 3.0}, "velocity_error": 0.1}
    assert FailsafeParams.of(json.loads(json.dumps(values))) == FailsafeParams(**values)
