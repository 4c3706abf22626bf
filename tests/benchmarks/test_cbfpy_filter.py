"""CBFpy as a filter: what is asked of it and made of its answers, with somebody in its place where it is missing."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT

import jssa_gym
from jssa_gym.shields import JSSAFilter, Shield
from jssa_gym.types import Status

ROBOT = gym.make("jssa_gym/Home-v0").unwrapped.robot
DT = 0.008


@pytest.fixture
def module(monkeypatch):
    monkeypatch.syspath_prepend(ROOT)
    import benchmarks.cbfpy_filter as found

    yield found
    for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
        del sys.modules[name]


def scenes(steps=300):
    """Scenes beside somebody who walks up, each with a jerk that brings the arm home."""
    env = gym.make("jssa_gym/Home-v0", human="approach_retreat", terminate_on=())
    shielded = jssa_gym.JSSAShield(env)
    policy = jssa_gym.HoldPolicy(env)
    observation, _ = shielded.reset(seed=3)
    for _ in range(steps):
        action = policy(observation)
        yield env.unwrapped.scene, action * ROBOT.limits.jerk
        observation, *_ = shielded.step(action)


def test_answers_are_kept_in_the_box_and_near_ones_are_the_nominal(module, monkeypatch):
    asked, answers = [], []

    def solver(z, jerk, people):
        asked.append((z, jerk, people))
        return jerk + answers.pop(0) * ROBOT.limits.jerk

    monkeypatch.setattr(module, "compiled", lambda robot, dt, humans: solver)
    scene, nominal = next(scenes())
    tamed = module.CBFpyFilter(ROBOT, DT)
    tamed.reset(scene)
    answers += [1e-4, 0.5, 5.0, np.nan]
    decisions = [tamed.decide(scene._replace(time=k * DT), nominal) for k in range(1)]
    z, jerk, people = asked[0]
    np.testing.assert_array_equal(z, [*scene.robot.position, *scene.robot.velocity, *scene.robot.acceleration, 0.0])
    np.testing.assert_array_equal(jerk, nominal)
    human = scene.human
    expected = np.column_stack([human.start, human.end, human.start_velocity, human.end_velocity, human.radius])
    np.testing.assert_array_equal(people, expected)
    assert decisions[0].status == Status.NOMINAL
    np.testing.assert_array_equal(decisions[0].jerk, nominal)
    for status in (Status.PROJECTED, Status.PROJECTED, Status.FAULT):
        fresh = module.CBFpyFilter(ROBOT, DT)
        fresh.reset(scene)
        decision = fresh.decide(scene, nominal)
        assert decision.status == status
        assert np.all(np.abs(decision.jerk) <= ROBOT.limits.jerk)
    assert "CBFpy found no jerk" in decision.reason


def test_it_is_a_submission(module, monkeypatch):
    from jssa_gym.board import filter_factory

    assert filter_factory("benchmarks.cbfpy_filter:CBFpyFilter+stop") is module.CBFpyFilter
    inside = module.CBFpyFilter(ROBOT, DT, viability=True, failsafe=jssa_gym.FailsafeParams())
    assert isinstance(Shield(gym.make("jssa_gym/Home-v0"), inside).filter, module.CBFpyFilter)


def test_the_shield_has_little_to_change_in_cbfpys_own_answers(module):
    pytest.importorskip("cbfpy")
    theirs, ours, left, asked = module.CBFpyFilter(ROBOT, DT), JSSAFilter(ROBOT, DT, recovery=0.0), [], []
    for k, (scene, nominal) in enumerate(scenes()):
        if k == 0:
            theirs.reset(scene)
            ours.reset(scene)
        one = theirs.decide(scene, nominal)
        other = ours.decide(scene, one.jerk)
        if one.status == Status.PROJECTED:
            asked.append(np.abs(one.jerk - nominal).max())
            left.append(np.abs(other.jerk - one.jerk).max())
    assert len(asked) > 50
    # one keeps the barrier in continuous time, the other at the end of the step
    assert np.median(left) < 0.2 * np.median(asked)
