"""Alternatives, and stops that give way gradually: anything may propose, only the verification admits."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from monitors import keeps_safe
from numba import njit
from strollers import ball

import jssa_gym
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import make_human
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.kernels.verification import SAFE
from jssa_gym.safety.failsafe import HARDNESS, FailsafeParams
from jssa_gym.shields import FILTERS, PROFILES, NoFilter, Shield, make_filter
from jssa_gym.shields.reasons import REASONS
from jssa_gym.tick import codes as reasons
from jssa_gym.tick.admit import EASY, GRADED, SOFT, WANTED, blend, choose, room_behind, share_of
from jssa_gym.tick.admit import keeps_safe as keeps_safe_by
from jssa_gym.types import Status

ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)


def beside(name="jssa", human="none", **shield):
    """A shield at the task Home."""
    return Shield(jssa_gym.ArmEnv("home", human=human, terminate_on=()), name, **shield)


class Straying:
    """A path that offers what it is given, and fails where it is told to."""

    override = 0.5

    def __init__(self, jerks, fails=""):
        self.jerks, self.fails, self.told = jerks, fails, []

    def alternatives(self, state, margin):
        assert state.shape == (3, 6)
        if self.fails == "alternatives":
            raise RuntimeError("no idea")
        return self.jerks

    def took(self, choice):
        self.told.append(choice)
        if self.fails == "took":
            raise RuntimeError("no idea")


@pytest.mark.parametrize("name", [*FILTERS, "jssa+stop", "cbf+stop", *PROFILES])
def test_the_first_alternative_in_the_box_is_applied(name):
    shield = beside(name)
    shield.reset(seed=0)
    bound = shield.unwrapped.robot.limits.jerk
    jerks = np.array([np.full(6, np.nan), 1.5 * bound, 0.25 * bound, 0.5 * bound])
    path = Straying(jerks)
    shield.offer(path)
    *_, info = shield.step(np.zeros(6))
    assert (info["shield/choice"], info["shield/kind"], info["shield/override"]) == (2, "alternative", 0.5)
    assert path.told == [2]
    assert info["jerk"] == pytest.approx(0.25 * bound, rel=1e-12)
    assert info["shield/intervened"]
    *_, info = shield.step(np.zeros(6))  # an offer is for one step
    assert (info["shield/choice"], info["shield/kind"]) == (-1, "nominal")


def test_no_alternative_is_applied_that_a_filter_would_change_or_no_stop_follows():
    """Towards somebody: the verified stop forbids at last what was offered, and the stored stop goes on."""
    shield = beside("stop", human="pursuit")
    shield.reset(seed=1)
    bound, kinds = shield.unwrapped.robot.limits.jerk, []
    for k in range(400):
        shield.offer(np.array([(0.4 if k // 40 % 2 else -0.4) * bound]))
        *_, info = shield.step(np.zeros(6))
        kinds.append(info["shield/kind"])
        assert info["contact_speed"] <= 1e-3
        assert not info["limit_violation"]
    assert {"alternative", "stop"} <= set(kinds)


def test_what_a_filter_would_change_is_not_applied():
    """Bare JSSA, no stop around it: an offer that breaks its rows is passed over, one that keeps them is taken."""
    shield = beside("jssa", human="pursuit")
    shield.reset(seed=1)
    bound, seen = shield.unwrapped.robot.limits.jerk, set()
    for _ in range(300):
        shield.offer(np.array([np.full(6, 0.3) * bound]))
        *_, info = shield.step(np.full(6, 0.3))
        # what is offered is the action, too: the same filter, asked for it alone, would have kept or changed it
        seen.add((Status(info["shield/status"]).name, info["shield/kind"]))
    assert ("NOMINAL", "alternative") in seen
    assert seen & {("PROJECTED", "projected"), ("RELAXED", "projected")}


@pytest.mark.long
def test_an_offer_that_is_passed_over_stops_nobody(robot, make_scene):
    """Where the nominal keeps the protective distance and a faster jerk does not, an offer of the latter is nothing."""
    nominal, offer = np.zeros(robot.n), robot.limits.jerk
    state = np.array([robot.home, 0.9 * robot.limits.velocity, np.zeros(robot.n)])
    passed_over = 0
    for gap in np.arange(0.5, 3.5, 2e-3):
        scene = make_scene(state, ball((gap, 0.0, 1.0)))
        alone, offered, faster = (make_filter("ssm", robot, 0.008) for _ in range(3))
        for filter in (alone, offered, faster):
            filter.reset(scene)
        expected = alone.decide(scene, nominal)
        if expected.status == Status.NOMINAL != faster.decide(scene, offer).status:
            decision = offered.decide(scene, nominal, Straying(offer[None]))
            assert (decision.status, decision.kind, decision.choice) == (Status.NOMINAL, "nominal", -1)
            assert np.array_equal(decision.jerk, expected.jerk)
            passed_over += 1
    assert passed_over


def test_an_offer_that_the_stop_refuses_lets_nobody_go_on(robot, make_scene):
    """Where SSM would let an offer pass that no verified stop follows, it goes on as if none had been made."""
    state, offer = np.array([robot.home, 0.9 * robot.limits.velocity, np.zeros(robot.n)]), robot.limits.jerk
    refused = 0
    for gap in np.arange(0.3, 1.5, 2e-2):
        scene, resumes = make_scene(state, ball((gap, 0.0, 1.0))), []
        for path in (None, Straying(0.15 * offer[None])):
            filter = make_filter("ssm", robot, 0.008, viability=True, failsafe=FailsafeParams())
            filter.reset(scene)
            arm = filter.records.memory.arm[0]
            arm["resume"] = 1e-3
            choice = filter.decide(scene, np.zeros(robot.n), path).choice
            resumes.append(float(arm["resume"]))
        if choice < 0:
            np.testing.assert_equal(*resumes)
            refused += 1
    assert refused


def test_what_would_be_known_of_nobody_is_a_fault(robot):
    """Distances that overflow: nobody knows who is in the way, and the nominal is not applied."""
    env = jssa_gym.ArmEnv("home", human="pursuit")
    env.reset(seed=0)
    scene, filter = env.scene, make_filter("jssa_ahead", env.robot, env.dt)
    human = scene.human
    for far in (1e160, 1e308):
        away = human._replace(start=human.start + far, end=human.end - far)
        with np.errstate(all="ignore"):
            filter.reset(scene._replace(human=away))
            decision = filter.decide(scene._replace(human=away), np.ones(6))
        assert (decision.status, decision.reason) == (Status.FAULT, "the safety index is not finite")


@pytest.mark.parametrize("name", ["jssa_ahead", "ssa", "sss", "cbf"])
def test_a_projection_that_fails_is_a_fault(name):
    shield = beside(name, human="pursuit")
    shield.reset(seed=1)
    for _ in range(500):
        shield.step(np.full(6, 0.2))
        if shield.last_decision.rows:
            break
    assert shield.last_decision.rows
    records = shield.filter.records
    records.settings = records.settings._replace(diagonal=False, inverse=-np.eye(6))
    records.release()
    *_, info = shield.step(np.full(6, 0.2))
    assert (info["shield/status"], info["shield/kind"]) == (Status.FAULT, "fault")
    assert info["shield/reason"] == REASONS[reasons.UNSOLVED]


def test_records_that_are_out_of_order_cost_a_path_nothing_else(robot, caplog):
    """What fails while a fault is told to a path is not raised."""

    class Broken:
        def __getattr__(self, name):
            raise RuntimeError("broken")

    env = jssa_gym.ArmEnv("home", human="none")
    env.reset(seed=0)
    filter, path = make_filter("jssa+stop", env.robot, env.dt), Straying(np.zeros((1, 6)))
    filter.reset(env.scene)
    vars(filter)["records"] = Broken()
    for offered in (None, path):
        decision = filter.decide(env.scene, np.ones(6), offered)
        assert decision.status == Status.FAULT
        assert not decision.jerk.any()
    assert path.told == [-1]


def test_a_filter_that_knows_of_no_path_says_so_before_anything_moves():
    class Old(NoFilter):
        def decide(self, scene, nominal):
            return super().decide(scene, nominal)

    env = jssa_gym.ArmEnv("home", human="none")
    shield = Shield(env, Old(env.robot, env.dt))
    shield.reset(seed=0)
    with pytest.raises(InterfaceError, match=r"Old\.decide takes no path"):
        shield.offer(np.zeros((1, 6)))
    shield.step(np.zeros(6))


@settings(max_examples=30, deadline=None)
@given(jerks=arrays(np.float64, st.tuples(st.integers(0, 12), st.just(6)), elements=ANY))
def test_garbage_moves_nobody_into_anybody(jerks):
    """Whatever is offered: what is applied is in the box, and followed by a verified stop."""
    shield = SHIELD
    shield.reset(seed=2)
    for _ in range(15):
        shield.offer(jerks)
        *_, info = shield.step(np.zeros(6))
        filter = shield.filter
        assert (filter.lower <= info["jerk"] + 1e-9).all()
        assert (info["jerk"] <= filter.upper + 1e-9).all()
        assert info["shield/status"] != Status.FAULT
        assert info["contact_speed"] <= 1e-3


SHIELD = beside("jssa+stop", human=make_human("approach_retreat"))


@pytest.mark.parametrize("offered", [None, "path", np.zeros(6), np.zeros((2, 5)), np.zeros((2, 6), np.float32), 7])
@pytest.mark.parametrize("fails", ["", "alternatives", "took"])
def test_a_path_that_fails_costs_nothing_but_its_alternatives(offered, fails, caplog):
    shield = beside("jssa+stop")
    shield.reset(seed=0)
    shield.offer(Straying(offered, fails))
    *_, info = shield.step(np.full(6, 0.2))
    assert (info["shield/status"], info["shield/choice"]) == (Status.NOMINAL, -1)
    said = len(caplog.records)
    assert said in ((1, 2) if fails == "took" else (1,))
    shield.offer(Straying(offered, fails))
    shield.step(np.full(6, 0.2))
    assert len(caplog.records) == said  # what is wrong in one step is wrong in the next: it is said once


# ---- graded ------------------------------------------------------------------------------------------


def test_a_graded_stop_jumps_less_and_keeps_the_promise():
    """The same person walks up to an arm that sways; all that differs is how the stop gives way."""
    jumps = {}
    for graded in (False, True):
        shield = beside("stop", human=make_human("approach_retreat"), stop={"graded": graded})
        shield.reset(seed=3)
        bound, last, count, kinds = shield.unwrapped.robot.limits.jerk, np.zeros(6), 0, set()
        for k in range(1200):
            *_, info = shield.step(0.25 * np.sin(k / 25.0) * np.array([1.0, 0.6, 0.6, 1.0, 1.0, 1.0]))
            count += np.any(np.abs(info["jerk"] - last) > bound)
            last = info["jerk"]
            kinds.add(info["shield/kind"])
            assert info["contact_speed"] <= 1e-3
            assert not info["limit_violation"]
            if info["shield/kind"] == "graded":
                assert shield.filter.verified
        jumps[graded] = count
    assert "graded" in kinds
    assert jumps[True] < jumps[False]


@pytest.mark.long
def test_what_is_applied_before_a_softer_stop_is_followed_by_one(robot):
    """The stop that a graded shield stores behind the nominal keeps the softer limits."""
    filter = make_filter("stop", robot, 0.008, failsafe=FailsafeParams(graded=True))
    limits = filter.records.settings.soft_limits
    np.testing.assert_allclose(limits[:, 3], np.outer(HARDNESS, robot.limits.acceleration), rtol=1e-15)
    assert (limits[:, :3] == robot.limits.bounds()[:3]).all()
    shield = beside("stop", stop={"graded": True})
    shield.reset(seed=0)
    # the jerk itself may be as hard as the arm allows: only stops are soft
    assert [shield.step(np.full(6, share))[-1]["shield/kind"] for share in (0.9, -0.9)] == ["nominal", "nominal"]
    shield.reset(seed=0)
    for _ in range(20):
        shield.step(np.full(6, 0.3))
    plan = shield.filter.records.memory.stored[0]
    assert (np.abs(plan["jerk_in"]) <= HARDNESS[0] * robot.limits.jerk * (1 + 1e-9)).all()
    assert keeps_safe(shield.filter, 0.3 * robot.limits.jerk)


def test_a_blend_is_what_its_formula_says(robot):
    """b + w (u - b), b the jerk with which the stored stop goes on."""
    filter = make_filter("stop", robot, 0.008, failsafe=FailsafeParams(graded=True))
    memory, bounds, rng, first = filter.records.memory, robot.limits.bounds(), np.random.default_rng(0), np.zeros(6)
    for share in (0.0, 0.25, 1.0):
        state = np.array([robot.home, rng.uniform(-0.3, 0.3, 6) * bounds[2], rng.uniform(-0.3, 0.3, 6) * bounds[3]])
        plan_stop(state, bounds, 0.008, memory.stored[0])
        memory.arm[0]["step"] = step = int(rng.integers(0, 5))
        stop_jerk(memory.stored[0], step, first)
        wanted, found = rng.uniform(-1.0, 1.0, 6) * bounds[4], np.zeros(6)
        _blend(filter.records.view.arms, wanted, share, found)
        np.testing.assert_allclose(found, first + share * (wanted - first), rtol=1e-12, atol=1e-9)


@njit
def _blend(arms, wanted, share, jerk):
    blend(arms.memory, wanted, share, arms.settings.stop_limits, jerk, 0)


@pytest.mark.parametrize(
    ("room", "share"), [(np.inf, 1.0), (EASY, 1.0), (EASY / 2, 0.5), (0.0, 0.0), (-np.inf, 0.0), (np.nan, 0.0)]
)
def test_the_share_of_the_room(room, share):
    assert share_of(room) == pytest.approx(share, abs=1e-15)


@pytest.mark.long
@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_an_alternative_has_a_verified_soft_stop_behind_it(seed):
    """Beside somebody who comes, whoever offers what: what is taken is followed by one of the softest stops."""
    rng, shield = np.random.default_rng(seed), _approached()
    shield.reset(seed=seed % 7)
    bound = shield.unwrapped.robot.limits.jerk
    soft = shield.filter.records.settings.soft_limits[SOFT - 1]
    way = rng.uniform(-1.0, 1.0, 6)
    for _ in range(250):
        before = shield.filter.expected.copy()
        shield.offer(np.array([share * way * bound for share in (0.5, 0.1, -0.1, -0.5)]))
        *_, info = shield.step(np.zeros(6))
        assert info["contact_speed"] <= 1e-3
        if info["shield/choice"] >= 0:
            stop = shield.filter.records.memory.stored[0]
            assert (np.abs(stop["jerk_in"]) <= soft[4] * (1 + 1e-9)).all()
            assert not np.array_equal(before, shield.filter.expected)
        if rng.random() < 0.05:
            way = rng.uniform(-1.0, 1.0, 6)


@cache
def _approached():
    return beside("stop", human=make_human("approach_retreat"), stop={"graded": True})


def test_an_arm_found_in_motion_stops_as_soon_as_any_stop_is_verified(robot, make_scene):
    """However hard that is, and however little room it leaves: with graded stops no later than without."""
    state = np.array([robot.home, 0.3 * robot.limits.velocity, np.zeros(robot.n)])
    seen = set()
    for gap, share in product(np.arange(1.0, 1.4, 0.01), (0.0, 0.9)):
        scene, verified = make_scene(state, ball((gap, 0.0, 1.0))), []
        for graded in (False, True):
            filter = make_filter("stop", robot, 0.008, viability=True, failsafe=FailsafeParams(graded=graded))
            filter.reset(scene)
            filter.decide(scene, share * robot.limits.jerk)
            verified.append(filter.verified)
        assert verified[1] >= verified[0]
        seen.add(verified[0])
    assert seen == {True, False}


@pytest.mark.long
def test_what_a_blend_is_verified_by_is_stored(robot):
    """Arms in motion, somebody near: a blend is chosen only with the stop behind it that is verified, or not at all.

    Braking harder now is not always safer, so that some blends have to be given up; that is seen here too. What a
    filter wants instead of the nominal is blended as well where it leaves little room to people.
    """
    filter = make_filter("stop", robot, 0.008, failsafe=FailsafeParams(graded=True))
    filter.records.make_room(people=1)
    arms, memory, work = filter.records.view.arms, filter.records.memory, filter.records.work
    bounds, rng, jerk = robot.limits.bounds(), np.random.default_rng(0), np.zeros(6)
    chosen = given_up = crowded = 0
    memory.touch[:], work.reach[:] = 0.0, 0.0
    for _ in range(3000):
        state = rng.uniform(-1.0, 1.0, (3, 6)) * [[0.8], [0.3], [0.3]] * np.array([np.ones(6), bounds[2], bounds[3]])
        state[0] += robot.home
        memory.state[0] = state
        work.grown["start"] = work.grown["end"] = rng.uniform([-1.2, -1.2, 0.4], [1.2, 1.2, 1.8])
        work.grown["radius"] = 0.1
        wanted = rng.uniform(-1.0, 1.0, 6) * bounds[4]
        own = rng.random() < 0.5
        work.clipped[:] = wanted * (0.9 if own else 1.0)
        memory.growth[:] = 0.02 if own else 1.6  # beside the slow a soft stop is as good as a hard one
        plan_stop(state, bounds, 0.008, memory.stored[0])
        codes = [_verified(arms, wanted, hardness) for hardness in range(len(HARDNESS))]
        roomy = not own or share_of(_room(arms, wanted)) == 1.0
        which = _choose(arms, wanted, jerk)
        crowded += codes[0] and not roomy
        if which == GRADED:
            assert not (codes[0] and roomy)
            assert any(codes)
            stop = work.next.copy()
            behind = [(_verified(arms, jerk, hardness), work.next.copy()) for hardness in range(len(HARDNESS))]
            assert any(verified and (plan == stop).all() for verified, plan in behind)
            chosen += 1
        else:
            assert (which == WANTED) == (codes[0] and roomy)
            given_up += any(codes) and not codes[0]
    assert chosen > 20
    assert given_up > 0
    assert crowded > 0


@njit
def _room(arms, wanted):
    return room_behind(arms.robot, arms.settings, arms.memory, wanted, arms.work, 0)


@njit
def _choose(arms, wanted, jerk):
    return choose(arms.robot, arms.settings, arms.memory, wanted, jerk, np.nan, arms.work, 0)[0]


@njit
def _verified(arms, jerk, hardness):
    return keeps_safe_by(arms.robot, arms.settings, arms.memory, jerk, hardness, arms.work, 0)[0] == SAFE


def test_graded_is_a_switch():
    with pytest.raises(ParameterError, match="graded has to be True or False, got 1"):
        FailsafeParams(graded=1)
    assert FailsafeParams().hardness == (1.0,)
    assert replace(FailsafeParams(), graded=True).hardness == HARDNESS


# ---- profiles ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_is_the_same_by_every_door(profile):
    env = jssa_gym.ArmEnv("home", human="none")
    filters = [jssa_gym.JSSAShield(env, profile=profile).filter, Shield(env, profile).filter]
    filters.append(make_filter(profile, env.robot, env.dt))
    for filter in filters:
        assert filter.params == PROFILES[profile]
        assert filter.viability
        assert filter.failsafe == FailsafeParams(graded=True)
    bold = jssa_gym.JSSAShield(env, profile=profile, horizon=0.3, failsafe={"graded": False, "human_speed": 1.0})
    assert (bold.filter.params.horizon, bold.filter.failsafe) == (0.3, FailsafeParams(human_speed=1.0))
    with pytest.raises(ParameterError, match="lambda1, lambda2, rows, recovery and options are of 'paper'"):
        jssa_gym.JSSAShield(env, profile=profile, lambda1=1.0)


def test_the_paper_knows_no_horizon():
    env = jssa_gym.ArmEnv("home", human="none")
    with pytest.raises(ParameterError, match="horizon is of the others"):
        jssa_gym.JSSAShield(env, horizon=1.0)
    with pytest.raises(ParameterError, match="profile"):
        jssa_gym.JSSAShield(env, profile="play")
