"""Pages that load nothing: tags in which all text is escaped, and small figures of them."""

import html
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from jssa_gym.palette import COLOURS
from jssa_gym.text import printable
from jssa_gym.types import Array

_Ends = Sequence[float] | Array

_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 14.0, 14.0, 44.0


STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, sans-serif; color: #1d2125; background: #fff; margin: 2rem auto; max-width: 1260px;
  padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
p.note { color: #4a5157; max-width: 75ch; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .88rem; }
th, td { padding: .3rem .55rem; text-align: right; border-bottom: 1px solid #e3e6e8; vertical-align: top; }
td.text { white-space: nowrap; } tbody tr:nth-child(even) { background: #f8f9fa; }
th { font-weight: 600; vertical-align: bottom; } th:first-child, td:first-child, td.text, th.text { text-align: left; }
td.text.long { white-space: normal; }
h3 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
figure { display: inline-block; margin: .5rem 1rem .5rem 0; vertical-align: top; } figcaption { max-width: 460px;
  color: #4a5157; font-size: .88rem; }
svg .grid { stroke: #e3e6e8; } svg .label { font: 11px system-ui, sans-serif; fill: #4a5157; }
.key { display: inline-block; margin-right: 1.2rem; white-space: nowrap; }
code { background: #f3f5f6; padding: .1rem .3rem; border-radius: 3px; font-size: .85rem; }
details { margin: .4rem 0; } summary { cursor: pointer; }
"""
"""Style of all pages."""


class Markup(str):
    """What is a part of a page as it is; all other text is escaped where it becomes one."""


def tag(name: str, *parts: Any, **attributes: Any) -> Markup:
    """An element of HTML or SVG.

    Args:
        name: Of the element.
        parts: What it holds, other elements or text.
        attributes: With ``_`` for ``-``, and ``class_``; floats get four digits.
    """
    shown = {key: f"{value:.4g}" if isinstance(value, float) else value for key, value in attributes.items()}
    given = "".join(f' {key.rstrip("_").replace("_", "-")}="{_escaped(value)}"' for key, value in shown.items())
    return Markup(f"<{name}{given}>{''.join(_escaped(part) for part in parts)}</{name}>")


def _escaped(part: Any) -> str:
    return part if isinstance(part, Markup) else html.escape(printable(str(part)))


def colour(k: int) -> str:
    """The colour of the k-th thing."""
    return COLOURS[k % len(COLOURS)]


def dashes(k: int) -> str:
    """The dashes of the k-th thing's line: where colours repeat, lines differ."""
    return ("", "6 3", "2 3", "8 3 2 3")[(k // len(COLOURS)) % 4]


def marker(k: int, x: float, y: float, title: str = "") -> Markup:
    """A point of the k-th thing, at ``x``, ``y`` [pixels]: where colours repeat, shapes differ."""
    corners = (
        (),
        ((-4.5, -4.5), (4.5, -4.5), (4.5, 4.5), (-4.5, 4.5)),
        ((0.0, -6.5), (6.0, 4.5), (-6.0, 4.5)),
        ((0.0, -6.5), (6.5, 0.0), (0.0, 6.5), (-6.5, 0.0)),
    )[(k // len(COLOURS)) % 4]
    told = title and tag("title", title)
    if not corners:
        return tag("circle", told, cx=x, cy=y, r=5, fill=colour(k), stroke="#fff")
    points = " ".join(f"{x + a:.1f},{y + b:.1f}" for a, b in corners)
    return tag("polygon", told, points=points, fill=colour(k), stroke="#fff")


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
        self._parts: list[Markup] = []
        for value in ticks(*self._x):
            self._line([value] * 2, self._y, class_="grid")
            self._text(f"{value:g}", self._across(value), height - _BOTTOM + 15.0, "middle")
        for value, text in list(enumerate(names)) or [(value, f"{value:g}") for value in ticks(*self._y)]:
            self._line(self._x, [value] * 2, class_="grid")
            self._text(text, self._left - 6.0, self._up(value) + 4.0, "end")
        self._text(x_label, (self._left + width - _RIGHT) / 2.0, height - 8.0, "middle")
        turned = f"rotate(-90 13 {(_TOP + height - _BOTTOM) / 2.0:.4g})"
        self._text(y_label, 13.0, (_TOP + height - _BOTTOM) / 2.0, "middle", transform=turned)

    def _across(self, value: float) -> float:
        low, high = self._x
        return self._left + (value - low) / (high - low) * (self.width - self._left - _RIGHT)

    def _up(self, value: float) -> float:
        low, high = self._y
        return self.height - _BOTTOM - (value - low) / (high - low) * (self.height - _TOP - _BOTTOM)

    def _text(self, text: str, x: float, y: float, anchor: str, **style: Any) -> None:
        self._parts.append(tag("text", text, class_="label", x=x, y=y, text_anchor=anchor, **style))

    def _line(self, x: _Ends, y: _Ends, title: str = "", *, shape: str = "polyline", **style: Any) -> None:
        """Through points of the axes, (n,) each."""
        points = " ".join(f"{self._across(a):.1f},{self._up(b):.1f}" for a, b in zip(x, y, strict=True))
        told = title and tag("title", title)
        self._parts.append(tag(shape, told, points=points, **style))

    def curve(self, x: Array, y: Array, k: int, title: str) -> None:
        """A line through points (n,)."""
        self._line(x, y, title, fill="none", stroke=colour(k), stroke_width=2, stroke_dasharray=dashes(k))

    def band(self, x: Array, low: Array, high: Array, k: int) -> None:
        """What lies between two lines, shaded."""
        around = np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]])
        self._line(*around, shape="polygon", fill=colour(k), fill_opacity=0.14)

    def cross(self, x: tuple[float, float, float], y: tuple[float, float, float], k: int, title: str) -> None:
        """A point with its intervals: value, low, high in both directions."""
        for ends in ((x[1:], [y[0]] * 2), ([x[0]] * 2, y[1:])):
            self._line(*ends, stroke=colour(k), stroke_width=1.5)
        self._parts.append(marker(k, self._across(x[0]), self._up(y[0]), title))

    def box(self, row: int, quantiles: Sequence[float], k: int, title: str) -> None:
        """Least, lower quartile, median, upper quartile and largest of something, along x."""
        least, lower, median, upper, most = quantiles
        low, high, line = row + 0.25, row - 0.25, colour(k)
        around = [lower, upper, upper, lower], [low, low, high, high]
        self._line([least, most], [row] * 2, title, stroke=line, stroke_width=1.5)
        self._line(*around, title, shape="polygon", stroke=line, stroke_width=1.5, fill=line, fill_opacity=0.3)
        self._line([median] * 2, [low, high], title, stroke=line, stroke_width=3)

    def drawn(self) -> Markup:
        """The figure."""
        size = {"viewBox": f"0 0 {self.width:g} {self.height:g}", "width": f"{self.width:g}"}
        return tag("svg", *self._parts, xmlns="http://www.w3.org/2000/svg", **size, role="img")


def _range(ends: tuple[float, float]) -> tuple[float, float]:
    """The ends, which may fall, apart from each other."""
    low, high = ends
    return (low, high) if abs(high - low) > 1e-9 * max(abs(low), abs(high), 1e-9) else (low - 0.5, low + 0.5)


def document(title: str, parts: Iterable[Any]) -> str:
    """A page of its own.

    Args:
        title: Of the page.
        parts: Of its body.
    """
    head = tag("head", Markup('<meta charset="utf-8">'), tag("title", title), tag("style", Markup(STYLE)))
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', *parts), lang='en')}\n"


def note(text: str) -> Markup:
    """A paragraph that explains."""
    return tag("p", text, class_="note")


def rows_of(titles: Sequence[str], rows: Iterable[Sequence[Any]], text: int = 1, kind: str = "text") -> Markup:
    """A table of rows; the first columns are text."""
    classes = [{"class_": kind} if k < text else {} for k in range(len(titles))]
    head = (tag("th", title, **of) for title, of in zip(titles, classes, strict=True))
    body = (tag("tr", *(tag("td", cell, **of) for cell, of in zip(row, classes, strict=True))) for row in rows)
    return tag("div", tag("table", tag("thead", tag("tr", *head)), tag("tbody", *body)), class_="wide")


def figure(panel: Panel, *caption: str) -> Markup:
    """A drawing with what it says."""
    return tag("figure", panel.drawn(), *(tag("figcaption", text) for text in caption))
