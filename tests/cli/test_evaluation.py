"""``jssa-gym evaluate``, ``compare`` and ``replay``: what they print, write and exit with."""

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import TESTS

from jssa_gym import plots
from jssa_gym.cli import parse
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.evaluate import Evaluate, Separation
from jssa_gym.cli.replay import Replay
from jssa_gym.evaluation import load_trace, read_meta, save_trace
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.play import played_again, recorded_setting
from jssa_gym.exceptions import MissingExtraError, ParameterError


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A finished comparison."""
    out = tmp_path_factory.mktemp("compared") / "deep"
    Compare(filters=("jssa+stop", "none"), humans=("pursuit",), episodes=2, seconds=1.6, out=out).run()
    return out


def test_evaluate_prints_writes_and_continues(tmp_path, capsys):
    command = Evaluate(filter="none", human="pursuit", episodes=2, seconds=0.4, out=tmp_path, keep=1, json=True)
    command.run()
    told = json.loads(capsys.readouterr().out)
    assert told["episodes"] == 2
    assert told["rates"]["collision_rate"]["n"] == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "campaign.json",
        "episodes.csv",
        "summary.json",
        "traces",
    ]
    before = (tmp_path / "episodes.csv").read_bytes()
    command.run()
    assert (tmp_path / "episodes.csv").read_bytes() == before
    assert json.loads(capsys.readouterr().out) == told == json.loads((tmp_path / "summary.json").read_text())[0]
    with pytest.raises(ParameterError, match=r"another campaign \(other filters\)"):
        Evaluate(filter="jssa", human="pursuit", episodes=2, seconds=0.4, out=tmp_path).run()
    with pytest.raises(ParameterError, match=r"\(other episodes: 2 there, 3 asked for\)"):
        Evaluate(filter="none", human="pursuit", episodes=3, seconds=0.4, out=tmp_path).run()


def test_evaluate_prints_a_table(tmp_path, capsys):
    Evaluate(filter="none", human="none", episodes=1, seconds=0.2, out=tmp_path).run()
    text = capsys.readouterr().out
    for word in ("collision_rate", "0 / 1", "success_and_safe_rate", "ep_return", "jssa-gym replay"):
        assert word in text
    # nobody there: no distance to tell of
    assert "min_distance" not in text
    assert "1e+0" not in text


def test_the_command_for_the_worst_episode_can_be_pasted(tmp_path, capsys):
    Evaluate(filter="none", human="none", episodes=1, seconds=0.2, out=tmp_path / "two words").run()
    (line,) = (x for x in capsys.readouterr().out.splitlines() if x.startswith("one of the worst: "))
    words = shlex.split(line.removeprefix("one of the worst: "))
    assert parse(words[1:]).episode.parent == tmp_path / "two words" / "traces"


def test_a_policy_of_the_working_directory_is_found(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_policies.py").write_text("def still(env, seed):\n    return lambda observation: [0.0] * 6\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", list(sys.path))
    command = Evaluate(policy="my_policies:still", episodes=1, seconds=0.2, keep=1, filter="none", json=True)
    command.run()
    told = json.loads(capsys.readouterr().out)
    assert told["means"]["path_length"]["value"] == 0.0
    trace = tmp_path / told["traces"][0]
    Replay(trace, figure=False, video=False, again=True, policy="my_policies:still").run()
    assert "the same bit for bit" in capsys.readouterr().out


@pytest.mark.long
def test_what_only_a_recording_names_is_not_run(folder, tmp_path, monkeypatch, capsys):
    """Code that lies beside a recording, which its author may have put there, runs if it is repeated and only then."""
    path = next((folder / "traces").iterdir())
    ran = tmp_path / "ran"
    (tmp_path / "beside.py").write_text(
        f"open({str(ran)!r}, 'w').close()\ndef still(env, seed):\n    return lambda observation: [0.0] * 6\n"
    )
    for name in ("beside:still", "./beside.npz", "//somewhere/else.zip"):
        save_trace(load_trace(path), tmp_path / "named.npz", read_meta(path) | {"policy": name})
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.path", list(sys.path))
        again = Replay(Path("named.npz"), figure=False, video=False, verify=True, again=True)
        for command in (again, replace(again, trust_pickle=True)):
            with pytest.raises(ParameterError, match=f"asks for the policy '{name}'.*: --policy {name}"):
                command.run()
        assert capsys.readouterr().out == ""
        with pytest.raises(ParameterError, match=f"--policy {name}"):
            played_again(read_meta("named.npz"))
    # what the command line says counts, whatever the recording says
    Replay(Path("named.npz"), figure=False, video=False, again=True, policy="jpc").run()
    assert "the same bit for bit" in capsys.readouterr().out
    Evaluate(policy="hold", filter="none", human="none", episodes=1, seconds=0.2, out=tmp_path / "out").run()
    assert not ran.exists()
    assert str(tmp_path) not in sys.path
    with pytest.raises(SystemExit):  # it is another policy than the one that was recorded
        Replay(Path("named.npz"), figure=False, video=False, again=True, policy="beside:still").run()
    assert ran.exists()


@pytest.mark.parametrize("what", ["human", "robot"])
def test_no_file_that_a_recording_names_is_opened(folder, tmp_path, monkeypatch, what, toy_mjcf):
    path = next((folder / "traces").iterdir())
    trace, meta = load_trace(path), read_meta(path)
    if what == "robot":
        trace = replace(trace, robot=str(toy_mjcf))
    save_trace(trace, tmp_path / "named.npz", meta | {what: str(toy_mjcf)})
    with pytest.raises(ParameterError, match="unknown human" if what == "human" else "give its file as --robot"):
        Replay(tmp_path / "named.npz", figure=False, video=False, again=True).run()
    if what == "human":  # before anything is made of it
        with pytest.raises(ParameterError, match="unknown human"):
            recorded_setting(read_meta(tmp_path / "named.npz"))


@pytest.mark.long
def test_a_policy_whose_actions_are_not_finite_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(TESTS)
    broken = "picklable:broken_every_third"
    Evaluate(policy=broken, episodes=1, seconds=0.2, filter="none", out=tmp_path / "a", json=True).run()
    told = capsys.readouterr()
    assert "not finite in 8 steps of 1 episode:" in told.err
    assert json.loads(told.out)["means"]["n_actions_not_finite"]["value"] == 8.0
    assert f"wrote episodes.csv and summary.json to {tmp_path / 'a'}" in told.err
    Evaluate(policy="hold", episodes=1, seconds=0.2, filter="none", out=tmp_path / "b").run()
    assert "warning" not in capsys.readouterr().err
    command = Compare(filters=("jssa", "none"), humans=("none",), policies=(broken, "hold"), episodes=1, seconds=0.2)
    replace(command, out=tmp_path / "c").run()
    warnings = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert [line.split(": ")[1].split(", ")[1] for line in warnings] == ["jssa", "none"]
    assert all(broken in line for line in warnings)


def test_an_interrupt_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def interrupted(*arguments, **options):
        options["progress"](3, 10)
        raise KeyboardInterrupt

    monkeypatch.setattr("jssa_gym.cli.evaluate.complete", interrupted)
    with pytest.raises(SystemExit) as caught:
        Evaluate(out=tmp_path).run()
    assert caught.value.code == 130
    assert "goes on from 3 episodes" in capsys.readouterr().err


def test_compare_writes_a_page_with_its_own_command(folder, capsys):
    assert sorted(path.name for path in folder.iterdir()) == [
        *("campaign.json", "episodes.csv", "report.html", "summary.json", "traces"),
    ]
    page = (folder / "report.html").read_text()
    (line,) = (part for part in page.split("<code>") if part.startswith("jssa-gym compare"))
    words = shlex.split(line.split("</code>")[0])
    assert words[words.index("--filters") + 1 : words.index("--humans")] == ["jssa+stop", "none"]
    assert float(words[words.index("--seconds") + 1]) == 1.6
    told = Compare(seed=12_345_678, seconds=1.2345678, separation=Separation(0.2, 2.0, 0.12345678, 0.05))
    words = shlex.split(told.command_line())
    assert parse(words[1:]) == told
    again = Compare(filters=("jssa+stop", "none"), humans=("pursuit",), episodes=2, seconds=1.6, out=folder, json=True)
    again.run()
    best, other = json.loads(capsys.readouterr().out)
    assert (best["filter"], other["filter"]) == ("jssa+stop", "none")
    assert other["rate_differences"]["collision"]["n"] == 2
    assert (folder / "report.html").read_text() == page
    again = Compare(filters=("jssa+stop", "none"), humans=("pursuit",), episodes=2, seconds=1.6, out=folder)
    again.run()
    assert "0 / 2" in capsys.readouterr().out


def test_replay_judges_and_plays_again(folder, capsys):
    for path in sorted((folder / "traces").iterdir()):
        Replay(path, figure=False, video=False, verify=True, again=True).run()
        text = capsys.readouterr().out
        assert "MuJoCo agrees" in text
        assert "the same bit for bit" in text
        assert read_meta(path)["digest"][:16] in text


def test_replay_sees_what_was_changed(folder, tmp_path, capsys):
    path = next((folder / "traces").iterdir())
    trace = load_trace(path)
    distance = np.array(trace.distance)
    distance[10] += 1e-3
    changed = {name: getattr(trace, name) for name in type(trace).__dataclass_fields__} | {"distance": distance}
    save_trace(type(trace)(**changed), tmp_path / "changed.npz", read_meta(path))
    for options, word in (({"verify": True}, "MuJoCo DISAGREES"), ({"again": True}, "DIFFERENT")):
        with pytest.raises(SystemExit) as caught:
            Replay(tmp_path / "changed.npz", figure=False, video=False, **options).run()
        assert caught.value.code == 1
        assert word in capsys.readouterr().out


@pytest.mark.long
def test_replay_says_if_other_code_made_a_recording_that_goes_another_way(folder, tmp_path, capsys):
    path = next((folder / "traces").iterdir())
    trace, meta = load_trace(path), read_meta(path)
    assert {name: meta[name] for name in code_version()} == code_version()
    nameless = {name: value for name, value in meta.items() if name not in code_version()}
    for told, words in (
        (meta, "the same version of the code made the recording"),
        (meta | {"source": "0" * 16}, "made by another version of the code, which may be why"),
        (meta | {"version": "0.0.1"}, "version 0.0.1 (source"),
        (nameless, "does not say which version of the code"),
    ):
        save_trace(replace(trace, distance=trace.distance + 1e-3), tmp_path / "changed.npz", told)
        with pytest.raises(SystemExit):
            Replay(tmp_path / "changed.npz", figure=False, video=False, again=True).run()
        assert words in capsys.readouterr().out
    # only a difference needs a reason
    save_trace(trace, tmp_path / "old.npz", nameless)
    Replay(tmp_path / "old.npz", figure=False, video=False, again=True).run()
    assert "version of the code" not in capsys.readouterr().out


def test_replay_draws(folder, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    path = next((folder / "traces").iterdir())
    Replay(path, out=tmp_path / "deep" / "out", video=False).run()
    assert [file.name for file in (tmp_path / "deep" / "out").iterdir()] == ["profile.png"]
    assert (tmp_path / "deep" / "out" / "profile.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
@pytest.mark.gl
def test_replay_films_beside_the_recording(folder):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    path = next((folder / "traces").iterdir())
    Replay(path, figure=False).run()
    trace = load_trace(path)
    assert len(trace.time) == 200
    (begin,) = np.flatnonzero(np.diff(trace.contact.astype(int)) == 1) + 1
    with av.open(str(path.with_suffix("") / "episode.mp4")) as film:
        # every fifth step; where the contact begins, which is between two, it stands still for 100 steps
        assert begin % 5
        assert sum(1 for _ in film.decode(video=0)) == 200 // 5 + 1 + 100 // 5


def test_replay_of_what_it_cannot(folder, tmp_path, monkeypatch):
    path = next((folder / "traces").iterdir())
    trace = load_trace(path)
    fields = {name: getattr(trace, name) for name in type(trace).__dataclass_fields__}
    save_trace(type(trace)(**(fields | {"robot": "mine"})), tmp_path / "mine.npz")
    with pytest.raises(ParameterError, match="--robot"):
        Replay(tmp_path / "mine.npz", figure=False, video=False).run()
    save_trace(trace, tmp_path / "bare.npz")
    with pytest.raises(ParameterError, match="played again"):
        Replay(tmp_path / "bare.npz", figure=False, video=False, again=True).run()

    def missing(film=False):
        raise MissingExtraError("figures need the extra 'plots'")

    monkeypatch.setattr(plots, "require", missing)
    with pytest.raises(MissingExtraError):
        Replay(path).run()


def test_compare_measures_separation_by_what_it_is_told(tmp_path, capsys):
    shared = {"filters": ("none",), "humans": ("walk_by",), "episodes": 1, "seconds": 0.2, "keep": 0, "json": True}
    margins = []
    for name, told in (("plain", Separation()), ("reaching", Separation(intrusion=0.5))):
        Compare(out=tmp_path / name, separation=told, **shared).run()
        (only,) = json.loads(capsys.readouterr().out)
        margins.append(only["means"]["ssm_margin"]["value"])
    assert margins[0] - margins[1] == pytest.approx(0.5)
