"""What the pages name is there: files, modules, functions."""

import importlib
import re
from fnmatch import fnmatch
from functools import reduce
from pathlib import Path

import pytest
from places import DOCS, ROOT

PACKAGE = ROOT / "jssa_gym"
PAGES = [ROOT / "CONTRIBUTING.md", ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
TOP = {path.stem for path in PACKAGE.iterdir() if path.stem[0] != "_"}


def is_there(name: str) -> bool:
    """Whether a dotted name is a module of the package, or something in one."""
    parts = name.removeprefix("jssa_gym").strip(".").split(".")
    for k in range(len(parts), -1, -1):
        path = PACKAGE.joinpath(*parts[:k])
        if path.is_dir() or path.with_suffix(".py").is_file():
            if k == len(parts):
                return True
            module = importlib.import_module(".".join(["jssa_gym", *parts[:k]]))
            return reduce(lambda thing, part: getattr(thing, part, None), parts[k:], module) is not None
    return False


def missing(text: str) -> list[str]:
    """Files and dotted names of the package in code spans that are not there."""
    found = []
    for span in re.findall(r"`([^`\n]+)`", text):
        top = re.split(r"[./]", span)[0]
        if top in TOP | {"jssa_gym", "tests", "benchmarks", "docs", "examples"} and re.fullmatch(r"[\w./]+", span):
            if "/" in span or re.search(r"\.(py|md|json|csv)$", span):
                there = (ROOT / span).exists() or (PACKAGE / span).exists() or span.endswith((".json", ".csv"))
            else:
                there = top not in TOP | {"jssa_gym"} or is_there(span)
            found += [] if there else [span]
    return found


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_files_and_names_are_there(page):
    assert missing(page.read_text(encoding="utf-8")) == []


def contents(page: Path) -> list[str]:
    """Entries of a page's tables of contents, patterns as they are."""
    trees = re.findall(r"^```{toctree}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]


@pytest.mark.parametrize("index", ["index.md", "api/index.md"])
def test_every_page_is_in_a_table_of_contents(index):
    folder = (DOCS / index).parent
    entries = contents(DOCS / index)
    for page in folder.glob("*.md"):
        found = [entry for entry in entries if fnmatch(page.stem, entry)]
        assert len(found) == (page.name != "index.md"), f"{page.name} is in {found}: docs/{index} has to list it once"
    for entry in entries:  # those of pages that are to come have a star
        assert "*" in entry or (folder / f"{entry}.md").is_file(), entry


def test_the_check_sees_what_is_not_there():
    gone = ["jssa_gym/shields/plain.py", "tick/believe.py", "kernels.trust.trust", "safety.certify", "tests/no_such.py"]
    there = ["jssa_gym/tick/admit.py", "tick/admit.py", "kernels.people.judge_people", "kernels.rest", "tests/kernels/"]
    assert missing(" ".join(f"`{name}`" for name in gone + there)) == gone


def test_where_things_go_is_where_they_are():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Where does")[2]
    told = re.findall(r"((?:`\w+`, )*`\w+`) \(`(?:jssa_gym/)?([\w/]+\.py)`\)", text)
    assert len(told) >= 10
    for names, file in told:
        source = (PACKAGE / file).read_text(encoding="utf-8")
        for name in re.findall(r"\w+", names):
            assert re.search(rf"^(class |def )?{name}\b", source, re.MULTILINE), (name, file)
