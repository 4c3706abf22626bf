"""Results on disk: complete, or not there."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym import plots
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import whole_file, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_json(path: Path, data: Any) -> None:
    """Write JSON into a file that is complete or not there."""
    write_whole(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_figure(path: Path, figure: "Figure") -> None:
    """Write a picture, of the kind that its ending says, into a file that is complete or not there."""
    with whole_file(path) as file:
        figure.savefig(file, dpi=110, format=path.suffix[1:])


def write_picture(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write pixels (height, width, 3) as PNG into a file that is complete or not there.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with whole_file(path) as file:
        plots.write_png(file, pixels)


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
