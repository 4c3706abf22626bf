"""``jssa-gym reproduce``: the paper's figures and table, with its numbers beside ours."""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro
from rich.table import Table
from rich.text import Text

from jssa_gym import plots
from jssa_gym.cli.files import writable_folder, write_figure
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.evaluation.blocked import blocked, warning
from jssa_gym.paper import claims, experiments, handover_claims, index_claims, reported
from jssa_gym.paper.claims import PAPER, Claim, LambdaTable
from jssa_gym.paper.experiments import SHIELDS
from jssa_gym.paper.reported import COLUMNS, Measures
from jssa_gym.safety.index import PUBLISHED
from jssa_gym.storage import as_json, write_json
from jssa_gym.types import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Advance = Callable[[Trace | None], Any]
"""Called with each episode, or with none for a step without."""

_MORE = {"lambda1": 5.0, "lambda2": 3.0}
"""The larger parameters of Fig. 7; the paper does not print its own."""


@dataclass(frozen=True, slots=True)
class Result:
    """What one figure or table came to."""

    figure: "Figure"
    measured: Mapping[str, Measures]
    """By source, the paper first."""
    claims: Sequence[Claim]


def _fig3(done: Advance) -> Result:
    figure = plots.portraits(PUBLISHED)
    done(None)
    return Result(figure, {}, index_claims.portrait_claims(PUBLISHED))


def _fig7(done: Advance) -> Result:
    figure = plots.shifts(PUBLISHED, **_MORE)
    done(None)
    return Result(figure, {}, index_claims.shift_claims(PUBLISHED, **_MORE))


def _fig6(done: Advance) -> Result:
    traces, limits = experiments.avoidance(done)
    figure = plots.profile(list(traces.values()), limits, PUBLISHED.d_min)
    measured = {PAPER: reported.FIG6} | {name: reported.measures(trace, limits) for name, trace in traces.items()}
    return Result(figure, measured, claims.avoidance_claims(traces, limits, PUBLISHED.d_min))


def _fig8(done: Advance) -> Result:
    traces, limits = experiments.comparison(done)
    figure = plots.profile(list(traces.values()), limits, PUBLISHED.d_min)
    measured = {"paper, SSA": reported.FIG8, "paper, JSSA": reported.FIG6}
    measured |= {name: reported.measures(trace, limits) for name, trace in traces.items()}
    baseline, *_ = traces
    rivals = {name: trace for name, trace in traces.items() if name != baseline}
    return Result(figure, measured, claims.comparison_claims(traces[baseline], rivals, limits))


def _fig10(done: Advance) -> Result:
    runs = experiments.handovers(done)
    measured = {PAPER: reported.FIG10} | {name: reported.measures(run.trace, run.limits) for name, run in runs.items()}
    figure = plots.handovers(list(runs.values()), PUBLISHED.d_min)
    return Result(figure, measured, handover_claims.handover_claims(runs, PUBLISHED.d_min))


def _table1(done: Advance) -> Result:
    tables: dict[str, LambdaTable] = {**experiments.sensitivity(done=done)}
    every = {PAPER: reported.TABLE1, **tables}
    arrays = {
        name: np.array([[_row(table[a, b]) for a in reported.GRID] for b in reported.GRID])
        for name, table in every.items()
    }
    titles = [f"{title} [{unit}]" for title, unit in COLUMNS.values()]
    figure = plots.sensitivity(arrays, reported.GRID, reported.GRID, titles)
    measured = {
        f"λ = ({a:g}, {b:g}), {name}": table[a, b]
        for b in reported.GRID
        for a in reported.GRID
        for name, table in every.items()
    }
    return Result(figure, measured, claims.sensitivity_claims(tables))


PARTS: Mapping[str, tuple[Callable[[Advance], Result], int]] = {
    "fig3": (_fig3, 1),
    "fig6": (_fig6, len(SHIELDS) + 1),
    "fig7": (_fig7, 1),
    "fig8": (_fig8, len(SHIELDS) + 1),
    "fig10": (_fig10, 3),
    "table1": (_table1, len(SHIELDS) * len(reported.GRID) ** 2),
}
"""What makes each figure or table, and how often it says that something is done."""


@dataclass(frozen=True)
class Reproduce:
    """Make the paper's figures and its table anew, and say which of its claims come out.

    The paper's person is not published: ours is one that comes near the numbers of its Fig. 6, the same everywhere. All
    of them take about half a minute of one core.
    """

    what: tyro.conf.Positional[Literal["fig3", "fig6", "fig7", "fig8", "fig10", "table1", "all"]] = "all"
    """Which figure or table."""
    out: Path = Path("reproduced")
    """Folder for a picture and the numbers of each."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self) -> None:
        """Play, draw, compare, write."""
        plots.require()
        writable_folder(self.out, "fig*.json", "table1.json")
        chosen = list(PARTS) if self.what == "all" else [self.what]
        results, reasons = {}, dict[str, str]()
        console = Terminal(stderr=True)
        with Bar(console) as progress:
            task = progress.add_task("", total=sum(PARTS[name][1] for name in chosen))

            def done(trace: Trace | None) -> None:
                progress.advance(task)
                if trace is not None and (reason := blocked(trace)):
                    reasons[trace.name] = reason

            for name in chosen:
                progress.update(task, description=name)
                make, _ = PARTS[name]
                results[name] = make(done)
                write_figure(self.out / f"{name}.png", results[name].figure)
                write_json(self.out / f"{name}.json", _plain(results[name]))
        if self.json:
            print(json.dumps({name: _plain(result) for name, result in results.items()}, indent=2))
        else:
            for name, result in results.items():
                _show(name, result)
        console.say(f"wrote {', '.join(chosen)}, each as .png and .json, to {self.out}")
        for name, reason in reasons.items():
            console.say(f"warning: {name}: {warning(reason)}")
        if reasons:
            raise SystemExit(1)


def _row(measures: Measures) -> list[float]:
    return [np.nan if value is None else value for value in dataclasses.astuple(measures)]


def _plain(result: Result) -> dict[str, Any]:
    """A result as JSON can hold it."""
    return {
        "measured": as_json(result.measured),
        "claims": [
            {**as_json(claim), "reproduced": claim.reproduced, "extent": claim.extent} for claim in result.claims
        ],
    }


def _show(name: str, result: Result) -> None:
    console = Terminal(width=150)
    if result.measured:
        table = table_of("", *(f"{title} [{unit}]" for title, unit in COLUMNS.values()), title=name)
        for source, measures in result.measured.items():
            cells = ("–" if value is None else f"{value:.3f}" for value in dataclasses.astuple(measures))
            table.add_row(source, *cells, end_section=source.endswith(tuple(SHIELDS)[-1]))
        console.print(table)
    table = Table("what the paper says", *result.claims[0].verdicts, "", title=f"{name}: is it so here?")
    for claim in result.claims:
        cells = (f"{'yes' if evidence.holds else 'no'}: {evidence.seen}" for evidence in claim.verdicts.values())
        table.add_row(claim.text, *cells, Text(claim.extent, "" if claim.extent == "reproduced" else "bold"))
    console.print(table)
