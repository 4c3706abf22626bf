# ruff: noqa: E402
"""Trainings that were interrupted or killed go on to the bit."""

import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import results, tiny

from jssa_gym.cli.train import Train
from jssa_gym.exceptions import CheckpointError, ParameterError
from jssa_gym.train import loop, train
from jssa_gym.train.history import as_rows


class Interrupted(Exception):
    pass


def cut_off_at(steps):
    """A ``watch`` that stops a training there, as Ctrl-C does."""

    def watch(now):
        if now >= steps:
            raise Interrupted

    return watch


# ---- resumed -----------------------------------------------------------------------------------------


@pytest.mark.long
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


@pytest.mark.long
def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train(tiny(steps=64, seed=seed), tmp_path / name)
    assert results(tmp_path / "a") == results(tmp_path / "b")
    assert results(tmp_path / "a")["files"] != results(tmp_path / "c")["files"]


@pytest.mark.long
def test_processes_give_the_same_bits(tmp_path):
    config = tiny(steps=64)
    train(config, tmp_path / "one")
    train(replace(config, processes=True), tmp_path / "many")
    assert results(tmp_path / "one") == results(tmp_path / "many")


@pytest.mark.long
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
    for other, why in (
        (replace(config, seed=1), r"\(other seed\)"),
        (replace(config, steps=128), r"\(other steps, and its learning rate decays over all steps\)"),
        (replace(config, shield=False), r"\(other shield\)"),
    ):
        with pytest.raises(CheckpointError, match=f"holds another training {why}"):
            train(other, tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_a_training_whose_checkpoints_are_gone_does_not_begin_anew_in_silence(tmp_path):
    train(tiny(steps=64), tmp_path)
    (tmp_path / "checkpoints").rename(tmp_path / "elsewhere")
    with pytest.raises(CheckpointError, match="history but no checkpoint"):
        train(tiny(steps=64), tmp_path)


def test_a_folder_takes_one_training_at_a_time(tmp_path):
    config, refused = tiny(steps=64), []

    def second(steps):
        with pytest.raises(CheckpointError, match="another process trains in") as error:
            train(config, tmp_path)
        refused.append(error)

    train(config, tmp_path, watch=second)
    assert refused
    train(config, tmp_path)  # it is free again


def test_a_best_policy_that_is_gone_is_not_replaced_in_silence(tmp_path):
    config, told = tiny(steps=64), []
    train(config, tmp_path, say=told.append)
    assert not any("is gone" in line for line in told)
    (tmp_path / "best.npz").unlink()
    training = train(config, tmp_path, say=told.append)
    assert "best.npz is gone; the policy is that of last.npz" in told[-1]
    assert training.policy.provenance["steps"] == 64


@pytest.mark.long
def test_the_learning_rate_falls_over_the_whole_training_not_in_every_leg(tmp_path, monkeypatch):
    rates = []
    real = loop.learn_leg

    def leg(model, *rest):
        history = real(model, *rest)
        rates.append(model.policy.optimizer.param_groups[0]["lr"])
        return history

    monkeypatch.setattr(loop, "learn_leg", leg)
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
def told(write):
    def writing(path, *content):
        print("writing", path, flush=True)
        time.sleep(slow)
        return write(path, *content)
    return writing
checkpoint.whole_file, checkpoint.write_json = told(checkpoint.whole_file), told(checkpoint.write_json)
checkpoint._to_disk = told(checkpoint._to_disk)
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


@pytest.mark.long
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


VECTORISED = {
    "as tuned": {"control": "tip", "ticks": 25},
    "velocity": {"task": "handover", "control": "velocity", "learn_from": "penalty"},
    "jerk": {"task": "track", "control": "jerk", "ticks": 3, "observe_intervention": True},
    "unshielded": {"control": "position", "shield": False, "human": "pursuit"},
    "one tick": {"control": "velocity", "ticks": 1, "envs": 4, "human": "hand"},
    "sac": {"control": "velocity"},
}


@pytest.mark.long
@pytest.mark.parametrize("kind", VECTORISED)
def test_a_vector_gives_the_same_bits(tmp_path, kind):
    config = tiny("sac" if kind == "sac" else "ppo", **{"steps": 128, "ticks": 50} | VECTORISED[kind])
    single = train(replace(config, vector=False), tmp_path / "one by one")
    vector = train(replace(config, vector=True), tmp_path / "together")
    assert results(tmp_path / "one by one") == results(tmp_path / "together")
    assert kind not in ("velocity", "unshielded") or single.history[-1].episodes == vector.history[-1].episodes > 0


def test_a_vector_is_what_there_is_where_it_can_be():
    assert tiny().steps_as_vector
    assert tiny("sac").steps_as_vector
    assert not tiny(processes=True).steps_as_vector
    assert not tiny(vector=False).steps_as_vector
    assert not tiny("sac", learn_from="executed").steps_as_vector
    assert Train(task="reach", algorithm="ppo").config().steps_as_vector
    assert not Train(task="reach", algorithm="ppo", vector=False).config().steps_as_vector
    with pytest.raises(ParameterError, match="either vector or processes"):
        tiny(vector=True, processes=True)
    with pytest.raises(ParameterError, match="executed"):
        tiny("sac", vector=True, learn_from="executed")
