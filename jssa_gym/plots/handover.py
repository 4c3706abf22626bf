"""Figures of handovers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jssa_gym.palette import BLACK, BLUE, COLOURS, ORANGE
from jssa_gym.plots.episodes import shade
from jssa_gym.plots.style import distance_panel, label_rows, legend_beside, panels, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jssa_gym.paper.handover import Delivery


@styled
def handovers(runs: Sequence["Delivery"], d_min: float) -> "Figure":
    """The four panels of the paper's Fig. 10, a column a run.

    Distance from the person, tool and goal, distance of the tool from the goal, and the largest jerk with marks
    where a new plan was asked for; spans in which the shield was active are shaded.

    Args:
        runs: Episodes of the same length.
        d_min: Drawn as a line [m].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = panels(4.6 * len(runs) + 1.6, 8.4, 4, len(runs), sharex=True, sharey="row")
    for column, run in zip(axes.T, runs, strict=True):
        _column(column, run, d_min)
    label_rows(axes, "distance from\nthe person [m]", "tool and goal [m]", "tool from goal [m]", "active, replans")
    for row in (0, 1, 3):
        legend_beside(axes[row, -1])
    return figure


def _column(axes: Sequence[Any], run: "Delivery", d_min: float) -> None:
    time = run.trace.time
    distance_panel(axes[0], run.trace, d_min)
    for k, name in enumerate("xyz"):
        axes[1].plot(time, run.tip[:, k], color=COLOURS[k], label=name)
        axes[1].plot(time, run.goal[:, k], color=COLOURS[k], linestyle=":")
    axes[1].plot([], [], color=BLACK, linestyle=":", label="goal")
    axes[2].plot(time, run.error, color=BLACK)
    axes[3].step(time, run.trace.intervened, where="post", color=ORANGE, label="shield active")
    axes[3].plot(
        time[run.replans],
        np.full(run.replans.sum(), 1.2),
        color=BLUE,
        marker="v",
        markersize=4.0,
        linestyle="none",
        label="replan",
    )
    axes[3].set_ylim(-0.1, 1.5)
    axes[3].set_yticks([0, 1], ["no", "yes"])
    axes[3].set_xlabel("time [s]")
    shade(axes, run.trace)
