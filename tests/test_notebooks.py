"""The notebooks run from top to bottom, and are stored without what they say."""

import subprocess
import sys

import pytest
from places import PATIENCE, ROOT, environment

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
SMALL = {"STEPS = 1000": "STEPS = 40", "EPISODES = 20": "EPISODES = 1"}
"""Counts that make minutes, and what they are here."""

RUN = """
import sys
import nbformat
from nbclient import NotebookClient
path, *changes = sys.argv[1:]
book = nbformat.read(path, 4)
for old, new in zip(changes[::2], changes[1::2]):
    for cell in book.cells:
        cell.source = cell.source.replace(old, new)
NotebookClient(book, timeout=None).execute()
outputs = [output for cell in book.cells for output in cell.get("outputs", ())]
print(sum("image/png" in output.get("data", {}) for output in outputs), "pictures")
"""
"""In a process of its own: what Jupyter warns of is not this package's."""


def cells(path):
    return pytest.importorskip("nbformat").read(path, 4).cells


def test_there_are_two():
    assert len(NOTEBOOKS) == 2
    assert all(any(old in cell.source for path in NOTEBOOKS for cell in cells(path)) for old in SMALL)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_nothing_is_stored_but_what_was_written(path):
    for cell in cells(path):
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.long
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path):
    for needed in ("nbclient", "ipykernel", "matplotlib"):
        pytest.importorskip(needed)
    changes = [text for change in SMALL.items() for text in change]
    process = environment() | {"PYTHONPATH": f"{ROOT}:{environment()['PYTHONPATH']}"}
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(path), *changes],
        cwd=tmp_path,
        env=process,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "1 pictures" in done.stdout
