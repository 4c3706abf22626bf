"""Real training through the shield, short and on small nets: it runs, and every number stays finite."""

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym

sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

STEPS = 2000
SMALL = {"net_arch": [16, 16]}


@pytest.fixture(autouse=True)
def _one_thread():
    """Small nets on busy machines: threads that wait for each other cost a hundred times the work."""
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Watch(gym.Wrapper):
    """Checks everything that passes between a learner and the shield."""

    def __init__(self, env):
        super().__init__(env)
        self.steps, self.statuses, self.actions = 0, set(), []

    def reset(self, **options):
        observation, info = self.env.reset(**options)
        assert np.isfinite(observation).all()
        return observation, info

    def step(self, action):
        assert np.isfinite(action).all()
        observation, reward, terminated, truncated, info = self.env.step(action)
        assert observation in self.observation_space
        assert np.isfinite(reward)
        assert np.isfinite(info["jerk"]).all()
        self.steps += 1
        self.statuses.add(info["shield/status"])
        self.actions.append(action)
        return observation, reward, terminated, truncated, info


def learn(algorithm, env, **options):
    model = algorithm("MlpPolicy", env, policy_kwargs=dict(SMALL), seed=0, device="cpu", **options)
    model.learn(STEPS)
    losses = {key: value for key, value in model.logger.name_to_value.items() if "loss" in key}
    assert all(np.isfinite(value) for value in losses.values())
    for parameters in model.policy.parameters():
        assert np.isfinite(parameters.detach().numpy()).all()
    return model, losses


def check(watch):
    assert watch.steps >= STEPS
    assert jssa_gym.Status.FAULT not in watch.statuses
    assert len(watch.statuses) > 1
    assert np.std(watch.actions) > 0.1


@pytest.mark.long
def test_ppo_learns_through_the_shield():
    watch = Watch(jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0")))
    model, losses = learn(sb3.PPO, watch, n_steps=250, batch_size=125, n_epochs=2)
    check(watch)
    assert "train/policy_gradient_loss" in losses
    action, _ = model.predict(watch.reset(seed=0)[0], deterministic=True)
    assert action in watch.action_space


@pytest.mark.long
def test_sac_learns_through_the_shield():
    watch = Watch(jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0")))
    _, losses = learn(sb3.SAC, watch, learning_starts=100, train_freq=8, gradient_steps=1, batch_size=64)
    check(watch)
    assert {"train/actor_loss", "train/critic_loss"} <= set(losses)


def test_training_by_name_on_the_shielded_id():
    model = sb3.PPO(
        "MlpPolicy",
        "jssa_gym/ReachShielded-v0",
        policy_kwargs=dict(SMALL),
        n_steps=64,
        batch_size=64,
        seed=0,
        device="cpu",
    )
    model.learn(128)
    env = model.get_env()
    assert env.num_envs == 1
    layers = env.envs[0]
    while isinstance(layers, gym.Wrapper) and not isinstance(layers, jssa_gym.JSSAShield):
        layers = layers.env
    assert isinstance(layers, jssa_gym.JSSAShield)
    assert layers.last_decision is not None
