"""Where the tests are, and how other processes import what they share."""

import os
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
DOCS = ROOT / "docs"


def environment(*folders: Path) -> dict[str, str]:
    """For processes that import the modules beside this one, and those of more ``folders``."""
    before = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([*map(str, (TESTS, *folders)), *([before] if before else [])])
    return {**os.environ, "PYTHONPATH": path}
