"""The command line, run as users run it: complete files or none, one line and exit code 2 on bad input."""

import importlib.metadata
import itertools
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from commands import cli, one_line

from jssa_gym import plots
from jssa_gym.cli import main, stopwatch
from jssa_gym.cli.bench import Bench
from jssa_gym.envs import TASKS
from jssa_gym.evaluation import Summary
from jssa_gym.evaluation.contenders import CONTENDERS, FAULTS
from jssa_gym.evaluation.people import PEOPLE
from jssa_gym.exceptions import MissingExtraError
from jssa_gym.policies import POLICIES, shipped_policies
from jssa_gym.shields import FILTERS
from jssa_gym.storage import write_json

SHORT = ("demo", "--seconds", "0.4")


def check_metrics(path):
    summaries = json.loads(path.read_text())
    names = ["no shield", "as published", "JSSAShield", "profile yield"]
    assert [summary["name"] for summary in summaries] == names
    for summary in summaries:
        assert list(summary) == list(Summary.__dataclass_fields__)
        assert summary["ep_len"] == 50
    assert summaries[0]["shield_p50"] is None
    assert all(summary["shield_p50"] > 0.0 for summary in summaries[1:])
    return summaries


@pytest.mark.long
def test_demo_writes_its_files_and_prints_a_table(tmp_path):
    run = cli(*SHORT, "--no-video", "--out", tmp_path / "deep" / "out")
    assert run.returncode == 0, run.stderr
    assert "JSSAShield" in run.stdout
    assert "min distance" in run.stdout
    assert sorted(path.name for path in (tmp_path / "deep" / "out").iterdir()) == ["metrics.json", "profile.png"]
    summaries = check_metrics(tmp_path / "deep" / "out" / "metrics.json")
    (changed,) = (line for line in run.stdout.splitlines() if "steps changed" in line)
    assert re.findall(r"[\d.]+ %", changed) == [f"{100.0 * s['intervention_rate']:.1f} %" for s in summaries]
    assert (tmp_path / "deep" / "out" / "profile.png").read_bytes().startswith(b"\x89PNG")
    assert "profile.png" in run.stderr


@pytest.mark.long
@pytest.mark.gl
def test_demo_films_and_prints_json(tmp_path, here):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    run = here(*SHORT, "--json", "--out", tmp_path)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == check_metrics(tmp_path / "metrics.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["metrics.json", "profile.png", "side_by_side.mp4"]
    with av.open(str(tmp_path / "side_by_side.mp4")) as film:
        stream = film.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert stream.codec_context.name == "h264"
        assert float(stream.average_rate) == 25.0
    assert len(pictures) == 10
    # heading, picture, footer, gauge and ribbon; a line between two columns
    assert pictures[0].shape == (34 + 400 + 46 + 14 + 46, 4 * 480 + 3 * 4, 3)
    for picture in pictures:
        for left in range(0, picture.shape[1], 484):
            shown = picture[34:-106, left : left + 480]
            assert shown.std() > 10.0
            # a yellow arm in every column
            red, green, blue = (shown[..., i].astype(int) for i in range(3))
            assert ((red > 120) & (green > 80) & (blue < green / 2)).mean() > 0.005


@pytest.mark.sampled(11)
@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("demo", "--seconds", "0.01"), "seconds"),
        (("demo", "--seconds", "nan"), "seconds"),
        (("demo", "--seconds", "1e9"), "seconds"),
        (("demo", "--speed", "-1"), "speed"),
        (("demo", "--speed", "nan"), "speed"),
        (("bench", "--rounds", "0"), "rounds"),
        (("stress", "--filters", "nope"), "unknown filter"),
        (("evaluate", "--task", "swim"), "unknown task"),
        (("evaluate", "--filter", "cdf+stop"), "valid: jssa"),
        (("evaluate", "--policy", "a.b:c"), "cannot load the policy"),
        (("evaluate", "--seconds", "nan"), "seconds"),
        (("evaluate", "--jobs", "0"), "jobs"),
        (("evaluate", "--keep", "-1"), "keep"),
        (("evaluate", "--out", "/dev/null/x"), "cannot use"),
        (("compare", "--humans", "martian"), "unknown human"),
        (("compare", "--filters"), "no filters"),
        (("compare", "--episodes", "0"), "episodes"),
        (("replay", "missing.npz"), "cannot read missing.npz"),
        (("stress", "--humans", "pursuit x9"), "unknown human"),
        (("stress", "--jobs", "0"), "jobs"),
        (("stress", "--seconds", "nan"), "seconds"),
        (("stress", "--judge", "2"), "judge"),
        (("stress", "--episodes", "0"), "episodes"),
        (("stress", "--seed", "-1"), "seed"),
        (("stress", "--keep", "-1"), "keep"),
    ],
    ids=" ".join,
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, here, arguments, word):
    assert word in one_line(here(*arguments, cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("where", ["file", "file/below"])
def test_a_folder_that_cannot_be_is_one_line_and_exit_code_2(tmp_path, here, where):
    (tmp_path / "file").write_text("mine")
    line = one_line(here(*SHORT, "--no-video", "--out", tmp_path / where))
    assert "file" in line
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("arguments", [(), ("fly",), ("demo", "--speed", "fast"), ("demo", "--bogus")], ids=" ".join)
def test_what_cannot_be_parsed_is_exit_code_2(tmp_path, here, arguments):
    run = here(*arguments, cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr
    assert "Traceback" not in run.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_version_is_the_packages(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["jssa-gym", "--version"])
    main()
    assert capsys.readouterr().out == f"jssa-gym {importlib.metadata.version('jssa-gym')}\n"


@pytest.mark.parametrize("command", ["", "demo", "bench", "stress"])
def test_help(command, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["jssa-gym", *command.split(), "--help"])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 0
    text = capsys.readouterr().out
    words = {
        "": ("demo", "bench", "stress"),
        "demo": ("--out", "--speed", "--video"),
        "bench": ("--rounds", "--json"),
        "stress": ("--preset", "--filters", "--jobs", "--by", "--degradation"),
    }
    for word in words[command]:
        assert word in text


@pytest.mark.parametrize(
    ("command", "registries"),
    [
        ("evaluate", (TASKS, FILTERS, PEOPLE, (*POLICIES, *shipped_policies()))),
        ("compare", (TASKS, FILTERS, PEOPLE, (*POLICIES, *shipped_policies()))),
        ("stress", (CONTENDERS, PEOPLE, POLICIES, FAULTS)),
    ],
)
def test_help_lists_every_name(command, registries, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["jssa-gym", command, "--help"])
    monkeypatch.setenv("COLUMNS", "100000")
    with pytest.raises(SystemExit):
        main()
    text = capsys.readouterr().out
    for names in registries:
        assert f"{', '.join(names)}." in text


@pytest.mark.long
def test_the_module_runs_as_a_command():
    command = [sys.executable, "-m", "jssa_gym", "evaluate"]
    run = subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
    assert "--episodes" in run.stdout
    run = subprocess.run([*command, "--jobs", "0"], capture_output=True, text=True, check=False)
    assert "jobs" in one_line(run)


@pytest.mark.parametrize(
    ("missing", "arguments"),
    [("matplotlib", (*SHORT, "--no-video")), pytest.param("av", SHORT, marks=pytest.mark.gl)],
)
def test_a_missing_extra_is_named(tmp_path, here, monkeypatch, missing, arguments):
    monkeypatch.setitem(sys.modules, missing, None)
    assert "'jssa-gym[plots]'" in one_line(here(*arguments, "--out", tmp_path))


@pytest.mark.parametrize("missing", ["matplotlib", "av"])
def test_a_missing_extra_is_a_typed_error(tmp_path, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    draw = {
        "av": lambda: plots.write_film(tmp_path / "film.mp4", iter([]), 25),
        "matplotlib": lambda: plots.label("text", 100),
    }[missing]
    with pytest.raises(MissingExtraError, match=r"jssa-gym\[plots\]") as caught:
        draw()
    assert isinstance(caught.value, ImportError)
    assert list(tmp_path.iterdir()) == []


def pictures(count, then=None):
    for k in range(count):
        yield np.full((64, 96, 3), 20 * k, np.uint8)
    if then:
        raise then


def test_an_interrupted_film_leaves_nothing_under_its_name(tmp_path):
    pytest.importorskip("av", reason="PyAV is not installed")
    film = tmp_path / "film.mp4"
    with pytest.raises(KeyboardInterrupt):
        plots.write_film(film, pictures(5, KeyboardInterrupt()), 25)
    assert not film.exists()
    plots.write_film(film, pictures(5), 25)
    whole = film.read_bytes()
    assert len(whole) > 500
    # an older film survives a later failure
    with pytest.raises(RuntimeError, match="camera"):
        plots.write_film(film, pictures(3, RuntimeError("camera")), 25)
    assert film.read_bytes() == whole


def test_json_is_complete_or_not_there(tmp_path):
    path = tmp_path / "x.json"
    write_json(path, {"a": [1, 2.5, None]})
    assert json.loads(path.read_text()) == {"a": [1, 2.5, None]}
    for bad in ({"a": np.inf}, {"a": object()}):
        with pytest.raises((ValueError, TypeError)):
            write_json(path, bad)
    assert json.loads(path.read_text()) == {"a": [1, 2.5, None]}
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]


# ---- pieces of the pictures ---------------------------------------------------------------------------


def test_a_gauge_is_as_long_as_the_distance():
    def length(*arguments):
        bar = plots.gauge(*arguments, 480)
        assert bar.shape == (14, 480, 3)
        row = np.delete(bar[7], [24, 25], axis=0)
        return int((row != 34).any(axis=1).sum()), tuple(bar[7, 0])

    assert length(0.5, 0.05, False, False) == (238, (150, 160, 170))
    assert length(0.5, 0.05, True, False) == (238, (230, 159, 0))
    assert length(5.0, 0.05, False, False)[0] == 478
    assert length(-0.1, 0.05, True, True) == (478, (200, 40, 40))
    assert length(-0.1, 0.05, False, False)[0] == 0
    assert tuple(plots.gauge(0.0, 0.05, False, False, 480)[0, 24]) == (255, 255, 255)


def test_a_ribbon_shows_whether_jerks_flip():
    def covered(jerk):
        strip = plots.ribbon(np.array(jerk, float)[:, None], 480)
        assert strip.shape == (46, 480, 3)
        return float((strip == plots.ribbon(np.ones((2, 1)), 480)[3, -1]).all(axis=2).mean())

    still, flips, turns = np.zeros(300), np.resize([1.0, -1.0], 300), np.sin(np.linspace(0.0, 6.0, 300))
    assert covered(still) == 0.0
    assert covered(flips) > 0.8 > 0.1 > covered(turns) > 0.0
    assert covered(flips[:26]) == pytest.approx(covered(flips) / 10.0, rel=0.1)  # newest at the right, by and by


def test_a_label_shows_its_text():
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    strips = [plots.label(text, 480) for text in ("", "no shield", "JSSAShield")]
    assert all(strip.shape == (30, 480, 3) and strip.dtype == np.uint8 for strip in strips)
    assert strips[0].std() < 10.0
    assert strips[1].max() > 200
    for one, other in itertools.combinations(strips, 2):
        assert not np.array_equal(one, other)


@pytest.mark.long
def test_a_profile_has_five_panels_a_trace_and_shades_interventions(robot):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    import gymnasium as gym

    import jssa_gym
    from jssa_gym.cli.demo import paper_scene
    from jssa_gym.evaluation import rollout

    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=()))
    trace = rollout(env, jssa_gym.HoldPolicy(env), seed=0, steps=420, name="shielded")
    figure = plots.profile([trace, trace], robot.limits, 0.05)
    assert len(figure.axes) == 10
    panel = figure.axes[0]
    np.testing.assert_array_equal(panel.lines[0].get_ydata(), trace.distance)
    spans = int((np.diff(trace.intervened.astype(int), prepend=0) == 1).sum())
    assert spans >= 1
    # the first panel has one more, for the legend
    assert len(figure.axes[2].patches) == spans == len(panel.patches) - 1
    jerks = figure.axes[8].lines[:6]
    np.testing.assert_allclose([line.get_ydata() for line in jerks], (trace.jerk / robot.limits.jerk).T)


@pytest.mark.long
def test_bench_measures_everything_and_agrees_with_mujoco(here):
    """One round; that the distances agree with MuJoCo's is checked by the command itself."""
    run = here("bench", "--rounds", "1", "--no-compile", "--json")
    assert run.returncode == 0, run.stderr
    timings = json.loads(run.stdout[run.stdout.index("{") :])["timings"]
    names = " ".join(timing["name"] for timing in timings)
    for word in ("filter.decide", "osqp", "env.step, shielded", "mj_geomDistance", "projection alone"):
        assert word in names
    assert all(0.0 < timing["median"] <= timing["p99"] for timing in timings)


@pytest.mark.parametrize(
    ("installed", "clone", "said"),
    [
        (False, True, "no times of CBFpy: cbfpy is not installed; pip install cbfpy"),
        (True, False, "no times of CBFpy: benchmarks/cbfpy_peer.py is not part of an installed package"),
        (False, False, "run jssa-gym bench in a clone"),
        (True, True, ""),
    ],
)
def test_bench_says_why_cbfpy_is_missing(monkeypatch, capsys, tmp_path, installed, clone, said):
    """The measurements stand still: this is about what the command says of the one it cannot make."""
    for name in ("time_decisions", "time_projectors", "time_distances"):
        monkeypatch.setattr(stopwatch, name, lambda *arguments: [])
    monkeypatch.setattr(stopwatch, "record_scenes", lambda *arguments: (None, None, None))
    monkeypatch.setattr(stopwatch, "time_steps", lambda make, name, steps: stopwatch.Timing(name, 1e-6, 2e-6, 1))
    peer = tmp_path / "cbfpy_peer.py"
    if clone:
        peer.write_text("print('times of another')")
    monkeypatch.setattr(stopwatch, "CBFPY", peer)
    monkeypatch.setattr(stopwatch.importlib.util, "find_spec", lambda name: object() if installed else None)
    Bench(compile=False).run()
    out, err = capsys.readouterr()
    assert "env.step" in out
    lines = [line for line in err.splitlines() if "CBFpy" in line]
    assert len(lines) == (said != "")
    assert said in err
    assert ("times of another" in out) == (said == "")


@pytest.mark.long
def test_stress_counts_and_the_same_command_adds_nothing(tmp_path, here):
    command = ("stress", "--seconds", "0.4", "--by", "filter", "human", "--out", tmp_path / "out")
    runs = [run(*command, "--json") for run in (cli, here)]
    assert [run.returncode for run in runs] == [0, 0], runs[0].stderr
    assert runs[0].stdout == runs[1].stdout
    result = json.loads(runs[0].stdout)
    assert [(row["filter"], row["human"]) for row in result["rows"]] == [
        (shield, human) for human in ("pursuit", "hand") for shield in ("full", "unshielded")
    ]
    assert all(row["contacts"]["n"] == 4 and row["moving"]["high"] > 0.0 for row in result["rows"])
    assert result["broken"] == 0
    assert "other steps" in one_line(here("stress", "--seconds", "0.5", "--out", tmp_path / "out"))
    (tmp_path / "file").write_text("mine")
    assert "file" in one_line(here("stress", "--out", tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"
