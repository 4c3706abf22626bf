"""What README and docs show runs: every Python block, with small counts; every command, or at least its parser.

Blocks of a page run one after the other, as a reader would paste them. Of the commands those in ``PLAYED`` are run with
one short episode; the others (campaigns, trainings, certificates, benchmarks: minutes to hours) are parsed:
``jssa-gym`` by itself, a script by the options that its source names.
"""

import re
import shlex
import shutil
import sys
import tomllib

import gait
import pytest
import robots_arms
from places import DOCS, ROOT

from jssa_gym.cli import main, parse
from jssa_gym.exceptions import JSSAGymError

PAGES = {page.name: page for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md")))}
"""Changelogs apart, which tell of what was."""
PAGES.pop("changelog.md")

SMALL = {
    "README.md": [("steps=30_000", "steps=100, interval=100, eval_episodes=1")],
    "certificate.md": [("100_000", "2_000")],
    "evaluation.md": [("episodes=100", "episodes=1")],
    "policies.md": [],
    "tutorial.md": [("episodes=20", "episodes=1"), ('"stop", "jssa+stop"', '"jssa+stop"')],
}
"""Counts that make minutes of a page, and what they are here."""

COMPILED = {
    "training_elsewhere.md": "needs ray[rllib] in an environment of its own",
    "controller.md": "needs drives and a controller; examples/own_controller.py is the same loop with pretended ones",
}
"""Pages whose blocks are not run, and why."""

NEEDS = {
    "policies.md": "stable_baselines3",
    "vector.md": "stable_baselines3",
    "training.md": "stable_baselines3",
    "README.md": "stable_baselines3",
}

PLAYED = ("tutorial.md", "evaluation.md", "humans.md")
"""Pages whose commands are run."""


def python_blocks(page):
    return re.findall(r"^```python\n(.*?)^```", PAGES[page].read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


WITH_PYTHON = [page for page in PAGES if python_blocks(page)]


@pytest.fixture
def files_of_the_pages(request, tmp_path, monkeypatch):
    """A folder with what the pages call theirs, to be in."""
    folder = tmp_path
    if request.node.callspec.params["page"] == "robots.md":
        folder = robots_arms.urdf(tmp_path).parent
    else:
        for ending in ("xml", "limits.toml"):
            shutil.copy(ROOT / "jssa_gym" / "robots" / "assets" / f"ur5e.{ending}", folder / f"arm.{ending}")
        motion = gait.walk(frames=420, speed=0.05)
        (folder / "walk.bvh").write_text(gait.bvh_text(*motion, unit=0.0254, up="z"))
    monkeypatch.chdir(folder)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*taken as inches")  # said of every capture whose unit is guessed
@pytest.mark.parametrize("page", WITH_PYTHON)
def test_blocks_run(page, files_of_the_pages):
    blocks = python_blocks(page)
    for old, _ in SMALL.get(page, []):
        assert any(old in block for block in blocks), f"{old} is no longer on {page}"
    if page in NEEDS:
        pytest.importorskip(NEEDS[page])
    namespace = {"__name__": "docs"}
    for number, block in enumerate(blocks):
        for old, new in SMALL.get(page, []):
            block = block.replace(old, new)
        code = compile(block, f"{page}, block {number}", "exec")
        if page not in COMPILED:
            exec(code, namespace)


def test_pages_that_are_not_run_are_there():
    assert set(COMPILED) <= set(WITH_PYTHON)
    assert set(SMALL) <= set(PAGES)


# ---- commands --------------------------------------------------------------------------------------


def indented(text):
    """Code that is indented, and blocks of shell, line by line; variables put in, continued lines joined."""
    fenced = "".join(re.findall(r"^```bash\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE))
    without = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    lines = fenced + "\n".join(line[4:] for line in without.splitlines() if line.startswith("    "))
    known = {}
    for line in lines.replace("\\\n", " ").splitlines():
        if told := re.fullmatch(r'(\w)="(.*)"', line):
            known[told[1]] = told[2]
        for part in re.split(r"&&|\s#\s|\s#$", line)[: None if "&&" in line else 1]:
            command = re.sub(r"\$(\w)\b", lambda match: known[match[1]], part).strip()
            if re.match(r"(\S*/)?(jssa-gym|python3?|pip) ", command):
                yield shlex.split(command)


def mentioned(text):
    """Commands in running text."""
    return [shlex.split(command) for command in re.findall(r"`(jssa-gym [^`\n]+)`", text)]


def commands(page):
    return list(indented(PAGES[page].read_text(encoding="utf-8")))


def script_options(words):
    return {word.partition("=")[0] for word in words if word.startswith("--")}


def complaint(words):
    """Why a command cannot be given; None if it can."""
    program, *rest = words
    program = program.rpartition("/")[2]
    if program == "jssa-gym":
        if rest == ["--version"]:
            return None
        try:
            parse(rest)
        except (SystemExit, JSSAGymError) as error:
            return f"{shlex.join(words)}: {error}"
    elif program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        asked = {name for word in rest for name in re.findall(r"^(?:jssa-gym|\.)\[(.*)\]", word)}
        gone = {name for names in asked for name in names.split(",")} - set(extras)
        return f"extras {gone} are not there" if gone else None
    elif rest[0] == "-c":
        compile(rest[1], "command", "exec")
    elif rest[0] != "-m":
        script = ROOT / rest[0]
        if not script.is_file():
            return f"{rest[0]} is not there"
        source = script.read_text(encoding="utf-8")
        named = {option: option[2:].removeprefix("no-").replace("-", "_") for option in script_options(rest)}
        gone = [
            option for option, name in named.items() if option not in source and not re.search(rf"\b{name}\b", source)
        ]
        return f"{rest[0]} does not know {gone}" if gone else None
    return None


@pytest.mark.sampled(2)
@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
def test_commands_can_be_given(page, capsys):
    assert [said for words in commands(page) if (said := complaint(words))] == []


@pytest.mark.sampled(7)
@pytest.mark.parametrize("page", [page for page in PAGES if mentioned(PAGES[page].read_text(encoding="utf-8"))])
def test_commands_in_the_text_are_there(page, capsys):
    for words in mentioned(PAGES[page].read_text(encoding="utf-8")):
        said = complaint(words)
        assert said is None or complaint([*words, "FILE"]) is None, said


def test_the_check_sees_what_cannot_be_given(capsys):
    for command in (
        "jssa-gym evaluate --tusk reach",
        "jssa-gym evalute",
        "python benchmarks/none.py",
        "python benchmarks/sliding.py --episods 4",
        "pip install -e .[trian]",
    ):
        assert complaint(shlex.split(command)), command
    text = 'x\n\n    # bash\n    F="a b"\n    jssa-gym compare --filters $F \\\n        --out c   # and so on\n'
    assert list(indented(text)) == [["jssa-gym", "compare", "--filters", "a", "b", "--out", "c"]]


@pytest.mark.long
@pytest.mark.parametrize("page", PLAYED)
def test_commands_run(page, files_of_the_pages, monkeypatch, capsys):
    played = 0
    for words in commands(page):
        if words[0] != "jssa-gym":
            continue
        played += 1
        words = shlex.split(re.sub(r"--(episodes|jobs) \d+", r"--\1 1", shlex.join(words)))
        if words[1] in {"evaluate", "compare"}:
            words += ["--seconds", "0.4"]
        if words[1] == "replay":
            words += ["--no-figure", "--no-video"] if "--no-video" not in words else []
        monkeypatch.setattr(sys, "argv", words)
        code = 0
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
        asks_for_changes = words[1:3] == ["recording", "check"]
        assert code == (1 if asks_for_changes else 0), (words, capsys.readouterr().err)
    assert played


def test_the_site_begins_with_the_commands_of_the_readme():
    readme, site = ((PAGES[page]).read_text(encoding="utf-8") for page in ("README.md", "index.md"))
    blocks = [re.findall(r"^```bash\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE) for text in (readme, site)]
    assert blocks[0] == blocks[1]
