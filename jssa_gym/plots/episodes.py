"""Figures and films of recorded episodes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jssa_gym.evaluation.spans import spans
from jssa_gym.palette import BLACK, BLUE, COLOURS, ORANGE, RED
from jssa_gym.plots.style import distance_panel, label_rows, legend_beside, panels, styled
from jssa_gym.robots import JointLimits
from jssa_gym.types import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHADE = 0.18
"""How opaque the shading is of times in which a shield was active."""


@styled
def profile(traces: Sequence[Trace], limits: JointLimits, d_min: float) -> "Figure":
    """The five panels of the paper's Fig. 6, a column a trace.

    Distance, its rate, its second derivative, the critical capsules, and the applied jerks with their bounds; spans
    in which the shield was active are shaded.

    Args:
        traces: Episodes of the same length.
        limits: For the jerk bounds.
        d_min: Drawn as a line [m].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = panels(4.6 * len(traces) + 1.4, 10.0, 5, len(traces), sharex=True, sharey="row")
    for column, trace in zip(axes.T, traces, strict=True):
        _column(column, trace, limits, d_min)
    told = "distance [m]", "its rate [m/s]", "its second\nderivative [m/s²]", "critical capsule", "jerk / its bound"
    label_rows(axes, *told)
    # a shield that throws the arm about would otherwise flatten everybody else's curve
    for row, field, most in ((1, "speed", 3.0), (2, "acceleration_of_distance", 12.0)):
        largest = max(np.nanmax(np.abs(getattr(trace, field)), initial=0.0) for trace in traces)
        bound = min(max(1.1 * largest, 0.1), most)
        axes[row, 0].set_ylim(-bound, bound)
    for row in (0, 3, 4):
        legend_beside(axes[row, -1])
    return figure


def _column(axes: Sequence[Any], trace: Trace, limits: JointLimits, d_min: float) -> None:
    time = trace.time
    distance_panel(axes[0], trace, d_min)
    axes[0].axvspan(np.nan, np.nan, color=ORANGE, alpha=_SHADE, label="shield active")
    axes[1].plot(time, trace.speed, color=BLACK)
    axes[2].plot(time, trace.acceleration_of_distance, color=BLACK, linewidth=0.9)
    axes[3].step(time, trace.pair[:, 0] + 1, where="post", color=BLUE, label="robot")
    axes[3].step(time, trace.pair[:, 1] + 1, where="post", color=RED, linestyle=":", label="human")
    axes[3].set_yticks(range(1, 7))
    share = trace.jerk / limits.jerk
    for j in range(share.shape[1]):
        colour = COLOURS[j % len(COLOURS)]
        axes[4].plot(time, share[:, j], color=colour, linewidth=0.8, label=f"J{j + 1}")
    axes[4].set_ylim(-1.1, 1.1)
    axes[4].set_xlabel("time [s]")
    shade(axes, trace)


def shade(panels: Sequence[Any], trace: Trace) -> None:
    """Mark when an episode's shield was active, on every panel."""
    for start, end in spans(trace.intervened):
        for panel in panels:
            panel.axvspan(trace.time[start] - trace.dt, trace.time[end - 1], color=ORANGE, alpha=_SHADE, linewidth=0.0)
