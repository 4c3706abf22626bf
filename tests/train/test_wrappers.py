"""What a learner is told of the shield, against values of one's own, beside a person who walks into the arm."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import jssa_gym
from jssa_gym.envs import TASKS
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.train import (
    PPO,
    SAC,
    ExecutedAction,
    InterventionPenalty,
    ObserveIntervention,
    TrainConfig,
    control_env,
    training_env,
)

CLOSE = TrainConfig(task="reach", human="pursuit", control="jerk")
ALONE = replace(CLOSE, human="none")


def actions(env, count, seed=0, size=1.0):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-size, size, (count // 25 + 1, *env.action_space.shape))  # long enough to get somewhere
    return np.repeat(low, 25, axis=0)[:count].astype(np.float32)


def play(env, steps=400, seed=3, size=1.0):
    """Observations, rewards and infos of one episode; it has to go on for all steps."""
    observation, _ = env.reset(seed=seed)
    seen = [(observation, 0.0, {})]
    for action in actions(env, steps, size=size):
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation, reward, info))
        if terminated or truncated:
            break
    env.close()
    return seen


# ---- penalty -----------------------------------------------------------------------------------------


def test_the_penalty_is_the_weight_times_the_largest_change():
    plain, charged = (play(env) for env in (control_env(CLOSE), InterventionPenalty(control_env(CLOSE), 0.3)))
    changes = np.array([min(info["shield/correction"], 1.0) for _, _, info in plain[1:]])
    assert (changes > 0.1).any()
    assert (changes == 0.0).any()
    assert len(plain) == len(charged)
    for (before, reward, _), (after, less, info), change in zip(plain[1:], charged[1:], changes, strict=True):
        np.testing.assert_array_equal(before, after)
        assert info["reward/intervention"] == -0.3 * change
        assert less == reward - 0.3 * change


def test_the_penalty_is_summed_over_the_ticks():
    env = training_env(replace(CLOSE, learn_from="penalty", penalty=0.3, ticks=10))
    own = control_env(CLOSE)
    env.reset(seed=3)
    own.reset(seed=3)
    charged = 0.0
    for action in actions(env, 750)[::25]:
        _, reward, terminated, truncated, _ = env.step(action)
        ticks = [own.step(action) for _ in range(10)]
        penalty = sum(0.3 * min(info["shield/correction"], 1.0) for *_, info in ticks)
        assert reward == pytest.approx(sum(tick[1] for tick in ticks) - penalty, abs=1e-9)
        charged += penalty
        assert not terminated
        assert not truncated
    assert charged > 0.1
    env.close()
    own.close()


def test_without_interventions_nothing_is_charged_and_nothing_observed():
    plain = play(control_env(ALONE), 30, size=0.02)
    wrapped = ObserveIntervention(InterventionPenalty(control_env(ALONE), 1.0))
    for (before, reward, _), (after, less, info) in zip(plain, play(wrapped, 30, size=0.02), strict=True):
        assert less == reward
        assert info.get("reward/intervention", 0.0) == 0.0
        np.testing.assert_array_equal(after, [*before, 0.0])


# ---- observation -------------------------------------------------------------------------------------


def test_the_last_change_is_observed():
    plain, seen = (play(env) for env in (control_env(CLOSE), ObserveIntervention(control_env(CLOSE))))
    last = [0.0] + [min(info["shield/correction"], 1.0) for _, _, info in plain[1:]]
    assert max(last) > 0.1
    for (before, *_), (after, *_), change in zip(plain, seen, last, strict=True):
        assert after.dtype == np.float32
        np.testing.assert_array_equal(after[:-1], before)
        assert after[-1] == np.float32(change)
    env = ObserveIntervention(control_env(CLOSE))
    play(env)
    assert env.reset(seed=1)[0][-1] == 0.0
    assert env.reset(seed=1)[0] in env.observation_space


class Told(gym.Env):
    """Says what it was told to say of the shield."""

    observation_space, action_space = gym.spaces.Box(0.0, 1.0, (2,)), gym.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, **info):
        self.info = info

    def reset(self, *, seed=None, options=None):
        return np.zeros(2, np.float32), {}

    def step(self, action):
        return np.zeros(2, np.float32), 0.0, False, False, dict(self.info)


@pytest.mark.parametrize(("said", "counts"), [(np.nan, 1.0), (np.inf, 1.0), (7.0, 1.0), (0.25, 0.25), (0.0, 0.0)])
def test_a_change_without_bound_counts_as_the_whole_bound(said, counts):
    env = ObserveIntervention(InterventionPenalty(Told(**{"shield/correction": said}), 2.0))
    env.reset()
    observation, reward, *_ = env.step(np.zeros(1))
    assert (observation[-1], reward) == (counts, -2.0 * counts)


@pytest.mark.parametrize("wrapper", [InterventionPenalty, ObserveIntervention])
def test_without_a_shield_they_refuse(wrapper):
    env = wrapper(Told())
    env.reset()
    with pytest.raises(InterfaceError, match="around a shield"):
        env.step(np.zeros(1))
    bare = wrapper(gym.make("jssa_gym/Reach-v0"))
    bare.reset(seed=0)
    with pytest.raises(InterfaceError, match="around a shield"):
        bare.step(np.zeros(6))


def test_bad_arguments_are_refused():
    for weight in (-0.1, np.nan, np.inf, "1", None, True):
        with pytest.raises(ParameterError, match="weight"):
            InterventionPenalty(Told(), weight)
    env = control_env(CLOSE)
    with pytest.raises(ParameterError, match="jerk, position, velocity, tip"):
        ExecutedAction(env, "torque")
    with pytest.raises(ParameterError, match="share"):
        ExecutedAction(env, "velocity", 0.0)
    with pytest.raises(InterfaceError, match="vector"):
        ObserveIntervention(gym.wrappers.ReshapeObservation(Told(), (1, 2)))


# ---- executed actions --------------------------------------------------------------------------------


def both(config, steps=60, size=1.0, seed=3):
    """Executed actions by the wrapper, beside the ticks of an environment of one's own that is played along."""
    env, own = training_env(config), control_env(config)
    if config.control != "jerk":
        own = jssa_gym.JPCAction(own, mode=config.control, share=config.share)
    first, second = env.reset(seed=seed)[0], own.reset(seed=seed)[0]
    np.testing.assert_array_equal(first, second)
    for action in actions(env, 25 * steps, size=size)[::25]:
        observation, _, terminated, truncated, info = env.step(action)
        jerks, changed = [], False
        for _ in range(config.ticks):
            now, _, over, late, tick = own.step(action)
            jerks.append(tick["jerk"])
            changed |= tick["shield/correction"] != 0.0
            if over or late:
                break
        np.testing.assert_array_equal(observation, now)
        yield action, info["executed_action"], changed, np.array(jerks), own.unwrapped.scene.robot
        if terminated or truncated:
            break
    env.close()
    own.close()


def test_an_executed_jerk_is_the_mean_over_the_ticks():
    config = replace(CLOSE, settings=SAC(), learn_from="executed", ticks=7)
    bound = lr_mate_200id_7l().limits.jerk
    kinds = set()
    for action, executed, changed, jerks, _ in both(config, steps=200):
        kinds.add(changed)
        if changed:
            np.testing.assert_allclose(executed, jerks.mean(axis=0) / bound, atol=1e-9)
            assert np.abs(executed - action).max() > 1e-9
        else:
            np.testing.assert_array_equal(executed, action)
    assert kinds == {True, False}


@pytest.mark.parametrize("control", ["velocity", "position"])
def test_an_executed_command_is_where_the_arm_ended(control):
    config = replace(CLOSE, settings=SAC(), learn_from="both", control=control, share=0.7)
    limits = lr_mate_200id_7l().limits
    kinds = set()
    for action, executed, changed, _, state in both(config, steps=60, size=0.5):
        kinds.add(changed)
        assert np.all(np.abs(executed) <= 1.0)
        if not changed:
            np.testing.assert_array_equal(executed, action)
        elif control == "velocity":
            np.testing.assert_allclose(executed, np.clip(state.velocity / (0.7 * limits.velocity), -1, 1), atol=1e-12)
        else:
            low, high = limits.position.T
            np.testing.assert_allclose(low + (executed + 1.0) / 2.0 * (high - low), state.position, atol=1e-9)
    assert True in kinds


def test_an_executed_action_would_have_done_the_same():
    """The jerks that a shield chose, commanded where there is no shield, lead to the same place."""
    config = replace(CLOSE, settings=SAC(), learn_from="executed", ticks=1)
    env, free = training_env(config), gym.make("jssa_gym/Reach-v0", human="pursuit", terminate_on=())
    env.reset(seed=3)
    free.reset(seed=3)
    intervened = 0
    for action in actions(env, 300):
        _, _, terminated, truncated, info = env.step(action)
        intervened += info["shield/intervened"]
        free.step(info["executed_action"])
        np.testing.assert_allclose(
            free.unwrapped.scene.robot.position, env.unwrapped.scene.robot.position, rtol=0, atol=1e-7
        )
        if terminated or truncated:
            break
    assert intervened > 5
    env.close()
    free.close()


@pytest.mark.long
def test_the_replay_buffer_gets_executed_actions():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from jssa_gym.train import ExecutedBuffer, build

    torch.set_num_threads(1)
    settings = SAC(width=16, learning_starts=500, buffer_size=400)
    buffers = []
    for learn_from in ("policy", "executed"):
        model = build(replace(CLOSE, settings=settings, learn_from=learn_from, envs=2))
        try:
            model.set_random_seed(4)
            model.learn(200)  # none of them with an update
            buffers.append(model.replay_buffer)
        finally:
            model.get_env().close()
    asked, executed = buffers
    assert isinstance(executed, ExecutedBuffer)
    assert not isinstance(asked, ExecutedBuffer)
    np.testing.assert_array_equal(asked.observations, executed.observations)
    np.testing.assert_array_equal(asked.rewards, executed.rewards)
    same = np.all(asked.actions[:100] == executed.actions[:100], axis=-1)
    assert same.any()
    assert not same.all()
    assert np.all(np.abs(executed.actions) <= 1.0)


# ---- the whole chain ---------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
@pytest.mark.parametrize("control", ["jerk", "velocity", "position"])
@pytest.mark.parametrize("task", TASKS)
def test_the_whole_chain_is_an_environment(task, control):
    config = TrainConfig(task=task, control=control, settings=SAC(), learn_from="both", observe_intervention=True)
    env = training_env(config)
    order = [name for name in str(env).split("<") if name and not name.startswith(("Order", "TimeLimit", "Passive"))]
    jpc = [] if control == "jerk" else ["JPCAction"]
    assert order[: 4 + len(jpc)] == [
        "ExecutedAction",
        "ActionRepeat",
        *jpc,
        "InterventionPenalty",
        "RecordSafety",
    ]
    assert "JSSAShield" in order
    check_env(env, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable_baselines3 is not installed")
    sb3.check_env(env)
    env.close()


@pytest.mark.parametrize("shield", [True, False])
def test_the_plain_chain(shield):
    env = training_env(TrainConfig(settings=PPO(), shield=shield, control="jerk"))
    assert ("JSSAShield" in str(env)) == shield
    for name in ("ExecutedAction", "InterventionPenalty", "ObserveIntervention", "JPCAction"):
        assert name not in str(env)
    env.reset(seed=0)
    *_, info = env.step(env.action_space.sample())
    assert "executed_action" not in info
    env.close()
