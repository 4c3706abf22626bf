"""Which code this is: what was begun by one is not continued by another."""

import hashlib
import importlib.metadata
from pathlib import Path

_TELLING = (
    "board",
    "cli",
    "datasets",
    "paper",
    "plots",
    "rates.py",
    "viewer",
    "train",
    "evaluation/comparison_page.py",
    "evaluation/standings.py",
    "evaluation/report.py",
    "evaluation/statistics.py",
    "evaluation/svg.py",
)
"""Parts of the package that only tell of episodes; all others decide how one goes or how it is judged."""


def source_hash() -> str:
    """Hash of all files that decide how an episode goes and how it is judged, models included."""
    package, text = Path(__file__).parents[1], hashlib.sha256()
    for file in sorted(package.rglob("*")):
        name = file.relative_to(package).as_posix()
        if file.suffix in (".py", ".xml", ".toml", ".npz") and not name.startswith(_TELLING):
            text.update(name.encode())
            text.update(file.read_bytes())
    return text.hexdigest()[:16]


def package_version() -> str:
    """Version of the installed package."""
    try:
        return importlib.metadata.version("jssa-gym")
    except importlib.metadata.PackageNotFoundError:  # run from a clone that is not installed
        return "unknown"
