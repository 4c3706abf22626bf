# ruff: noqa: E402
"""Constrained learners: the multiplier, what it does to advantages and rewards, and that a checkpoint keeps it."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from stable_baselines3.common.logger import Logger
from trainings import newest, results, tiny

from jssa_gym.train import build, train
from jssa_gym.train.lagrangian import CostLimit

CLOSE = {"human": "pursuit", "shield": False, "steps": 128}
"""Somebody comes near, and nothing keeps the arm away."""


@pytest.fixture
def model(request):
    """Of a tiny training, with one rollout played."""
    made = build(tiny(request.param, human="none"))
    made.set_random_seed(3)
    made.learn(64)
    yield made
    made.get_env().close()


# ---- the multiplier ----------------------------------------------------------------------------------


def test_the_multiplier_rises_above_the_limit_and_falls_to_nothing_below():
    limit, multiplier = CostLimit(share=0.01, rate=0.5, ticks=10), torch.zeros(())
    assert limit.adapt(multiplier, np.full(2000, 0.3)) == pytest.approx(0.03)
    assert multiplier.item() == pytest.approx(0.5 * 2.0 * 2.0)  # 2,000 steps, twice the limit too much
    limit.adapt(multiplier, np.full((10, 100), 0.1))  # just as much as there may be
    assert multiplier.item() == pytest.approx(2.0)
    limit.adapt(multiplier, np.zeros(1000))
    assert multiplier.item() == pytest.approx(1.5)
    limit.adapt(multiplier, np.zeros(10_000))
    assert multiplier.item() == 0.0


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["ppo-lagrangian", "sac-lagrangian"])
def test_it_answers_what_the_learner_does(algorithm):
    """Beside somebody who comes near it rises; beside nobody it stays where it was."""
    risen = []
    for human in ("pursuit", "none"):
        made = build(tiny(algorithm, **CLOSE | {"human": human}))
        try:
            made.set_random_seed(3)
            made.learn(256)
            risen.append(made.multiplier.item())
        finally:
            made.get_env().close()
    assert risen[0] > 0.0
    assert risen[1] == 0.0


# ---- PPO ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["ppo-lagrangian"], indirect=True)
def test_advantages_are_weighed_by_hand(model):
    rollout, shape = model.rollout_buffer, model.rollout_buffer.rewards.shape
    with torch.no_grad():
        for weights in model.cost_critic.parameters():
            weights.zero_()  # knows of no cost
    rng = np.random.default_rng(0)
    rollout.reset()
    rollout.observations = rng.normal(size=rollout.observations.shape).astype(np.float32)
    rollout.advantages = rng.normal(size=shape).astype(np.float32)
    costs = rng.integers(0, 3, size=shape).astype(np.float32)
    rollout.episode_starts[5] = 1.0  # what comes from there on is of another episode
    model._last_episode_starts = np.zeros(shape[1], bool)
    model.multiplier.fill_(0.7)
    model.limit = replace(model.limit, rate=0.0)
    gain = (rollout.advantages - rollout.advantages.mean()) / rollout.advantages.std()
    model.weigh(rollout, costs, np.zeros(shape, np.float32))
    ahead, fades = np.zeros(shape), model.gamma * model.gae_lambda
    for t in range(shape[0]):
        until = 5 if t < 5 else shape[0]
        ahead[t] = sum(fades ** (k - t) * costs[k] for k in range(t, until))
    np.testing.assert_allclose(rollout.advantages, (gain - 0.7 * (ahead - ahead.mean())) / 1.7, atol=1e-5)


@pytest.mark.long
def test_without_cost_it_is_ppo():
    """With a multiplier of 0, advantages are PPO's but for their unit, which it takes out of every batch."""
    weights = []
    for algorithm in ("ppo", "ppo-lagrangian"):
        made = build(tiny(algorithm, human="none"))
        made.set_random_seed(3)
        made.learn(64)
        weights.append([weight.detach().numpy() for weight in made.policy.parameters()])
        made.get_env().close()
    for one, other in zip(*weights, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.mark.parametrize("model", ["ppo-lagrangian"], indirect=True)
def test_the_critic_learns_what_is_to_come(model):
    model.targets = np.full_like(model.targets, 3.0)
    model.set_logger(Logger(None, []))
    before = np.abs(model.cost_to_come(model.seen) - 3.0).mean()
    model.lr_schedule = lambda left: 0.1
    rollout = model.rollout_buffer  # is turned once it is read
    rollout.advantages = np.zeros_like(rollout.advantages)
    model.train()
    assert np.abs(model.cost_to_come(model.seen) - 3.0).mean() < 0.9 * before


# ---- SAC ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["sac-lagrangian"], indirect=True)
def test_rewards_are_those_of_the_moment_at_which_they_are_sampled(model):
    buffer = model.replay_buffer
    buffer.costs[: buffer.pos] = np.random.default_rng(0).integers(0, 3, size=(buffer.pos, 2))
    drawn = []
    for multiplier in (0.0, 2.0, 0.5):
        model.multiplier.fill_(multiplier)
        np.random.seed(5)  # noqa: NPY002  # of Stable-Baselines3's sampling
        drawn.append(buffer.sample(64))
    bare, dear, cheap = (batch.rewards.numpy() for batch in drawn)
    cost = (bare - dear) / 2.0
    assert set(np.unique(np.round(cost, 4)).tolist()) == {0.0, 1.0, 2.0}
    np.testing.assert_allclose(bare - cheap, 0.5 * cost, atol=1e-4)
    for part in ("observations", "actions", "next_observations", "dones"):
        assert torch.equal(getattr(drawn[0], part), getattr(drawn[1], part))


# ---- checkpoints -------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["ppo-lagrangian", "sac-lagrangian"])
def test_a_checkpoint_keeps_the_multiplier(algorithm, tmp_path):
    longer = {"interval": 128, "ticks": 25}  # long enough for somebody to come
    steady = replace(tiny(algorithm).settings, decay=False)  # else it could not be given more steps
    whole = tiny(algorithm, **CLOSE | longer | {"steps": 256}, settings=steady)
    train(whole, tmp_path / "whole")
    train(replace(whole, steps=128), tmp_path / "parts")
    state = torch.load(newest(tmp_path / "parts") / "parameters.pt", weights_only=True)
    assert state["tensors"]["multiplier"].item() > 0.0
    train(whole, tmp_path / "parts")
    assert results(tmp_path / "parts") == results(tmp_path / "whole")


@pytest.mark.long
def test_costs_come_from_a_vector_as_from_single_environments(tmp_path):
    for vector in (True, False):
        train(tiny("ppo-lagrangian", **CLOSE | {"steps": 64}, vector=vector), tmp_path / str(vector))
    assert results(tmp_path / "True") == results(tmp_path / "False")
