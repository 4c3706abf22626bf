"""The live curves of the page."""

from typing import Any, NamedTuple

import numpy as np
import viser
import viser.uplot as uplot

from jssa_gym.palette import BLUE, RED
from jssa_gym.types import Array, Status
from jssa_gym.viewer.side import PLOTTED
from jssa_gym.viewer.snapshot import SERIES, Snapshot

COLOURS = (BLUE, RED)
"""Colours of the first and the second arm."""

_BOUND = "#999999"


class _Curve(NamedTuple):
    title: str
    low: float
    high: float
    bound: float | None
    """Drawn as a line."""


_CURVES: dict[str, _Curve] = {
    "distance": _Curve("distance [m]", -0.1, 1.5, 0.0),
    "phi": _Curve("index φ [m²]", -3.0, 1.0, 0.0),
    "margin": _Curve("room behind the nominal [m]", -0.2, 1.0, 0.0),
    "override": _Curve("pace along the path", 0.0, 1.1, 1.0),
    "speed": _Curve("largest joint speed / limit", 0.0, 1.1, 1.0),
    "jerk": _Curve("largest joint jerk / bound", 0.0, 1.1, 1.0),
    "status": _Curve("status: 0 nominal ... 4 fault", -0.2, 4.2, None),
}
assert tuple(_CURVES) == SERIES

_POINTS = 200
"""Points of a curve."""


class Charts:
    """Curves of the last seconds, one chart a quantity, a line an arm.

    Args:
        gui: viser's, inside the folder that they are to be in.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        empty = np.linspace(-PLOTTED, 0.0, 2)
        blank = np.full(2, np.nan)
        self._handles: dict[str, Any] = {}
        for name, curve in _CURVES.items():
            series = (
                uplot.Series(label="s"),
                uplot.Series(label="1", stroke=COLOURS[0], width=2),
                uplot.Series(label="2", stroke=COLOURS[1], width=2),
                uplot.Series(label="bound", stroke=_BOUND, width=1, dash=(4, 4)),
            )
            self._handles[name] = gui.add_uplot(
                (empty, blank, blank, blank),
                series,
                title=curve.title,
                scales={
                    "x": uplot.Scale(time=False, range=(-PLOTTED, 0.0)),
                    "y": uplot.Scale(range=(curve.low, curve.high)),
                },
                legend=uplot.Legend(show=False),
                height=110,
            )

    def show(self, snapshot: Snapshot) -> None:
        """The last seconds until now."""
        grid = np.linspace(-PLOTTED, 0.0, _POINTS)
        for row, (name, curve) in enumerate(_CURVES.items()):
            lines = [_on(grid, arm.history.time - snapshot.time, arm.history.values[row]) for arm in snapshot.arms]
            lines += [np.full(_POINTS, np.nan)] * (2 - len(lines))
            bound = np.full(_POINTS, np.nan if curve.bound is None else curve.bound)
            self._handles[name].data = (grid, *(np.clip(line, curve.low, curve.high) for line in lines), bound)

    def set_visible(self, visible: bool) -> None:
        """Show or hide all: what is hidden need not be sent."""
        for handle in self._handles.values():
            handle.visible = visible


def _on(grid: Array, time: Array, values: Array) -> Array:
    """A curve on other times: its last value until then, NaN before its first."""
    if not len(time):
        return np.full(len(grid), np.nan)
    index = np.searchsorted(time, grid, side="right") - 1
    return np.where(index >= 0, values[np.maximum(index, 0)], np.nan)


def ribbon(snapshot: Snapshot, colours: dict[Status, tuple[int, int, int]], width: int = 256) -> Array:
    """The status over the last seconds as a strip of colours, a row an arm, shape (24 arms, width, 3)."""
    grid = np.linspace(-PLOTTED, 0.0, width)
    rows = []
    for arm in snapshot.arms:
        status = _on(grid, arm.history.time - snapshot.time, arm.history.values[SERIES.index("status")])
        row = np.full((width, 3), 235, np.uint8)
        for one, colour in colours.items():
            row[status == float(one)] = colour
        rows += [np.tile(row, (20, 1, 1)), np.full((4, width, 3), 255, np.uint8)]
    return np.concatenate(rows)
