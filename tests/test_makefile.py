"""The commands that contributors are told exist, and what those name does."""

import re
import shlex
import tomllib

import pytest
from places import ROOT
from sampled import leave_cases_out

MAKEFILE = (ROOT / "Makefile").read_text()
PYTEST = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
COMMANDS = dict(re.findall(r"^(\w+):.*\n((?:\t.*\n)+)", MAKEFILE, flags=re.MULTILINE))


def constraint(name):
    (version,) = re.findall(rf"^{name}==(.*)$", (ROOT / "constraints.txt").read_text(), flags=re.MULTILINE)
    return version


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_names_what_there_is(name):
    for line in COMMANDS[name].splitlines():
        python, first, *words = shlex.split(line)
        assert python == "$(PYTHON)"
        if first != "-m":
            assert (ROOT / first).is_file()
            continue
        tool, *options = words
        assert constraint(tool)
        if "-m" in options:
            asked = set(re.findall(r"\w+", options[options.index("-m") + 1])) - {"not", "and", "or"}
            assert asked <= {marker.partition(":")[0] for marker in PYTEST["markers"]}


def test_contributors_are_told_of_every_command_and_of_no_other():
    assert set(re.findall(r"`make (\w+)`", (ROOT / "CONTRIBUTING.md").read_text())) == set(COMMANDS)
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, flags=re.MULTILINE)
    assert phony.split() == list(COMMANDS)


def test_whole_tests_are_those_of_the_readme():
    command = COMMANDS["test"].strip().removeprefix("$(PYTHON) ")
    assert f".venv/bin/python {command}\n" in (ROOT / "README.md").read_text()


def test_a_commit_is_formatted_by_the_version_that_is_installed():
    assert f"rev: v{constraint('ruff')}\n" in (ROOT / ".pre-commit-config.yaml").read_text()


class Case:
    """A case as pytest has collected it."""

    def __init__(self, nodeid, *marks):
        self.nodeid, self.marks = nodeid, list(marks)

    def get_closest_marker(self, name):
        return next((mark.mark for mark in self.marks if mark.name == name), None)

    def add_marker(self, mark):
        self.marks.append(mark)


@pytest.mark.parametrize("count", [1, 2, 5, 12, 40])
def test_of_a_sampled_test_so_many_cases_stay_and_of_others_all(count):
    sampled, slow = pytest.mark.sampled(count), pytest.mark.slow
    product = [Case(f"a.py::f[{one}-{other}]", sampled) for one in range(4) for other in range(6)]
    others = [Case("a.py::f[large]", sampled, slow), Case("a.py::g[0-0]"), Case("b.py::f[0-0]", sampled)]
    leave_cases_out(product + others)
    kept = [case for case in product if not case.get_closest_marker("long")]
    assert len(kept) == min(count, 24)
    assert not any(case.get_closest_marker("long") for case in others)
    if count >= 5:
        ones, others = zip(*(re.findall(r"\d+", case.nodeid) for case in kept), strict=True)
        assert len(set(ones)) >= 3
        assert len(set(others)) >= 3
