"""Small figures as SVG text, for pages that load nothing."""

import html
from collections.abc import Sequence

import numpy as np

from jssa_gym.text import printable
from jssa_gym.types import Array

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7f7f7f", "#000000")
"""Okabe and Ito's palette, told apart by colour-blind people."""

_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 14.0, 14.0, 44.0


def escape(text: str) -> str:
    """A text for HTML and SVG, in which all is seen."""
    return html.escape(printable(text))


def colour(k: int) -> str:
    """Of the k-th thing."""
    return COLOURS[k % len(COLOURS)]


def dashes(k: int) -> str:
    """Of the k-th thing's line: where colours repeat, lines differ."""
    return ("", "6 3", "2 3", "8 3 2 3")[(k // len(COLOURS)) % 4]


def marker(k: int, x: float, y: float, title: str = "") -> str:
    """Of the k-th thing's points: where colours repeat, shapes differ; at ``x``, ``y`` [pixels]."""
    corners = (
        (),
        ((-4.5, -4.5), (4.5, -4.5), (4.5, 4.5), (-4.5, 4.5)),
        ((0.0, -6.5), (6.0, 4.5), (-6.0, 4.5)),
        ((0.0, -6.5), (6.5, 0.0), (0.0, 6.5), (-6.5, 0.0)),
    )[(k // len(COLOURS)) % 4]
    shape = f'circle cx="{x:.1f}" cy="{y:.1f}" r="5"'
    if corners:
        shape = f'polygon points="{" ".join(f"{x + a:.1f},{y + b:.1f}" for a, b in corners)}"'
    told = f"<title>{escape(title)}</title>" if title else ""
    return f'<{shape} fill="{colour(k)}" stroke="#fff">{told}</{shape.split()[0]}>'


def ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Round numbers from low to high."""
    step = (high - low) / about
    power = 10.0 ** np.floor(np.log10(step))
    size = next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step) * power
    first = np.ceil(low / size - 1e-9)
    return [float((first + k) * size) for k in range(int(np.floor(high / size + 1e-9) - first) + 1)]


class Panel:
    """One pair of axes.

    Args:
        x, y: Lower and upper end of either axis; an empty range is widened.
        x_label, y_label: What is drawn.
        names: Instead of numbers along y: one a row, 0 at the top.
        width, height: Of the figure [pixels].
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        *,
        names: Sequence[str] = (),
        width: float = 460.0,
        height: float = 300.0,
    ) -> None:
        self.width, self.height = width, height
        self._left = 12.0 + 7.0 * max((len(name) for name in names), default=0) if names else _LEFT
        self._x, self._y = _range(x), _range(y)
        self._parts: list[str] = []
        bottom, right = height - _BOTTOM, width - _RIGHT
        for value in ticks(*self._x):
            at = self._across(value)
            self._parts.append(f'<line class="grid" x1="{at:.1f}" x2="{at:.1f}" y1="{_TOP}" y2="{bottom}"/>')
            self._text(at, bottom + 15.0, f"{value:g}", "middle")
        rows = [(float(k), name) for k, name in enumerate(names)] or [
            (value, f"{value:g}") for value in ticks(*self._y)
        ]
        for value, text in rows:
            at = self._up(value)
            self._parts.append(f'<line class="grid" x1="{self._left}" x2="{right}" y1="{at:.1f}" y2="{at:.1f}"/>')
            self._text(self._left - 6.0, at + 4.0, text, "end")
        self._text((self._left + right) / 2.0, height - 8.0, x_label, "middle")
        if y_label:
            middle = (_TOP + bottom) / 2.0
            self._parts.append(
                f'<text class="label" text-anchor="middle" transform="translate(13 {middle:.1f}) rotate(-90)">'
                f"{escape(y_label)}</text>"
            )

    def _across(self, value: float) -> float:
        low, high = self._x
        return self._left + (value - low) / (high - low) * (self.width - self._left - _RIGHT)

    def _up(self, value: float) -> float:
        low, high = self._y
        return self.height - _BOTTOM - (value - low) / (high - low) * (self.height - _TOP - _BOTTOM)

    def _text(self, x: float, y: float, text: str, anchor: str) -> None:
        self._parts.append(f'<text class="label" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>')

    def _points(self, x: Array, y: Array) -> str:
        return " ".join(f"{self._across(a):.1f},{self._up(b):.1f}" for a, b in zip(x, y, strict=True))

    def curve(self, x: Array, y: Array, k: int, title: str) -> None:
        """A line through points (n,)."""
        self._parts.append(
            f'<polyline points="{self._points(x, y)}" fill="none" stroke="{colour(k)}" stroke-width="2" '
            f'stroke-dasharray="{dashes(k)}"><title>{escape(title)}</title></polyline>'
        )

    def band(self, x: Array, low: Array, high: Array, k: int) -> None:
        """What lies between two lines, shaded."""
        points = self._points(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))
        self._parts.append(f'<polygon points="{points}" fill="{colour(k)}" fill-opacity="0.14"/>')

    def cross(self, x: tuple[float, float, float], y: tuple[float, float, float], k: int, title: str) -> None:
        """A point with its intervals: value, low, high in both directions."""
        (a, left, right), (b, low, high) = x, y
        line = f'stroke="{colour(k)}" stroke-width="1.5"'
        for x1, x2, y1, y2 in ((left, right, b, b), (a, a, low, high)):
            self._parts.append(
                f'<line x1="{self._across(x1):.1f}" x2="{self._across(x2):.1f}" y1="{self._up(y1):.1f}" '
                f'y2="{self._up(y2):.1f}" {line}/>'
            )
        self._parts.append(marker(k, self._across(a), self._up(b), title))

    def box(self, row: int, quantiles: Sequence[float], k: int, title: str) -> None:
        """Least, lower quartile, median, upper quartile and largest of something, along x."""
        least, lower, median, upper, most = (self._across(value) for value in quantiles)
        y, line = self._up(float(row)), f'stroke="{colour(k)}" stroke-width="1.5"'
        self._parts.append(f'<g><title>{escape(title)}</title><line x1="{least:.1f}" x2="{most:.1f}" y1="{y:.1f}" ')
        self._parts.append(f'y2="{y:.1f}" {line}/><rect x="{lower:.1f}" y="{y - 6.0:.1f}" height="12" ')
        self._parts.append(f'width="{max(upper - lower, 0.5):.1f}" fill="{colour(k)}" fill-opacity="0.3" {line}/>')
        self._parts.append(
            f'<line x1="{median:.1f}" x2="{median:.1f}" y1="{y - 6.0:.1f}" y2="{y + 6.0:.1f}" '
            f'stroke="{colour(k)}" stroke-width="3"/></g>'
        )

    def __str__(self) -> str:
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" '
            f'width="{self.width:g}" role="img">{"".join(self._parts)}</svg>'
        )


def _range(ends: tuple[float, float]) -> tuple[float, float]:
    """The ends, which may fall, apart from each other."""
    low, high = ends
    return (low, high) if abs(high - low) > 1e-9 * max(abs(low), abs(high), 1e-9) else (low - 0.5, low + 0.5)
