"""What commands print: names are shown and never obeyed, in what the stream can write; every option once."""

import ast
import functools
import io
import json
import logging
import os
import subprocess
import sys
import threading
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import picklable
import pytest
from rich.table import Table

import jssa_gym
from jssa_gym import plots
from jssa_gym.cli import terminal
from jssa_gym.cli.arguments import given_once
from jssa_gym.cli.terminal import Terminal, prepared
from jssa_gym.engine.workers import run
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import rollout, save_trace
from jssa_gym.evaluation.svg import Markup, Panel, tag
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES, HoldPolicy
from jssa_gym.shields import FILTERS
from jssa_gym.text import counted, printable

CLI = Path(jssa_gym.__file__).parent / "cli"
HOSTILE = "a\x1b[2J\x1b]0;title\x07b [/red] [bold] :smile: $\\frac$ \n jssa-gym: fine \u202etxt\x9b1m\x7f\ud800"
SEEN = r"a\x1b[2J\x1b]0;title\x07b [/red] [bold] :smile: $\frac$ \n jssa-gym: fine \u202etxt\x9b1m\x7f\ud800"


def fails(error):
    """In a thread of its own."""
    raise error


def obedient(text):
    """Characters that a terminal would obey, but for ends of lines."""
    return {c for c in text if not c.isprintable() and c != "\n"}


# ---- one place ---------------------------------------------------------------------------------------


def test_what_is_seen():
    assert printable(HOSTILE) == SEEN
    assert printable("plain ≤ é 𝒞 中") == "plain ≤ é 𝒞 中"
    assert printable("a\n\tb\r", keep="\n\t") == "a\n\tb\\r"


def test_tables_and_lines_show_what_they_are_given(capsys):
    console = Terminal(width=400)
    table = Table(HOSTILE, title=HOSTILE, caption=HOSTILE)
    table.add_row(HOSTILE)
    console.print(table)
    console.say(HOSTILE)
    out = capsys.readouterr().out
    assert obedient(out) == set()
    assert out.count(SEEN) == 5
    assert out.splitlines()[-1] == SEEN


def test_a_long_line_stays_one(capsys):
    Terminal(width=40).say("x" * 500)
    assert capsys.readouterr().out == "x" * 500 + "\n"


def test_every_print_of_the_commands_goes_through_it():
    """But for JSON, which is ASCII."""
    found = []
    for path in CLI.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "rich.console" and path.name != "terminal.py":
                found += [f"{path.name}:{node.lineno} {a.name}" for a in node.names if a.name == "Console"]
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                told = ast.unparse(node.args[0])
                if (
                    not told.startswith(("json.dumps(", "f'jssa-gym {package_version()}"))
                    and path.name != "terminal.py"
                ):
                    found.append(f"{path.name}:{node.lineno} print")
    assert found == []


def test_errors_warnings_and_log_lines_are_shown(capsys):
    terminal.complain(ParameterError(HOSTILE))
    assert capsys.readouterr().err == f"jssa-gym: {SEEN}\n"
    terminal.complain(FileNotFoundError(2, "No such file", "a\x1bb"))
    assert capsys.readouterr().err == "jssa-gym: a\\x1bb: No such file\n"
    before = warnings.formatwarning
    with prepared():
        text = warnings.formatwarning(HOSTILE, UserWarning, "x.py", 1)
        assert obedient(text) == set()
        record = logging.LogRecord("jssa_gym", logging.WARNING, "x.py", 1, "the filter failed: %s", (HOSTILE,), None)
        assert obedient(logging.lastResort.format(record)) == set()
    assert warnings.formatwarning is before
    assert logging.lastResort.formatter is None


@pytest.mark.long
def test_workers_show_what_they_say(capfd):
    run(picklable.saying, [HOSTILE.replace("\ud800", "")], 2, id)
    err = capfd.readouterr().err
    assert obedient(err) == set()
    assert err.count(r"a\x1b[2J") == 2


@pytest.mark.slow
def test_environments_in_processes_show_what_they_say(capfd):
    learner = pytest.importorskip("jssa_gym.train.learner", reason="stable_baselines3 is not installed")
    make = functools.partial(learner.monitored, picklable.loud_environment)
    learner.Processes([make], start_method="spawn").close()
    err = capfd.readouterr().err
    assert obedient(err) == set()
    assert r"a name: \x1b[2J" in err


def test_what_whoever_waits_for_a_thread_raises_is_told_once(monkeypatch):
    told = []
    monkeypatch.setattr(threading, "excepthook", lambda error: told.append(error.exc_type))
    before = threading.excepthook
    with prepared():
        for error in (OSError(28, "No space left on device"), ValueError("of a thread")):
            thread = threading.Thread(target=fails, args=(error,))
            thread.start()
            thread.join()
    assert told == [ValueError]
    assert threading.excepthook is before


# ---- every command -----------------------------------------------------------------------------------


@pytest.fixture
def hostile_trace(tmp_path):
    """A recording that somebody has named."""
    env = ArmEnv("reach", human="none", terminate_on=())
    trace = rollout(env, HoldPolicy(env), seed=0, steps=20, name="x")
    path = tmp_path / "named.npz"
    meta = {"task": HOSTILE, "filter": HOSTILE, "human": HOSTILE, "policy": HOSTILE, "seed": 0, "steps": 20}
    save_trace(replace(trace, name=HOSTILE), path, meta | {"named": True})
    return path


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Glyph")
def test_replay_shows_a_recordings_name(hostile_trace, tmp_path, here):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    code, out, err = here("replay", hostile_trace, "--no-video", "--verify")
    assert code == 0, err
    assert obedient(out + err) == set()
    assert out.splitlines()[0].startswith(f"{SEEN}: 20 steps")
    code, out, err = here("replay", hostile_trace, "--no-video", "--again")
    assert (code, out) == (2, "")
    assert obedient(err) == set()
    assert len(err.splitlines()) == 1


@pytest.mark.filterwarnings("ignore:Glyph")
def test_figures_show_a_name_as_it_is():
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    for name in (HOSTILE, r"$\frac{", "a $ b $ c"):
        assert plots.label(name, 480).shape == (30, 480, 3)


def test_a_counter_examples_name_is_shown(hostile_trace, here):
    code, out, err = here("certify", "--replay", hostile_trace)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert obedient(err) == set()


def test_the_names_of_a_robots_parts_are_shown_and_stay_in_the_folder(toy_mjcf, tmp_path, here):
    toy_mjcf.write_text(toy_mjcf.read_text().replace('name="third"', 'name="../../[/red]&#x202e;[2J"'))
    words = (
        "--robot",
        toy_mjcf,
        "--states",
        "50",
        "--no-search",
        "--authority",
        "0",
        "--out",
        tmp_path / "deep" / "out",
    )
    code, out, err = here("certify", *words)
    assert code in (0, 1), err
    assert obedient(out + err) == set()
    assert "[/red]\\u202e[2J" in out
    assert {path.name for path in tmp_path.iterdir()} == {"toy.xml", "toy.limits.toml", "deep"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["evaluate", "compare", "stress"])
def test_names_that_a_user_has_registered_are_shown(tmp_path, monkeypatch, here, name):
    bad = "[/red]\x1b[31m"
    monkeypatch.setitem(FILTERS, bad, FILTERS["none"])
    monkeypatch.setitem(POLICIES, bad, POLICIES["hold"])
    words = {
        "evaluate": ("--filter", bad, "--human", "none", "--policy", bad),
        "compare": ("--filters", bad, "none", "--humans", "none", "--policies", bad),
        "stress": ("--filters", "none", "--humans", "pursuit", "--policies", bad, "--by", "policy"),
    }[name]
    code, out, err = here(name, *words, "--episodes", "1", "--seconds", "0.2", "--out", tmp_path / "[bold]out\x1b")
    assert code in (0, 1), err
    assert obedient(out + err) == set()
    assert "[/red]\\x1b[31m" in out
    assert "[bold]out\\x1b" in err
    if name == "compare":
        page = (tmp_path / "[bold]out\x1b" / "report.html").read_text(encoding="utf-8")
        assert obedient(page) == set()
        assert "[/red]\\x1b[31m" in page
    assert all(path.name.isprintable() for path in (tmp_path / "[bold]out\x1b").rglob("*"))


@pytest.mark.sampled(9)
@pytest.mark.parametrize(
    "words",
    [
        ("replay", "a\x1b[31m\nb.npz"),
        ("evaluate", "--policy", "a\x1b[31m\nb.npz"),
        ("evaluate", "--policy", "[/red]\x1b:x"),
        ("evaluate", "--task", "[/red]\x1b"),
        ("compare", "--humans", "[/red]\x1b"),
        ("stress", "--filters", "[/red]\x1b"),
        ("certify", "--robot", "[/red]\x1b.xml"),
        ("certify", "--capsules", "[/red]\x1b"),
        ("train", "--human", "[/red]\x1b", "--no-video"),
        ("train", "--set", "[/red]\x1b=3", "--no-video"),
        ("demo", "--policy", "[/red]\x1b.npz", "--no-video"),
        ("demo", "--bogus\x1b", "\x1b"),
        ("reproduce", "\x1b[/red]"),
        ("bench", "--rounds", "\x1b[/red]"),
        ("fly\x1b",),
    ],
    ids=repr,
)
def test_wrong_arguments_are_repeated_but_not_obeyed(tmp_path, monkeypatch, words, here):
    monkeypatch.chdir(tmp_path)
    code, out, err = here(*words)
    assert (code, out) == (2, "")
    assert obedient(err) == set()
    assert "\\x1b" in err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("evaluate", "--jobs", "0", "--out", "x"), "jobs"),
        (("evaluate", "--out", "/proc/x"), "/proc/x"),
        (("compare", "--out", "/proc/x"), "/proc/x"),
        (("stress", "--faults", "stale", "--out", "x"), "names with spaces need quotes: 'stale "),
    ],
    ids=repr,
)
def test_an_error_is_one_line(tmp_path, monkeypatch, words, told, here):
    monkeypatch.chdir(tmp_path)
    code, out, err = here(*words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert told in err


def test_one_is_no_plural(tmp_path, here):
    words = ("--filter", "none", "--human", "none", "--policy", "hold", "--seconds", "0.1")
    for episodes, told in (("1", ": 1 episode, 95 %"), ("2", ": 2 episodes, 95 %")):
        again = (*words, "--out", tmp_path / episodes, "--episodes", episodes)
        code, out, err = here("evaluate", *again)
        assert code == 0, err
        assert told in out
        assert "" not in err.splitlines()
    assert counted(2000, "step") == "2,000 steps"


def test_pages_show_names():
    assert tag("p", HOSTILE) == f"<p>{SEEN}</p>"
    assert tag("p", HOSTILE, title=HOSTILE) == f'<p title="{SEEN}">{SEEN}</p>'
    seen = "&lt;b&gt;\\x1b&amp;&#x27;&quot;"
    assert tag("a", "<b>\x1b&'\"", href="<b>\x1b&'\"") == f'<a href="{seen}">{seen}</a>'
    # what is put together is text again, unless that is said
    assert tag("p", tag("b", "<") + "<") == "<p>&lt;b&gt;&amp;lt;&lt;/b&gt;&lt;</p>"
    assert tag("p", tag("b", "<"), Markup("<br>"), 3, x_y=0.123456) == '<p x-y="0.1235"><b>&lt;</b><br>3</p>'
    panel = Panel((0.0, 1.0), (0.0, 1.0), HOSTILE, HOSTILE, names=(HOSTILE, "<b>"))
    panel.curve(np.zeros(2), np.zeros(2), 0, HOSTILE)
    assert obedient(panel.drawn()) == set()
    assert "<b>" not in panel.drawn()


# ---- every option once -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words",
    [
        ("compare", "--filters", "stop", "--filters", "none"),
        ("compare", "--filters=stop", "--filters", "none"),
        ("stress", "--by", "filter", "--by", "human"),
        ("certify", "--capsules", "elbow", "--capsules", "forearm"),
        ("train", "--set", "width=3", "--set", "rollout=64"),
        ("evaluate", "--seed", "1", "--seed", "2"),
        ("evaluate", "--v-safe", "1", "--v_safe", "2"),
        ("demo", "--video", "--no-video"),
        ("replay", "x.npz", "--again", "--again"),
    ],
    ids=" ".join,
)
def test_an_option_given_twice_is_refused(tmp_path, monkeypatch, words, here):
    monkeypatch.chdir(tmp_path)
    code, out, err = here(*words)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert "is given twice" in line
    assert list(tmp_path.iterdir()) == []


def test_options_given_once_pass():
    given_once(["compare", "--filters", "stop", "none", "--humans", "none", "--no-json", "--seed", "-1", "x", "x"])
    with pytest.raises(ParameterError, match="--filters is given twice"):
        given_once(["--filters", "--filters"])


# ---- streams -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "utf-8"])
def test_what_a_stream_cannot_write_is_written_alike(monkeypatch, encoding):
    told = "tip ≤ 1 m/s, 𝒞, −3 – ±2 µs × λ₁ → φ² 中 ╭─│"
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\n")
    monkeypatch.setattr(sys, "stdout", stream)
    with prepared():
        print(told)
        Terminal().say(told)
    stream.flush()
    first, second = stream.buffer.getvalue().decode(encoding).splitlines()
    assert first == second
    expected = {
        "ascii": "tip <= 1 m/s, C, -3 - +/-2 us x lambda1 -> phi2 ? +-|",
        "cp1252": "tip <= 1 m/s, C, -3 – ±2 µs × lambda1 -> phi² ? +-|",
        "latin-1": "tip <= 1 m/s, C, -3 - ±2 µs × lambda1 -> phi² ? +-|",
        "utf-8": told,
    }
    assert first == expected[encoding]


def test_columns_stay_columns_where_a_look_alike_is_longer(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", newline="\n")
    monkeypatch.setattr(sys, "stdout", stream)
    with prepared():
        table = Table("≤ λ", "x")
        for text in ("≤≤≤≤ ±", "plain"):
            table.add_row(text, "x")
        Terminal(width=80).print(table)
    stream.flush()
    lines = stream.buffer.getvalue().decode("ascii").splitlines()
    assert "<=<=<=<= +/-" in lines[3]
    assert len({len(line) for line in lines}) == 1


@pytest.mark.long
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_a_command_in_another_encoding(tmp_path, encoding):
    words = ("evaluate", "--filter", "none", "--human", "none", "--episodes", "1", "--seconds", "0.2", "--out", "é")
    run = subprocess.run(
        [sys.executable, "-m", "jssa_gym", *words],
        cwd=tmp_path,
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    text = run.stdout.decode(encoding)
    assert "0 / 1 (<= 98 %)" in text
    assert json.loads((tmp_path / "é" / "summary.json").read_text(encoding="utf-8"))


def version_to(stream):
    """Exit code and standard error of a command that prints to a stream, through a buffer as always."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    words = [sys.executable, "-m", "jssa_gym", "--version"]
    run = subprocess.run(words, stdout=stream, stderr=subprocess.PIPE, text=True, env=environment, check=False)
    return run.returncode, run.stderr


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_an_output_that_is_full_is_one_line():
    with Path("/dev/full").open("w") as full:
        assert version_to(full) == (2, "jssa-gym: No space left on device\n")


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="pipes of another kind")
def test_a_reader_who_leaves_is_told_nothing():
    reader, writer = os.pipe()
    os.close(reader)
    assert version_to(writer) == (1, "")
    os.close(writer)
