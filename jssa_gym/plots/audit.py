"""Figures of audits."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.evaluation.audit import AuditedStretch
from jssa_gym.palette import BLUE, GREEN, GREY, RED
from jssa_gym.plots.style import label_rows, legend_below, panels, styled
from jssa_gym.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def audited(stretches: Sequence[AuditedStretch], title: str) -> "Figure":
    """Distance, margin to S_p, speed and lateness over time, as logged and with the shield.

    Spans in which the shield would have intervened are shaded; gaps stay empty.

    Args:
        stretches: Of one audit.
        title: Above.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    drawing, axes = panels(9.0, 9.0, 4, 1, sharex=True)
    axes[0, 0].set_title(printable(title), parse_math=False)
    for k, stretch in enumerate(stretches):
        fastest = [np.abs(trace.velocity).max(axis=1) for trace in (stretch.logged, stretch.safe)]
        curves = (
            (stretch.logged.distance, stretch.safe.distance),
            stretch.margins,
            fastest,
            (None, stretch.lateness),
        )
        for panel, both in zip(axes[:, 0], curves, strict=True):
            for curve, colour, name in zip(both, (BLUE, GREEN), ("as logged", "with the shield"), strict=True):
                if curve is not None:
                    shown = np.where(np.isfinite(curve), curve, np.nan)
                    panel.plot(stretch.time, shown, color=colour, linewidth=1.2, label=name if k == 0 else None)
            for one in stretch.interventions:
                panel.axvspan(one.start, one.end, color=RED, alpha=0.18, linewidth=0.0)
    label_rows(axes, "distance [m]", "distance - S_p [m]", "fastest joint\n[rad/s]", "behind the log\n[s]")
    for panel in axes[:2, 0]:
        panel.axhline(0.0, color=GREY, linewidth=0.8)
    axes[-1, 0].set_xlabel("time [s]")
    legend_below(drawing, axes[0, 0])
    return drawing
