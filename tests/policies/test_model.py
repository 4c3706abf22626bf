"""Models with `predict` in evaluations: their state, and the normalisation of what they observe."""

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.evaluation import evaluate, make_policy
from jssa_gym.exceptions import ParameterError, PolicyFileError
from jssa_gym.policies import load_policy
from jssa_gym.policies.model import ModelPolicy

STEPS, SEEDS = 40, (0, 1)


def reach():
    return gym.make("jssa_gym/Reach-v0", terminate_on=(), max_episode_steps=STEPS, human="none")


def returns(act):
    """Of every episode, as `evaluate` plays them; ``act`` is called with an observation and whether it is the first."""
    totals, env = [], reach()
    for seed in SEEDS:
        observation, _ = env.reset(seed=seed)
        total, first = 0.0, True
        for _ in range(STEPS):
            observation, reward, *_ = env.step(act(observation, first))
            total, first = total + float(reward), False
        totals.append(total)
    return totals


def evaluated(model):
    report = evaluate(reach, model, episodes=len(SEEDS), steps=STEPS)
    return [episode.summary.ep_return for episode in report.episodes]


def shaken(model, by=0.3):
    """With weights that do something: those of a fresh model hardly do."""
    torch = pytest.importorskip("torch")
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in model.policy.parameters():
            parameter.add_(by * torch.randn(parameter.shape, generator=generator))
    return model


@pytest.fixture(scope="module")
def recurrent():
    contrib = pytest.importorskip("sb3_contrib", reason="sb3_contrib is not installed")
    options = {"lstm_hidden_size": 16, "net_arch": [16]}
    return shaken(contrib.RecurrentPPO("MlpLstmPolicy", reach(), policy_kwargs=options, seed=0, device="cpu"))


@pytest.fixture(scope="module")
def normalised():
    sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    env = sb3.common.vec_env.VecNormalize(sb3.common.vec_env.DummyVecEnv([reach]), clip_obs=2.0)
    model = shaken(sb3.PPO("MlpPolicy", env, policy_kwargs={"net_arch": [16]}, seed=0, device="cpu"), 0.1)
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(100):
        env.step(rng.uniform(-1.0, 1.0, (1, 6)).astype(np.float32))
    return model


def test_a_recurrent_model_remembers_within_an_episode_and_not_beyond(recurrent):
    state = None

    def act(observation, first):
        nonlocal state
        action, state = recurrent.predict(
            observation, state=None if first else state, episode_start=np.array([first]), deterministic=True
        )
        return action

    wanted = returns(act)
    assert evaluated(recurrent) == pytest.approx(wanted, rel=1e-12)
    forgetful = returns(lambda observation, first: recurrent.predict(observation, deterministic=True)[0])
    assert np.abs(np.subtract(forgetful, wanted)).min() > 1e-3


def test_observations_are_normalised_as_in_training_and_teach_nothing(normalised):
    venv = normalised.get_vec_normalize_env()
    mean, count = venv.obs_rms.mean.copy(), venv.obs_rms.count
    wanted = returns(lambda o, first: normalised.predict(venv.normalize_obs(o), deterministic=True)[0])
    assert evaluated(normalised) == pytest.approx(wanted, rel=1e-12)
    raw = returns(lambda o, first: normalised.predict(o, deterministic=True)[0])
    assert np.abs(np.subtract(raw, wanted)).min() > 1e-3
    np.testing.assert_array_equal(venv.obs_rms.mean, mean)
    assert venv.obs_rms.count == count


def test_rewards_alone_being_normalised_changes_nothing(normalised):
    venv = normalised.get_vec_normalize_env()
    venv.norm_obs = False
    try:
        observation = reach().reset(seed=0)[0]
        wanted = normalised.predict(observation, deterministic=True)[0]
        np.testing.assert_array_equal(ModelPolicy(normalised)(observation), wanted)
    finally:
        venv.norm_obs = True


class Plain:
    """Of somebody else, who knows nothing of states."""

    def __init__(self, size=None):
        if size is not None:
            self.observation_space = gym.spaces.Box(-1.0, 1.0, (size,))

    def predict(self, observation, deterministic=False):
        assert deterministic
        return np.full(6, 0.1), None


def test_models_of_others_are_asked_for_what_they_know():
    env = reach()
    observation, _ = env.reset(seed=0)
    for model in (Plain(), Plain(len(observation))):
        np.testing.assert_array_equal(make_policy(model, env, 0)(observation), np.full(6, 0.1))


def test_a_factory_may_return_a_model(monkeypatch):
    monkeypatch.setitem(globals(), "make", lambda env, seed: Plain())
    policy = make_policy(f"{__name__}:make", reach(), 0)
    np.testing.assert_array_equal(policy(np.zeros(34)), np.full(6, 0.1))


def test_a_model_of_other_observations_is_refused():
    with pytest.raises(ParameterError, match=r"observations of shape \(78,\), the environment's have shape \(34,\)"):
        evaluate(reach, Plain(78), episodes=1, steps=5)


@pytest.mark.parametrize("trust", [False, True])
def test_the_file_of_a_recurrent_model_is_refused_with_advice(recurrent, tmp_path, trust):
    recurrent.save(tmp_path / "model")
    with pytest.raises(PolicyFileError, match=r"recurrent policy.*evaluate\(\) itself"):
        load_policy(tmp_path / "model.zip", trust_pickle=trust)
