"""One look for all figures: letters, lines, and where legends go; the colours are :mod:`jssa_gym.palette`'s."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from jssa_gym.exceptions import MissingExtraError, how_to_install
from jssa_gym.palette import BLACK, RED
from jssa_gym.text import printable
from jssa_gym.types import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE = Path(__file__).parent / "jssa.mplstyle"
"""For figures of one's own: ``matplotlib.style.use(jssa_gym.plots.style.STYLE)``."""

_Parameters = ParamSpec("_Parameters")


def styled(draw: "Callable[_Parameters, Figure]") -> "Callable[_Parameters, Figure]":
    """Have a function draw its figure in the package's style, without a display unless the user has chosen one.

    Raises:
        MissingExtraError: When it is called, if matplotlib is not installed.
    """

    @wraps(draw)
    def drawn(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> "Figure":
        draw_without_display()
        from matplotlib import style

        with style.context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def draw_without_display() -> None:
    """Choose matplotlib's backend that needs no display, unless the user has chosen one.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(f"figures need the extra 'plots': {how_to_install('plots')}") from error
    matplotlib.use("agg", force=False)


def panels(width: float, height: float, rows: int, columns: int, **shared: Any) -> "tuple[Figure, Any]":
    """A figure of so many inches, and its panels, shape (rows, columns); ``shared`` are options of ``subplots``."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def label_rows(axes: Any, *labels: str) -> None:
    """What is drawn upwards in each row of panels."""
    for panel, label in zip(axes[:, 0], labels, strict=True):
        panel.set_ylabel(label)


def distance_panel(axes: "Axes", trace: Trace, d_min: float) -> None:
    """An episode's distance from people, under its name, with the lines that it should stay above."""
    axes.set_title(printable(trace.name), parse_math=False)
    axes.plot(trace.time, trace.distance, color=BLACK)
    axes.axhline(d_min, color=RED, linestyle="--", linewidth=1.0, label=f"$d_{{min}}$ = {d_min} m")
    axes.axhline(0.0, color=RED, linewidth=1.0, label="contact")


def legend_beside(axes: "Axes") -> None:
    """A legend to the right of a panel, where no curve is."""
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0.0)


def legend_below(figure: "Figure", axes: "Axes", columns: int = 3) -> None:
    """A panel's legend below the whole figure, which is laid out around it."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
