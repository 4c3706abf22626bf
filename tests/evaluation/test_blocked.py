"""Runs in which every decision is a FAULT: said, saved, and no success."""

import json
import logging

import numpy as np
import picklable
import pytest

import jssa_gym
from jssa_gym import FILTERS
from jssa_gym.cli import stopwatch
from jssa_gym.cli.bench import Bench
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.demo import Demo
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.cli.reproduce import Reproduce
from jssa_gym.cli.stress import Stress
from jssa_gym.evaluation.blocked import commonest
from jssa_gym.exceptions import BlockedError
from jssa_gym.shields.baselines import NoFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.tick.proposals.nothing import Foreign

WHY = "out of order since [today]"


class OutOfOrder(NoFilter):
    """A filter that finds no jerk, ever."""

    def respond(self, tick):
        return self.failed(tick, WHY)


class Sleepy(NoFilter):
    """A filter that finds one now and then."""

    def respond(self, tick):
        return super().respond(tick) if tick.scene.time < 0.03 else self.failed(tick, WHY)


@pytest.fixture(autouse=True)
def filters(monkeypatch):
    def build(cls):
        return lambda robot, dt, params=None, **kwargs: cls(robot, dt, params, **kwargs)

    monkeypatch.setitem(FILTERS, "broken", build(OutOfOrder))
    monkeypatch.setitem(FILTERS, "sleepy", build(Sleepy))


def break_jssa(monkeypatch):
    """It is asked, not compiled, and finds no jerk."""
    monkeypatch.setattr(JSSAFilter, "proposal", Foreign())
    monkeypatch.setattr(JSSAFilter, "respond", OutOfOrder.respond)


@pytest.fixture
def broken_jssa(monkeypatch):
    break_jssa(monkeypatch)


def told(capsys):
    """The only line of warning."""
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning")]
    return line


def fails(command):
    with pytest.raises(SystemExit) as end:
        command.run()
    assert end.value.code == 1


# ---- evaluations ---------------------------------------------------------------------------------------


def test_an_evaluation_warns_and_reports(caplog, tmp_path):
    with caplog.at_level(logging.WARNING, logger="jssa_gym"):
        report = jssa_gym.evaluate("jssa_gym/Home-v0", "hold", 2, filter="broken", steps=20, out=tmp_path)
    assert report.blocked == WHY
    assert [episode.fault for episode in report.episodes] == [WHY, WHY]
    said = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    (line,) = [text for text in said if not text.startswith("Compiling")]  # where this is the first to run
    assert "every decision was a FAULT" in line
    assert WHY in line
    assert "jssa_gym/Home-v0, broken" in line
    (kept,) = json.loads((tmp_path / "summary.json").read_text())
    assert any(WHY in warning for warning in kept["warnings"])


@pytest.mark.parametrize("name", ["sleepy", "none", None])
def test_one_decision_that_is_none_is_enough(caplog, name):
    with caplog.at_level(logging.WARNING, logger="jssa_gym"):
        report = jssa_gym.evaluate("jssa_gym/Home-v0", "hold", 2, filter=name, steps=20)
    assert (report.means["fault_rate"].value > 0.5) == (name == "sleepy")
    assert report.blocked == ""
    assert not caplog.records


def test_a_policy_that_only_answers_with_nan_is_told_of_both():
    report = jssa_gym.evaluate("jssa_gym/Home-v0", lambda o: np.full(6, np.nan), 1, filter="jssa+stop", steps=10)
    assert "nominal jerk is not finite" in report.blocked
    assert len(report.warnings) == 2


def test_a_blind_sensor_is_told():
    report = jssa_gym.evaluate(picklable.sightless, picklable.push, 1, filter="jssa+stop", steps=30)
    assert "not measured" in report.blocked


def test_the_commonest_reason_is_told_on_a_line():
    assert commonest(["a", "b\nc", "b\nc"]) == "b c"
    assert commonest([]) == ""
    assert commonest([""]) == "no reason given"


# ---- commands ------------------------------------------------------------------------------------------


def test_evaluate_says_so_and_fails(capsys, tmp_path):
    fails(Evaluate(filter="broken", policy="hold", episodes=2, seconds=0.2, out=tmp_path / "out"))
    line = told(capsys)
    assert line.startswith("warning: reach, broken, walk_by, hold: every decision was a FAULT")
    assert line.endswith(WHY)
    assert len((tmp_path / "out" / "episodes.csv").read_text().splitlines()) == 3
    Evaluate(filter="sleepy", policy="hold", episodes=2, seconds=0.2, out=tmp_path / "other").run()
    assert "warning" not in capsys.readouterr().err


def test_compare_says_which_combination_and_fails(capsys, tmp_path):
    options = {"humans": ("none",), "policies": ("hold",), "episodes": 1, "seconds": 0.2}
    fails(Compare(filters=("none", "broken"), out=tmp_path / "out", **options))
    assert told(capsys).startswith("warning: reach, broken, none, hold")
    assert (tmp_path / "out" / "report.html").exists()


def test_stress_judges_the_whole(capsys, tmp_path, monkeypatch):
    options = {"humans": ("pursuit",), "policies": ("hold",), "episodes": 1, "seconds": 0.2, "judge": 0.0}
    # a fault that holds the arm by design, among others
    Stress(filters=("full", "unshielded"), faults=("none", "partial body"), out=tmp_path / "one", **options).run()
    assert "warning" not in capsys.readouterr().err
    break_jssa(monkeypatch)
    fails(Stress(filters=("full", "unshielded"), faults=("none", "partial body"), out=tmp_path / "two", **options))
    assert "every decision was a FAULT" in told(capsys)
    assert len((tmp_path / "two" / "episodes.csv").read_text().splitlines()) == 5
    # nobody was to decide
    Stress(filters=("unshielded",), faults=("none",), out=tmp_path / "three", **options).run()


@pytest.mark.long
def test_demo_says_which_shield_and_fails(broken_jssa, capsys, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    fails(Demo(out=tmp_path, seconds=0.2, video=False))
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning")]
    assert [line.split(":")[1].strip() for line in lines] == ["as published", "JSSAShield"]
    assert all(line.endswith(WHY) for line in lines)
    assert (tmp_path / "metrics.json").exists()


@pytest.mark.long
def test_bench_says_which_times_and_fails(broken_jssa, capsys, monkeypatch):
    monkeypatch.setattr(stopwatch, "time_projectors", lambda *told: [])
    monkeypatch.setattr(stopwatch, "time_distances", lambda *told: [])
    monkeypatch.setattr(stopwatch, "cbfpy_missing", lambda: "not here")
    fails(Bench(rounds=1, compile=False))
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if line.startswith("warning")]
    assert len(lines) == 5
    assert all("every decision was a FAULT" in line and WHY in line for line in lines)
    assert "env.step" in out


@pytest.mark.long
def test_reproduce_says_which_shields_and_fails(broken_jssa, capsys, monkeypatch, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    fails(Reproduce("fig6", out=tmp_path))
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning")]
    assert len(lines) == 4
    assert all(WHY in line for line in lines)
    assert (tmp_path / "fig6.json").exists()


# ---- trainings -----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("interval", "steps"), [(64, 64), (65536, 400)])
def test_a_training_ends_early_with_the_reason(broken_jssa, tmp_path, interval, steps):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from trainings import tiny

    from jssa_gym.train import train

    def watch(so_far):
        assert so_far <= steps, "it goes on"

    with pytest.raises(BlockedError, match=r"every decision of the shield is a FAULT.*out of order"):
        train(tiny(steps=2**20, interval=interval, ticks=10, vector=False), tmp_path, watch=watch)
    assert not (tmp_path / "best.npz").exists()


@pytest.mark.long
def test_a_training_without_a_shield_cannot_be_blocked(broken_jssa, tmp_path):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from trainings import tiny

    from jssa_gym.train import train

    assert train(tiny(steps=64, shield=False), tmp_path).history


def test_reasons_that_differ_in_numbers_alone_are_one():
    late = [f"the joint state lags by {k}.{k}e-0{k} rad" for k in range(1, 4)]
    assert commonest([*late, "frozen", "frozen"]) == late[0]
    assert commonest([*late, late[1]]) == late[1]
    assert commonest(["frozen", "frozen", late[0]]) == "frozen"
