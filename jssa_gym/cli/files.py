"""Results on disk: complete, or not there."""

import json
from pathlib import Path
from typing import Any


def write_json(path: Path, data: Any) -> None:
    """Write JSON into a temporary file beside ``path`` and rename it."""
    unfinished = path.with_suffix(path.suffix + ".part")
    unfinished.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n")
    unfinished.replace(path)
