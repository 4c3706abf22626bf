"""Learning curves, against policy steps and against time."""

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

from jssa_gym.palette import COLOURS
from jssa_gym.plots.style import label_rows, legend_below, panels, styled
from jssa_gym.train.curves import MEASURES, LearningCurve

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = ("success", "return", "contacts")


@styled
def learning(curves: Sequence[LearningCurve]) -> "Figure":
    """Success, return and contacts while learning: interquartile means over seeds with 95 % intervals.

    Args:
        curves: As :func:`jssa_gym.train.learning_curves` puts them together.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = panels(9.0, 8.0, len(_SHOWN), 2, sharex="col", sharey="row")
    clocks = sorted({"processor" if curve.processor else "wall-clock" for curve in curves})
    for curve, colour in zip(curves, cycle(COLOURS), strict=False):
        minutes = [seconds / 60.0 for seconds in curve.seconds]
        for row, name in zip(axes, _SHOWN, strict=True):
            band = curve.bands[name]
            for panel, along in zip(row, (curve.steps, minutes), strict=True):
                panel.fill_between(along, band.low, band.high, color=colour, alpha=0.2, linewidth=0.0)
                seeds = f"{curve.label} ({curve.runs} seed{'s' if curve.runs > 1 else ''})"
                panel.plot(along, band.value, color=colour, marker=".", label=seeds)
    label_rows(axes, *(MEASURES[name].replace(" while", "\nwhile").replace(" without", "\nwithout") for name in _SHOWN))
    axes[0, 0].set_ylim(-0.02, 1.02)
    axes[-1, 0].set_xlabel("policy steps")
    axes[-1, 1].set_xlabel(f"{' or '.join(clocks)} time of learning [min]")
    legend_below(figure, axes[0, 0], columns=min(len(curves), 3))
    return figure
