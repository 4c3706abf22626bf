"""Deliver against hand computation: legs, reward, throughput; alone, in vectors, by hand and by scripted policies."""

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.control.inverse import postures_for
from jssa_gym.envs import ArmEnv
from jssa_gym.envs.tasks import Deliver, Moment, Progress
from jssa_gym.evaluation import rollout, summarise
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES
from jssa_gym.robots import ROBOTS
from jssa_gym.safety.postures import reach_of, room, tool_point

DT = 0.008


@pytest.fixture(scope="module")
def places(robot):
    """Two postures, and where they put the tool of an arm on the table."""
    arm = robot.mounted([0.0, 0.0, 0.87])
    postures = [arm.home + np.array([side, 0.2, 0.0, 0.0, 0.0, 0.0]) for side in (0.5, -0.5)]
    return postures, np.array([tool_point(arm, posture) for posture in postures])


def delivery(places, **options):
    env = ArmEnv(Deliver(**options), human="none", terminate_on=())
    env.reset(seed=0, options={"goal": places[1]})
    return env


def put(env, position, velocity=0.0):
    """Put the arm somewhere; a step without jerk then measures it there."""
    env.state[0], env.state[1], env.state[2] = position, velocity, 0.0
    return env.step(np.zeros(6))


def stay(env, position, steps):
    return [put(env, position)[-1] for _ in range(steps)]


def test_legs_are_counted_in_their_order_after_a_stay(places):
    (fetch, bring), points = places
    env = delivery(places)
    np.testing.assert_array_equal(env.goal, points[0])
    # to bring something it has to be fetched first
    assert stay(env, bring, 30)[-1]["deliver/legs"] == 0
    legs = [info["deliver/legs"] for info in stay(env, fetch, 14)]
    assert legs == [0] * 12 + [1, 1]  # 0.1 s are 12.5 steps
    np.testing.assert_array_equal(env.goal, points[1])
    # a stay that is broken off begins anew
    stay(env, bring, 12), stay(env, fetch, 1)
    assert [info["deliver/legs"] for info in stay(env, bring, 13)] == [1] * 12 + [2]
    seen = [*stay(env, fetch, 13), *stay(env, bring, 13)]
    assert [info["success"] for info in seen] == [False] * 25 + [True]
    assert (seen[-1]["deliver/legs"], seen[-1]["deliver/deliveries"]) == (4, 2)
    # and that is all: the last place stays the goal
    assert stay(env, fetch, 20)[-1]["deliver/legs"] == 4
    np.testing.assert_array_equal(env.goal, points[1])


@pytest.mark.parametrize(("gap", "speed", "counts"), [(0.019, 0.04, True), (0.021, 0.0, False), (0.0, 0.06, False)])
def test_a_leg_ends_near_its_place_at_rest(places, gap, speed, counts):
    task, place = Deliver(), places[1][0]
    moment = Moment(np.zeros(6), place + np.array([0.0, gap, 0.0]), speed, np.zeros(6), np.inf, False)
    assert (task.advance(places[1], moment, np.zeros(6), 0.2).visited == 1) is counts


def test_the_reward_is_the_way_that_is_left_and_does_not_jump_where_a_leg_ends(places):
    (fetch, bring), points = places
    env = delivery(places)
    leg = np.linalg.norm(points[1] - points[0])
    begin = env.step(np.zeros(6))[-1]
    away = np.linalg.norm(points[0] - tool_point(env.robot, env.robot.home))
    assert begin["reward/deliver"] == pytest.approx(-(away + 3.0 * leg))
    assert begin["reward/near"] == pytest.approx(-(np.tanh(away / 0.1) + 3.0))
    rewards = []
    for place in (fetch, bring, fetch, bring):
        for _ in range(13):
            _, reward, _, _, info = put(env, place)
            rewards.append(reward)
    at = np.array(rewards)
    # where it stays, nothing changes, not even as the next place becomes the goal but for tanh(leg / 0.1) < 1
    assert np.abs(np.diff(at[:13])).max() < 1e-4 > np.abs(np.diff(at[13:26])).max()
    np.testing.assert_allclose(at[[0, 13, 26, 39]], [-3.0 * (leg + 1), -2.0 * (leg + 1), -(leg + 1), 0.0], atol=1e-3)
    assert at[51] == pytest.approx(10.0, abs=1e-9)
    assert info["reward/success"] == 10.0


def test_deliveries_per_minute_count_until_the_last(places):
    (fetch, bring), _ = places
    env = delivery(places)
    assert env.reset(seed=0, options={"goal": places[1]})[1]["deliver/per_minute"] == 0.0
    stay(env, fetch, 50), stay(env, bring, 50)
    assert put(env, fetch)[-1]["deliver/per_minute"] == pytest.approx(60.0 / (101 * DT))
    stay(env, fetch, 12)
    last = stay(env, bring, 13)[-1]
    assert last["deliver/per_minute"] == pytest.approx(120.0 / (126 * DT))
    assert stay(env, bring, 100)[-1]["deliver/per_minute"] == last["deliver/per_minute"]


def test_both_places_and_what_is_done_are_observed(places):
    (fetch, bring), points = places
    env = delivery(places, count=1)
    seen = env.layout.slices
    observation = put(env, fetch)[0]
    np.testing.assert_allclose(observation[seen["goal"]], 0.0, atol=1e-6)
    np.testing.assert_allclose(observation[seen["other"]], points[1] - points[0], atol=1e-6)
    assert observation[seen["stay"]] == pytest.approx(DT / 0.1)
    assert observation[seen["done"]] == 0.0
    stay(env, fetch, 12)
    observation = put(env, bring)[0]
    np.testing.assert_allclose(observation[seen["goal"]], 0.0, atol=1e-6)
    np.testing.assert_allclose(observation[seen["other"]], points[0] - points[1], atol=1e-6)
    assert observation[seen["done"]] == 0.5


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ROBOTS)
def test_drawn_places_are_apart_and_in_reach(name):
    env = ArmEnv("deliver", robot=name, human="none")
    found, rng, clear = [], np.random.default_rng(0), min(room(env.robot, env.planes, (0.01, 0.01)))
    for seed in range(15):
        env.reset(seed=seed)
        goal = env.task.draw_goal(np.random.default_rng(seed), env.robot, env.planes)
        fetch, bring = goal
        np.testing.assert_array_equal(env.goal, fetch)
        np.testing.assert_array_equal(env.task.check_goal(goal, env.robot), goal)
        assert 0.4 <= np.linalg.norm(fetch - bring) / reach_of(env.robot) <= 0.8
        found.append(fetch)
        for place in (fetch, bring):
            assert postures_for(env.robot, place, env.planes, env.robot.home, rng, restarts=30, clear=clear)
    assert np.ptp(found, axis=0).min() > 0.2
    env.reset(seed=3)
    np.testing.assert_array_equal(env.goal, found[3])


@pytest.mark.parametrize(
    ("goal", "told"),
    [
        ([0.5, 0.0, 1.3], "two points"),
        ([[0.5, 0.0, 1.3], [np.nan, 0.0, 1.3]], "two points"),
        ([[0.5, 0.0, 1.3], [5.0, 0.0, 1.3]], "cannot be reached"),
        ([[0.5, 0.0, 1.3], [0.5, 0.03, 1.3]], "apart"),
    ],
)
def test_bad_places_are_refused_before_anything_changes(goal, told):
    env = ArmEnv("deliver", human="none")
    env.reset(seed=0)
    before = env.goal
    with pytest.raises(ParameterError, match=told):
        env.reset(seed=1, options={"goal": goal})
    np.testing.assert_array_equal(env.goal, before)


@pytest.mark.parametrize("arguments", [{"stay": 0.01}, {"count": 0}, {"tolerance": -1.0}, {"speed": np.inf}], ids=str)
def test_bad_parameters_are_named(arguments):
    with pytest.raises(ParameterError, match=next(iter(arguments))):
        Deliver(**arguments)


def test_a_task_alone_waits_at_its_first_place(places):
    np.testing.assert_array_equal(Deliver().present(places[1], Progress()), places[1][0])


@pytest.mark.long
@pytest.mark.parametrize("policy", ["jpc", "jpc_paper"])
def test_the_position_controllers_deliver(policy):
    for seed in range(2):
        env = gym.make("jssa_gym/Deliver-v0", human="none")
        trace = rollout(env, POLICIES[policy](env, seed), seed=seed)
        summary = summarise(trace, env.unwrapped.robot.limits)
        assert summary.success
        assert summary.limit_violation_rate == 0.0
        assert 2.0 < summary.time_to_goal < 6.0
        assert summary.deliveries_per_minute == pytest.approx(120.0 / summary.time_to_goal)


def test_the_throughput_of_a_recording_is_that_of_info(places):
    (fetch, bring), _ = places
    env = delivery(places)
    script = iter([fetch] * 14 + [bring] * 14 + [fetch] * 40)

    def policy(observation):
        env.state[0], env.state[1:] = next(script), 0.0
        return np.zeros(6)

    trace = rollout(env, policy, steps=68, options={"goal": places[1]})
    summary = summarise(trace, env.robot.limits)
    assert not summary.success
    assert summary.deliveries_per_minute == pytest.approx(60.0 / (68 * DT))


def test_a_vector_counts_legs_as_one_does(places):
    """Arms that are put where they are to be: what the comparisons of random arms hardly ever see."""
    (fetch, bring), _ = places
    envs = gym.make_vec("jssa_gym/Deliver-v0", 2, human="none", terminate_on=(), max_episode_steps=None)
    alone = [delivery(places), delivery(places)]
    envs.reset(seed=0, options={"goal": places[1]})
    for env in alone:
        env.reset(options={"goal": places[1]})
    first, second = [fetch] * 15 + [bring] * 15, [bring] * 5 + [fetch] * 25
    for k, both in enumerate(zip(first * 3, second * 3, strict=True)):
        envs.state[:, 0], envs.state[:, 1:] = both, 0.0
        seen, rewards, terminated, _, infos = envs.step(np.zeros((2, 6)))
        for e, (env, position) in enumerate(zip(alone, both, strict=True)):
            observation, reward, ended, _, info = put(env, position)
            np.testing.assert_array_equal(seen[e], observation)
            assert (rewards[e], terminated[e]) == (reward, ended), k
            for name in ("legs", "deliveries", "per_minute"):
                assert infos[f"deliver/{name}"][e] == info[f"deliver/{name}"], (k, name)
            assert infos["success"][e] == info["success"]
            np.testing.assert_array_equal(envs.goal_of(e), env.goal)
    assert infos["deliver/legs"].tolist() == [4, 1]
