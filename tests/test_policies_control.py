"""The scripted policies and the controller behind them."""

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.control import Cascade
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import HoldPolicy, RandomPolicy
from jssa_gym.types import JointState

HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])


def displaced(robot, rng, corner):
    low, high = robot.limits.position.T
    return np.where(rng.random(robot.n) < 0.5, low, high) if corner else rng.uniform(low, high)


@pytest.mark.parametrize("count", [8, pytest.param(200, marks=pytest.mark.slow)])
def test_hold_returns_home_within_all_limits(robot, count):
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    limits, rng = robot.limits, np.random.default_rng(0)
    low, high = limits.position.T
    moved = 0.0
    for k in range(count):
        start = displaced(robot, rng, corner=k % 2 == 0)
        observation, _ = env.reset(seed=0, options={"joint_position": start})
        policy, side = HoldPolicy(env), np.sign(start - HOME)
        for _ in range(1000):
            action = policy(observation)
            assert np.abs(action).max() <= 1.0
            observation, _, _, _, info = env.step(action)
            state = env.unwrapped.scene.robot
            assert not info["limit_violation"]
            assert np.all((low <= state.position) & (state.position <= high))
            assert np.all(np.abs(state.velocity) <= limits.velocity)
            assert np.all(np.abs(state.acceleration) <= limits.acceleration)
            assert np.all(np.abs(info["jerk"]) <= limits.jerk)
            # overshoot: beyond home, seen from where it came
            assert np.max(-side * (state.position - HOME)) < 1e-3
            moved = max(moved, np.abs(state.velocity / limits.velocity).max())
        np.testing.assert_allclose(state.position, HOME, atol=1e-4)
        np.testing.assert_allclose(state.velocity, 0.0, atol=1e-4)
    # the velocity reference really was at its share of the limit
    assert moved > 0.4


def test_hold_goes_where_it_is_told(robot):
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    env.reset(seed=0)
    target = HOME + np.array([0.4, -0.2, 0.3, 0.5, -0.3, 1.0])
    policy = HoldPolicy(env, target)
    for _ in range(800):
        env.step(policy(None))
    np.testing.assert_allclose(env.unwrapped.scene.robot.position, target, atol=1e-3)


def test_hold_reads_the_state_through_wrappers_and_keeps_its_own_target():
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="none"))
    env.reset(seed=0)
    target = HOME + 0.1
    policy = HoldPolicy(env, target)
    first = policy(None)
    target[:] = 0.0
    np.testing.assert_array_equal(policy(None), first)
    assert np.abs(first).max() > 0.0
    # at home and at rest nothing is to be done
    np.testing.assert_array_equal(HoldPolicy(env)(None), np.zeros(6))


def test_random_is_uniform_and_fixed_by_its_seed():
    env = gym.make("jssa_gym/Home-v0")
    one, two, other = RandomPolicy(env, 1), RandomPolicy(env, 1), RandomPolicy(env, 2)
    drawn = np.array([one(None) for _ in range(500)])
    np.testing.assert_array_equal(drawn, [two(None) for _ in range(500)])
    assert not np.array_equal(drawn[0], other(None))
    assert drawn.shape == (500, 6)
    assert np.abs(drawn).max() <= 1.0
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(drawn.std(axis=0), 1.0 / np.sqrt(3.0), atol=0.05)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_the_cascade_keeps_its_references_to_a_share_of_the_limits(robot, share):
    limits = robot.limits
    cascade = Cascade(limits, share=share, kp=20.0)
    far = limits.position[:, 1]
    # at the velocity reference it asks for no more acceleration; beyond it, for less
    at = JointState(limits.position[:, 0] + 0.0, share * limits.velocity, np.zeros(6))
    np.testing.assert_allclose(cascade.jerk(at, far), 0.0, atol=1e-9)
    over = at._replace(velocity=1.1 * at.velocity)
    assert np.all(cascade.jerk(over, far) < 0.0)
    under = at._replace(velocity=0.9 * at.velocity)
    assert np.all(cascade.jerk(under, far) > 0.0)
    # at the acceleration reference it asks for no more jerk
    held = JointState(limits.position[:, 0] + 0.0, -10.0 * limits.velocity, share * limits.acceleration)
    np.testing.assert_allclose(cascade.jerk(held, far), 0.0, atol=1e-9)


def test_the_cascade_never_asks_for_more_jerk_than_there_is(robot):
    rng = np.random.default_rng(0)
    limits, cascade = robot.limits, Cascade(robot.limits)
    for _ in range(200):
        state = JointState(*(rng.normal(size=6) * 10.0 ** rng.uniform(-3, 5) for _ in range(3)))
        jerk = cascade.jerk(state, rng.normal(size=6) * 10.0)
        assert np.all(np.abs(jerk) <= limits.jerk)


def test_the_cascade_clips_its_target_to_the_position_limits(robot):
    low, high = robot.limits.position.T
    cascade = Cascade(robot.limits)
    at_limit = JointState(high.copy(), np.zeros(6), np.zeros(6))
    np.testing.assert_array_equal(cascade.jerk(at_limit, high + 1.0), np.zeros(6))
    at_limit = JointState(low.copy(), np.zeros(6), np.zeros(6))
    np.testing.assert_array_equal(cascade.jerk(at_limit, low - 1.0), np.zeros(6))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"share": 0.0}, "share"),
        ({"share": 1.1}, "share"),
        ({"share": np.nan}, "share"),
        ({"kp": 0.0}, "gains"),
        ({"kv": -1.0}, "gains"),
        ({"ka": np.inf}, "gains"),
        ({"kp": np.nan}, "gains"),
    ],
    ids=str,
)
def test_bad_gains_are_refused(robot, arguments, word):
    with pytest.raises(ParameterError, match=word):
        Cascade(robot.limits, **arguments)
