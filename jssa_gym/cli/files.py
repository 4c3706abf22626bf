"""Results on disk: complete, or not there."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jssa_gym.exceptions import ParameterError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_json(path: Path, data: Any) -> None:
    """Write JSON into a temporary file beside ``path`` and rename it."""
    unfinished = path.with_suffix(path.suffix + ".part")
    unfinished.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n")
    unfinished.replace(path)


def write_figure(path: Path, figure: "Figure") -> None:
    """Write a picture into a temporary file beside ``path`` and rename it."""
    unfinished = path.with_suffix(f".part{path.suffix}")
    figure.savefig(unfinished, dpi=110)
    unfinished.replace(path)


def writable_folder(path: Path) -> None:
    """Make a folder for results, if there is none.

    Raises:
        ParameterError: Nothing can be written there.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"cannot write to {path}: {error.strerror}") from error
    if not os.access(path, os.W_OK):
        raise ParameterError(f"cannot write to {path}: it is read-only")
