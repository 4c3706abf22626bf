"""One look for all figures: letters, lines, and where legends go; the colours are :mod:`jssa_gym.palette`'s."""

from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

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


def legend_above(axes: "Axes", columns: int = 4, handles: Sequence[Any] | None = None) -> None:
    """A legend over the panel, where no curve is."""
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": columns, "borderaxespad": 0.2}
    given = {} if handles is None else {"handles": list(handles)}
    axes.legend(**place, **given)
