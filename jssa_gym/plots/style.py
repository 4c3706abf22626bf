"""One look for all figures: letters, lines, and where legends go; the colours are :mod:`jssa_gym.palette`'s."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec

from jssa_gym.exceptions import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE = Path(__file__).parent / "jssa.mplstyle"
"""For figures of one's own: ``matplotlib.style.use(jssa_gym.plots.style.STYLE)``."""

INSTALL = "pip install 'jssa-gym[plots]', or pip install -e '.[plots]' in a clone"

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
        raise MissingExtraError(f"figures need the extra 'plots': {INSTALL}") from error
    matplotlib.use("agg", force=False)


def legend_beside(axes: "Axes") -> None:
    """A legend to the right of a panel, where no curve is."""
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0.0)


def legend_below(figure: "Figure", axes: "Axes", columns: int = 3) -> None:
    """A panel's legend below the whole figure, which is laid out around it."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
