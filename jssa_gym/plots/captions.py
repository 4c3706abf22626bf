"""Strips of text for films: drawn fast, in the letters that matplotlib comes with."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import MissingExtraError
from jssa_gym.palette import Rgb, rgb
from jssa_gym.plots.style import INSTALL
from jssa_gym.text import printable

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

GROUND: Rgb = (34, 38, 43)
"""Behind text."""

_TEXT: Rgb = (238, 240, 242)
_QUIET: Rgb = (166, 174, 182)


class Caption(NamedTuple):
    """What is said below a picture, and beside its name."""

    name: str
    """Name of the run."""
    status: str
    """In a word or two."""
    colour: str
    """Colour of the status, as ``#rrggbb``."""
    numbers: str
    """Clock and distance."""
    reason: str
    """Why the jerk is not the policy's; may be empty."""


def heading(caption: Caption, width: int, height: int = 34) -> NDArray[np.uint8]:
    """A run's name and, to the right, its status; shape (height, width, 3)."""
    strip = _Strip(width, height)
    size = round(0.47 * height)
    room = strip.badge(caption.status, caption.colour, 0.8 * size) if caption.status else width
    strip.text(caption.name, 12, height / 2.0, size, bold=True, room=room - 20)
    return strip.pixels()


def footer(caption: Caption, width: int, height: int = 46) -> NDArray[np.uint8]:
    """Clock and distance, below them the reason, cut where there is no more room; shape (height, width, 3)."""
    strip = _Strip(width, height)
    strip.text(caption.numbers, 12, 0.29 * height, 0.33 * height, room=width - 24)
    strip.text(caption.reason, 12, 0.75 * height, 0.26 * height, colour=_QUIET, room=width - 24)
    return strip.pixels()


def label(text: str, width: int, height: int = 30) -> NDArray[np.uint8]:
    """A dark strip with a line of text, shape (height, width, 3)."""
    strip = _Strip(width, height)
    strip.text(text, 12, height / 2.0, 0.5 * height, room=width - 24)
    return strip.pixels()


class _Strip:
    """A dark strip that is written on.

    Raises:
        MissingExtraError: matplotlib or Pillow is not installed.
    """

    def __init__(self, width: int, height: int) -> None:
        try:
            import matplotlib  # noqa: F401  # whose letters these are
            from PIL import Image, ImageDraw
        except ImportError as error:
            raise MissingExtraError(f"figures need the extra 'plots': {INSTALL}") from error
        self._width, self._height = width, height
        self._image = Image.new("RGB", (width, height), GROUND)
        self._draw = ImageDraw.Draw(self._image)

    def text(
        self, text: str, x: float, y: float, size: float, *, room: float, bold: bool = False, colour: Rgb = _TEXT
    ) -> None:
        """A line of text from x on, its middle at y, no longer than ``room`` [pixels]."""
        font = _font(round(size), bold)
        shown = _cut(printable(text), font, room)
        self._draw.text((x, y), shown, fill=colour, font=font, anchor="lm")

    def badge(self, text: str, colour: str, size: float) -> int:
        """A coloured field at the right with a text; where it begins [pixels]."""
        font = _font(round(size), bold=True)
        left = self._width - 26 - round(font.getlength(printable(text)))
        box = (left, 0.17 * self._height, self._width - 8, 0.83 * self._height)
        self._draw.rounded_rectangle(box, radius=5, fill=colour)
        ink = GROUND if sum(rgb(colour)) > 330 else _TEXT
        self._draw.text(((left + self._width - 8) / 2.0, self._height / 2.0), printable(text), ink, font, anchor="mm")
        return left

    def pixels(self) -> NDArray[np.uint8]:
        """The strip, shape (height, width, 3)."""
        return np.asarray(self._image).copy()


@functools.cache
def _font(size: int, bold: bool = False) -> "FreeTypeFont":
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path(), "fonts", "ttf", name)), size)


def _cut(text: str, font: "FreeTypeFont", room: float) -> str:
    """A text, or as much of its beginning as there is room for, and an ellipsis."""
    if font.getlength(text) <= room:
        return text
    while text and font.getlength(f"{text}…") > room:
        text = text[:-1]
    return f"{text.rstrip()}…"
