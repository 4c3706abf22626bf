"""Other observations than the default: everybody's whole body, the goal apart, pictures."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import jssa_gym
from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.envs.goals import Goals
from jssa_gym.envs.observation import MOST_PEOPLE, OBSERVATIONS, bodies
from jssa_gym.envs.tasks import Reach, Track
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS


@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("task", TASKS)
def test_every_task_has_every_observation(task, observation):
    check_env(ArmEnv(task, observation=observation), skip_render_check=True)


def test_others_are_refused():
    with pytest.raises(ParameterError, match="closest, full, goal"):
        ArmEnv("reach", observation="pixels")


# ---- everybody's whole body ---------------------------------------------------------------------------


@pytest.mark.parametrize("human", ["random", ("hand", "walk_by"), ("random",) * 3], ids=str)
def test_every_part_of_everybody_is_observed_where_it_is(human):
    env, alone = (ArmEnv("reach", human=human, observation=seen, terminate_on=()) for seen in ("full", "closest"))
    env.reset(seed=3), alone.reset(seed=3)
    slices, own = env.layout.slices, alone.layout.slices
    for _ in range(40):
        action = np.full(6, 0.1)
        observation, default = env.step(action)[0], alone.step(action)[0]
        people = env.scene.human
        count, room = len(people.radius), 6 * MOST_PEOPLE
        for name, values, high in (
            ("part_start", people.start - env.robot.mount, 2.0),
            ("part_end", people.end - env.robot.mount, 2.0),
            ("part_start_velocity", people.start_velocity, 3.0),
            ("part_end_velocity", people.end_velocity, 3.0),
        ):
            told = observation[slices[name]].reshape(room, 3)
            np.testing.assert_allclose(told[:count], np.clip(values, -high, high), atol=1e-6)
            assert not told[count:].any()
        np.testing.assert_array_equal(observation[slices["part_there"]], np.arange(room) < count)
        for name in own:  # and all that the default tells
            np.testing.assert_array_equal(observation[slices[name]], default[own[name]])


def test_its_size_does_not_depend_on_how_many_there_are():
    people = ["none", "random", ("random", "walk_by"), ("random", "walk_by", "hand")]
    spaces = [ArmEnv("reach", human=human, observation="full").observation_space for human in people]
    assert all(space == spaces[0] for space in spaces)
    with pytest.raises(ParameterError, match=r"room for 3 people.*take 'closest'"):
        ArmEnv("reach", human=("random",) * 4, observation="full")
    ArmEnv("reach", human=("random",) * 4)


def test_who_comes_when_there_is_no_room_left_is_not_observed():
    told = bodies(np.ones((2, 4, 20, 3)), np.zeros(3), 6)
    assert told.shape == (2, 13 * 18)
    np.testing.assert_array_equal(told, 1.0)


def test_nobody_is_masked():
    env = ArmEnv("reach", human="none", observation="full")
    observation, _ = env.reset(seed=0)
    slices = env.layout.slices
    assert all(not observation[part].any() for name, part in slices.items() if name.startswith("part_"))
    np.testing.assert_array_equal(observation[slices["human_distance"]], 2.0)


@pytest.mark.parametrize(("task", "human"), [("reach", "hand"), ("deliver", ["walk_by", "random"]), ("home", "none")])
def test_a_vector_observes_as_one_does(task, human):
    envs = gym.make_vec(f"jssa_gym/{task.capitalize()}-v0", 3, human=human, observation="full")
    alone = [ArmEnv(task, human=human, observation="full") for _ in range(3)]
    seen, _ = envs.reset(seed=4)
    for e, env in enumerate(alone):
        np.testing.assert_array_equal(seen[e], env.reset(seed=4 + e)[0])
    for actions in 0.2 * np.random.default_rng(0).uniform(-1.0, 1.0, (30, 3, 6)):
        seen = envs.step(actions)[0]
        for e, env in enumerate(alone):
            np.testing.assert_array_equal(seen[e], env.step(actions[e])[0])


# ---- the goal apart -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
@pytest.mark.parametrize("task", TASKS)
def test_the_reward_is_what_compute_reward_says_of_what_is_told(task, dynamics):
    env = ArmEnv(task, observation="goal", dynamics=dynamics, human="receive", terminate_on=(), d_min=0.5)
    env.reset(seed=2)
    rng, seen = np.random.default_rng(0), []
    for _ in range(10 if dynamics == "servo" else 60):
        told, reward, *_, info = env.step(rng.uniform(-1.0, 1.0, 6))
        achieved, desired = told["achieved_goal"], told["desired_goal"]
        assert reward == env.compute_reward(achieved, desired, info)
        assert reward == pytest.approx(sum(v for key, v in info.items() if key.startswith("reward/")), abs=1e-12)
        seen.append((achieved, desired, info, reward))
    achieved, desired, infos, rewards = (list(column) for column in zip(*seen, strict=True))
    np.testing.assert_array_equal(env.compute_reward(np.array(achieved), np.array(desired), infos), rewards)
    as_objects = np.array(infos, object)  # as a replay buffer has them
    np.testing.assert_array_equal(env.compute_reward(np.array(achieved), np.array(desired), as_objects), rewards)
    # what was achieved is worth most, and without infos nothing else counts
    np.testing.assert_array_equal(env.compute_reward(np.array(achieved), np.array(achieved), [{}] * len(seen)), 0.0)
    away = np.array(achieved) + np.float32(0.5)
    np.testing.assert_array_equal(env.compute_reward(away, np.array(achieved), [{}] * len(seen)), -1.0)
    assert type(env.compute_reward(achieved[0], achieved[0], {})) is float


def test_what_is_achieved_is_where_the_tool_is_and_what_is_desired_is_the_goal():
    env = ArmEnv("reach", observation="goal", human="none")
    told, _ = env.reset(seed=1)
    default, _ = ArmEnv("reach", human="none").reset(seed=1)
    np.testing.assert_array_equal(told["observation"], default[:-3])
    np.testing.assert_allclose(told["desired_goal"], env.goal - env.robot.mount, atol=1e-6)
    np.testing.assert_array_equal(told["achieved_goal"], told["observation"][env.layout.slices["tip"]])


def test_the_next_waypoint_is_what_is_desired():
    env = ArmEnv(Track(count=2), observation="goal", human="none", terminate_on=())
    told, _ = env.reset(seed=0)
    np.testing.assert_allclose(told["achieved_goal"], env.robot.home, atol=1e-6)
    np.testing.assert_allclose(told["desired_goal"], env.goal[0], atol=1e-6)
    env.state[0] = env.goal[0]
    told = env.step(np.zeros(6))[0]
    np.testing.assert_allclose(told["desired_goal"], env.goal[1], atol=1e-6)


@pytest.mark.parametrize(("gap", "missed"), [(0.0199, False), (0.0201, True)])
def test_near_is_within_the_tolerance(gap, missed):
    env = ArmEnv(Reach(), observation="goal")
    assert env.compute_reward(np.array([0.3, gap, 0.2]), np.array([0.3, 0.0, 0.2]), {}) == (-1.0 if missed else 0.0)
    joints = ArmEnv("home", observation="goal")  # root mean square, tolerance 0.05
    assert joints.compute_reward(np.full(6, 2.5 * gap), np.zeros(6), {}) == (-1.0 if missed else 0.0)


def test_compute_reward_is_of_goals_only():
    # by which libraries tell environments with goals from others
    for env in (ArmEnv("reach"), jssa_gym.ActionRepeat(ArmEnv("reach"), 5)):
        assert not hasattr(env, "compute_reward")
        assert not env.has_wrapper_attr("compute_reward")
    with pytest.raises(AttributeError, match="observation='goal'"):
        _ = ArmEnv("reach").compute_reward


def test_a_task_without_a_tolerance_has_no_goals_apart():
    class Vague(Reach):
        tolerance = property()

        def __post_init__(self):
            pass

    with pytest.raises(ParameterError, match=r"tolerance.*'closest'"):
        ArmEnv(Vague.__new__(Vague), observation="goal")


def test_vectors_refuse_dictionaries_and_say_what_to_do():
    with pytest.raises(ParameterError, match="vectorization_mode='sync'"):
        VectorArmEnv(2, "reach", observation="goal")
    envs = gym.make_vec("jssa_gym/Reach-v0", 2, vectorization_mode="sync", observation="goal")
    told, _ = envs.reset(seed=0)
    assert told["achieved_goal"].shape == (2, 3)
    envs.close()


@pytest.mark.parametrize("human", [human for human in HUMANS if human != "none"])
def test_success_does_not_depend_on_what_is_observed(human):
    action, found = np.random.default_rng(0).uniform(-1.0, 1.0, (30, 6)), []
    for observation in OBSERVATIONS:
        env = ArmEnv("deliver", human=human, observation=observation)
        env.reset(seed=5)
        infos = [env.step(one)[4] for one in action]
        found.append([(info["distance"], info["success"], info["deliver/legs"]) for info in infos])
    assert found[0] == found[1] == found[2]


def test_repeated_actions_are_worth_all_their_ticks():
    env = jssa_gym.ActionRepeat(ArmEnv("reach", observation="goal"), 5)
    far, near = np.zeros(3), np.zeros(3) + 0.001
    assert env.compute_reward(np.ones(3), far, {"reward/contact": -5.0}) == -30.0
    np.testing.assert_array_equal(env.compute_reward([near, near + 1.0], [far, far], [{}, {}]), [0.0, -5.0])


def test_stable_baselines3_finds_nothing_to_complain_about():
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable_baselines3 is not installed")
    for observation in OBSERVATIONS:
        checker.check_env(gym.make("jssa_gym/DeliverShielded-v0", observation=observation).unwrapped)


@pytest.mark.long
def test_hindsight_trains(monkeypatch):
    sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    env = gym.make("jssa_gym/ReachShielded-v0", observation="goal", human="none", max_episode_steps=100)
    env = jssa_gym.ActionRepeat(jssa_gym.JPCAction(env, mode="tip", share=1.0), 5)
    asked, real = [], Goals.reward
    monkeypatch.setattr(Goals, "reward", lambda *pairs: asked.append(real(*pairs)) or asked[-1])
    model = sb3.SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future", "copy_info_dict": True},
        learning_starts=100,
        train_freq=4,
        batch_size=64,
        device="cpu",
        seed=0,
        policy_kwargs={"net_arch": [32, 32]},
    )
    model.learn(240)
    assert len(asked) >= 30
    rewards = model.replay_buffer.sample(300).rewards.numpy().ravel()
    # on its own way the arm never met a goal; in hindsight it has met what it came to
    assert model.replay_buffer.rewards[:240].max() < -4.0
    assert (rewards > -1.0).sum() > 10
    assert rewards.min() < -4.0
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert action in env.action_space


# ---- pictures -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_pictures_are_observed_by_gymnasiums_own_wrapper():
    env = gym.make("jssa_gym/Reach-v0", render_mode="rgb_array", width=64, height=48)
    env = gym.wrappers.AddRenderObservation(env, render_only=True)
    first, _ = env.reset(seed=0)
    assert env.observation_space.contains(first)
    assert first.shape == (48, 64, 3)
    for _ in range(40):
        later = env.step(np.ones(6, np.float32))[0]
    assert np.any(later != first)
    env.close()
