r"""Phase portraits of the safety index: where it is 0, over :math:`\phi_0`, :math:`\dot\phi_0`, :math:`\ddot\phi_0`.

:math:`\phi_0 = d_{min} - D`, so that :math:`\dot\phi_0 = -\dot D` is the speed of approach and :math:`\ddot\phi_0 =
-\ddot D` its growth.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jssa_gym.kernels.index import index_value
from jssa_gym.palette import BLUE, GREEN, GREY, RED
from jssa_gym.plots.style import styled
from jssa_gym.safety.condition import fastest_approach
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FARTHEST = 1.2
"""Largest distance beyond d_min that is drawn [m]."""

_FASTEST = 0.8
"""Largest speed of approach or retreat that is drawn [m/s]."""

_STEEPEST = 5.0
"""Largest second derivative that is drawn [m/s²]."""


class Surface(NamedTuple):
    """Where an index is 0, as a function of distance and rate."""

    title: str
    curvature: Callable[[Array, Array], Array]
    r""":math:`\ddot D` there [m/s²], from :math:`D` [m] and :math:`\dot D` [m/s]."""
    fastest: Callable[[Array], Array]
    r"""Fastest approach :math:`\dot D` [m/s] that the index alone stops, from :math:`D` [m]."""


def surface(index: IndexParams) -> Surface:
    """The zero set of Eq. (6)."""
    kernel = index.kernel()
    level = np.vectorize(lambda D, rate: index_value(D, rate, 0.0, kernel) / index.lambda2)
    title = rf"$\phi$, $\lambda$ = ({index.lambda1:g}, {index.lambda2:g})"
    return Surface(title, level, lambda D: fastest_approach(index, D))


def linear_surface(index: IndexParams) -> Surface:
    r"""The zero set of the paper's linear :math:`\phi^* = \phi_0 + \lambda_1\dot\phi_0 + \lambda_2\ddot\phi_0`."""
    d_min, one, two = index.d_min, index.lambda1, index.lambda2
    slope = (one + np.sqrt(max(one**2 - 4.0 * two, 0.0))) / (2.0 * two)
    title = rf"$\phi^*$ (linear), $\lambda$ = ({one:g}, {two:g})"
    return Surface(title, lambda D, rate: (d_min - D - one * rate) / two, lambda D: -slope * (D - d_min))


@styled
def portraits(index: IndexParams) -> "Figure":
    r"""The paper's Fig. 3: :math:`\phi_0 = 0`, :math:`\phi^* = 0`, :math:`\phi = 0`, and what stays inside.

    Above the surfaces, below their slice at :math:`\ddot\phi_0 = 0`, with the largest set that each index alone makes
    forward invariant: the paper shades a part of it.

    Args:
        index: Parameters of the index.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 8.8), layout="constrained")
    for k, drawn in enumerate((None, linear_surface(index), surface(index))):
        space = figure.add_subplot(2, 3, k + 1, projection="3d")
        _space(space, f"({'abc'[k]})  " + (drawn.title if drawn else r"$\phi_0$"))
        _margin(space)
        if drawn:
            _sheet(space, drawn, index.d_min, "Reds")
        _slice(figure.add_subplot(2, 3, k + 4), drawn, index.d_min)
    return figure


@styled
def shifts(index: IndexParams, lambda1: float, lambda2: float) -> "Figure":
    r"""The paper's Fig. 7: how :math:`\phi = 0` moves when :math:`\lambda_1` or :math:`\lambda_2` grows.

    Args:
        index: Before.
        lambda1: The larger :math:`\lambda_1` [m·s].
        lambda2: The larger :math:`\lambda_2` [m·s²].

    Raises:
        MissingExtraError: matplotlib is not installed.
        ParameterError: These are no parameters of an index.
    """
    from matplotlib.figure import Figure

    d_min, before = index.d_min, surface(index)
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    changes = (
        (r"(a)  larger $\lambda_1$", IndexParams(d_min=d_min, lambda1=lambda1, lambda2=index.lambda2)),
        (r"(b)  larger $\lambda_2$", IndexParams(d_min=d_min, lambda1=index.lambda1, lambda2=lambda2)),
    )
    for k, (title, changed) in enumerate(changes):
        after = surface(changed)
        space = figure.add_subplot(2, 2, k + 1, projection="3d")
        _space(space, title)
        _margin(space)
        _sheet(space, before, d_min, None)
        _sheet(space, after, d_min, "Reds")
        flat = figure.add_subplot(2, 2, k + 3)
        (_over_distance if k == 0 else _over_growth)(flat, before, after, d_min)
    return figure


def _space(axes: Any, title: str) -> None:
    axes.set_title(title)
    axes.set_xlabel(r"$\phi_0$ [m]")
    axes.set_ylabel(r"$\dot\phi_0$ [m/s]")
    axes.set_zlabel(r"$\ddot\phi_0$ [m/s²]")
    axes.set_xlim(-_FARTHEST, 0.2)
    axes.set_zlim(-_STEEPEST, _STEEPEST)
    axes.set_xticks([-1.2, -0.8, -0.4, 0.0])
    axes.set_yticks([-0.8, 0.0, 0.8])
    axes.set_zticks([-4.0, 0.0, 4.0])
    axes.view_init(elev=24.0, azim=-22.0)
    axes.set_box_aspect(None, zoom=0.78)


def _margin(axes: Any) -> None:
    """The plane φ0 = 0."""
    rate, growth = np.meshgrid([-_FASTEST, _FASTEST], [-_STEEPEST, _STEEPEST])
    axes.plot_surface(np.zeros_like(rate), rate, growth, color=BLUE, alpha=0.2)


def _sheet(axes: Any, drawn: Surface, d_min: float, colours: str | None) -> None:
    """An index' zero set; without a colour map it is plain blue."""
    # a strip beyond the margin too, as in the paper: there the index is 0 at negative distances
    phi0, rate0 = np.meshgrid(np.linspace(-_FARTHEST, 0.2, 57), np.linspace(-_FASTEST, _FASTEST, 65))
    growth = -drawn.curvature(d_min - phi0, -rate0)
    growth = np.where(np.abs(growth) <= _STEEPEST, growth, np.nan)
    style = {"cmap": colours, "vmin": -_STEEPEST, "vmax": 0.8 * _STEEPEST} if colours else {"color": BLUE}
    axes.plot_surface(phi0, rate0, growth, alpha=0.8, linewidth=0.0, rcount=60, ccount=60, **style)


def _slice(axes: Any, drawn: Surface | None, d_min: float) -> None:
    """The plane of no acceleration, with the set that stays inside; without a surface only the margin."""
    phi0 = np.linspace(-_FARTHEST, 0.0, 121)[::-1]
    axes.axvline(0.0, color=BLUE, label=r"$\phi_0 = 0$")
    if drawn is None:
        axes.axvspan(-_FARTHEST, 0.0, color=GREY, alpha=0.15, linewidth=0.0, label="safe, but not invariant")
    else:
        phi, rate = np.meshgrid(np.linspace(-_FARTHEST, 0.2, 141), np.linspace(-_FASTEST, _FASTEST, 161))
        axes.contour(phi, rate, drawn.curvature(d_min - phi, -rate), [0.0], colors=[RED])
        axes.plot([], [], color=RED, label=r"index = 0 at $\ddot\phi_0 = 0$")
        fastest = -drawn.fastest(d_min - phi0)
        axes.plot(phi0, fastest, color=GREEN, linestyle="--", label="fastest approach it stops")
        held = np.where(drawn.curvature(d_min - phi, -rate) <= 0.0, 1.0, 0.0)
        held *= (phi <= 0.0) & (rate <= np.interp(-phi, -phi0, fastest))
        axes.contourf(phi, rate, held, [0.5, 1.5], colors=[GREEN], alpha=0.18)
        axes.fill_between([], [], [], color=GREEN, alpha=0.18, label=r"forward invariant, at $\ddot\phi_0 = 0$")
    axes.set_xlim(-_FARTHEST, 0.2)
    axes.set_ylim(-_FASTEST, _FASTEST)
    axes.set_xlabel(r"$\phi_0$ [m]")
    axes.set_ylabel(r"$\dot\phi_0$ [m/s]")
    _legend(axes)


def _over_distance(axes: Any, before: Surface, after: Surface, d_min: float) -> None:
    """Slices at no acceleration: who is triggered at which speed of approach."""
    phi, rate = np.meshgrid(np.linspace(-_FARTHEST, 0.2, 141), np.linspace(-_FASTEST, _FASTEST, 161))
    _compare(axes, before, after, phi, rate, lambda s: s.curvature(d_min - phi, -rate))
    axes.axvline(0.0, color=BLUE, alpha=0.4)
    axes.set_xlabel(r"$\phi_0$ [m]")
    axes.set_ylabel(r"$\dot\phi_0$ [m/s]")
    axes.set_title(r"slice at $\ddot\phi_0 = 0$; above a line the index is positive", fontsize="medium")


def _over_growth(axes: Any, before: Surface, after: Surface, d_min: float) -> None:
    """Slices at one distance: who is triggered at which acceleration."""
    distance = 0.6
    growth, rate = np.meshgrid(np.linspace(-3.0, 3.0, 121), np.linspace(-_FASTEST, _FASTEST, 161))
    _compare(axes, before, after, growth, rate, lambda s: s.curvature(np.full_like(rate, distance), -rate) + growth)
    axes.set_xlabel(r"$\ddot\phi_0$ [m/s²]")
    axes.set_ylabel(r"$\dot\phi_0$ [m/s]")
    axes.set_title(rf"slice at D = {distance} m; above a line the index is positive", fontsize="medium")


def _compare(axes: Any, before: Surface, after: Surface, x: Array, y: Array, level: Callable[[Surface], Array]) -> None:
    for drawn, colour in ((before, BLUE), (after, RED)):
        axes.contour(x, y, level(drawn), [0.0], colors=[colour])
        axes.plot([], [], color=colour, label=drawn.title)
    old, new = level(before), level(after)
    for where, colour, label in (
        ((new > 0.0) & (old <= 0.0), RED, "newly triggered"),
        ((new <= 0.0) & (old > 0.0), GREEN, "no longer triggered"),
    ):
        if where.any():
            axes.contourf(x, y, where.astype(float), [0.5, 1.5], colors=[colour], alpha=0.18)
            axes.fill_between([], [], [], color=colour, alpha=0.18, label=label)
    _legend(axes, columns=2)


def _legend(axes: Any, columns: int = 1) -> None:
    """Below the panel, where no line is."""
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.18), ncols=columns, borderaxespad=0.0)
