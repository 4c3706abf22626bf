"""``jssa-gym curves``: learning curves of trainings, as a figure and tables."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jssa_gym import plots
from jssa_gym.cli.files import writable_folder, write_figure
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import as_json, write_json, write_whole
from jssa_gym.train.curves import MEASURES, LearningCurve, learning_curves

_TITLES = ("trainings", "seeds", "policy steps", *MEASURES.values(), "of all episodes", "time of one")


@dataclass(frozen=True)
class Curves:
    """Put trainings together by seeds: interquartile means with stratified bootstrap intervals of 95 %.

    Writes curves.png, curves.md and curves.json. Curves end where the shortest training of a label has come; those that
    are still under way count too. It takes some seconds.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of trainings, as `jssa-gym train` leaves them, or with such in them, as `train --seeds` does."""
    labels: tuple[str, ...] = ()
    """One for every folder; folders of one label count together. By default the folders' names."""
    out: Path = Path("curves")
    """Folder for figure and tables."""
    resamples: int = 2000
    """Draws of the bootstrap."""
    figure: bool = True
    """Draw the curves; it needs the extra plots."""
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Read, put together, draw, write, print."""
        if not self.folders:
            raise ParameterError("give at least one folder of a training")
        labels = self.labels or tuple(folder.resolve().name for folder in self.folders)
        if len(labels) != len(self.folders):
            raise ParameterError(f"{len(self.folders)} folders need as many labels, got {len(labels)}")
        if self.figure:
            plots.require()
        curves = learning_curves(list(zip(labels, self.folders, strict=True)), resamples=self.resamples)
        writable_folder(self.out, "curves.json")
        data = as_json(curves)
        write_json(self.out / "curves.json", data)
        rows = [_row(curve) for curve in curves]
        write_whole(self.out / "curves.md", _markdown(rows))
        if self.figure:
            write_figure(self.out / "curves.png", plots.learning(curves))
        if self.json:
            print(json.dumps(data, allow_nan=False))
        else:
            _show(rows)


def _row(curve: LearningCurve) -> tuple[str, ...]:
    """What a label has come to at its end."""
    shares = [_told(curve, name, 100.0, " %") for name in ("success", "reached")]
    clock = "processor" if curve.processor else "wall clock"
    numbers = (*shares, _told(curve, "return"), _told(curve, "contacts"), str(curve.moving_contacts or "–"))
    time = f"{curve.seconds[-1] / 60.0:.1f} min ({clock})"
    return curve.label, str(curve.runs), f"{curve.steps[-1]:,}", *numbers, time


def _told(curve: LearningCurve, name: str, factor: float = 1.0, unit: str = "") -> str:
    band = curve.bands[name]
    value, low, high = (factor * values[-1] for values in (band.value, band.low, band.high))
    return f"{value:.0f}{unit}" + (f" [{low:.0f}, {high:.0f}]" if curve.runs > 1 else "")  # one says nothing of others


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    lines = [_TITLES, ["---"] * len(_TITLES), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _show(rows: Sequence[Sequence[str]]) -> None:
    table = table_of(*_TITLES, title="at the end: interquartile means over seeds, 95 % intervals")
    for row in rows:
        table.add_row(*row)
    Terminal(width=140).print(table)
