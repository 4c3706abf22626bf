"""``jssa-gym dataset``: what it writes, prints and refuses."""

import json
import sys

import pytest
from commands import one_line

from jssa_gym.datasets import DESCRIBED, Recipe, read_digest, write_dataset
from jssa_gym.exceptions import MissingExtraError

h5py = pytest.importorskip("h5py")

SHORT = ("--task", "home", "--policy", "hold", "--human", "walk_by", "--episodes", "2", "--seconds", "0.1")


def test_the_command_writes_one_and_says_how_minari_reads_it(here, tmp_path):
    run = here("dataset", *SHORT, "--shield", "none", "--name", "mine/a-v3", "--out", tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("mine/a-v3: 2 episodes, 24 steps, ")
    assert f"MINARI_DATASETS_PATH={tmp_path}: minari.load_dataset('mine/a-v3')" in run.stderr
    assert "another --name" in one_line(here("dataset", *SHORT, "--name", "mine/a-v3", "--out", tmp_path))
    run = here("dataset", *SHORT, "--json", "--seed", "7", "--robot", "ur5e", "--out", tmp_path)
    told = json.loads(run.stdout)
    assert told["name"] == "jssa_gym/home-hold-shielded-walk_by-v0"
    metadata = json.loads((tmp_path / told["name"] / "data/metadata.json").read_text())
    assert (metadata["jssa_gym"]["seed"], metadata["jssa_gym"]["robot"]) == (7, "ur5e")


def test_a_described_one_is_compared_with_its_card(here, tmp_path, monkeypatch):
    tiny = Recipe("home", "hold", episodes=1, steps=3)
    digest = write_dataset(tmp_path / "first", tiny).digest
    name = next(iter(DESCRIBED))
    for k, (told, code, word) in enumerate(((digest, 0, "as its card says"), ("0" * 64, 1, "not as its card says"))):
        monkeypatch.setitem(DESCRIBED, name, DESCRIBED[name]._replace(recipe=tiny, digest=told))
        run = here("dataset", "--described", name, "--out", tmp_path / str(k))
        assert (run.returncode, word in run.stdout) == (code, True)
        assert (tmp_path / str(k) / name / "data/metadata.json").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--described", "reach"), "unknown data set 'reach'"),
        (("--described", "jssa_gym/home-random-v0", "--seed", "3"), "leave the other options"),
        (("--name", "reach"), "namespace/name-vNUMBER"),
        (("--name", "../reach-v0"), "namespace/name-vNUMBER"),
        (("--task", "swim"), "unknown task 'swim'"),
        (("--shield", "swim"), "unknown filter 'swim'"),
        (("--episodes", "0"), "episodes has to be a positive integer"),
        (("--check", "nowhere"), "there is no data set in nowhere: name the folder of one"),
        (("--check", "nowhere", "--episodes", "3"), "leave the other options but --json out"),
    ],
)
def test_wrong_words_are_told_in_one_line(words, message, here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in one_line(here("dataset", *words))
    assert list(tmp_path.iterdir()) == []


def test_without_h5py_it_says_what_to_install(here, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert "jssa-gym[data]" in one_line(here("dataset", *SHORT, "--out", tmp_path))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(MissingExtraError):
        read_digest(tmp_path)


def test_what_was_changed_is_seen(tmp_path, here):
    made = write_dataset(tmp_path, Recipe("home", "hold", human="walk_by", episodes=1, steps=5))
    run = here("dataset", "--check", made.path)
    assert (run.returncode, run.stdout) == (0, f"as it was written: SHA-256 {made.digest}\n")
    with h5py.File(made.path / "main_data.hdf5", "a") as archive:
        archive["episode_0/infos/people/start"][2, 0, 0] += 1e-3
    run = here("dataset", "--check", made.path.parent)
    assert run.returncode == 1
    assert run.stdout.startswith("changed: SHA-256 ")
    run = here("dataset", "--check", made.path, "--json")
    assert (run.returncode, json.loads(run.stdout)["as_written"]) == (1, False)
