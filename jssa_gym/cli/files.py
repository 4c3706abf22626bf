"""Results on disk: complete, or not there."""

import os
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jssa_gym import plots
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


def own_folder(path: Path, *kept: str) -> None:
    """Whether results may go into a folder: one that is not there, that is empty, or that has such results already.

    Args:
        path: The folder.
        kept: Files that tell such results, as patterns: there is one of them as soon as there is anything.

    Raises:
        ParameterError: There is something else in it.
    """
    try:
        found = [name for name in sorted(entry.name for entry in path.iterdir()) if not name.startswith(".")]
    except OSError:  # whoever writes there will say why that cannot be
        return
    if found and not any(fnmatch(name, pattern) for name in found for pattern in kept):
        what = f"{found[0]} and more" if len(found) > 1 else found[0]
        raise ParameterError(f"{path} has {what} in it, and none of this command's results; give another --out")


def writable_folder(path: Path, *kept: str) -> None:
    """Make a folder for results, if there is none.

    Args:
        path: The folder.
        kept: Files that tell results of the same command, as :func:`own_folder` takes them; without any, whatever is in
            the folder stays.

    Raises:
        ParameterError: Nothing can be written there, or the folder is somebody else's.
    """
    if kept:
        own_folder(path, *kept)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"cannot write to {path}: {error.strerror}") from error
    if not os.access(path, os.W_OK):
        raise ParameterError(f"cannot write to {path}: it is read-only")
