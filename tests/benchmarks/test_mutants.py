"""``benchmarks/mutants.py``: every mutant fits the source, and what was not noticed is not called so."""

import runpy
from collections import Counter
from subprocess import CompletedProcess

import pytest
from places import ROOT

pytest.importorskip("resource", reason="processor time cannot be limited here")

MODULE = runpy.run_path(str(ROOT / "benchmarks" / "mutants.py"))
MUTANTS, RUN, KILLED, LINE, SOURCES = (MODULE[name] for name in ("MUTANTS", "run", "killed", "line", "sources"))


def test_every_mutant_replaces_one_place_of_the_source():
    texts = {name: (ROOT / "jssa_gym" / name).read_text(encoding="utf-8") for name in {one.file for one in MUTANTS}}
    assert [one.name for one in MUTANTS if texts[one.file].count(one.old) != 1 or one.old == one.new] == []


def test_every_mutant_has_a_name_of_its_own_and_tests():
    assert [name for name, count in Counter(one.name for one in MUTANTS).items() if count > 1] == []
    assert [one.name for one in MUTANTS if not (ROOT / one.tests[0]).is_file()] == []


def test_a_line_of_a_log_counts_only_for_what_it_is_of(tmp_path):
    """Neither after the source or a test has changed, nor for another substitution of that name."""
    for name in ("jssa_gym", "tests"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "one.py").write_text("one = 1\n")
    log, (one, two, three), before = tmp_path / "log", MUTANTS[:3], SOURCES(tmp_path)
    lines = [LINE("killed", 1.0, one, "", before), LINE("SURVIVED", 1.0, two, "", before)]
    log.write_text("".join(lines) + "killed\t1\t" + three.name + "\t\n")  # the last without what it is of
    assert KILLED(log, MUTANTS, before) == {one.name}
    assert KILLED(log, [one._replace(new="another"), two, three], before) == set()
    assert KILLED(tmp_path / "none", MUTANTS, before) == KILLED(None, MUTANTS, before) == set()
    for name in ("jssa_gym", "tests"):
        (tmp_path / name / "one.py").write_text("one = 2\n")
        assert KILLED(log, MUTANTS, SOURCES(tmp_path)) == set()
        (tmp_path / name / "one.py").write_text("one = 1\n")
        assert KILLED(log, MUTANTS, SOURCES(tmp_path)) == {one.name}


@pytest.mark.parametrize(
    ("code", "told"), [(0, "passed"), (1, "failed"), (5, "error 5"), (-9, "error -9, as if out of memory")]
)
def test_tests_that_were_killed_noticed_nothing(monkeypatch, tmp_path, code, told):
    done = CompletedProcess([], code, "FAILED tests/one.py::two - assert\n" if code == 1 else "", "")
    monkeypatch.setattr(RUN.__globals__["subprocess"], "run", lambda *_, **__: done)
    assert RUN(("tests/one.py", "two"), tmp_path) == (told, "tests/one.py::two" if code == 1 else "")


@pytest.mark.long
def test_tests_that_go_on_for_ever_are_ended_as_such(monkeypatch, tmp_path):
    (tmp_path / "test_endless.py").write_text("def test_endless():\n    while True:\n        pass\n")
    monkeypatch.setitem(RUN.__globals__, "LONGEST", 1)
    assert RUN(("test_endless.py", "endless"), tmp_path) == ("failed", "took too long")


def test_a_substitution_that_does_not_fit_is_told(tmp_path):
    one = MUTANTS[0]
    path = tmp_path / "jssa_gym" / one.file
    path.parent.mkdir(parents=True)
    path.write_text(2 * one.old)
    assert MODULE["judge"](one, tmp_path) == ("DOES NOT FIT", f"2 places in {one.file}")
    assert path.read_text() == 2 * one.old
