"""Alternatives, and stops that give way gradually: anything may propose, only the verification admits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from monitors import keeps_safe

import jssa_gym
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import make_human
from jssa_gym.safety.failsafe import HARDNESS, FailsafeParams
from jssa_gym.shields import PROFILES, Shield, make_filter
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


@pytest.mark.parametrize("name", ["jssa", "jssa+stop", "cbf+stop", "stop", "none", *PROFILES])
def test_the_first_alternative_in_the_box_is_applied(name):
    shield = beside(name)
    shield.reset(seed=0)
    bound = shield.unwrapped.robot.limits.jerk
    jerks = np.array([np.full(6, np.nan), 1.5 * bound, 0.25 * bound, 0.5 * bound])
    path = Straying(jerks)
    shield.offer(path)
    *_, info = shield.step(np.zeros(6))
    if shield.filter.compiled:
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
    assert caplog.records


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


def test_what_is_applied_before_a_softer_stop_is_followed_by_one(robot):
    """The stop that a graded shield stores behind the nominal keeps the softer limits."""
    filter = make_filter("stop", robot, 0.008, failsafe=FailsafeParams(graded=True))
    limits = filter.records.settings.soft_limits
    np.testing.assert_allclose(limits[:, 3], np.outer(HARDNESS, robot.limits.acceleration), rtol=1e-15)
    assert (limits[:, :3] == robot.limits.bounds()[:3]).all()
    shield = beside("stop", stop={"graded": True})
    shield.reset(seed=0)
    for _ in range(20):
        shield.step(np.full(6, 0.3))
    plan = shield.filter.records.memory.stored[0]
    assert (np.abs(plan["jerk_in"]) <= HARDNESS[0] * robot.limits.jerk * (1 + 1e-9)).all()
    assert keeps_safe(shield.filter, 0.3 * robot.limits.jerk)


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
