"""``benchmarks/tables.py``: every table's commands are on its page, and run as they stand there."""

import re
import runpy
import sys
from pathlib import Path

import pytest
from places import DOCS, ROOT

MODULE = runpy.run_path(str(ROOT / "benchmarks" / "tables.py"))
TABLES, BLOCK, BLOCKS, TABLE, RUN = (MODULE[name] for name in ("TABLES", "block", "blocks", "Table", "run"))

NOT_OF_A_TABLE = {
    "cbfpy_filter.py": "a filter, for the leaderboard's own command",
    "digests.py": "compares two versions of the code",
    "mutants.py": "of the tests",
    "robot_files.py": "needs files that are downloaded one by one",
    "ship_policy.py": "puts a policy into the package",
    "tables.py": "lists the others",
}
"""Benchmarks that make no table by a command of a page alone, and why."""

SAYS_NOTHING = {"cbfpy_filter.py", "digests.py", "mutants.py", "ship_policy.py"}
"""Benchmarks that print no figures of the package."""

QUOTED = {("comparison.md", "cbfpy_peer.py"), ("scaling.md", "vector_step.py")}
"""Figures that are from another page's table."""

BENCHMARKS = sorted((ROOT / "benchmarks").glob("*.py"))


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


def scripts(text):
    return set(re.findall(r"python benchmarks/(\w+\.py)", text))


def test_every_benchmark_that_a_page_runs_is_listed_for_it():
    listed = {(table.page, script) for table in TABLES.values() for script in scripts(BLOCK(table))}
    run = {
        (page.name, script) for page in DOCS.glob("*.md") for block in BLOCKS(page.name) for script in scripts(block)
    }
    assert run - listed <= {(page, script) for page, script in run if script in NOT_OF_A_TABLE} | QUOTED
    assert {path.name for path in BENCHMARKS} == {script for _, script in listed} | {*NOT_OF_A_TABLE}
    assert {script for _, script in listed} & {*NOT_OF_A_TABLE} == set()


def test_every_benchmark_says_what_made_its_figures():
    silent = {path.name for path in BENCHMARKS if "made_with()" not in path.read_text(encoding="utf-8")}
    assert silent == SAYS_NOTHING


@pytest.mark.parametrize("page", sorted({table.page for table in TABLES.values()}))
def test_a_page_with_measured_tables_says_what_made_them(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    assert "](benchmarks.md#machine-and-versions)" in text or re.search(r"AMD EPYC.*threads", text)


def test_the_versions_that_are_told_are_those_that_are_installed():
    text = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    pinned = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if "==" in line
    )
    for name in ("numpy", "numba", "mujoco", "scipy", "torch"):
        assert re.search(rf"\b{name} {re.escape(pinned[name].split()[0])}\b", text), name


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
    assert "there is Bench, ControlStep" in capsys.readouterr().err
