"""``jssa-gym train --seeds`` and ``jssa-gym curves``, run as users run them."""

import json

import pytest
from commands import TINY, WITHOUT, cli, one_line

from jssa_gym import plots
from jssa_gym.exceptions import MissingExtraError

SHORT = tuple("64" if word == "128" else word for word in TINY)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    folder = tmp_path_factory.mktemp("swept") / "out"
    run = cli(*SHORT, "--seed", "4", "--seeds", "2", "--jobs", "2", "--json", "--out", folder)
    return folder, run, _kept(folder)


def _kept(folder):
    """What both trainings left."""
    from trainings import results

    return {seed: results(folder / f"seed-{seed}") for seed in (4, 5)}


@pytest.mark.long
def test_ray_trains_the_same(swept, tmp_path):
    pytest.importorskip("ray", reason="ray is not installed")
    _, local, kept = swept
    options = ("--seed", "4", "--seeds", "2", "--engine", "ray", "--json", "--out", tmp_path / "ray")
    run = cli(*SHORT, *options)
    assert run.returncode == 0, run.stderr
    assert _kept(tmp_path / "ray") == kept
    assert kept[4] != kept[5]
    told, before = json.loads(run.stdout), json.loads(local.stdout)
    assert [(one["seed"], one["error"]) for one in told] == [(one["seed"], one["error"]) for one in before]
    files = [sorted(path.name for path in (where / "seed-5").iterdir()) for where in (tmp_path / "ray", swept[0])]
    assert files[0] == files[1]


def test_threads_are_those_of_every_training_and_of_nothing_else(monkeypatch, here, tmp_path):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    import torch

    from jssa_gym.train import loop

    found, before = [], torch.get_num_threads()
    monkeypatch.setattr(loop, "train", lambda config, *_, **__: found.append((config.seed, torch.get_num_threads())))
    try:
        here(*SHORT, "--seeds", "2", "--threads", before + 1, "--out", tmp_path / "out")
    finally:
        after = torch.get_num_threads()
        torch.set_num_threads(before)
    assert found == [(0, before + 1), (1, before + 1)]
    assert after == before


@pytest.mark.long
def test_several_seeds_by_one_command(swept, here):
    folder, run, _ = swept
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert [(one["seed"], one["error"], len(one["history"])) for one in told] == [(4, "", 1), (5, "", 1)]
    assert sorted(path.name for path in folder.iterdir()) == ["seed-4", "seed-5"]
    assert "seed 5: 64 steps: " in run.stderr
    assert not (folder / "seed-4" / "best.mp4").exists()
    (folder / "seed-5" / "checkpoints" / "000000000064" / "parameters.pt").write_bytes(b"bad")
    again = here(*SHORT, "--seed", "4", "--seeds", "2", "--out", folder)
    assert again.returncode == 1
    assert "seed 4: going on from 64 policy steps" in again.stderr
    assert "seed 5: failed: none of the checkpoints" in again.stderr
    assert f"jssa-gym curves {folder}" in again.stdout


@pytest.mark.long
def test_curves_of_them_are_drawn_and_written(swept, tmp_path, here):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    folder, *_ = swept
    run = here("curves", folder, folder / "seed-4", "--labels", "both", "one", "--out", tmp_path / "drawn")
    assert run.returncode == 0, run.stderr
    assert "interquartile means over seeds" in run.stdout
    both, one = json.loads((tmp_path / "drawn" / "curves.json").read_text())
    assert (both["label"], both["runs"], both["steps"]) == ("both", 2, [64])
    assert (one["label"], one["runs"]) == ("one", 1)
    lines = (tmp_path / "drawn" / "curves.md").read_text().splitlines()
    assert lines[0].startswith("| trainings | seeds | policy steps |")
    assert lines[2].startswith("| both | 2 | 64 | 0 % [0, 0] |")
    assert lines[3].startswith("| one | 1 | 64 | 0 % | 0 % |")
    assert (tmp_path / "drawn" / "curves.png").read_bytes().startswith(b"\x89PNG")
    quick = here("curves", folder / "seed-4", "--no-figure", "--json", "--resamples", "10", "--out", tmp_path / "json")
    assert json.loads(quick.stdout)[0]["label"] == "seed-4"
    assert sorted(path.name for path in (tmp_path / "json").iterdir()) == ["curves.json", "curves.md"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("train", "--jobs", "2"), "are for several trainings: give --seeds as well"),
        (("train", "--engine", "ray"), "are for several trainings: give --seeds as well"),
        (("train", "--seeds", "0"), "seeds has to be a positive integer"),
        (("train", "--seeds", "2", "--seed", str(2**32 - 1)), "seed has to be at most"),
        (("train", "--seeds", "2", "--address", "auto"), "give --engine ray as well"),
        (("curves", "nothing"), "nothing holds no training"),
        (("curves", "nothing", "--labels", "a", "b"), "1 folders need as many labels, got 2"),
        (("curves", "nothing", "--resamples", "0"), "nothing holds no training"),
    ],
)
def test_bad_input_is_one_line(arguments, says, tmp_path, here):
    assert says in one_line(here(*arguments, "--out", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_curves_need_no_torch_and_without_a_figure_no_matplotlib(tmp_path):
    run = cli("curves", tmp_path, "--no-figure", before=WITHOUT.format(blocked=("torch", "matplotlib")))
    assert "holds no training" in one_line(run)


def test_figures_are_asked_for_before_anything_is_read(tmp_path, monkeypatch, here):
    def missing():
        raise MissingExtraError("figures need the extra 'plots'")

    monkeypatch.setattr(plots, "require", missing)
    assert "figures need the extra" in one_line(here("curves", tmp_path))
