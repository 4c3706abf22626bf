"""The scripted policies and the controller behind them."""

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.control import Cascade
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, HumanMotion, nobody
from jssa_gym.policies import (
    POLICIES,
    BangBangPolicy,
    ChasePolicy,
    ConstantPolicy,
    HoldPolicy,
    LimitSeekingPolicy,
    RandomPolicy,
    SteeredPolicy,
    StraightPolicy,
    WanderPolicy,
)
from jssa_gym.safety.postures import tool_point
from jssa_gym.safety.proximity import measure
from jssa_gym.types import JointState

HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])


def displaced(robot, rng, corner):
    low, high = robot.limits.position.T
    return np.where(rng.random(robot.n) < 0.5, low, high) if corner else rng.uniform(low, high)


@pytest.mark.long
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


def unshielded(policy, seed=0, steps=1000, human="random", **options):
    """Actions (steps, n), joint states (steps, 3, n), infos and tip positions (steps, 3) of an unshielded episode."""
    env = gym.make("jssa_gym/Home-v0", human=human, terminate_on=())
    observation, _ = env.reset(seed=seed, options=options)
    chosen = policy(env)
    actions, states, infos, tips = [], [], [], []
    for _ in range(steps):
        actions.append(chosen(observation))
        observation, _, _, _, info = env.step(actions[-1])
        state = env.unwrapped.scene.robot
        states.append((state.position, state.velocity, state.acceleration))
        infos.append(info)
        tips.append(env.unwrapped.robot_capsules.end[-1])  # the tool centre point ends the tool's capsule
    return np.array(actions), np.array(states), infos, np.array(tips)


def paths(tips):
    """Speed of a tip by differences, shape (steps - 1,) [m/s]."""
    return np.linalg.norm(np.diff(tips, axis=0), axis=1) / 0.008


@pytest.mark.parametrize("name", POLICIES)
class TestEveryPolicy:
    @pytest.mark.sampled(2)
    def test_its_actions_are_finite_within_bounds_and_its_own(self, name):
        for human in ("random", "none"):
            actions, *_ = unshielded(lambda env: POLICIES[name](env, 0), human=human)
            assert actions.shape == (1000, 6)
            assert np.all(np.isfinite(actions))
            assert np.abs(actions).max() <= 1.0

    def test_a_seed_fixes_it(self, name):
        one, two, other = (unshielded(lambda env, k=k: POLICIES[name](env, k), steps=150)[0] for k in (1, 1, 2))
        np.testing.assert_array_equal(one, two)
        if name not in ("hold", "chase", "straight", "jpc", "jpc_paper"):  # jpc: at home there is nothing to draw
            assert not np.array_equal(one, other)

    def test_it_serves_episode_after_episode_under_a_shield(self, name):
        env = jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0", human="hand", terminate_on=()))
        policy = POLICIES[name](env, None)
        for seed in range(2):
            observation, _ = env.reset(seed=seed)
            for _ in range(60):
                action = policy(observation)
                assert env.action_space.contains(action.astype(np.float32))
                kept = action.copy()
                observation, *_ = env.step(action)
                action[:] = np.nan  # what was returned is the caller's
            assert np.all(np.isfinite(kept))


def test_wander_is_in_motion_and_keeps_the_limits():
    speeds, spread = [], []
    for seed in range(4):
        _, states, infos, tips = unshielded(lambda env, k=seed: WanderPolicy(env, k), seed, human="none")
        assert not any(info["limit_violation"] for info in infos)
        speeds.append(paths(tips))
        spread.append(np.ptp(states[:, 0], axis=0))
    moving = np.concatenate(speeds)
    assert moving.mean() > 0.5
    assert np.mean(moving > 0.05) > 0.9
    # every joint takes part
    assert np.max(spread, axis=0).min() > 1.0


def test_wander_goes_elsewhere_when_it_is_kept_from_its_posture():
    env = gym.make("jssa_gym/Home-v0", human="none", terminate_on=())
    env.reset(seed=0)
    policy = WanderPolicy(env, 0, patience=0.5)
    actions = []
    for _ in range(200):  # somebody else has the arm: it stays at home
        actions.append(policy(None))
        env.step(np.zeros(6))
    assert len(np.unique(actions, axis=0)) == 4


def test_wander_draws_postures_clear_of_the_table_and_the_arm_itself(robot):
    env = gym.make("jssa_gym/Home-v0", human="none")
    env.reset(seed=0)
    policy = WanderPolicy(env, 0)
    planes = env.unwrapped.scene.planes
    low, high = robot.limits.position.T
    for _ in range(50):
        posture, _ = policy.draw(planes)
        assert np.all((low < posture) & (posture < high))
        near = measure(robot, JointState(posture, np.zeros(6), np.zeros(6)), nobody(), planes)
        assert min(near.planes.min(), near.own.min()) >= 0.03


def test_bang_bang_is_full_jerk_that_switches_joint_by_joint():
    actions, *_ = unshielded(lambda env: BangBangPolicy(env, 0, period=0.1))
    assert set(np.unique(actions)) == {-1.0, 1.0}
    switches = np.count_nonzero(np.diff(actions, axis=0), axis=0)
    # 8 s of switches every 0.1 s
    assert np.all((switches >= 50) & (switches <= 110))
    assert not np.array_equal(actions[:, 0], actions[:, 1])


def test_constant_is_constant_between_draws_and_new_in_every_episode():
    actions, *_ = unshielded(lambda env: ConstantPolicy(env, 0, period=1.0))
    changes = np.any(np.diff(actions, axis=0) != 0.0, axis=1)
    assert 2 <= np.count_nonzero(changes) <= 20
    env = gym.make("jssa_gym/Home-v0")
    policy = ConstantPolicy(env, 0, period=1e6)
    env.reset(seed=0)
    first = policy(None)
    env.step(first)
    np.testing.assert_array_equal(policy(None), first)
    env.reset(seed=1)
    assert not np.array_equal(policy(None), first)


def test_limit_seeking_exceeds_every_kind_of_limit_on_either_side(robot):
    limits = robot.limits
    low, high = limits.position.T
    over = np.zeros((4, 6), bool)
    for seed in range(6):
        actions, states, infos, _ = unshielded(lambda env, k=seed: LimitSeekingPolicy(env, k), seed)
        over[0] |= np.any(states[:, 0] > high, axis=0)
        over[1] |= np.any(states[:, 0] < low, axis=0)
        over[2] |= np.any(np.abs(states[:, 1]) > 1.1 * limits.velocity, axis=0)
        over[3] |= np.any(np.abs(states[:, 2]) > 1.1 * limits.acceleration, axis=0)
        assert any(info["limit_violation"] for info in infos)
        assert np.abs(actions).max() == 1.0
        # beyond, but not without end: a joint turns once it is past its range
        assert np.abs((states[:, 0] - (low + high) / 2.0) / (high - low)).max() < 2.5
        assert np.abs(states[:, 1] / limits.velocity).max() < 1.5
    assert over.all()


def test_chase_closes_the_distance_and_hits():
    for seed in range(4):
        _, _, infos, tips = unshielded(lambda env: ChasePolicy(env), seed, human=Statue(), steps=400)
        distance = np.array([info["distance"] for info in infos])
        assert distance[0] > 0.2
        assert distance.min() <= 0.0
        assert any(info["contact_speed"] > 0.1 for info in infos)
        # it went for it: one joint at least came near its speed or acceleration limit
        assert paths(tips).max() > 0.5
    # wherever the person stands
    for bearing in (-2.0, 0.0, 1.5):
        there = 0.95 * np.array([np.cos(bearing), np.sin(bearing)])
        _, _, infos, _ = unshielded(lambda env: ChasePolicy(env), 0, human=Statue(), steps=500, human_start=there)
        assert min(info["distance"] for info in infos) <= 0.0


def test_chase_holds_still_where_nobody_is():
    actions, *_ = unshielded(lambda env: ChasePolicy(env), human="none", steps=50)
    np.testing.assert_array_equal(actions, 0.0)


class Statue(HumanMotion):
    """Stands still in front of the arm."""

    speed_bound = 0.0
    reacts = False

    def reset(self, rng, start=None, person=0):
        root = (1.1, rng.uniform(-0.2, 0.2)) if start is None else (float(start[0]), float(start[1]))
        self.capsules = Body.facing(np.arctan2(-root[1], -root[0]), person).at(root, (0.0, 0.0))
        return self.capsules

    def step(self, dt, robot):
        return self.capsules


def test_steered_policy_plays_its_parameters():
    parameters = np.random.default_rng(0).uniform(-1.5, 1.5, (5, 6))
    actions, *_ = unshielded(lambda env: SteeredPolicy(env, parameters, period=0.2), steps=150)
    for k in range(150):
        expected = np.clip(parameters[k // 25], -1.0, 1.0) if k < 125 else np.zeros(6)
        np.testing.assert_array_equal(actions[k], expected)


@pytest.mark.parametrize(
    ("build", "word"),
    [
        (lambda env: SteeredPolicy(env, np.zeros((3, 5))), "segments, 6"),
        (lambda env: SteeredPolicy(env, np.zeros(6)), "segments, 6"),
        (lambda env: SteeredPolicy(env, np.full((3, 6), np.nan)), "parameters"),
        (lambda env: SteeredPolicy(env, np.zeros((3, 6)), period=0.0), "period"),
        (lambda env: BangBangPolicy(env, period=0.0), "period"),
        (lambda env: ConstantPolicy(env, period=np.nan), "period"),
        (lambda env: LimitSeekingPolicy(env, excess=-1.0), "excess"),
        (lambda env: LimitSeekingPolicy(env, patience=0.0), "patience"),
        (lambda env: ChasePolicy(env, damping=0.0), "damping"),
        (lambda env: WanderPolicy(env, patience=0.0), "patience"),
        (lambda env: WanderPolicy(env, share=(0.0, 1.0)), "share"),
        (lambda env: WanderPolicy(env, share=(0.5, 1.5)), "share"),
    ],
)
def test_bad_parameters_of_policies_are_named(build, word):
    with pytest.raises(ParameterError, match=word):
        build(gym.make("jssa_gym/Home-v0"))


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


@pytest.mark.parametrize("task", ["reach", "handover"])
def test_straight_brings_the_tool_to_the_goal_on_a_line(task):
    env = jssa_gym.ArmEnv(task, human="none" if task == "reach" else None, terminate_on=())
    policy, arrived = POLICIES["straight"](env, None), 0
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        begin = before = tool_point(env.robot, env.scene.robot.position)
        goal, aside = env.goal, 0.0
        for _ in range(700):
            observation, *_, info = env.step(policy(observation))
            way = (goal - begin) / np.linalg.norm(goal - begin)
            tip = tool_point(env.robot, env.scene.robot.position)
            assert np.linalg.norm(tip - before) < 1.0 * env.dt
            off, before = tip - begin, tip
            aside = max(aside, np.linalg.norm(off - off.dot(way) * way))
            assert not info["limit_violation"]
            if info["success"]:
                arrived += 1
                break
        if task == "reach" and info["success"]:
            assert aside < 0.25 * np.linalg.norm(goal - begin) + 0.02
    assert arrived >= 3


def test_straight_creeps_where_a_shield_lets_it():
    """The controller that plans is stopped short beside a person; this one arrives, slowly."""
    env = gym.make("jssa_gym/HandoverShielded-v0", terminate_on=())
    policy = POLICIES["straight"](env, None)
    observation, _ = env.reset(seed=0)
    touched, moving = 0, False
    for _ in range(1000):
        observation, *_, info = env.step(policy(observation))
        touched += info["shield/intervened"]
        moving = moving or info["contact_speed"] > 0.1
        if info["success"]:
            break
    assert info["success"]
    assert touched > 20
    assert not moving


def test_straight_needs_a_goal():
    with pytest.raises(ParameterError, match="no goal"):
        StraightPolicy(gym.make("CartPole-v1"))
