# ruff: noqa: E402
"""Trainings: resumed to the bit, learning, honest about safety."""

"""Trainings: resumed to the bit, learning, honest about safety."""

import json
import signal
import subprocess
import sys
from dataclasses import asdict, replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import results, tiny, weights

from jssa_gym.evaluation.runner import evaluate
from jssa_gym.exceptions import CheckpointError, MissingExtraError
from jssa_gym.policies import load_policy
from jssa_gym.shields import Shield
from jssa_gym.train import PPO, TrainConfig, build, control_env, loop, to_policy, train, training_env
from jssa_gym.train.config import EVALUATION_SEED
from jssa_gym.train.history import Tally, as_rows, from_rows


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Interrupted(Exception):
    pass


def cut_off_at(steps):
    """A ``watch`` that stops a training there, as Ctrl-C does."""

    def watch(now):
        if now >= steps:
            raise Interrupted

    return watch


# ---- resumed -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc"])
def test_a_training_that_was_interrupted_goes_on_to_the_bit(algorithm, tmp_path):
    if algorithm == "tqc":
        pytest.importorskip("sb3_contrib", reason="sb3_contrib is not installed")
    config = tiny(algorithm, learn_from="policy" if algorithm == "ppo" else "both", observe_intervention=True)
    whole = train(config, tmp_path / "whole")
    assert [leg.steps for leg in whole.history] == [64, 128, 192]
    told: list[str] = []
    for stop in (100, 130):
        with pytest.raises(Interrupted):
            train(config, tmp_path / "parts", watch=cut_off_at(stop))
        np.random.seed(stop)  # noqa: NPY002 - whatever state a process is in
        torch.manual_seed(stop)
    parts = train(config, tmp_path / "parts", say=told.append)
    assert told[0] == "going on from 128 policy steps"
    assert results(tmp_path / "parts") == results(tmp_path / "whole")
    assert len(parts.history) == 3
    for name in ("best.npz", "last.npz"):
        assert (tmp_path / "parts" / name).exists()
    files = json.loads((tmp_path / "parts/checkpoints/000000000192/manifest.json").read_text())["files"]
    assert ("buffer.npz" in files) == (algorithm != "ppo")


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train(tiny(steps=64, seed=seed), tmp_path / name)
    assert results(tmp_path / "a") == results(tmp_path / "b")
    assert results(tmp_path / "a")["files"] != results(tmp_path / "c")["files"]


def test_processes_give_the_same_bits(tmp_path):
    config = tiny(steps=64)
    train(config, tmp_path / "one")
    train(replace(config, processes=True), tmp_path / "many")
    assert results(tmp_path / "one") == results(tmp_path / "many")


def test_a_training_that_has_ended_is_read_not_repeated_and_goes_on_with_more_steps(tmp_path):
    config = tiny(steps=128, settings=replace(tiny().settings, decay=False))
    first = train(config, tmp_path)
    watched: list[int] = []
    again = train(config, tmp_path, watch=watched.append)
    assert watched == []
    assert as_rows(again.history) == as_rows(first.history)
    more = train(replace(config, steps=192), tmp_path)
    assert as_rows(more.history)[:2] == as_rows(first.history)
    train(replace(config, steps=192), tmp_path / "whole")
    assert results(tmp_path) == results(tmp_path / "whole")


def test_another_training_s_folder_is_refused_before_anything_is_written(tmp_path):
    config = tiny(steps=64)
    train(config, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    for other in (replace(config, seed=1), replace(config, steps=128), replace(config, shield=False)):
        with pytest.raises(CheckpointError, match="holds another training"):
            train(other, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_training_whose_checkpoints_are_gone_does_not_begin_anew_in_silence(tmp_path):
    train(tiny(steps=64), tmp_path)
    (tmp_path / "checkpoints").rename(tmp_path / "elsewhere")
    with pytest.raises(CheckpointError, match="history but no checkpoint"):
        train(tiny(steps=64), tmp_path)


def test_the_learning_rate_falls_over_the_whole_training_not_in_every_leg(tmp_path, monkeypatch):
    rates = []
    real = loop._leg

    def leg(model, *rest):
        history = real(model, *rest)
        rates.append(model.policy.optimizer.param_groups[0]["lr"])
        return history

    monkeypatch.setattr(loop, "_leg", leg)
    config = tiny(steps=256)
    with pytest.raises(Interrupted):
        train(config, tmp_path, watch=cut_off_at(140))
    train(config, tmp_path)
    assert rates == pytest.approx([3e-4 * left for left in (0.75, 0.5, 0.25, 0.0)])


# ---- killed ------------------------------------------------------------------------------------------

CHILD = """
import json, sys, time, torch
torch.set_num_threads(1)
from jssa_gym.train import PPO, TrainConfig, checkpoint, train
config, folder, slow = TrainConfig.of(json.loads(sys.argv[1])), sys.argv[2], float(sys.argv[3])
real = checkpoint._to_disk
def to_disk(path):
    print("writing", path, flush=True)
    time.sleep(slow)
    real(path)
checkpoint._to_disk = to_disk
say = lambda line: print("said", line, flush=True)
train(config, folder, say=say, watch=lambda steps: print("at", steps, flush=True))
"""


def child(config, folder, slow=0.0):
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, json.dumps(config.as_dict()), str(folder), str(slow)],
        stdout=subprocess.PIPE,
        text=True,
    )


def killed_after(process, stop) -> tuple[int, int, bool]:
    """Kill it once ``stop`` holds of a line; steps that it began with and got to, and whether it was killed."""
    began = got = 0
    for line in process.stdout:
        word, _, rest = line.strip().partition(" ")
        if word == "at":
            got = int(rest)
        elif rest.startswith("going on from"):
            began = got = int(rest.split()[3].replace(",", ""))
        if stop(line):
            process.send_signal(signal.SIGKILL)
            process.stdout.read()
            process.wait()
            process.stdout.close()
            return began, got, True
    process.stdout.close()
    assert process.wait() == 0
    return began, got, False


@pytest.mark.parametrize("algorithm", ["sac"])
def test_a_training_that_was_killed_loses_at_most_one_leg(algorithm, tmp_path):
    config = tiny(algorithm)
    train(config, tmp_path / "whole")
    folder = tmp_path / "killed"
    # in a leg, then when all files but the manifest are written
    _, got, killed = killed_after(child(config, folder), lambda line: line == "at 100\n")
    assert (got, killed) == (100, True)
    began, _, killed = killed_after(child(config, folder, slow=0.2), lambda line: "00192.part/manifest.json" in line)
    assert (began, killed) == (64, True)
    assert [path.name for path in (folder / "checkpoints").glob("*.part")] == ["000000000192.part"]
    told: list[str] = []
    train(config, folder, say=told.append)
    assert told[0] == "going on from 128 policy steps"
    assert results(folder) == results(tmp_path / "whole")
    assert not list((folder / "checkpoints").glob("*.part"))


@pytest.mark.slow
def test_killed_at_twenty_random_moments(tmp_path, capsys):
    rng = np.random.default_rng(0)
    config = tiny("sac", steps=48 * 64)
    folder, losses, unfinished, last, reached = tmp_path / "killed", [], 0, 0, 0
    for _ in range(20):
        lines = int(rng.integers(1, 120))  # of about 32 steps and 6 of a checkpoint in a leg
        seen = 0

        def stop(line, lines=lines):
            nonlocal seen
            seen += line.startswith(("at", "writing"))
            return seen >= lines

        began, got, killed = killed_after(child(config, folder, slow=0.01), stop)
        assert killed
        losses.append(last - began)
        assert began >= reached - 64
        last, reached = got, max(reached, began)
        unfinished += len(list((folder / "checkpoints").glob("*.part"))) if folder.exists() else 0
    told: list[str] = []
    train(config, folder, say=told.append)
    train(config, tmp_path / "whole")
    assert results(folder) == results(tmp_path / "whole")
    assert max(losses) <= 64
    with capsys.disabled():
        print(f"20 kills, all resumed, {unfinished} in a checkpoint, largest loss {max(losses)} of 64 steps")


# ---- what it says ------------------------------------------------------------------------------------


def test_a_training_leaves_what_it_promises(tmp_path):
    config = tiny(steps=256, interval=256, settings=replace(tiny().settings, rollout=256))
    told: list[str] = []
    watched: list[int] = []
    training = train(config, tmp_path, say=told.append, watch=watched.append, command="a command")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "best.npz",
        "checkpoints",
        "history.csv",
        "last.npz",
        "tensorboard",
    ]
    assert watched == list(range(2, 257, 2))
    assert len(told) == 1
    (leg,) = training.history
    # 128 policy steps of each of two environments, 100 in an episode
    assert leg.episodes >= 2
    assert 0.0 <= leg.interventions <= 1.0
    assert leg.moving_contacts == leg.limit_violations == 0
    head, row = (tmp_path / "history.csv").read_text().splitlines()
    assert head.split(",") == list(asdict(leg))
    assert row.split(",")[0] == "256"
    policy = load_policy(tmp_path / "best.npz")
    assert policy.provenance["command"] == "a command"
    assert TrainConfig.of(policy.provenance["training"]) == config
    assert policy.provenance["training_episodes"] == leg.episodes
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    logs = events.EventAccumulator(str(tmp_path / "tensorboard"))
    logs.Reload()
    names = logs.Tags()["scalars"]
    assert {"safety/moving_contacts", "eval/safe", "train/loss", "rollout/ep_rew_mean"} <= set(names)
    (event,) = logs.Scalars("eval/return")
    assert (event.step, event.value) == (256, pytest.approx(leg.eval_return))


def test_a_leg_counts_every_episode_once_and_without_penalties(tmp_path, monkeypatch):
    ended = []
    real = Tally.take

    def take(tally, info):
        real(tally, info)
        if "safety" in info:
            ended.append((info["safety"], info["episode"]["r"]))

    monkeypatch.setattr(Tally, "take", take)
    config = tiny(
        human="pursuit",
        learn_from="penalty",
        penalty=1.0,
        interval=256,
        steps=512,
        settings=replace(tiny().settings, rollout=256),
    )
    history = train(config, tmp_path).history
    assert sum(leg.episodes for leg in history) == len(ended)
    split = history[0].episodes
    assert split >= 2
    for leg, part in zip(history, (ended[:split], ended[split:]), strict=True):
        returns = [safety["ep_return"] for safety, _ in part]
        rates = [safety["intervention_rate"] for safety, _ in part]
        assert leg.ep_return == pytest.approx(np.mean(returns))
        assert leg.interventions == pytest.approx(np.mean(rates))
        assert leg.collisions == sum(safety["collision"] for safety, _ in part)
        assert leg.moving_contacts == sum(safety["moving_contact"] for safety, _ in part) == 0
    # the learner's own reward has the penalties in it
    assert any(rewarded < safety["ep_return"] - 1.0 for safety, rewarded in ended)


def test_a_history_is_read_back_or_refused(tmp_path):
    leg = train(tiny(steps=64), tmp_path).history
    rows = json.loads(json.dumps(as_rows(leg), allow_nan=False))
    assert rows[0]["success"] is None
    assert as_rows(from_rows(rows)) == rows
    bad = [
        None,
        3,
        "text",
        [3],
        [{}],
        [{**rows[0], "more": 1}],
        [{**rows[0], "steps": "64"}],
        [{**rows[0], "episodes": []}],
    ]
    for wrong in bad:
        with pytest.raises(CheckpointError, match="no history"):
            from_rows(wrong)


def test_without_tensorboard_one_is_told_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("stable_baselines3.common.logger.SummaryWriter", None)
    with pytest.raises(MissingExtraError, match=r"jssa-gym\[train\]"):
        train(tiny(), tmp_path)


# ---- safety ------------------------------------------------------------------------------------------


def layers(env):
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


@pytest.mark.parametrize("shield", [True, False])
def test_trainings_and_evaluations_have_the_shield_that_was_asked_for(shield):
    config = tiny(shield=shield)
    for env in (training_env(config), control_env(config)):
        assert any(isinstance(layer, Shield) for layer in layers(env)) == shield
        env.close()
    env = control_env(config, shield=False)
    assert not any(isinstance(layer, Shield) for layer in layers(env))
    env.close()


@pytest.mark.parametrize("shield", [True, False])
def test_what_is_evaluated_during_a_training_is_what_is_trained(shield, tmp_path, monkeypatch):
    made = []
    real = loop.control_env

    def watched(config, *rest, **more):
        made.append(real(config, *rest, **more))
        return made[-1]

    monkeypatch.setattr(loop, "control_env", watched)
    (leg,) = train(tiny(steps=64, shield=shield), tmp_path).history
    assert made
    assert all(any(isinstance(layer, Shield) for layer in layers(env)) == shield for env in made)
    assert (leg.eval_interventions > 0.0) == shield


# ---- the policy --------------------------------------------------------------------------------------


@pytest.mark.parametrize("control", ["jerk", "velocity", "position"])
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "tqc"])
def test_an_exported_policy_does_what_the_model_does(algorithm, control):
    if algorithm == "tqc":
        pytest.importorskip("sb3_contrib", reason="sb3_contrib is not installed")
    config = tiny(algorithm, control=control, share=0.6, observe_intervention=True)
    model = build(config)
    try:
        model.set_random_seed(3)
        model.learn(128)  # statistics and weights that are not the first ones
        policy, env = to_policy(model, config), model.get_env()
        assert np.any(policy.network.mean != 0.0)
        chain = training_env(replace(config, ticks=1))
        observation, _ = chain.reset(seed=5)
        for k in range(30):
            asked = env.normalize_obs(observation[None]) if k < 15 else env.normalize_obs(3.0 * observation[None])
            raw = model.predict(asked, deterministic=True)[0][0]
            given = observation if k < 15 else 3.0 * observation
            np.testing.assert_allclose(policy.network(given.astype(np.float64)), raw, atol=1e-5)
            if k < 15:
                jerk = policy(observation)
                if control == "jerk":
                    np.testing.assert_allclose(jerk, raw, atol=1e-5)
                else:
                    commands = next(layer for layer in layers(chain) if type(layer).__name__ == "JPCAction")
                    # the observation has the state in float32, the arm in float64
                    np.testing.assert_allclose(jerk, commands.action(raw), atol=2e-3)
            observation = chain.step(chain.action_space.sample())[0]
        chain.close()
    finally:
        model.get_env().close()


# ---- learning ----------------------------------------------------------------------------------------


def test_the_best_policy_is_the_one_with_the_best_evaluation(tmp_path):
    config = tiny(steps=256)
    training = train(config, tmp_path)
    best = max(training.history, key=lambda leg: (leg.eval_safe, leg.eval_return))
    assert training.policy.provenance["steps"] == best.steps
    report = evaluate(partial(control_env, config), training.policy, 1, EVALUATION_SEED)
    assert report.means["ep_return"].value == best.eval_return
    last = load_policy(tmp_path / "last.npz")
    assert last.provenance["steps"] == 256
    assert weights(tmp_path / "last.npz").keys() == weights(tmp_path / "best.npz").keys()


def test_ppo_learns_to_reach_beside_a_person_and_never_touches_anybody_in_motion(tmp_path):
    config = TrainConfig(
        human="walk_by",
        settings=PPO(width=64, rollout=512, batch_size=128, learning_rate=2e-3, decay=False, gamma=0.95),
        control="position",
        share=1.0,
        steps=6144,
        interval=3072,
        envs=8,
        eval_episodes=6,
    )
    model = build(config)
    untrained = evaluate(partial(control_env, config), to_policy(model, config), 6, EVALUATION_SEED)
    model.get_env().close()
    history = train(config, tmp_path).history
    assert max(leg.eval_return for leg in history) > untrained.means["ep_return"].value + 60.0
    assert sum(leg.episodes for leg in history) >= 48
    assert all(leg.moving_contacts == leg.eval_moving_contacts == leg.limit_violations == 0 for leg in history)
