# ruff: noqa: E402
"""Several seeds: each the training that it would be alone, and none lost with another."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from trainings import results, tiny

from jssa_gym.exceptions import ParameterError
from jssa_gym.train import learning_curves, train, train_seeds
from jssa_gym.train.sweep import seed_folder

SHORT = tiny(steps=64)


@pytest.mark.long
def test_each_seed_is_the_training_that_it_is_alone(tmp_path):
    """And two processes give the same as one after the other."""
    told = []
    here = train_seeds(SHORT, (3, 1), tmp_path / "here", say=told.append, command="several")
    assert [(one.seed, one.folder.name, one.error) for one in here] == [(3, "seed-3", ""), (1, "seed-1", "")]
    assert any(line.startswith("seed 1: 64 steps") for line in told)
    there = train_seeds(SHORT, (3, 1), tmp_path / "there", 2)
    alone = train(tiny(steps=64, seed=1), tmp_path / "alone")
    found = [results(folder) for folder in (there[1].folder, here[1].folder, alone.folder)]
    assert found[0] == found[1] == found[2]
    assert results(here[0].folder)["best.npz"] != found[0]["best.npz"]
    assert learning_curves([("tiny", tmp_path / "here")])[0].runs == 2


@pytest.mark.long
def test_a_seed_that_fails_loses_no_other_and_goes_on_by_the_same_call(tmp_path):
    (seed_folder(tmp_path, 0) / "checkpoints").mkdir(parents=True)
    (blocked := seed_folder(tmp_path, 0) / "history.csv").write_text("of another time")
    told = []
    failed, ended = train_seeds(SHORT, (0, 1), tmp_path, say=told.append)
    assert failed.error.startswith("CheckpointError: ")
    assert "no checkpoint to go on from" in failed.error
    assert (failed.history, ended.error) == ((), "")
    assert [leg.steps for leg in ended.history] == [64]
    assert any(line.startswith("seed 0: failed: ") for line in told)
    blocked.unlink()
    again = train_seeds(SHORT, (0, 1), tmp_path, say=told.append)
    assert [one.error for one in again] == ["", ""]
    assert "seed 1: going on from 64 policy steps" in told


@pytest.mark.parametrize("seeds", [(), (1, 1)])
def test_seeds_are_given_once(seeds, tmp_path):
    with pytest.raises(ParameterError, match="at least one, each once"):
        train_seeds(SHORT, seeds, tmp_path)
