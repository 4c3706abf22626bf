"""``jssa-gym audit``: what it writes, how it ends, and one line for what it cannot read."""

import json
import sys

import numpy as np
import pytest

from jssa_gym.cli import main, parse
from jssa_gym.cli.audit import AuditLog
from jssa_gym.humans import Body, Recording
from jssa_gym.robots import lr_mate_200id_7l


@pytest.fixture
def folder(tmp_path):
    """A log of a move of 2 s and somebody who stands near it, or far away."""
    time = np.arange(251) * 0.008
    home = np.array(lr_mate_200id_7l().home)
    share = np.clip(time / 2.0, 0.0, 1.0)
    way = 10 * share**3 - 15 * share**4 + 6 * share**5
    position = home + np.outer(way, [1.2, 0.3, 0.0, 0.0, 0.0, 0.0])
    np.savez(tmp_path / "log.npz", time=time, position=position)
    for name, x in (("near", 0.95), ("far", 6.0)):
        body = Body.facing().at((x, 0.2), (0.0, 0.0))
        ends = [np.stack([end, end]) for end in (body.start, body.end)]
        Recording(np.array([0.0, 3.0]), *ends, body.radius, body.names).save(tmp_path / f"{name}.npz")
    return tmp_path


def run(*words):
    """Exit code of a command in this process."""
    try:
        parse([str(word) for word in words]).run()
    except SystemExit as end:
        return end.code
    return 0


@pytest.mark.long
def test_it_writes_a_page_a_figure_numbers_and_the_safe_motion(folder, capsys):
    assert run("audit", folder / "log.npz", "--people", folder / "near.npz") == 1
    out = folder / "log-audit"
    assert {path.name for path in out.iterdir()} == {"report.html", "audit.json", "audit.png", "safe.csv"}
    shown = capsys.readouterr().out
    assert "The shield would have intervened" in shown
    assert "distance - S_p" in shown
    told = json.loads((out / "audit.json").read_text())
    assert told["interventions"]
    assert told["robot"] == "lr_mate_200id_7l"
    # the safe motion is a log itself, in which the shield has nothing to do with limits and moving contacts
    assert run("audit", out / "safe.csv", "--people", folder / "near.npz", "--no-figure", "--out", folder / "b") in (
        0,
        1,
    )
    again = json.loads((folder / "b" / "audit.json").read_text())
    assert again["logged"]["min_distance"] == pytest.approx(told["with_shield"]["min_distance"])
    assert not again["logged"]["moving_contact"]
    assert again["logged"]["limit_violation_rate"] == 0.0


def test_nothing_to_do_is_exit_code_0_and_json_is_all_that_is_printed(folder, capsys):
    words = ("--people", folder / "far.npz", "--json", "--no-figure", "--out", folder / "out")
    assert run("audit", folder / "log.npz", *words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["would_intervene"] is False
    assert told["lateness"] == pytest.approx(0.0, abs=1e-9)
    assert not (folder / "out" / "audit.png").exists()


def test_options_reach_what_they_are_for(folder, capsys):
    words = ("--no-figure", "--out", folder / "out", "--json")
    far = ("audit", folder / "log.npz", "--people", folder / "far.npz", *words)
    run(*far, "--filter", "work", "--dt", 0.004, "--human-speed", 2.5, "--position-error", 0.07, "--reaction-time", 0.3)
    told = json.loads(capsys.readouterr().out)
    assert (told["filter"], told["dt"]) == ("work", 0.004)
    assert (told["assumed"]["human_speed"], told["assumed"]["position_error"]) == (2.5, 0.07)
    run(*far)
    usual = json.loads(capsys.readouterr().out)
    assert told["logged"]["ssm_margin"] < usual["logged"]["ssm_margin"] - 0.3
    assert run(*far, "--shift", 0.504) == 0
    assert json.loads(capsys.readouterr().out)["stretches"][0]["start"] == pytest.approx(0.504)
    run(*far, "--scene", "floor")
    assert json.loads(capsys.readouterr().out)["closest_logged"]["human"]
    assert AuditLog(folder / "log.npz").body == "jointed"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nothing.csv",), "no log at nothing.csv"),
        (("run.mcap",), "run.mcap: .mcap is not read"),
        (("log.npz", "--people", "nobody.csv"), "no recording at nobody.csv"),
        (("log.npz", "--filter", "nothing"), "unknown filter 'nothing'"),
        (("log.npz", "--people", "far.npz", "--shift", "60"), "there is no time at which robot and people are known"),
        (("log.npz", "--dt", "0"), "dt has to be a positive number"),
        (("bad.csv",), "bad.csv: row 3, column q2 holds 'x', which is no number"),
    ],
)
def test_what_cannot_be_read_is_one_line(folder, monkeypatch, capsys, words, message):
    header = ",".join(["time", *(f"q{j}" for j in range(1, 7))])
    (folder / "bad.csv").write_text(f"{header}\n0,0,0,0,0,0,0\n0.1,0,x,0,0,0,0\n")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["jssa-gym", "audit", *words, "--no-figure"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("jssa-gym: ")
    assert message in line


def test_help_says_what_every_option_is_for(capsys):
    assert run("audit", "--help") == 0
    said = capsys.readouterr().out
    for option in (
        *("--people", "--robot", "--filter", "--scene", "--position-error", "--human-speed", "--shift", "--body"),
        *("--dt", "--out", "--figure", "--reaction-time", "--json"),
    ):
        assert option in said
    for command in ("evaluate", "compare"):
        assert run(command, "--help") == 0
        assert "--sensor" in capsys.readouterr().out
