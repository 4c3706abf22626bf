"""Strips above and below the pictures of a film: what is said, in the letters that matplotlib comes with; how far
people are, and the jerks so far. Drawn fast.
"""

import functools
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import MissingExtraError, how_to_install
from jssa_gym.palette import BLACK, COLOURS, Rgb, rgb
from jssa_gym.text import printable
from jssa_gym.types import Array

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

GROUND: Rgb = (34, 38, 43)
"""Colour behind text."""

_TEXT: Rgb = (238, 240, 242)
_QUIET: Rgb = (166, 174, 182)

_RGB = [rgb(colour) for colour in COLOURS if colour != BLACK]
"""Colours to be seen on dark ground."""


class Caption(NamedTuple):
    """What is said below a picture, and beside its name."""

    name: str
    """Name of the run."""
    status: str
    """What happens, in a word or two."""
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
            raise MissingExtraError(f"figures need the extra 'plots': {how_to_install('plots')}") from error
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


def gauge(
    distance: float, d_min: float, active: bool, touching: bool, width: int, height: int = 14
) -> NDArray[np.uint8]:
    """A bar as long as the distance, up to 1 m: grey, orange while the shield acts, red in contact."""
    strip = np.full((height, width, 3), 34, np.uint8)
    colour = (200, 40, 40) if touching else (230, 159, 0) if active else (150, 160, 170)
    length = width if touching else int(np.clip(distance, 0.0, 1.0) * width)
    strip[3:-3, :length] = colour
    mark = int(d_min * width)
    strip[:, mark : mark + 2] = (255, 255, 255)
    return strip


def ribbon(share: Array, width: int, height: int = 46, steps: int = 250) -> NDArray[np.uint8]:
    """The last ``steps`` control steps of every joint's jerk, newest at the right, shape (height, width, 3).

    A shield that flips a jerk between its bounds fills it from top to bottom, one that gives way leaves a line.

    Args:
        share: Jerks so far over their bounds, shape (t, n).
        width, height: Of the picture.
        steps: How many are shown.
    """
    strip = np.full((height, width, 3), 34, np.uint8)
    strip[height // 2] = (90, 96, 104)
    shown = share[-steps - 1 :]
    rows = np.clip(np.rint((1.0 - shown) / 2.0 * (height - 7) + 3), 0, height - 1).astype(int)
    right = width - np.arange(len(shown) - 1, -1, -1) * width / steps
    for k in range(1, len(shown)):
        left, end = int(max(right[k - 1], 0.0)), int(right[k])
        for j in range(rows.shape[1]):
            top, bottom = sorted((rows[k - 1, j], rows[k, j]))
            if shown[k - 1, j] or shown[k, j]:
                strip[top : bottom + 1, left : max(end, left + 1)] = _RGB[j % len(_RGB)]
    return strip
