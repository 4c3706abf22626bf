"""Where the tests are, and what those of other processes share."""

import os
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
DOCS = ROOT / "docs"

PATIENCE = 1500.0
"""For another process to do what it shall [s]: longer than any machine takes, less than pytest waits for the test."""
LASTING = 7200.0
"""What a process does all this time is not over before somebody has lost their patience [s]."""


def environment(*folders: Path) -> dict[str, str]:
    """For processes that import the modules beside this one, and those of more ``folders``."""
    before = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([*map(str, (TESTS, *folders)), *([before] if before else [])])
    return {**os.environ, "PYTHONPATH": path}
