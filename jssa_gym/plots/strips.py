"""Strips below the pictures of a film: how far people are, and the jerks so far."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.palette import BLACK, COLOURS, rgb
from jssa_gym.types import Array

_RGB = [rgb(colour) for colour in COLOURS if colour != BLACK]
"""Colours to be seen on dark ground."""


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
