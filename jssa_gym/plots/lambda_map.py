"""The map of the index's parameters."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from jssa_gym.palette import RED
from jssa_gym.plots.style import legend_below, panels, styled
from jssa_gym.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jssa_gym.certificate.lambda_map import LambdaMap


@styled
def lambda_map(swept: "LambdaMap", pairs: Mapping[str, tuple[float, float]]) -> "Figure":
    """Share of boundary states that each pair of parameters loses, a panel a capsule.

    Args:
        swept: The map; its first grid is drawn as tiles, its finer ones as dots, the bound on the trigger as a line.
        pairs: Pairs to mark, by name.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    from matplotlib.colors import LogNorm

    names, best = list(swept.best.lost), swept.best
    columns = min(len(names), 2)
    rows = -(-len(names) // columns)
    figure, axes = panels(4.6 * columns, 3.9 * rows + 0.6, rows, columns, sharex=True, sharey=True)
    least, (ones, twos) = 1e-2, swept.grid
    edges = [np.sqrt(x[0] / x[1]) * np.r_[x, x[-1] * x[1] / x[0]] for x in swept.grid]
    scale = LogNorm(least, 1.0)
    known = {(cell.lambda1, cell.lambda2): cell for cell in swept.cells}
    for panel in axes.flat[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(axes.flat, names, strict=False):
        share = np.array([[known[x, y].lost[name].value if (x, y) in known else np.nan for x in ones] for y in twos])
        panel.set_facecolor("#dddddd")
        panel.grid(False)
        tiles = panel.pcolormesh(*edges, np.maximum(share, least), norm=scale, cmap="cividis")
        finer = [cell for cell in swept.cells if cell.lambda1 not in ones or cell.lambda2 not in twos]
        shares = [max(cell.lost[name].value, least) for cell in finer]
        dots = [cell.lambda1 for cell in finer], [cell.lambda2 for cell in finer]
        panel.scatter(*dots, c=shares, norm=scale, cmap="cividis", s=14, edgecolors="white", linewidths=0.4)
        bound = (swept.trigger**2 - swept.d_min**2) / swept.domain.human_speed
        if edges[0][0] < bound < edges[0][-1]:
            label = f"triggered at {swept.trigger:g} m: no pair beyond"
            panel.axvline(bound, color=RED, linestyle="--", linewidth=1.2, label=label)
        panel.plot(best.lambda1, best.lambda2, "*", color=RED, markersize=13, label="least lost, worst capsule")
        for marker, (text, pair) in zip("osD^v", pairs.items(), strict=False):
            panel.plot(*pair, marker, color="none", markeredgecolor=RED, markeredgewidth=1.6, label=text)
        panel.set(xscale="log", yscale="log")
        panel.set_title(printable(name), parse_math=False)
    legend_below(figure, axes[0, 0], columns=2)
    for panel in axes[-1]:
        panel.set_xlabel("λ₁ [m·s]")
    for panel in axes[:, 0]:
        panel.set_ylabel("λ₂ [m·s²]")
    figure.colorbar(tiles, ax=axes, label="boundary states lost")
    return figure
