"""matplotlib and PyAV, which come with the extra ``plots``; colours for all figures."""

import importlib.util
from typing import IO, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import MissingExtraError

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#999999", "#000000")
"""Okabe and Ito's palette, told apart by colour-blind people."""

INSTALL = "pip install 'jssa-gym[plots]', or pip install -e '.[plots]' in a clone"


def require(film: bool = False) -> None:
    """Find out before long work whether figures, and films, can be made.

    Raises:
        MissingExtraError: matplotlib or PyAV is not installed.
    """
    for module, what in (("matplotlib", "figures"), ("av", "films"))[: 2 if film else 1]:
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(f"{what} need the extra 'plots': {INSTALL}")


def draw_without_display() -> None:
    """Choose matplotlib's backend that needs no display, unless the user has chosen one.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(f"figures need the extra 'plots': {INSTALL}") from error
    matplotlib.use("agg", force=False)


def write_png(file: IO[bytes], pixels: NDArray[np.uint8]) -> None:
    """Write a picture of shape (height, width, 3).

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    draw_without_display()
    from matplotlib.image import imsave

    imsave(cast(BinaryIO, file), pixels, format="png")
