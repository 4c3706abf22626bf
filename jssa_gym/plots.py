"""Figures and films of recorded episodes; needs the extra ``plots``."""

import importlib.util
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import MissingExtraError
from jssa_gym.robots import JointLimits
from jssa_gym.types import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jssa_gym.safety.lambda_map import LambdaMap

_JOINT_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#999999", "#000000")
"""Okabe and Ito's palette, told apart by colour-blind people."""


_INSTALL = "pip install 'jssa-gym[plots]', or pip install -e '.[plots]' in a clone"


def require(film: bool = False) -> None:
    """Find out before long work whether figures, and films, can be made.

    Raises:
        MissingExtraError: matplotlib or PyAV is not installed.
    """
    for module, what in (("matplotlib", "figures"), ("av", "films"))[: 2 if film else 1]:
        if importlib.util.find_spec(module) is None:
            raise MissingExtraError(f"{what} need the extra 'plots': {_INSTALL}")


def _matplotlib() -> Any:
    try:
        import matplotlib
    except ImportError as error:
        raise MissingExtraError(f"figures need the extra 'plots': {_INSTALL}") from error
    matplotlib.use("agg", force=False)
    return matplotlib


def profile(traces: Sequence[Trace], limits: JointLimits, d_min: float) -> "Figure":
    """The five panels of the paper's Fig. 6, a column a trace.

    Distance, its rate, its second derivative, the critical capsules, and the applied jerks with their bounds; spans
    in which the shield was active are shaded.

    Args:
        traces: Episodes of the same length.
        limits: For the jerk bounds.
        d_min: Drawn as a line [m].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    _matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * len(traces), 11.0), layout="constrained")
    axes = figure.subplots(5, len(traces), sharex=True, sharey="row", squeeze=False)
    for column, trace in zip(axes.T, traces, strict=True):
        _column(column, trace, limits, d_min)
    for row, label in zip(
        axes[:, 0],
        ("distance [m]", "its rate [m/s]", "its second\nderivative [m/s²]", "critical capsule", "jerk / its bound"),
        strict=True,
    ):
        row.set_ylabel(label)
    # a shield that throws the arm about would otherwise flatten everybody else's curve
    axes[1, 0].set_ylim(-3.0, 3.0)
    axes[2, 0].set_ylim(-12.0, 12.0)
    return figure


def _column(axes: Sequence[Any], trace: Trace, limits: JointLimits, d_min: float) -> None:
    time = trace.time
    axes[0].set_title(trace.name)
    axes[0].plot(time, trace.distance, color="black")
    axes[0].axhline(d_min, color="#D55E00", linestyle="--", linewidth=1.0, label=f"d_min = {d_min} m")
    axes[0].axhline(0.0, color="#D55E00", linewidth=1.0, label="contact")
    axes[0].legend(loc="upper right", fontsize="small")
    axes[1].plot(time, trace.speed, color="black")
    axes[2].plot(time, trace.acceleration_of_distance, color="black", linewidth=0.8)
    axes[3].step(time, trace.pair[:, 0] + 1, where="post", color="#0072B2", label="robot")
    axes[3].step(time, trace.pair[:, 1] + 1, where="post", color="#D55E00", linestyle=":", label="human")
    axes[3].set_yticks(range(1, 7))
    axes[3].legend(loc="upper right", fontsize="small")
    share = trace.jerk / limits.jerk
    for j in range(share.shape[1]):
        colour = _JOINT_COLOURS[j % len(_JOINT_COLOURS)]
        axes[4].plot(time, share[:, j], color=colour, linewidth=0.8, label=f"J{j + 1}")
    axes[4].set_ylim(-1.1, 1.1)
    axes[4].legend(loc="upper right", fontsize="x-small", ncols=3)
    axes[4].set_xlabel("time [s]")
    if trace.intervened.any():
        axes[0].axvspan(np.nan, np.nan, color="#E69F00", alpha=0.18, label="shield active")
        axes[0].legend(loc="upper right", fontsize="small")
    for start, end in _spans(trace.intervened):
        for panel in axes:
            panel.axvspan(time[start] - trace.dt, time[end - 1], color="#E69F00", alpha=0.18, linewidth=0.0)


def _spans(active: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(active.astype(int), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def label(text: str, width: int, height: int = 30) -> NDArray[np.uint8]:
    """A dark strip with a line of text, shape (height, width, 3)."""
    _matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100, facecolor="#22262b")
    figure.text(0.03, 0.5, text, color="white", fontsize=11, va="center")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:height, :width, :3].copy()


def gauge(
    distance: float, d_min: float, active: bool, touching: bool, width: int, height: int = 14
) -> NDArray[np.uint8]:
    """A bar as long as the distance, up to 1 m: grey, orange while the shield acts, red in contact."""
    strip = np.full((height, width, 3), 34, np.uint8)
    colour = (200, 40, 40) if touching else (230, 159, 0) if active else (150, 160, 170)
    length = width if touching else int(np.clip(distance, 0.0, 1.0) * width)
    strip[3:-3, :length] = colour
    mark = int(d_min * width)
    strip[:, mark : mark + 2] = (255, 255, 255)
    return strip


def write_film(path: str | Path, frames: Iterator[NDArray[np.uint8]], rate: int) -> None:
    """Write frames as H.264 into an MP4; the file appears when it is complete.

    Args:
        path: The file.
        frames: Pictures of one shape with even sides, (height, width, 3).
        rate: Frames a second.

    Raises:
        MissingExtraError: PyAV is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise MissingExtraError(f"films need the extra 'plots': {_INSTALL}") from error
    path = Path(path)
    unfinished = path.with_suffix(".part.mp4")
    with av.open(str(unfinished), "w") as container:
        stream: Any = container.add_stream("h264", rate=rate)
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": "22", "preset": "fast"}
        for k, picture in enumerate(frames):
            if k == 0:
                stream.height, stream.width = picture.shape[:2]
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    unfinished.replace(path)


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


def degradation(fast: Curve, late: Curve) -> "Figure":
    """What happens as people become faster, and measurements older, than a shield assumes.

    Args:
        fast: Over the people's speed in multiples of what is assumed.
        late: Over the delay that nobody reports [ms].

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    _matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots(2, 2, sharex="col", sharey="row")
    titles = ("speed of people / speed assumed", "latency that nobody reports [ms]")
    for (rate, speed), curve, title in zip(axes.T, (fast, late), titles, strict=True):
        rate.fill_between(curve.level, curve.low, curve.high, color="#0072B2", alpha=0.2, linewidth=0.0)
        rate.plot(curve.level, curve.rate, color="#0072B2", marker="o")
        speed.plot(curve.level, curve.speed, color="#D55E00", marker="o")
        speed.set_xlabel(title)
    axes[0, 0].set_ylabel("episodes with a\nmoving contact")
    axes[1, 0].set_ylabel("fastest contact [m/s]")
    axes[0, 0].set_ylim(-0.02, 1.02)
    axes[1, 0].set_ylim(bottom=0.0)
    return figure


def lambda_map(swept: "LambdaMap", pairs: Mapping[str, tuple[float, float]]) -> "Figure":
    """Share of boundary states that each pair of parameters loses, a panel a capsule.

    Args:
        swept: The map; its first grid is drawn as tiles, its finer ones as dots.
        pairs: Pairs to mark, by name.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    _matplotlib()
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    names, best = list(swept.best.lost), swept.best
    columns = min(len(names), 2)
    figure = Figure(figsize=(4.6 * columns, 3.9 * -(-len(names) // columns)), layout="constrained")
    axes = figure.subplots(-(-len(names) // columns), columns, sharex=True, sharey=True, squeeze=False)
    least, (ones, twos) = 1e-2, swept.grid
    edges = [np.sqrt(x[0] / x[1]) * np.r_[x, x[-1] * x[1] / x[0]] for x in swept.grid]
    scale = LogNorm(least, 1.0)
    known = {(cell.lambda1, cell.lambda2): cell for cell in swept.cells}
    for panel in axes.flat[len(names) :]:
        panel.set_visible(False)
    for panel, name in zip(axes.flat, names, strict=False):
        share = np.array([[known[x, y].lost[name].value if (x, y) in known else np.nan for x in ones] for y in twos])
        panel.set_facecolor("#dddddd")
        tiles = panel.pcolormesh(*edges, np.maximum(share, least), norm=scale, cmap="cividis")
        finer = [cell for cell in swept.cells if cell.lambda1 not in ones or cell.lambda2 not in twos]
        shares = [max(cell.lost[name].value, least) for cell in finer]
        dots = [cell.lambda1 for cell in finer], [cell.lambda2 for cell in finer]
        panel.scatter(*dots, c=shares, norm=scale, cmap="cividis", s=14, edgecolors="white", linewidths=0.4)
        panel.plot(best.lambda1, best.lambda2, "*", color="#D55E00", markersize=13, label="least lost, worst capsule")
        for marker, (text, pair) in zip("osD^v", pairs.items(), strict=False):
            panel.plot(*pair, marker, color="none", markeredgecolor="white", markeredgewidth=1.6, label=text)
        panel.set(xscale="log", yscale="log", title=name)
    axes[0, 0].legend(fontsize="x-small", loc="lower right", facecolor="#777777", labelcolor="white")
    for panel in axes[-1]:
        panel.set_xlabel("λ₁ [m·s]")
    for panel in axes[:, 0]:
        panel.set_ylabel("λ₂ [m·s²]")
    figure.colorbar(tiles, ax=axes, label="boundary states lost")
    return figure
