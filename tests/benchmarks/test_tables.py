"""``benchmarks/tables.py``: every table's commands are on its page, and run as they stand there."""

import runpy
import sys
from pathlib import Path

import pytest
from places import ROOT

MODULE = runpy.run_path(str(ROOT / "benchmarks" / "tables.py"))
TABLES, BLOCK, TABLE, RUN = (MODULE[name] for name in ("TABLES", "block", "Table", "run"))


def told(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["tables.py", *map(str, words)])
    runpy.run_path(str(ROOT / "benchmarks" / "tables.py"), run_name="__main__")
    return capsys.readouterr().out


@pytest.mark.parametrize("name", TABLES)
def test_the_commands_are_on_the_page(name):
    assert TABLES[name].sign in BLOCK(TABLES[name])


def test_what_is_not_on_the_page_is_missed():
    with pytest.raises(SystemExit, match="0 blocks"):
        BLOCK(TABLE("reproducing.md", "jssa-gym reproduce nothing", 1))


def test_without_run_it_says_them_and_which_machine(monkeypatch, capsys):
    out = told(monkeypatch, capsys, "Leaderboard", "Paper")
    assert "jssa-gym reproduce all" in out
    assert "--out handover" in out
    first = out.splitlines()[0]
    assert f"Python {sys.version_info.major}.{sys.version_info.minor}" in first
    assert all(word in first for word in ("jssa_gym ", "numpy ", "numba ", "mujoco ", " threads"))


def test_long_ones_are_said(monkeypatch, capsys, tmp_path):
    out = told(monkeypatch, capsys, "Leaderboard", "--run", "--out", tmp_path)
    assert "too long for now: --run Leaderboard --minutes" in out
    assert list(tmp_path.iterdir()) == []


def test_a_block_runs_where_its_scripts_are_found(tmp_path):
    script = 'X="benchmarks"\ntest -f $X/tables.py && which python > where.txt\n'
    assert RUN(script, tmp_path / "out") == 0
    assert Path((tmp_path / "out" / "where.txt").read_text().strip()).parent == Path(sys.executable).parent
    assert RUN("false\ntrue\n", tmp_path / "out") != 0


def test_unknown_names_are_refused(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        told(monkeypatch, capsys, "Nothing")
    assert "there is Paper, TurningPerson" in capsys.readouterr().err
