"""``jssa-gym train``, run as users run it."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from commands import TINY, WITHOUT, cli, one_line
from places import PATIENCE

from jssa_gym import plots
from jssa_gym.cli.train import Train
from jssa_gym.exceptions import MissingExtraError, ParameterError
from jssa_gym.policies import load_policy
from jssa_gym.train import PPO, SAC, TrainConfig, config, preset


@pytest.mark.long
def test_help_is_there_without_torch():
    run = cli("train", "--help", before=WITHOUT.format(blocked=("torch", "stable_baselines3", "matplotlib")))
    assert run.returncode == 0, run.stderr
    assert "--learn-from" in run.stdout
    assert "goes on where it stopped" in " ".join(run.stdout.split())


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--set", "widht=3"), "unknown setting 'widht' of sac; valid: learning_rate,"),
        (("--set", "width"), "--set takes name=value, got 'width'"),
        (("--set", "width=wide"), "width has to be of type int, got 'wide'"),
        (("--set", "learning_rate=nan"), "learning_rate has to be a number in"),
        (("--algorithm", "ppo", "--set", "rollout=100"), "rollout has to be a multiple of the 8 environments"),
        (("--task", "dance"), "unknown task 'dance'; valid: home, reach, track, handover"),
        (("--human", "ghost"), "unknown human 'ghost'; valid: "),
        (
            ("--algorithm", "ppo", "--learn-from", "executed"),
            "needs an algorithm with a replay buffer, sac, td3 or tqc",
        ),
        (("--no-shield", "--learn-from", "penalty"), "without a shield there are no interventions"),
        (("--threads", "0"), "threads has to be a positive integer, got 0"),
        (("--steps", "0"), "steps has to be a positive integer"),
        (("--seed", "-1"), "seed has to be a whole number"),
        (("--share", "0"), "share has to be a number in"),
    ],
)
def test_bad_input_is_one_line(arguments, says, tmp_path, here):
    assert says in one_line(here("train", "--out", tmp_path / "out", *arguments))
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize("blocked", [("torch",), ("stable_baselines3",)])
def test_without_the_extra_it_says_what_to_install(blocked, tmp_path):
    run = cli("train", "--no-video", "--out", tmp_path / "out", before=WITHOUT.format(blocked=blocked))
    assert "pip install 'jssa-gym[train]'" in one_line(run)
    assert not (tmp_path / "out").exists()


def test_films_are_asked_for_before_the_training_not_after(tmp_path, monkeypatch):
    def missing(film=False):
        assert film
        raise MissingExtraError("films need the extra 'plots'")

    monkeypatch.setattr(plots, "require", missing)
    with pytest.raises(MissingExtraError, match="films"):
        Train(algorithm="ppo", out=tmp_path / "out", steps=64, envs=2, set=("rollout=64", "batch_size=32")).run()
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_folder_that_cannot_be_one_is_one_line(tmp_path, here):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    (tmp_path / "file").write_text("in the way")
    assert "cannot write to" in one_line(here(*TINY, "--no-video", "--out", tmp_path / "file"))


def test_what_is_not_given_stays_as_tuned(monkeypatch):
    tuned = TrainConfig(
        task="home",
        settings=SAC(width=99),
        human="pursuit",
        control="jerk",
        share=0.9,
        ticks=3,
        learn_from="both",
        penalty=0.7,
        observe_intervention=True,
        steps=77,
        envs=5,
        interval=7,
        eval_episodes=4,
    )
    monkeypatch.setitem(config.PRESETS, ("home", "sac"), tuned)
    assert Train(task="home", algorithm="sac").config() == tuned == preset("home", "sac")
    given = {
        "human": "hand",
        "control": "position",
        "share": 0.2,
        "ticks": 9,
        "learn_from": "policy",
        "penalty": 0.0,
        "observe_intervention": False,
        "steps": 5,
        "envs": 2,
        "interval": 3,
        "eval_episodes": 1,
        "seed": 8,
    }
    asked = Train(task="home", algorithm="sac", set=("width=12", "tau=0.01"), processes=True, **given).config()
    assert {name: getattr(asked, name) for name in given} == given
    assert asked.settings == SAC(width=12, tau=0.01)
    assert asked.processes
    assert asked.shield
    assert Train(shield=False).config() == replace(preset("reach", "sac"), shield=False, learn_from="policy")
    assert preset("reach", "sac").learn_from == "executed"
    assert Train().config() == preset("reach", "sac")
    assert Train(algorithm="ppo").config() == preset("reach", "ppo")
    assert Train(task="handover").config() == preset("handover", "ppo")
    assert Train(task="track").config() == preset("track", "ppo")
    assert Train(task="track").config().settings == PPO()
    assert Train(task="home").config() == tuned  # the only one that was tuned for it
    with pytest.raises(ParameterError, match="name=value"):
        Train(set=("width",)).config()


def test_settings_given_twice_are_refused(here):
    """Of two options the last one would count, and nobody would see it."""
    assert "--set is given twice" in one_line(here("train", "--set", "rollout=64", "--set", "width=32"))


# ---- run ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    folder = tmp_path_factory.mktemp("trained") / "out"
    return folder, cli(*TINY, "--no-video", "--json", "--out", folder)


@pytest.mark.long
def test_from_one_command_to_a_policy(trained):
    folder, run = trained
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert told == json.loads((folder / "training.json").read_text())
    changes = {"width": 16, "rollout": 64, "batch_size": 32, "n_epochs": 2}
    assert TrainConfig.of(told["training"]).settings == replace(preset("reach", "ppo").settings, **changes)
    assert [leg["steps"] for leg in told["history"]] == [64, 128]
    assert "128 steps: " in run.stderr
    policy = load_policy(folder / "best.npz")
    assert policy.provenance["command"].startswith("jssa-gym train --algorithm ppo --steps 128")


@pytest.mark.long
def test_the_same_command_again_tells_the_same(trained, here):
    folder, first = trained
    run = here(*TINY, "--no-video", "--json", "--out", folder)
    assert run.returncode == 0, run.stderr
    assert run.stdout == first.stdout
    assert "going on from 128 policy steps" in run.stderr


@pytest.mark.long
def test_another_training_in_its_folder_is_one_line(trained, here):
    folder, _ = trained
    run = here(*TINY, "--no-video", "--out", folder, "--seed", "5")
    assert "holds another training" in one_line(run)


@pytest.mark.long
def test_its_policy_is_evaluated_by_the_line_that_it_prints(trained, tmp_path, here):
    folder, _ = trained
    run = here(*TINY, "--no-video", "--out", folder)
    assert run.returncode == 0, run.stderr
    assert "the training, leg by leg" in run.stdout
    line = run.stdout.strip().splitlines()[-1]
    assert line.startswith("jssa-gym evaluate --task reach --human random --filter shielded --policy ")
    words = line.replace("--episodes 1000", "--episodes 1").split()[1:]
    run = here(*words, "--out", tmp_path, "--json")
    assert run.returncode == 0, run.stderr
    assert "success_rate" in run.stdout


@pytest.mark.long
@pytest.mark.gl
def test_it_films_the_best_policy(trained, here):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    folder, _ = trained
    run = here(*TINY, "--json", "--out", folder)
    assert run.returncode == 0, run.stderr
    with av.open(str(folder / "best.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) >= 10


@pytest.mark.long
def test_ctrl_c_says_how_to_go_on(tmp_path):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    script = "import sys\nsys.argv[0] = 'jssa-gym'\nfrom jssa_gym.cli import main\nmain()"
    long = [word if word != "128" else "100000" for word in TINY]
    process = subprocess.Popen(
        [sys.executable, "-c", script, *long, "--no-video", "--out", str(tmp_path)],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "300"},
        # whoever runs the tests in the background may have it ignored, which children inherit
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        while process.poll() is None and not (tmp_path / "history.csv").exists():
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert "the same command goes on from the last checkpoint" in err
    assert "Traceback" not in err
    assert out == ""
