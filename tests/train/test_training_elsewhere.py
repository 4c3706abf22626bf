"""Training with other libraries: what they do with the package's ids works, and the one-file PPO is PPO."""

import importlib
import importlib.util
import re
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from places import ROOT

torch = pytest.importorskip("torch", reason="torch is not installed")


def example(name):
    """An example as a module of its own."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def ppo():
    yield example("cleanrl_ppo")
    del sys.modules["cleanrl_ppo"]


# ---- one file ----------------------------------------------------------------------------------------


def test_advantages_are_sums_of_discounted_errors(ppo):
    rng = np.random.default_rng(0)
    T, n, gamma, lam = 12, 3, 0.9, 0.7
    reward, value, following = rng.normal(size=(3, T, n))
    terminated, late = rng.random((2, T, n)) < 0.2
    done = terminated | late
    assert (late & ~terminated).any()
    found = ppo.advantages(*map(torch.as_tensor, (reward, value, following, terminated, done)), gamma, lam)
    for k in range(n):
        for t in range(T):
            total, weight = 0.0, 1.0
            for s in range(t, T):
                after = 0.0 if terminated[s, k] else following[s, k]
                total += weight * (reward[s, k] + gamma * after - value[s, k])
                weight *= gamma * lam
                if done[s, k]:
                    break
            assert found[t, k].item() == pytest.approx(total)


class Corridor(gym.Env):
    """Every step costs the square of (action - 0.5); 5 steps, then out of time. The observation is the time."""

    observation_space, action_space = gym.spaces.Box(0.0, 1.0, (1,)), gym.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.t += 1
        reward = -float((action[0] - 0.5) ** 2)
        return np.full(1, self.t / 5.0, np.float32), reward, False, self.t == 5, {}


@pytest.mark.long
def test_it_learns_across_episodes_that_run_out_of_time(ppo, monkeypatch, capsys):
    def make_envs(args):
        # nothing of ours; the same wrappers and the same way of resetting
        return gym.wrappers.vector.ClipAction(
            gym.vector.SyncVectorEnv([Corridor] * args.num_envs, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP)
        )

    monkeypatch.setattr(ppo, "make_envs", make_envs)
    args = ppo.Args(num_envs=4, num_steps=64, total_timesteps=64 * 4 * 30, learning_rate=3e-3, gamma=0.9)
    agent = ppo.train(args)
    with torch.no_grad():
        assert agent.actor(torch.tensor([[0.0], [0.4], [0.8]])).flatten().tolist() == pytest.approx([0.5] * 3, abs=0.15)
    returns = [float(x) for x in re.findall(r"return (\S+)", capsys.readouterr().out.replace(",", ""))]
    # an untrained policy costs 5 · (0.25 + the clipped noise's variance)
    assert len(returns) == 30
    assert returns[0] < -2.5
    assert returns[-1] > -1.5


def test_what_follows_the_last_step_is_not_the_next_episode(ppo, monkeypatch):
    seen = []
    monkeypatch.setattr(ppo, "update", lambda agent, optimizer, args, batch: None)
    real = ppo.Agent.value
    monkeypatch.setattr(ppo.Agent, "value", lambda agent, o: seen.append(o.clone()) or real(agent, o))
    monkeypatch.setattr(
        ppo,
        "make_envs",
        lambda args: gym.vector.SyncVectorEnv([Corridor], autoreset_mode="SameStep"),
    )
    ppo.train(ppo.Args(num_envs=1, num_steps=10, total_timesteps=10))
    now, following = (observations[:, 0, 0] for observations in seen)
    assert now.tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8] * 2)
    assert following.tolist() == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0] * 2)


@pytest.mark.long
def test_it_trains_inside_the_shield_and_the_same_seed_gives_the_same_bits(ppo, tmp_path, capsys):
    import jssa_gym

    args = ppo.Args(total_timesteps=128, num_envs=2, num_steps=64, update_epochs=1, save=tmp_path / "agent.pt")
    envs, layers = ppo.make_envs(args), []
    while isinstance(envs, gym.vector.VectorWrapper):
        layers, envs = [*layers, type(envs).__name__], envs.env
    assert layers == ["ClipAction", "VectorActionRepeat", "VectorJPCAction", "VectorRecordSafety", "VectorShield"]
    ppo.train(args)
    told = capsys.readouterr().out
    assert re.search(
        r"128 steps, 2 episodes ended, return -[\d.e+]+, success 0, moving_contact 0, intervention_rate", told
    )
    first = torch.load(args.save, weights_only=True)
    ppo.train(replace(args, save=tmp_path / "again.pt"))
    again = torch.load(tmp_path / "again.pt", weights_only=True)
    assert capsys.readouterr().out == told
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert all(torch.isfinite(part).all() for part in first.values())
    env = jssa_gym.JPCAction(gym.make(args.env_id), mode="tip", share=1.0)
    agent = ppo.Agent(env.observation_space.shape[0], 3)
    agent.load_state_dict(first)
    observation, _ = env.reset(seed=0)
    with torch.no_grad():
        assert torch.isfinite(agent.policy(torch.as_tensor(observation)).mean).all()


# ---- by name -----------------------------------------------------------------------------------------

BY_IMPORT = """
import importlib, sys
import gymnasium as gym
assert "jssa_gym/ReachShielded-v0" not in gym.registry
importlib.import_module("jssa_gym")  # --gym-packages jssa_gym
assert "jssa_gym/ReachShielded-v0" in gym.registry
env = gym.make("jssa_gym/ReachShielded-v0", human="walk_by")
"""

BY_NAME = """
import sys
import gymnasium as gym
env = gym.make("jssa_gym:jssa_gym/ReachShielded-v0")
"""

STEPS = """
assert "torch" not in sys.modules and "stable_baselines3" not in sys.modules
env.reset(seed=0)
*_, info = env.step(env.action_space.sample())
print(info["shield/status"])
"""


@pytest.mark.long
@pytest.mark.parametrize("script", [BY_IMPORT, BY_NAME], ids=["by import", "by name"])
def test_a_framework_that_knows_the_name_alone_gets_the_shielded_environment(script):
    run = subprocess.run([sys.executable, "-c", script + STEPS], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) in range(5)


def test_the_zoo_s_parameters_train(capsys):
    sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from stable_baselines3.common.env_util import make_vec_env

    read: dict = {}
    exec((ROOT / "examples" / "rl_zoo3_ppo.py").read_text(), read)  # as rl_zoo3 reads it
    ((env_id, parameters),) = read["hyperparams"].items()
    ((wrapper, options),) = parameters.pop("env_wrapper")[0].items()
    module, _, name = wrapper.rpartition(".")
    wrapper_class = getattr(importlib.import_module(module), name)
    env = make_vec_env(env_id, parameters.pop("n_envs"), seed=0, wrapper_class=wrapper_class, wrapper_kwargs=options)
    assert parameters.pop("n_timesteps") >= 100_000
    model = sb3.PPO(env=env, seed=0, device="cpu", **{**parameters, "n_steps": 64, "n_epochs": 1})
    model.learn(4 * 64)
    assert model.num_timesteps == 256
    assert all(torch.isfinite(part).all() for part in model.policy.state_dict().values())


def test_the_page_names_what_is_there():
    import jssa_gym

    page = (ROOT / "docs" / "training_elsewhere.md").read_text()
    for path in re.findall(r"examples/\w+\.py", page):
        assert (ROOT / path).exists(), path
    for name in re.findall(r"jssa_gym/\w+-v0", page):
        assert name in gym.registry
    for name in re.findall(r"jssa_gym\.([A-Z]\w+)", page):
        assert hasattr(jssa_gym, name)
