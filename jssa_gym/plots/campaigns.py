"""Figures of campaigns."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from jssa_gym.palette import BLUE, RED
from jssa_gym.plots.style import label_rows, panels, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Curve(NamedTuple):
    """How a shield degrades as something grows; one entry a level."""

    level: Sequence[float]
    rate: Sequence[float]
    """Share of the episodes with a moving contact."""
    low: Sequence[float]
    high: Sequence[float]
    """Its 95 % interval."""
    speed: Sequence[float]
    """Largest contact speed [m/s]."""


@styled
def degradation(fast: Curve, late: Curve) -> "Figure":
    """What happens as people become faster, and measurements older, than a shield assumes.

    Args:
        fast: Over the people's speed in multiples of what is assumed.
        late: Over the delay that nobody reports [ms].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure, axes = panels(9.0, 6.0, 2, 2, sharex="col", sharey="row")
    titles = ("speed of people / speed assumed", "latency that nobody reports [ms]")
    for (rate, speed), curve, title in zip(axes.T, (fast, late), titles, strict=True):
        rate.fill_between(curve.level, curve.low, curve.high, color=BLUE, alpha=0.2, linewidth=0.0)
        rate.plot(curve.level, curve.rate, color=BLUE, marker="o")
        speed.plot(curve.level, curve.speed, color=RED, marker="o")
        speed.set_xlabel(title)
    label_rows(axes, "episodes with a\nmoving contact", "fastest contact [m/s]")
    axes[0, 0].set_ylim(-0.02, 1.02)
    axes[1, 0].set_ylim(bottom=0.0)
    return figure
