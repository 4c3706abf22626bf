"""Figures of handovers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jssa_gym.palette import COLOURS
from jssa_gym.plots.style import draw_without_display
from jssa_gym.plots.episodes import shade
from jssa_gym.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jssa_gym.paper.handover import Delivery


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
    draw_without_display()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * len(runs), 9.0), layout="constrained")
    axes = figure.subplots(4, len(runs), sharex=True, sharey="row", squeeze=False)
    for column, run in zip(axes.T, runs, strict=True):
        _column(column, run, d_min)
    for row, label in zip(
        axes[:, 0],
        ("distance from\nthe person [m]", "tool and goal [m]", "tool from goal [m]", "active, replans"),
        strict=True,
    ):
        row.set_ylabel(label)
    return figure


def _column(axes: Sequence[Any], run: "Delivery", d_min: float) -> None:
    time = run.trace.time
    axes[0].set_title(printable(run.trace.name), parse_math=False)
    axes[0].plot(time, run.trace.distance, color="black")
    axes[0].axhline(d_min, color="#D55E00", linestyle="--", linewidth=1.0, label=f"d_min = {d_min} m")
    axes[0].axhline(0.0, color="#D55E00", linewidth=1.0)
    for k, name in enumerate("xyz"):
        axes[1].plot(time, run.tip[:, k], color=COLOURS[k], label=name)
        axes[1].plot(time, run.goal[:, k], color=COLOURS[k], linestyle=":")
    axes[1].plot([], [], color="black", linestyle=":", label="goal")
    axes[1].legend(loc="upper right", fontsize="small", ncols=4)
    axes[2].plot(time, np.linalg.norm(run.tip - run.goal, axis=1), color="black")
    axes[3].step(time, run.trace.intervened, where="post", color="#E69F00", label="shield active")
    axes[3].plot(
        time[run.replans],
        np.full(run.replans.sum(), 1.2),
        color="#0072B2",
        marker="v",
        markersize=4.0,
        linestyle="none",
        label=f"replan ({run.replans.sum()})",
    )
    axes[3].set_ylim(-0.1, 1.9)
    axes[3].set_yticks([0, 1], ["no", "yes"])
    axes[3].legend(loc="upper right", fontsize="small", ncols=2)
    axes[3].set_xlabel("time [s]")
    shade(axes, run.trace)
    axes[0].legend(loc="upper right", fontsize="small")
