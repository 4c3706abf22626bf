"""Tables of measures over two parameters."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.plots.style import panels, styled
from jssa_gym.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def sensitivity(
    tables: Mapping[str, Array], lambda1: Sequence[float], lambda2: Sequence[float], measures: Sequence[str]
) -> "Figure":
    """The paper's Table 1 as heat maps: a row a measure, a column a source of numbers.

    Every map has its own range of colours, dark for its largest value: what is to be compared is the pattern.

    Args:
        tables: By title, each of shape (len(lambda2), len(lambda1), len(measures)); NaN where there is no number.
        lambda1: Values from left to right [m·s].
        lambda2: Values from top to bottom [m·s²].
        measures: Titles with units.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    width, height = 2.8 * len(tables) + 1.4, 1.9 * len(measures)
    figure, axes = panels(width, height, len(measures), len(tables), sharex=True, sharey=True)
    for column, (title, table) in zip(axes.T, tables.items(), strict=True):
        column[0].set_title(title)
        for panel, values in zip(column, np.moveaxis(table, -1, 0), strict=True):
            known = values[np.isfinite(values)]
            low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
            # equal values are to look equal, not like the bottom of a range
            middle, half = (low + high) / 2.0, max((high - low) / 2.0, 1e-9)
            panel.imshow(values, cmap="Blues", vmin=middle - 1.4 * half, vmax=middle + 1.8 * half, aspect="auto")
            panel.grid(False)
            for (row, place), value in np.ndenumerate(values):
                if np.isfinite(value):
                    ink = "white" if float(value) > middle + 0.4 * half else "black"
                    panel.text(place, row, f"{value:.3f}", ha="center", va="center", fontsize="medium", color=ink)
        column[-1].set_xlabel(r"$\lambda_1$")
    for panel, measure in zip(axes[:, 0], measures, strict=True):
        panel.set_ylabel(measure.replace("critical ", "critical\n") + "\n" + r"$\lambda_2$")
        panel.set_xticks(range(len(lambda1)), [f"{value:g}" for value in lambda1])
        panel.set_yticks(range(len(lambda2)), [f"{value:g}" for value in lambda2])
    return figure
