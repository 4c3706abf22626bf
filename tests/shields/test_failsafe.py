"""The verified stop in a filter: what is applied, what goes on when something fails, and that the arm comes to rest."""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest
import reference as ref
from monitors import Unsolvable, forget_people, step_of, stored
from places import environment
from strollers import ball

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, nobody, together
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.kernels.stopping import stop_jerk
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.projectors import Projection
from jssa_gym.safety.proximity import measure
from jssa_gym.shields import FILTERS, JSSAFilter, JSSAShield, NoFilter, SafetyFilter, Shield, make_filter
from jssa_gym.shields.reasons import SAMPLES
from jssa_gym.types import CapsuleSet, Decision, JointState, Planes, Status

DT = 0.008
TABLE = 0.87
LONGEST = 1.2
"""No stop of this arm takes longer [s]: 0.86 s from full speed, 1.03 s from full acceleration besides."""


@pytest.fixture(params=[1, pytest.param(25, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


FAR = ball([3.0, 0.0, 1.2])

CHAIN = [ref.lr_mate_chain()[0]._replace(offset=np.array([0.0, 0.0, 0.330 + TABLE])), *ref.lr_mate_chain()[1:]]
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
TIP = ref.point(CHAIN, HOME, 5, (0.16, 0.0, 0.0))
"""The lowest end of the wrist's axis at home [m]; the wrist points down."""


class Arm:
    """An arm that does exactly what a filter says, and what the filter has promised to do next."""

    def __init__(self, filter, make_scene, state=None, human=FAR):
        self.filter, self.make_scene, self.human = filter, make_scene, human
        self.robot = filter.robot
        rest = [self.robot.home, np.zeros(6), np.zeros(6)]
        self.state = np.array(rest if state is None else state, float)
        self.time = 0.0
        self.bounds = np.array(
            [*self.robot.limits.position.T, self.robot.limits.velocity, self.robot.limits.acceleration,
             self.robot.limits.jerk]
        )  # fmt: skip
        filter.reset(self.scene())

    def surprise(self, human):
        """Somebody is there who was not there before: a change that nobody who is remembered can make."""
        self.human = human
        forget_people(self.filter)

    def scene(self, **changes):
        return self.make_scene(self.state, self.human, time=self.time)._replace(**changes)

    @property
    def tail(self):
        """The next jerk of the stored stop."""
        jerk = np.zeros(6)
        stop_jerk(stored(self.filter), step_of(self.filter), jerk)
        return jerk

    @property
    def left(self) -> int:
        """Ticks until the stored stop's end."""
        lengths = (s["ramp"] + s["hold"] + s["release"] for s in stored(self.filter))
        return int(max(0, max(lengths) - step_of(self.filter)))

    def move(self, jerk):
        integrate(self.state, jerk, DT, self.state)
        self.time += DT

    def step(self, nominal, scene=None, **changes) -> Decision:
        scene = self.scene(**changes) if scene is None else scene
        decision = self.filter.decide(scene, np.array(nominal, float))
        assert np.all(np.isfinite(decision.jerk))
        self.move(decision.jerk)
        return decision

    def get_going(self, seconds=0.2, share=0.4, seed=0) -> "Arm":
        """Until all joints move well."""
        rng = np.random.default_rng(seed)
        nominal = share * rng.choice([-1.0, 1.0], 6) * self.robot.limits.jerk
        for _ in range(round(seconds / DT)):
            assert self.step(nominal).status != Status.FAULT
        assert np.abs(self.state[1]).min() > 0.05
        return self

    def inside(self):
        return not violates(self.state, np.zeros(6), self.bounds, 1e-9)

    def at_rest(self):
        return np.abs(self.state[1:]).max() < 1e-6


PARAMS = FailsafeParams()


def plain(robot, params=PARAMS) -> SafetyFilter:
    return NoFilter(robot, DT, viability=True, failsafe=params)


def jssa(robot, params=PARAMS, **options) -> SafetyFilter:
    return JSSAFilter(robot, DT, viability=True, failsafe=params, **options)


def named(name):
    return lambda robot, params=PARAMS: make_filter(name, robot, DT, viability=True, failsafe=params)


KINDS = {"none": plain, "jssa": jssa, **{name: named(name) for name in FILTERS if name not in ("none", "jssa")}}
DRIVEN = {name: build for name, build in KINDS.items() if name != "ssm"}
"""Filters that go on where the verified stop has to overrule them; "ssm" stops by itself before."""


def share(robot, jerk):
    """What an environment makes of a jerk: a share of the bound, times the bound."""
    return jerk / robot.limits.jerk * robot.limits.jerk


def nominals(kind, robot, rng):
    """Endless nominal jerks of a policy that means no good."""
    jerk, held = robot.limits.jerk, np.zeros(6)
    k = 0
    while True:
        if kind == "random":
            held = rng.uniform(-1.5, 1.5, 6) * jerk
        elif kind == "bang-bang":
            if k % 20 == 0:
                held = rng.choice([-1.0, 1.0], 6) * jerk
        elif k % 80 == 0:  # limit-seeking
            held = rng.choice([-1.0, 0.0, 1.0], 6) * jerk
        k += 1
        yield held


class Teleporting:
    """Capsules whose ends leap about as far as the bounds let them, towards the arm at last; velocities are lies."""

    def __init__(self, rng, params=PARAMS, home=(0.75, 0.0, 1.2)):
        self.rng, self.params = rng, params
        names = ("core_body", "left_arm", "head")
        self.ends = np.array(home) + rng.normal(size=(2, 3, 3)) * 0.6
        self.speed = np.array([params.speed_of(name) for name in names])
        self.names, self.radius = names, np.array([0.2, 0.06, 0.1])
        self.aim = self.ends.copy()

    def move(self):
        if self.rng.random() < 0.02:
            self.aim = np.array([0.5, 0.0, 1.2]) + self.rng.normal(size=(2, 3, 3)) * self.rng.choice([0.2, 1.0])
        way = self.aim - self.ends + self.rng.normal(size=(2, 3, 3)) * 0.01
        length = np.linalg.norm(way, axis=2, keepdims=True)
        most = self.speed[None, :, None] * DT
        self.ends += way * np.minimum(1.0, most / np.maximum(length, 1e-12))
        rate = self.rng.uniform(-2.0, 2.0, (2, 3, 3))
        return CapsuleSet(*self.ends.copy(), *rate, self.radius, self.names, np.zeros(3, np.int64))


# ---- what it promises ----------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("policy", ["random", "bang-bang", "limit-seeking"])
@pytest.mark.parametrize("kind", KINDS)
def test_limits_stops_and_touches_whatever_anybody_does(robot, make_scene, kind, policy, times):
    """From rest: limits kept, a stop always stored, its jerk applied bit for bit, and only a resting arm is touched."""
    rng = np.random.default_rng([len(kind), len(policy)])
    seen, touched, halved = set(), 0, 0
    for _ in range(2 * times):
        people = Teleporting(rng)
        arm = Arm(KINDS[kind](robot), make_scene, human=people.move())
        policy_jerk = nominals(policy, robot, rng)
        for k in range(500):
            arm.human = people.move()
            tail, left = arm.tail, arm.left
            wanted = next(policy_jerk)
            decision = arm.step(wanted)
            seen.add(decision.status)
            assert decision.status != Status.FAULT, decision.reason
            if decision.status == Status.FAILSAFE:
                assert decision.reason
                if step_of(arm.filter):
                    np.testing.assert_array_equal(decision.jerk, tail)
                    assert arm.left == max(left - 1, 0)
                else:
                    halved += 1
                    if kind == "none":
                        proposal = np.clip(wanted, arm.filter.lower, arm.filter.upper)
                        if np.any(proposal != wanted):
                            proposal = share(robot, proposal)
                        # whole or half way; all joints, or those alone that carry what is in the way
                        spared = [share(robot, np.concatenate([tail[:k], proposal[k:]])) for k in range(1, 6)]
                        half = [share(robot, (tail + jerk) / 2.0) for jerk in (proposal, *spared)]
                        assert any(np.array_equal(decision.jerk, jerk) for jerk in (*spared, *half))
            if decision.status == Status.NOMINAL:
                np.testing.assert_array_equal(decision.jerk, wanted)
            assert arm.inside()
            assert np.all(np.abs(decision.jerk) <= robot.limits.jerk * (1.0 + 1e-9))
            near = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
            assert near.contact_speed < 1e-5
            touched += near.smallest < 0.0
            if k % 25 == 0:
                state, jerk, step = arm.state.copy(), np.zeros(6), step_of(arm.filter)
                np.testing.assert_allclose(state, arm.filter.expected, atol=1e-12)
                for tick in range(step, step + arm.left):
                    stop_jerk(stored(arm.filter), tick, jerk)
                    integrate(state, jerk, DT, state)
                    assert not violates(state, jerk, arm.bounds, 1e-9)
                assert np.abs(state[1:]).max() < 1e-9
                assert arm.left * DT < LONGEST
    assert touched
    if kind in DRIVEN:
        assert Status.FAILSAFE in seen
        assert halved
    assert seen & {Status.PROJECTED, Status.RELAXED} or (kind in ("none", "stop") and policy != "random")


@pytest.mark.parametrize("policy", ["random", "bang-bang", "limit-seeking"])
def test_the_viability_box_alone_keeps_the_limits(robot, make_scene, policy):
    filter = NoFilter(robot, DT, viability=True)
    rng, state = np.random.default_rng(1), np.array([robot.home, np.zeros(6), np.zeros(6)])
    bounds = np.array([*robot.limits.position.T, robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk])
    policy_jerk, share = nominals(policy, robot, rng), np.zeros(3)
    for _ in range(250):
        decision = filter.decide(make_scene(state), next(policy_jerk))
        integrate(state, decision.jerk, DT, state)
        assert not violates(state, decision.jerk, bounds, 1e-6)
        share = np.maximum(share, [np.abs(state[k] / bounds[k + 1]).max() for k in range(3)])
    assert share[2] > 0.5
    # without the box the same policy does not
    state, policy_jerk = np.array([robot.home, np.zeros(6), np.zeros(6)]), nominals("limit-seeking", robot, rng)
    filter, broken = NoFilter(robot, DT), False
    for _ in range(250):
        integrate(state, filter.decide(make_scene(state), next(policy_jerk)).jerk, DT, state)
        broken = broken or violates(state, np.zeros(6), bounds, 1e-6)
    assert broken


def test_without_the_verified_stop_the_same_people_are_hit(robot, make_scene):
    rng = np.random.default_rng(0)
    hit = 0.0
    for _ in range(3):
        people = Teleporting(rng)
        arm = Arm(NoFilter(robot, DT, viability=True), make_scene, human=people.move())
        policy_jerk = nominals("bang-bang", robot, rng)
        for _ in range(300):
            arm.human = people.move()
            arm.step(next(policy_jerk))
            near = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
            hit = max(hit, near.contact_speed)
    assert hit > 0.2


@pytest.mark.sampled(5)
@pytest.mark.parametrize("kind", DRIVEN)
@pytest.mark.parametrize("seed", range(4))
def test_what_is_rejected_for_good_rests_within_the_stop_and_stays(robot, make_scene, kind, seed):
    arm = Arm(KINDS[kind](robot), make_scene).get_going(0.15 + 0.05 * seed, seed=seed)
    everywhere = ball([3.0, 0.0, 1.2], radius=4.0)
    length, start = arm.left, arm.tail
    assert length > 5
    arm.surprise(everywhere)
    decision = arm.step(robot.limits.jerk)
    np.testing.assert_array_equal(decision.jerk, start)
    for k in range(1, length + 60):
        tail = arm.tail
        decision = arm.step(np.random.default_rng(k).uniform(-1.0, 1.0, 6) * robot.limits.jerk)
        assert decision.status == Status.FAILSAFE
        assert "can reach" in decision.reason or "joint limits" in decision.reason
        np.testing.assert_array_equal(decision.jerk, tail)
        assert arm.inside()
        if k >= length - 1:
            assert arm.at_rest()
            if k >= length:
                np.testing.assert_array_equal(decision.jerk, np.zeros(6))


@pytest.mark.parametrize("kind", DRIVEN)
def test_who_touches_a_resting_arm_holds_it_until_gone(robot, make_scene, kind):
    arm = Arm(KINDS[kind](robot), make_scene, human=ball(TIP, 0.1))
    near = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
    assert near.smallest < 0.0
    nominal = 0.2 * robot.limits.jerk
    for _ in range(30):
        decision = arm.step(nominal)
        np.testing.assert_array_equal(decision.jerk, np.zeros(6))
        assert decision.status == Status.FAILSAFE
    # the same without a wish is nobody's intervention, but for rows
    arm.filter.reset(arm.scene())
    if kind == "none":
        assert arm.step(np.zeros(6)).status == Status.NOMINAL
    assert arm.at_rest()
    for k in range(250):
        arm.human = ball(TIP + np.array([1.5 * DT * k, 0.0, 0.0]), 0.1, velocity=(1.5, 0.0, 0.0))
        decision = arm.step(nominal if arm.at_rest() else -arm.state[2] / DT * 0.1)
        if decision.status == Status.NOMINAL and not arm.at_rest():
            break
    else:
        pytest.fail("the arm never moved again")


# ---- faults ----------------------------------------------------------------------------------------------


def _human(scene, **changes):
    return scene._replace(human=scene.human._replace(**changes))


def _robot(scene, **changes):
    return scene._replace(robot=scene.robot._replace(**changes))


class Cursed:
    def __getattr__(self, name):
        raise ConnectionError("unplugged")


NAN3 = np.full((1, 3), np.nan)

FAULTS = {
    "no scene": (lambda s: None, "no scene"),
    "cursed scene": (lambda s: Cursed(), "unplugged"),
    "NaN position": (lambda s: _robot(s, position=np.full(6, np.nan)), "joint state"),
    "NaN in one velocity": (lambda s: _robot(s, velocity=np.array([0, 0, np.nan, 0, 0, 0])), "joint state"),
    "inf acceleration": (lambda s: _robot(s, acceleration=np.full(6, np.inf)), "joint state"),
    "joints of another number": (lambda s: _robot(s, position=np.zeros(5)), "joint state"),
    "no robot": (lambda s: s._replace(robot=None), "joint state"),
    "NaN person": (lambda s: _human(s, start=NAN3), "not finite"),
    "inf person": (lambda s: _human(s, end=np.full((1, 3), np.inf)), "not finite"),
    "NaN velocity of a person": (lambda s: _human(s, end_velocity=NAN3), "not finite"),
    "NaN radius": (lambda s: _human(s, radius=np.array([np.nan])), "not finite"),
    "negative radius": (lambda s: _human(s, radius=np.array([-0.1])), "not finite"),
    "NaN age": (lambda s: s._replace(age=np.array([np.nan])), "not finite"),
    "negative age": (lambda s: s._replace(age=np.array([-0.05])), "from the future"),
    "infinite age": (lambda s: s._replace(age=np.array([np.inf])), "not finite"),
    "other names": (lambda s: _human(s, names=("left_arm",)), "other names"),
    "no names": (lambda s: _human(s, names=()), "shapes"),
    "one more capsule": (lambda s: s._replace(**_two(s)), "2 capsules instead of 1"),
    "nobody any more": (
        lambda s: s._replace(human=nobody(), age=np.zeros(0), valid=np.zeros(0, bool)),
        "0 capsules instead of 1",
    ),
    "somebody else": (lambda s: _human(s, person=np.array([3])), "another person"),
    "no human": (lambda s: s._replace(human=None), "cannot be read"),
    "no validity": (lambda s: s._replace(valid=None), "cannot be read"),
    "time is NaN": (lambda s: s._replace(time=np.nan), "time"),
    "time is inf": (lambda s: s._replace(time=np.inf), "time"),
    "time is None": (lambda s: s._replace(time=None), "cannot be read"),
    "time is long ago": (lambda s: s._replace(time=-5.0), "went back"),
    "static is NaN": (lambda s: s._replace(static=ball([np.nan, 0, 0])), "static capsule or half-space"),
    "static is None": (lambda s: s._replace(static=None), "does not fit"),
    "static does not fit": (lambda s: s._replace(static=ball([1, 1, 1])._replace(radius=np.ones(2))), "does not fit"),
    "plane is NaN": (lambda s: _plane(s, offset=np.array([np.nan])), "static capsule or half-space"),
    "plane is no unit": (lambda s: _plane(s, normal=np.array([[0, 0, 2.0]])), "static capsule or half-space"),
    "plane does not fit": (lambda s: _plane(s, normal=np.zeros((2, 3))), "half-spaces with normals"),
    "no planes": (lambda s: s._replace(planes=None), "does not fit"),
}


def _plane(scene, **changes):
    return scene._replace(planes=scene.planes._replace(**changes))


def _two(scene):
    return {
        "human": together([scene.human, ball([5.0, 0.0, 1.0])]), "age": np.zeros(2), "valid": np.ones(2, bool),
    }  # fmt: skip


def assert_stored_stop_goes_on(arm, decide, word, ticks):
    """FAULT with its reason, the stored stop bit for bit, the limits kept; at rest at its end."""
    length = arm.left
    for k in range(ticks):
        tail = arm.tail
        decision = decide()
        assert decision.status == Status.FAULT
        assert word in decision.reason, decision.reason
        np.testing.assert_array_equal(decision.jerk, tail)
        arm.move(decision.jerk)
        assert arm.inside()
        assert arm.at_rest() or k + 1 < length


@pytest.mark.sampled(2)
@pytest.mark.parametrize("ticks", [1, 3, 50])
@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_ends_in_the_stored_stop_and_what_follows_is_not_lost(robot, make_scene, kind, ticks):
    for what, (harm, word) in FAULTS.items():
        arm = Arm(KINDS[kind](robot), make_scene).get_going(seed=len(what))

        def decide(arm=arm, harm=harm):
            return arm.filter.decide(harm(arm.scene()), 0.5 * robot.limits.jerk)

        assert_stored_stop_goes_on(arm, decide, word, ticks)
        # the arm is still where it is expected, and its stop still verified
        assert arm.step(np.zeros(6)).status != Status.FAULT, what


@pytest.mark.sampled(25)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", KINDS)
def test_a_nominal_that_is_no_number_ends_in_the_stored_stop(robot, make_scene, kind, bad):
    arm = Arm(KINDS[kind](robot), make_scene).get_going()
    nominal = np.zeros(6)
    nominal[3] = bad
    assert_stored_stop_goes_on(arm, lambda: arm.filter.decide(arm.scene(), nominal), "nominal jerk", 80)


class Sick(NoFilter):
    """Works until it does not."""

    how = None

    def respond(self, tick):
        decision = super().respond(tick)
        if self.how is None:
            return decision
        return self.how(self, tick, decision)


def _raises(filter, tick, decision):
    raise ZeroDivisionError("sick")


class OwnDecision(NamedTuple):
    jerk: object
    nominal: object
    status: object
    reason: object
    phi: object
    distance: object
    pair: object
    slack: object
    rows: object


def _writes(decision):
    decision.nominal[:] = 0.0
    return decision._replace(jerk=decision.nominal.copy(), status=Status.NOMINAL)


SICK = {
    "raises": (_raises, "ZeroDivisionError"),
    "NaN": (lambda f, t, d: d._replace(jerk=np.full(6, np.nan)), "not finite"),
    "beyond": (lambda f, t, d: d._replace(jerk=np.full(6, 1e4)), "outside the jerk bounds"),
    "None": (lambda f, t, d: None, "a Decision, got NoneType"),
    "shape": (lambda f, t, d: d._replace(jerk=np.zeros(5)), "shape"),
    "float32": (lambda f, t, d: d._replace(jerk=np.zeros(6, np.float32)), "type"),
    "not the nominal": (lambda f, t, d: d._replace(status=Status.NOMINAL, jerk=d.jerk / 2.0), "not the nominal"),
    "a fault of its own": (lambda f, t, d: d._replace(status=Status.FAULT, reason="I am sick"), "I am sick"),
    "failed": (lambda f, t, d: f.failed(t, "I am sick"), "I am sick"),
    "phi is None": (lambda f, t, d: d._replace(phi=None), "TypeError"),
    "three in a pair": (lambda f, t, d: d._replace(pair=(0, 0, 0)), "ValueError"),
    "a status of its own": (lambda f, t, d: d._replace(status=17), "ValueError"),
    "a tuple of its own": (lambda f, t, d: OwnDecision(*d[:9]), "a Decision, got OwnDecision"),
    "writes into the nominal": (lambda f, t, d: _writes(d), "not the nominal"),
}


@pytest.mark.parametrize("how", SICK)
def test_a_sick_filter_ends_in_the_stored_stop(robot, make_scene, how, caplog):
    filter = Sick(robot, DT, viability=True, failsafe=PARAMS)
    arm = Arm(filter, make_scene).get_going()
    filter.how, word = SICK[how]
    assert_stored_stop_goes_on(arm, lambda: filter.decide(arm.scene(), 0.9 * arm.filter.upper), word, 120)


def test_numbers_of_any_kind_are_an_answer(robot, make_scene):
    """What a filter of a user's own answers is taken as Python's numbers, whatever numpy made of them."""
    filter = Sick(robot, DT, viability=True, failsafe=PARAMS)
    arm = Arm(filter, make_scene).get_going()
    filter.how = lambda f, t, d: d._replace(
        phi=np.float32(0.5), distance=np.float64(2.0), slack=0, pair=np.unravel_index(3, (2, 2)), status=int(d.status)
    )
    decision = arm.step(np.zeros(6))
    assert decision.status == Status.NOMINAL
    assert [type(x) for x in (decision.phi, decision.distance, decision.slack, *decision.pair)] == [float] * 3 + [
        int
    ] * 2
    assert type(decision.status) is Status


def test_a_filter_that_fails_itself_outside_its_box_moves_the_stored_stop_on_by_one_tick(robot, make_scene):
    """Its jerk may lie outside the present box; that is no second failure."""
    filter = Sick(robot, DT, viability=True, failsafe=PARAMS)
    arm = Arm(filter, make_scene).get_going()

    def fail(self, tick, decision):
        self.lower[:], self.upper[:] = 1e-3, 2e-3
        return self.failed(tick, "I am sick")

    filter.how = fail
    assert_stored_stop_goes_on(arm, lambda: filter.decide(arm.scene(), np.zeros(6)), "I am sick", 3)


@pytest.mark.parametrize(
    "jerk", [np.full(6, np.nan), np.full(6, np.inf), np.zeros(4), None, np.full(6, 1e6), "nothing"], ids=str
)
def test_a_projection_that_is_none_ends_in_the_stored_stop(robot, make_scene, jerk, monkeypatch, caplog):
    arm = Arm(jssa(robot, projector="osqp"), make_scene, human=ball([1.3, 0.0, 1.3])).get_going(share=0.2)
    unsolved = isinstance(jerk, str)
    wrong = Projection(np.zeros(6) if unsolved else jerk, True, np.nan if unsolved else 0.0, "")
    called = []
    monkeypatch.setattr(arm.filter.projector, "project", lambda *_: called.append(1) or wrong)
    for _ in range(150):
        tail = arm.tail
        decision = arm.step(0.6 * robot.limits.jerk * [1, 1, -1, 1, 1, 1])
        assert arm.inside()
        if called:
            assert decision.status == Status.FAULT
            np.testing.assert_array_equal(decision.jerk, tail)
            break
    else:
        pytest.fail("no row was ever needed")


def test_a_compiled_projection_that_is_none_ends_in_the_stored_stop(robot, make_scene):
    filter = Unsolvable(robot, DT, viability=True, failsafe=PARAMS)
    arm = Arm(filter, make_scene, human=ball([1.3, 0.0, 1.3])).get_going(share=0.2)
    filter.make_unsolvable()
    for _ in range(150):
        tail = arm.tail
        decision = arm.step(0.6 * robot.limits.jerk * [1, 1, -1, 1, 1, 1])
        assert arm.inside()
        if decision.status == Status.FAULT:
            assert decision.reason == "the projection found no solution"
            np.testing.assert_array_equal(decision.jerk, tail)
            break
    else:
        pytest.fail("no row was ever needed")


GARBAGE = {
    "nan": lambda n: np.full(n, np.nan),
    "far": lambda n: np.full(n, 1e9),
    "zeros": lambda n: np.zeros(n),
    "shape": lambda n: np.zeros(n - 1),
    "random": lambda n: np.random.default_rng(0).uniform(-60, 60, n),
    "raises": None,
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", GARBAGE)
def test_an_osqp_that_answers_garbage_hurts_nobody(robot, make_scene, how, caplog):
    rng = np.random.default_rng(3)
    people = Teleporting(rng)
    arm = Arm(jssa(robot, projector="osqp"), make_scene, human=people.move())
    policy_jerk, used = nominals("bang-bang", robot, rng), 0

    def solve(*_, **__):
        if GARBAGE[how] is None:
            raise RuntimeError("boom")
        return type("Answer", (), {"x": GARBAGE[how](6)})()

    for _ in range(250):
        arm.human = people.move()
        if arm.filter.projector._solver is not None:
            arm.filter.projector._solver.solve, used = solve, used + 1
        arm.step(next(policy_jerk))
        assert arm.inside()
        near = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
        assert near.contact_speed < 1e-5
    assert used > 50


@pytest.mark.sampled(34)
@pytest.mark.parametrize("kind", DRIVEN)
@pytest.mark.parametrize("tolerance", [0.0, 2e-4])
@pytest.mark.parametrize("missed", [1, 2, 5, 15, 500])
def test_missed_ticks_on_the_stored_stop_are_no_deviation(robot, make_scene, kind, missed, tolerance):
    """While no decision was made the arm went on with its stop; it goes on from there, still verified."""
    measured = (tolerance, np.inf, np.inf) if tolerance else (0.0, 0.0, 0.0)
    arm = Arm(KINDS[kind](robot, FailsafeParams(state_tolerance=measured)), make_scene).get_going()
    step, jerk = step_of(arm.filter), np.zeros(6)
    for tick in range(step, step + missed):
        stop_jerk(stored(arm.filter), tick, jerk)
        arm.move(jerk)
    stop_jerk(stored(arm.filter), step + missed, jerk)
    arm.surprise(ball([3.0, 0.0, 1.2], radius=4.0))
    decision = arm.step(robot.limits.jerk)
    assert decision.status == Status.FAILSAFE, decision.reason
    np.testing.assert_array_equal(decision.jerk, jerk)
    np.testing.assert_allclose(arm.filter.expected, arm.state, rtol=0.0, atol=1e-12)


def test_a_missed_tick_that_a_tolerance_hides_is_no_deviation(robot, make_scene):
    """However slow the arm, the clock tells whether it has gone on: what is expected must not stay behind for good."""
    params = FailsafeParams(state_tolerance=(2e-4, np.inf, np.inf))
    for share in (0.02, 0.05, 0.2):
        arm = Arm(plain(robot, params), make_scene)
        for _ in range(3):
            arm.step(share * robot.limits.jerk)
        arm.move(arm.tail)
        for _ in range(300):
            assert arm.step(np.zeros(6)).status != Status.FAULT
        np.testing.assert_allclose(arm.filter.expected, arm.state, rtol=0.0, atol=1e-12)


def elsewhere(arm, how):
    """Move the arm to where no jerk of the filter has led."""
    if how in ("last jerk held", "zero jerk"):
        jerk = arm.filter.records.memory.applied[0].copy() if how == "last jerk held" else np.zeros(6)
        for _ in range(3):
            arm.move(jerk)
    elif how == "teleported":
        arm.state[0, 1] += 0.1
    else:
        arm.state[1, 2] += 1e-4


@pytest.mark.sampled(13)
@pytest.mark.parametrize("kind", DRIVEN)
@pytest.mark.parametrize("how", ["last jerk held", "zero jerk", "teleported", "a little"])
def test_an_arm_that_is_elsewhere_is_stopped_from_where_it_must_be(robot, make_scene, kind, how, caplog):
    """A reading is no reason to give up a verified stop: it goes on, and nothing else is done until a reset."""
    arm = Arm(KINDS[kind](robot), make_scene).get_going(share=0.3)
    elsewhere(arm, how)
    expected, left = arm.filter.expected.copy(), arm.left
    for k in range(left + 40):
        tail = arm.tail
        decision = arm.step(robot.limits.jerk)
        assert decision.status == Status.FAULT
        assert "not where the last jerk led" in decision.reason
        assert "no verified stop" not in decision.reason
        np.testing.assert_array_equal(decision.jerk, tail)
        integrate(expected, tail, DT, expected)
        np.testing.assert_array_equal(arm.filter.expected, expected)
        assert not violates(expected, tail, arm.bounds, 1e-9)
        assert k < left or not np.any(tail)
    assert np.abs(expected[1:]).max() < 1e-6
    # said once, and aloud
    assert sum("something else moves it" in record.message for record in caplog.records) == 1
    arm.state[1:] = 0.0
    arm.filter.reset(arm.scene())
    assert arm.step(np.zeros(6)).status == Status.NOMINAL


@pytest.mark.parametrize("kind", KINDS)
def test_clocks_that_stand_still_leap_or_go_back_cost_no_stop(robot, make_scene, kind):
    arm = Arm(KINDS[kind](robot), make_scene).get_going(share=0.2)
    fine, slow = "", "lags by 1 tick"
    for leap, word in (
        (0.0, fine), (0.4 * DT, fine), (-0.4 * DT, fine), (-DT, "stands still"), (0.0, slow), (DT, fine),
        (-3.3 * DT, "went back"), (0.0, "went back"), (3.3 * DT, fine), (0.0, fine),
        (10 * DT, "clock leapt"), (0.0, fine),
    ):  # fmt: skip
        arm.time += leap
        tail = arm.tail
        decision = arm.step(np.zeros(6))
        assert (decision.status == Status.FAULT) == bool(word), (leap, decision.reason)
        if word:
            assert word in decision.reason
            np.testing.assert_array_equal(decision.jerk, tail)
        assert "not where" not in decision.reason
        assert "no verified" not in decision.reason


def test_a_pause_at_rest_is_no_leap(robot, make_scene):
    arm = Arm(plain(robot), make_scene)
    arm.step(np.zeros(6))
    arm.time += 60.0
    assert arm.step(np.zeros(6)).status == Status.NOMINAL


# ---- people that are not seen ----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("blank", [True, False])
def test_who_is_not_measured_is_grown_until_max_age(robot, make_scene, kind, blank):
    arm = Arm(KINDS[kind](robot, FailsafeParams(max_age=0.1)), make_scene)
    for _ in range(5):
        arm.step(np.zeros(6))
    seen = arm.time - DT
    for _ in range(20):
        scene = arm.scene(valid=np.zeros(1, bool))
        if blank:
            scene = _human(scene, start=NAN3, end=NAN3, start_velocity=NAN3, end_velocity=NAN3)
        decision = arm.step(np.zeros(6), scene)
        assert (decision.status == Status.FAULT) == (arm.time - DT - seen > 0.1 + 1e-6)
        if decision.status == Status.FAULT:
            assert "core_body of person 0: not measured" in decision.reason
    # measured again, everything is as before
    assert arm.step(np.zeros(6)).status == Status.NOMINAL


def test_what_is_too_old_from_the_beginning_is_a_fault(robot, make_scene):
    arm = Arm(plain(robot), make_scene)
    for age, fault in ((0.199, False), (0.201, True)):
        arm.filter.reset(arm.scene())
        decision = arm.step(np.zeros(6), age=np.array([age]))
        assert (decision.status == Status.FAULT) == fault
        assert ("too old" in decision.reason) == fault


def test_a_frozen_and_a_jumping_person_are_faults_in_the_end(robot, make_scene):
    # frozen: the same numbers again, though they claim to move
    arm = Arm(plain(robot), make_scene, human=ball([3.0, 0.0, 1.2], velocity=(0.5, 0.0, 0.0)))
    reasons = [arm.step(np.zeros(6)) for _ in range(40)]
    assert [d.status == Status.FAULT for d in reasons] == [k * DT > 0.2 + 1e-6 for k in range(40)]
    assert "frozen" in reasons[-1].reason
    # jumping: where nobody can have got in time
    arm = Arm(plain(robot), make_scene)
    arm.step(np.zeros(6))
    arm.human = ball([9.0, 0.0, 1.2])
    reasons = [arm.step(np.zeros(6)) for _ in range(40)]
    assert [d.status == Status.FAULT for d in reasons] == [(k + 1) * DT > 0.2 + 1e-6 for k in range(40)]
    assert "jumped" in reasons[-1].reason


@pytest.mark.sampled(16)
@pytest.mark.parametrize("kind", DRIVEN)
@pytest.mark.parametrize("seed", range(5))
def test_a_person_spawned_inside_a_moving_arm_finds_it_at_rest_soon(robot, make_scene, kind, seed):
    """Beyond the assumptions, and still: the stop as it was stored, no limit exceeded, rest at its end."""
    arm = Arm(KINDS[kind](robot), make_scene).get_going(0.25, seed=seed)
    length = arm.left
    capsules = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
    assert capsules.smallest > 0.5
    arm.surprise(Body.facing().at((0.4, 0.0), (0.0, 0.0)))
    for k in range(length + 20):
        tail = arm.tail
        decision = arm.step(robot.limits.jerk)
        np.testing.assert_array_equal(decision.jerk, tail)
        assert decision.status == Status.FAILSAFE
        assert arm.inside()
        if k >= length:
            np.testing.assert_array_equal(decision.jerk, np.zeros(6))
    assert arm.at_rest()


# ---- where it begins -------------------------------------------------------------------------------------


class Kinematic(gym.Env):
    """An arm that begins in whatever state it is told."""

    def __init__(self, robot, make_scene, state, human=FAR):
        self.robot, self.dt, self._make, self._start, self.human = robot, DT, make_scene, np.array(state), human
        self.action_space = gym.spaces.Box(-1.0, 1.0, (6,), np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (3, 6), np.float64)

    @property
    def scene(self):
        return self._make(self.state, self.human, time=self.time)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state, self.time = self._start.copy(), 0.0
        return self.state.copy(), {}

    def step(self, action):
        integrate(self.state, np.asarray(action, float) * self.robot.limits.jerk, DT, self.state)
        self.time += DT
        return self.state.copy(), 0.0, False, False, {}


def test_reset_reports_a_start_from_which_no_stop_is_verified(robot, make_scene):
    velocity = 0.3 * robot.limits.velocity
    for state, human, status, word in (
        ([robot.home, np.zeros(6), np.zeros(6)], FAR, Status.NOMINAL, ""),
        ([robot.home, 0.1 * velocity, np.zeros(6)], FAR, Status.NOMINAL, ""),
        ([robot.home, velocity, np.zeros(6)], ball([3.0, 0.0, 1.2], 4.0), Status.FAULT, "core_body can reach"),
        ([robot.home, 4.0 * velocity, np.zeros(6)], FAR, Status.FAULT, "joint limits"),
    ):
        env = Shield(Kinematic(robot, make_scene, state, human), plain(robot))
        _, info = env.reset()
        assert info["shield/status"] == status
        assert word in info["shield/reason"]
        assert (info["shield/reason"] == "") == (status == Status.NOMINAL)
        assert info["shield/correction"] == 0.0
        if status != Status.FAULT:
            continue
        assert info["shield/reason"].startswith("no verified stop: ")
        before = np.abs(env.unwrapped.state[1]).max()
        for _ in range(150):
            *_, info = env.step(np.sign(velocity))
            if np.abs(env.unwrapped.state[1]).max() < 1e-6:
                break
            assert info["shield/status"] in (Status.FAULT, Status.FAILSAFE)
        assert np.abs(env.unwrapped.state[1]).max() < 0.01 * before


# ---- assumptions: each of them counts, and for as much as it says ------------------------------------------


def rejected_at(robot, make_scene, params, distance, *, age=0.0, name="core_body", share=0.02):
    """Whether a slow step beside somebody in front of the tool is overruled at a distance [m] of the surfaces."""
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    filter = plain(robot, params)
    human = ball(TIP + np.array([0.06 + 0.1 + distance, 0.0, 0.0]), 0.1, name)
    scene = make_scene(state, human)._replace(age=np.array([age]))
    filter.reset(scene)
    nominal = np.zeros(6)
    nominal[1] = share * robot.limits.jerk[1]
    return filter.decide(scene, nominal).status == Status.FAILSAFE


def edge(robot, make_scene, params=PARAMS, **options):
    """Distance from which on the step is let pass [m]."""
    low, high = 0.0, 2.0
    assert rejected_at(robot, make_scene, params, low, **options)
    assert not rejected_at(robot, make_scene, params, high, **options)
    for _ in range(18):
        middle = (low + high) / 2.0
        low, high = (middle, high) if rejected_at(robot, make_scene, params, middle, **options) else (low, middle)
    return high


@pytest.mark.long
def test_every_assumption_moves_the_edge_by_what_it_says(robot, make_scene):
    base = edge(robot, make_scene)
    duration = base / PARAMS.human_speed
    assert 0.01 < duration < 0.2
    for params, options, expected in (
        (FailsafeParams(position_error=0.03), {}, 0.03),
        (FailsafeParams(tracking_error=0.02), {}, 0.02),
        (FailsafeParams(actuation_lag=0.05), {}, 0.05 * 1.6),
        (PARAMS, {"age": 0.1}, 0.1 * 1.6),
        (PARAMS, {"age": 0.1, "name": "left_arm"}, 0.1 * 2.0 + duration * 0.4),
        (PARAMS, {"name": "left_arm"}, duration * 0.4),
        (PARAMS, {"name": "right_hand"}, duration * 0.4),
        (FailsafeParams(human_speed=0.8), {}, -0.5 * base),
        (FailsafeParams(limb_speed=4.0), {}, 0.0),
        (FailsafeParams(human_speed=0.8), {"name": "left_arm"}, duration * 0.4),
    ):
        moved = edge(robot, make_scene, params, **options) - base
        assert moved == pytest.approx(expected, abs=2e-3), (params, options)


def test_a_contact_speed_lets_pass_slow_motion_only_and_only_where_it_is_allowed(robot, make_scene):
    for contact, part, slow, fast in (
        (0.0, "left_arm", True, True),
        (0.25, "left_arm", False, True),
        (0.25, "core_body", False, True),
        ({"left_arm": 0.25}, "left_arm", False, True),
        ({"left_arm": 0.25}, "right_arm", True, True),
        ({"left_arm": 0.25, "right_arm": 0.0}, "right_arm", True, True),
        ({}, "left_arm", True, True),
    ):
        params = FailsafeParams(contact_speed=contact)
        assert rejected_at(robot, make_scene, params, 0.0, name=part, share=0.5) == slow, (contact, part)
        assert rejected_at(robot, make_scene, params, -0.05, name=part, share=0.5) == slow, (contact, part)
        arm = Arm(plain(robot, params), make_scene).get_going(0.3)
        np.testing.assert_array_equal(arm.filter.records.memory.touch[0], [params.contact_speed_of("core_body")])
        arm.surprise(ball([3.0, 0.0, 1.2], radius=4.0))
        assert (arm.step(robot.limits.jerk).status == Status.FAILSAFE) == fast


def test_a_contact_speed_is_for_one_part_only(robot, make_scene):
    """Who may be touched in motion does not make it so for who stands beside."""
    state, nominal = np.array([robot.home, np.zeros(6), np.zeros(6)]), np.zeros(6)
    nominal[1] = 0.5 * robot.limits.jerk[1]
    hand, head = ball(TIP, 0.1, "left_arm"), ball(TIP, 0.1, "head")
    for people, passes in (([hand], True), ([hand, head], False), ([head, hand], False), ([hand, hand], True)):
        filter = plain(robot, FailsafeParams(contact_speed={"left_arm": 0.25}))
        scene = make_scene(state, together(people))
        filter.reset(scene)
        assert (filter.decide(scene, nominal).status == Status.NOMINAL) == passes


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"human_speed": 0.0}, "human_speed"), ({"limb_speed": np.nan}, "limb_speed"), ({"max_age": np.inf}, "max_age"),
        ({"position_error": -0.1}, "position_error"), ({"tracking_error": np.nan}, "tracking_error"),
        ({"actuation_lag": "x"}, "actuation_lag"), ({"contact_speed": -1.0}, "contact_speed"),
        ({"contact_speed": np.inf}, "contact_speed"),
        ({"contact_speed": {"head": np.nan}}, "head"), ({"contact_speed": None}, "contact_speed"),
        ({"end_speeds": {"arm": (1.6, 0.0)}}, "end_speeds"), ({"end_speeds": {"arm": 2.0}}, "arm"),
        ({"end_speeds": {"arm": (1.0, np.nan)}}, "arm"), ({"end_speeds": [1.6, 2.0]}, "end_speeds"),
        ({"human_acceleration": 0.0}, "human_acceleration"), ({"velocity_error": -0.1}, "velocity_error"),
        ({"human_acceleration": {"head": np.inf}}, "head"), ({"human_acceleration": "x"}, "human_acceleration"),
    ],
)  # fmt: skip
def test_assumptions_that_are_none_are_refused(options, word):
    with pytest.raises(ParameterError, match=word):
        FailsafeParams(**options)


def test_bad_options_of_a_filter_are_refused(robot):
    with pytest.raises(ParameterError, match="viability"):
        NoFilter(robot, DT, viability=1)
    with pytest.raises(ParameterError, match="failsafe"):
        NoFilter(robot, DT, failsafe=True)


@pytest.mark.parametrize("what", ["static", "planes", "self", "table"])
def test_what_stands_in_the_way_is_named_and_missed(robot, make_scene, what):
    """The arm is driven at something until it is overruled: it says at what, and stops short of it."""
    arm = Arm(plain(robot), make_scene, human=nobody())
    post = CapsuleSet(
        np.array([[0.95, 0.0, 0.9]]), np.array([[0.95, 0.0, 1.8]]), np.zeros((1, 3)), np.zeros((1, 3)),
        np.array([0.05]), ("post",), np.zeros(1, np.int64),
    )  # fmt: skip
    changes = {}
    towards, word = {"static": ([0, 1, 1, 0, 0, 0], "post"), "planes": ([0, 1, 1, 0, 0, 0], "wall"),
                     "table": ([0, 1, -1, 0, 0, 0], "table"),
                     "self": ([0, 0, 1, 0, 0, 0], "would meet")}[what]  # fmt: skip
    if what == "static":
        changes["static"] = post
    elif what == "planes":
        changes["planes"] = Planes(np.array([[-1.0, 0.0, 0.0]]), np.array([-0.9]), ("wall",))
    elif what == "self":
        changes["planes"] = Planes(np.zeros((0, 3)), np.zeros(0), ())
    words, nearest = set(), np.inf
    for k in range(400):
        nominal = 0.3 * robot.limits.jerk * towards if k < 60 else np.array(towards) * 1.0
        words.add(arm.step(nominal, **changes).reason)
        static, planes = changes.get("static", nobody()), changes.get("planes", arm.scene().planes)
        near = measure(robot, JointState(*arm.state), static, planes)
        nearest = min(nearest, near.smallest, near.planes.min(initial=np.inf), near.own.min())
    found = [text for text in words if word in text]
    assert found, words
    assert 0.0 < nearest < 0.1
    assert arm.at_rest() or nearest > 0.0


@pytest.mark.parametrize("what", ["wall", "post"])
def test_a_thing_without_a_name_is_a_fault_that_keeps_the_stop(robot, make_scene, what):
    """What is in the way cannot be told: the stored stop goes on, by one tick and no more."""
    arm, faults = Arm(plain(robot), make_scene, human=nobody()), 0
    changes = {"static": ball(TIP + np.array([0.45, 0.0, -0.1]))._replace(names=())}
    if what == "wall":
        changes = {"planes": Planes(np.array([[-1.0, 0.0, 0.0]]), np.array([-0.9]), ())}
    for _ in range(300):
        tail, left = arm.tail, arm.left
        decision = arm.step(0.3 * robot.limits.jerk * [0, 1, 1, 0, 0, 0], **changes)
        if decision.status == Status.FAULT:
            faults += 1
            assert "does not fit" in decision.reason
            np.testing.assert_array_equal(decision.jerk, tail)
            assert arm.left == max(left - 1, 0)
    assert faults > 3
    assert arm.inside()


def test_an_error_of_tracking_is_kept_from_what_stands_still_too(robot, make_scene):
    nearest = {}
    for error in (0.0, 0.02):
        arm = Arm(plain(robot, FailsafeParams(tracking_error=error)), make_scene, human=nobody())
        nearest[error] = np.inf
        for _ in range(300):
            arm.step(0.3 * robot.limits.jerk * [0, 1, -1, 0, 0, 0])
            near = measure(robot, JointState(*arm.state), nobody(), arm.scene().planes)
            nearest[error] = min(nearest[error], near.planes.min())
    assert 0.0 < nearest[0.0] < nearest[0.02]
    assert nearest[0.02] > 0.02


@pytest.mark.parametrize("seed", range(2))
def test_a_faster_person_never_gets_more_let_through(robot, make_scene, seed, times):
    rng = np.random.default_rng(seed)
    mixed = 0
    for _ in range(25 * times):
        state = np.array([robot.home + rng.uniform(-0.3, 0.3, 6), np.zeros(6), np.zeros(6)])
        nominal = rng.uniform(-1.0, 1.0, 6) * robot.limits.jerk
        human = ball(TIP + rng.normal(size=3) * 0.3, 0.05, rng.choice(["head", "left_arm"]))
        passed = []
        for speed in (0.1, 0.5, 1.0, 1.6, 3.0):
            filter = plain(robot, FailsafeParams(human_speed=speed, limb_speed=1.25 * speed))
            filter.reset(make_scene(state, human))
            passed.append(filter.decide(make_scene(state, human), nominal).status != Status.FAILSAFE)
        assert passed == sorted(passed, reverse=True)
        mixed += len(set(passed)) > 1
    assert mixed > 3


# ---- recovery --------------------------------------------------------------------------------------------

INDEX = ref.Params(0.05, 2.0, 0.25)


def index_of_pair(scene, jerk, tau, i, j):
    state, human = scene.robot, scene.human
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[i]
    return (CHAIN, state.position, state.velocity, state.acceleration, jerk, tau, link, start, end,
            human.start[j], human.end[j], human.start_velocity[j], human.end_velocity[j],
            radius + human.radius[j], INDEX, False)  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("recovery", [0.0, 0.2, 0.5, 1.0])
def test_rows_ask_for_what_they_say_and_get_it(robot, random_scene, recovery, times):
    """Targets are max(0, phi_k - rho authority) of each pair, and kept by the arm's true motion."""
    filter = JSSAFilter(robot, DT, IndexParams(*INDEX), recovery=recovery)
    rng, kept, positive, compared = np.random.default_rng(4), 0, 0, 0
    for _ in range(4000 * times):
        scene = random_scene(rng, 0.5, 1.2, motion=0.05)
        decision = filter.decide(scene, rng.uniform(-1.0, 1.0, 6) * robot.limits.jerk)
        if decision.rows == 0:
            continue
        work = filter.records.work
        owner, target = (rows[: decision.rows].copy() for rows in (work.owner, work.target))
        good = decision.status == Status.PROJECTED or "recovering" in decision.reason
        recovering = decision.status == Status.RELAXED and "recovering" in decision.reason
        assert not recovering or target.max() > 0.0
        if not good and recovery and positive > 5:
            continue
        for k, (number, asked) in enumerate(zip(owner, target, strict=True)):
            pair = divmod(int(number), len(scene.human.radius))
            now = ref.phi_after(*index_of_pair(scene, np.zeros(6), 0.0, *pair))
            if (k == 0 and kept < 12) or (now > 0.0 and compared < 12):
                compared += now > 0.0
                L = ref.row_by_differences(*index_of_pair(scene, decision.jerk, DT, *pair))
                expected = max(0.0, now - recovery * float(np.abs(L) @ robot.limits.jerk)) if recovery else 0.0
                assert asked == pytest.approx(expected, rel=1e-2, abs=2e-3)
            if recovery == 0.0:
                assert asked == 0.0
            positive += asked > 0.0
            if good:
                after = ref.phi_after(*index_of_pair(scene, decision.jerk, DT, *pair))
                assert after <= asked + 1e-6
                kept += 1
        if kept > 25 * times:
            break
    assert kept > 25 * times
    assert compared >= 12
    assert (positive > 5) == (recovery > 0.0)


def test_a_smaller_recovery_asks_for_more(robot, random_scene):
    """Recovery is what keeps rows feasible: with it fewer of the same scenes are beyond every jerk."""
    rng, hopeless = np.random.default_rng(5), {}
    drawn = [(random_scene(rng, 0.5, 0.9, motion=0.1), rng.uniform(-1, 1, 6)) for _ in range(150)]
    for recovery in (0.0, 0.5, 1.0):
        filter = JSSAFilter(robot, DT, recovery=recovery)
        decisions = [filter.decide(scene, share * robot.limits.jerk) for scene, share in drawn]
        hopeless[recovery] = sum(d.reason.startswith("no jerk keeps") for d in decisions)
    assert hopeless[0.5] < hopeless[0.0]
    assert hopeless[0.5] <= hopeless[1.0] <= hopeless[0.0]


def test_nothing_jumps_when_another_pair_becomes_the_closest(robot, make_scene):
    """With rows of all pairs the decision is continuous where the closest one changes; with one row it is not."""
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    state[1, 1:3] = [0.15, -0.15]
    nominal = 0.3 * robot.limits.jerk * np.array([0.0, 1.0, -1.0, 0.0, 0.1, 0.0])
    change = {}
    for rows in ("all", "closest"):
        change[rows] = 0.0
        filter = JSSAFilter(robot, DT, rows=rows)
        for distance in np.linspace(0.2, 0.6, 12):
            answers = []
            for shift in (1e-9, -1e-9):
                people = together(
                    [ball([TIP[0] + distance + shift, 0.12, TIP[2]], velocity=(-0.4, 0.0, 0.0)),
                     ball([TIP[0] + distance - shift, -0.12, TIP[2]], velocity=(-0.4, 0.0, 0.0), person=1)]
                )  # fmt: skip
                decision = filter.decide(make_scene(state, people), nominal)
                answers.append((decision.jerk, decision.pair))
            assert answers[0][1] != answers[1][1]  # the pair did switch
            change[rows] = max(change[rows], np.abs(answers[0][0] - answers[1][0]).max())
    assert change["all"] < 1e-4
    assert change["closest"] > 1e-2


# ---- the same again ----------------------------------------------------------------------------------------


def digest(steps=1500):
    env = JSSAShield(gym.make("jssa_gym/Home-v0", human=["random", "walk_by"], terminate_on=()))
    rng, out = np.random.default_rng(1), hashlib.sha256()
    observation, info = env.reset(seed=5)
    for k in range(steps):
        if k % 10 == 0:
            action = rng.uniform(-1.0, 1.0, 6)
        observation, reward, terminated, truncated, info = env.step(action)
        out.update(observation.tobytes() + env.last_decision.jerk.tobytes() + bytes([info["shield/status"]]))
        out.update(np.float64(reward).tobytes() + info["shield/reason"].encode())
        if terminated or truncated:
            env.reset()
    return out.hexdigest()


@pytest.mark.long
def test_runs_repeat_bit_for_bit_here_and_in_another_process():
    here = digest()
    assert digest() == here
    command = [sys.executable, "-c", "import test_failsafe; print(test_failsafe.digest())"]
    there = subprocess.run(command, env=environment(Path(__file__).parent), capture_output=True, text=True, check=True)
    assert there.stdout.strip() == here


CLOCKS = {
    "stands": lambda k: 0.0,
    "crawls": lambda k: 0.3 * k * DT,
    "stands, every other reading is none": lambda k: 0.0 if k % 2 else np.nan,
    "to and fro": lambda k: DT * (k % 2),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("clock", CLOCKS)
def test_people_move_on_though_the_clock_stands(robot, make_scene, clock):
    """A source that never advances its clock must not make the first measurement true for ever."""
    hit = []
    for reading in (lambda k: k * DT, CLOCKS[clock]):
        arm = Arm(plain(robot), make_scene, human=ball([1.9, 0.0, 1.2], 0.2))
        rng, x, fastest, statuses = np.random.default_rng(3), 1.9, 0.0, set()
        policy = nominals("bang-bang", robot, rng)
        for k in range(250):
            x -= 1.5 * DT if k > 60 else 0.0
            arm.human = ball([x, 0.0, 1.2], 0.2, velocity=(-1.5 if k > 60 else 0.0, 0.0, 0.0))
            arm.time = reading(k)
            state = arm.state
            decision = arm.filter.decide(arm.scene(), next(policy))
            statuses.add(decision.status)
            arm.state = np.array(ref.triple_integrator(*state, decision.jerk, DT))
            near = measure(robot, JointState(*arm.state), arm.human, Planes(np.zeros((0, 3)), np.zeros(0), ()))
            fastest = max(fastest, near.contact_speed)
        hit.append(fastest)
        assert statuses & {Status.FAILSAFE, Status.FAULT}
    assert max(hit) < 1e-3


def test_a_radius_that_changes_at_once_is_not_believed(robot, make_scene):
    arm = Arm(plain(robot), make_scene, human=ball([1.0, 0.0, 1.2], 0.3))
    arm.step(np.zeros(6))
    arm.human = ball([1.0, 0.0, 1.2], 0.01)
    arm.step(np.zeros(6))
    assert arm.filter.records.work.radius[0] == 0.3
    assert "jumped" in SAMPLES[arm.filter.records.answer.told[0]["sample"]]


@pytest.mark.parametrize(
    ("part", "speed"), [("RightHand", 2.0), ("left_wrist", 2.0), ("thing", 2.0), ("forearm of the body", 2.0),
                        ("body.LeftElbow", 2.0), ("upper_body_right_wrist", 2.0), ("body_index_finger", 2.0),
                        ("Head", 1.6), ("core_body", 1.6), ("left_leg", 1.6), ("LeftKnee", 1.6), ("LeftFoot", 4.8),
                        ("left_ankle", 4.8), ("toe of the left leg", 4.8), ("forefeet", 4.8), ("right_heel", 4.8),
                        ("left_lower_leg", 4.8), ("LeftLowerLeg", 4.8), ("lowerleg2", 4.8), ("leg_lower_l", 4.8),
                        ("shin", 4.8), ("LeftShank", 4.8), ("calf", 4.8), ("calves", 4.8), ("TIBIA", 4.8),
                        ("left_shoe", 4.8), ("left_sole", 4.8), ("knee", 1.6), ("upper_leg", 1.6), ("thigh", 2.0),
                        ("left_hip", 1.6), ("LeftHip", 1.6), ("Hips", 1.6), ("hip2", 1.6), ("LHip", 1.6),
                        ("ship", 2.0), ("whip", 2.0), ("chip_7", 2.0)]
)  # fmt: skip
def test_a_part_is_taken_for_fast_unless_its_name_says_that_it_is_not(part, speed):
    assert FailsafeParams().speed_of(part) == speed
