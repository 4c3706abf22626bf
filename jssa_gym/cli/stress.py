"""``jssa-gym stress``: campaigns that try to break shields."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from jssa_gym import plots
from jssa_gym.cli.arguments import distinct
from jssa_gym.cli.engine import Engine
from jssa_gym.cli.evaluate import ticks
from jssa_gym.cli.files import own_folder, write_figure
from jssa_gym.cli.names import HUMAN, OPPONENTS, ROBOT, SHIELDS, TASK, WRONG
from jssa_gym.cli.progress import episodes_bar
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.engine.cluster import Cluster
from jssa_gym.envs.arm import DT
from jssa_gym.evaluation.blocked import commonest, warning
from jssa_gym.evaluation.campaign import PRESETS, Campaign
from jssa_gym.evaluation.contenders import contender
from jssa_gym.evaluation.ledger import CONFIG, Ledger
from jssa_gym.evaluation.report import Tally, tally
from jssa_gym.evaluation.rows import StressRow
from jssa_gym.evaluation.runner import finish
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import DEFAULT
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.storage import as_json
from jssa_gym.text import counted


@dataclass(frozen=True)
class Stress:
    """Try to break shields: every combination of filters, people, policies and faults, with paired seeds.

    A campaign that was interrupted goes on where it stopped when the same command is given again. The exit code is 1
    if a shield broke its promise within the assumptions, MuJoCo disagreed, or every decision of all was a FAULT. The
    preset quick takes some seconds of one core; of the others the progress tells how many episodes are to be played,
    about three a second.
    """

    preset: Literal["quick", "claim", "power", "joints", "avoid", "degradation"] = "quick"
    """What is tried: a check in seconds; the promise; shields without a guard; wrong joint states and clocks, with and
    without the guard against them; harmless people; worse than assumed. The next five replace a part of it."""
    filters: Annotated[tuple[str, ...], SHIELDS] = ()
    humans: Annotated[tuple[str, ...], HUMAN] = ()
    policies: Annotated[tuple[str, ...], OPPONENTS] = ()
    faults: Annotated[tuple[str, ...], WRONG] = ()
    episodes: int | None = None
    """Episodes of every combination."""
    out: Path = Path("stress")
    """Folder for the results; a campaign that is there already is continued."""
    task: Annotated[str, TASK] = "home"
    robot: Annotated[str, ROBOT] = DEFAULT
    seconds: float = 8.0
    """Length of an episode."""
    seed: int = 0
    """First seed."""
    judge: float = 0.02
    """Share of the episodes that MuJoCo judges again at 1 kHz, besides all suspicious ones of shields that promise."""
    keep: int = 20
    """How many recordings of the worst episodes are kept."""
    by: tuple[Literal["filter", "human", "policy", "fault"], ...] = ("filter",)
    """What makes a row of the table."""
    degradation: bool = False
    """Short for --preset degradation."""
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Play, count, print."""
        jobs = self.workers.chosen()
        if not self.keep >= 0:
            raise ParameterError(f"keep has to be at least 0, got {self.keep}")
        steps = ticks(self.seconds)
        preset = "degradation" if self.degradation else self.preset
        if preset == "degradation":
            plots.require()
        own_folder(self.out, CONFIG)
        ledger = Ledger(self.out, self.campaign(preset, steps))
        console = Terminal(stderr=True)
        self._play(ledger, jobs, console)
        episodes = [episode for some in ledger.by_cell().values() for episode in some]
        rows = tally(episodes, self.by)
        if preset == "degradation":
            figure = plots.degradation(*curves(episodes))
            write_figure(self.out / "degradation.png", figure)
        broken = [episode for episode in episodes if episode.broken]
        if self.json:
            print(json.dumps({"rows": [_plain(row, self.by) for row in rows], "broken": len(broken)}, indent=2))
        else:
            _show(rows, self.by, broken, ledger)
        written = ["episodes.csv"]
        if preset == "degradation":
            written.append("degradation.png")
        if any(ledger.traces.glob("*.npz")):
            written.append("traces of the worst episodes")
        console.say(f"wrote {', '.join(written)} to {self.out}")
        if reason := _blocked(episodes):
            console.say(f"warning: {warning(reason)}")
        if broken or reason:
            raise SystemExit(1)

    def campaign(self, preset: str, steps: int) -> Campaign:
        """What is to be played, by the options and a preset."""
        chosen: dict[str, Any] = {
            name: value
            for name in ("filters", "humans", "policies", "faults", "episodes")
            if (value := getattr(self, name)) not in ((), None)
        }
        for name in ("filters", "humans", "policies", "faults"):
            distinct(name, getattr(self, name))
        grids = tuple(dict.fromkeys(replace(grid, **chosen) for grid in PRESETS[preset]))
        return Campaign(grids, self.task, steps, self.seed, self.judge, self.robot)

    def _play(self, ledger: Ledger[StressRow], jobs: int | Cluster, console: Terminal) -> None:
        moving, total = 0, ledger.plan.total()
        with episodes_bar(console, self.out) as show:

            def done(episodes: list[StressRow]) -> None:
                nonlocal moving
                ledger.keep_worst([e for e in ledger.episodes if e.broken and e.judged], self.keep)
                moving += sum(episode.broken for episode in episodes)
                show(len(ledger.episodes), total, f"episodes, {moving} broken promises")

            show(len(ledger.episodes), total)
            finish(ledger, jobs, done)


def _blocked(episodes: Sequence[StressRow]) -> str:
    """Why every decision of the whole campaign was a FAULT; empty if not every one was: some faults are to hold it."""
    guarded = [episode for episode in episodes if episode.filter != UNSHIELDED]
    return commonest(e.first_fault for e in guarded) if all(e.faulty == e.steps for e in guarded) else ""


def _plain(row: Tally, by: Sequence[str]) -> dict[str, Any]:
    values = as_json(row)
    return {**dict(zip(by, values.pop("group"), strict=True)), **values}


def _show(rows: Sequence[Tally], by: Sequence[str], broken: Sequence[StressRow], ledger: Ledger[StressRow]) -> None:
    console = Terminal(width=140)
    episodes = f"{counted(len(ledger.episodes), 'episode')} of {ledger.plan.steps * DT:g} s, 95 % intervals"
    titles = ("contacts", "moving contacts", "limit violations", "fastest contact", "largest excess")
    happened = table_of(*by, *titles, left=len(by), title=episodes)
    titles = ("stored stop", "intervened", "fault", "no stop", "joint speed", "judged", "disagree", "overlaps")
    did = table_of(*by, *titles, left=len(by), title="what the shields did, and what MuJoCo says")
    for row in rows:
        happened.add_row(
            *row.group,
            *(str(rate) for rate in (row.contacts, row.moving, row.violations)),
            f"{row.contact_speed:.2g} m/s",
            f"{100.0 * row.excess:.2g} %",
        )
        did.add_row(
            *row.group,
            *(f"{100.0 * share:.1f} %" for share in (row.stored, row.intervened, row.faulty, row.no_stop)),
            f"{row.joint_speed:.2f} rad/s",
            *(f"{count:,}" for count in (row.judged, row.disagreements, row.overlaps)),
        )
    console.print(happened)
    console.print(did)
    if "filter" in by:
        for name in dict.fromkeys(row.group[by.index("filter")] for row in rows):
            if without := contender(name).without:
                console.say(f"{name}: full without {without}")
    same = unusual_options(ledger.plan)
    for episode in sorted(broken, key=lambda e: -e.severity)[:10]:
        what = "MuJoCo disagrees" if not episode.agrees else f"{episode.judged_speed or episode.contact_speed:.3g} m/s"
        names = " ".join(
            f"--{option} '{name}'"
            for option, name in zip(("filters", "humans", "policies", "faults"), episode.cell, strict=True)
        )
        console.say(
            f"broken ({what}, {episode.violations} violations, {episode.overlaps} overlaps): jssa-gym stress {names} "
            f"--episodes 1 --seed {episode.seed} --judge 1 --out again{same}"
        )


def unusual_options(plan: Any) -> str:
    """Options of a command that plays episodes of a campaign again: those that are not as ever."""
    if not isinstance(plan, Campaign):
        return ""
    chosen = {"task": (plan.task, Stress.task), "robot": (plan.robot, DEFAULT)}
    chosen["seconds"] = (f"{plan.steps * DT:g}", f"{Stress.seconds:g}")
    return "".join(f" --{name} {shlex.quote(value)}" for name, (value, usual) in chosen.items() if value != usual)


def curves(episodes: Sequence[StressRow]) -> tuple[plots.Curve, plots.Curve]:
    """Two curves: by the people's speed, and by the delay that nobody reports."""

    def curve(points: dict[float, list[StressRow]]) -> plots.Curve:
        levels = sorted(points)
        rates = [Rate.of(sum(e.touched_moving for e in points[x]), len(points[x])) for x in levels]
        speeds = [[max(e.contact_speed, e.judged_speed) for e in points[x]] for x in levels]
        return plots.Curve(
            levels, [r.value for r in rates], [r.low for r in rates], [r.high for r in rates], [max(s) for s in speeds]
        )

    fast: dict[float, list[StressRow]] = {}
    late: dict[float, list[StressRow]] = {}
    for episode in episodes:
        if " x" in episode.human:
            fast.setdefault(float(episode.human.split(" x")[1]), []).append(episode)
        if episode.fault.startswith("unmodelled"):
            late.setdefault(float(episode.fault.split()[1]), []).append(episode)
    return curve(fast), curve(late)
