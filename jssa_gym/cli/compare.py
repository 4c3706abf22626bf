"""``jssa-gym compare``: filters side by side, as one page."""

import json
import shlex
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from jssa_gym.cli.arguments import distinct
from jssa_gym.cli.engine import Engine
from jssa_gym.cli.evaluate import Separation, Trained, find_policies_here, play, ticks, warn
from jssa_gym.cli.names import FILTER, HUMAN, POLICY, ROBOT, SENSOR, TASK, TRUST
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.comparison_page import write_page
from jssa_gym.evaluation.contenders import NO_SENSOR
from jssa_gym.evaluation.standings import UNFILTERED, Standing, median_time_to_goal, standings
from jssa_gym.evaluation.statistics import short
from jssa_gym.evaluation.study import Study
from jssa_gym.robots import DEFAULT
from jssa_gym.robots.model import unpromised
from jssa_gym.storage import as_json


@dataclass(frozen=True)
class Compare:
    """Every combination of tasks, filters, people and policies on paired seeds, as one HTML page.

    Differences are relative to the first filter. A comparison that was interrupted goes on where it stopped when the
    same command is given again. The exit code is 1 if every decision of some combination was a FAULT. With the
    defaults, 200 episodes, it takes about a minute of one core.
    """

    tasks: Annotated[tuple[str, ...], TASK] = ("reach",)
    filters: Annotated[tuple[str, ...], FILTER] = ("jssa+stop", "jssa", "jssa_published", "none+stop", "none")
    humans: Annotated[tuple[str, ...], HUMAN] = ("walk_by", "approach_retreat")
    policies: Annotated[tuple[str, ...], POLICY] = ("jpc",)
    episodes: int = 20
    """Episodes of every combination."""
    seed: int = 0
    """First seed."""
    seconds: float = 8.0
    """Length of an episode."""
    out: Path = Path("comparison")
    """Folder for report.html, episodes.csv, summary.json and recordings; one that is there already is continued."""
    pair_policies: bool = False
    """Give all policies the same seeds too: then they are ranked by pairs of episodes. Otherwise their seeds differ."""
    keep: int = 1
    """How many recordings of the worst episodes of every combination are kept."""
    v_safe: float = MOVING
    """Speed of the robot's touching point from which a contact is critical [m/s]."""
    robot: Annotated[str, ROBOT] = DEFAULT
    sensor: Annotated[str, SENSOR] = NO_SENSOR
    separation: Annotated[Separation, tyro.conf.arg(name="")] = field(default_factory=Separation)
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    trained: Annotated[Trained, tyro.conf.arg(name="")] = field(default_factory=Trained)
    trust_pickle: Annotated[bool, TRUST] = False
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Play, write the page, print."""
        find_policies_here(self.policies)
        study = Study(
            distinct("tasks", self.tasks),
            distinct("filters", self.filters),
            distinct("humans", self.humans),
            distinct("policies", self.policies),
            episodes=self.episodes,
            seed=self.seed,
            steps=ticks(self.seconds),
            v_safe=self.v_safe,
            separation=self.separation.params(),
            trust_pickle=self.trust_pickle,
            robot=self.robot,
            pair_policies=self.pair_policies,
            sensor=self.sensor,
            trained=self.trained.told(),
        )
        reports = play(study, self.out, self.workers.chosen(), self.keep)
        ranked = standings(reports)
        write_page(self.out / "report.html", study, reports, self.command_line())
        if self.json:
            promise = {"uncovered": list(reports[0].uncovered)} if reports[0].uncovered else {}
            print(json.dumps([_plain(one) | promise for one in ranked], indent=2, allow_nan=False))
        else:
            if reports[0].uncovered:
                Terminal().say(unpromised(reports[0].uncovered))
            _show(ranked)
        console = Terminal(stderr=True)
        for report in reports:
            warn(report, console)
        console.say(f"wrote {self.out / 'report.html'}")
        if any(report.blocked for report in reports):
            raise SystemExit(1)

    def command_line(self) -> str:
        """What makes the same page again."""
        parts = ["jssa-gym", "compare"]
        for name in ("tasks", "filters", "humans", "policies"):
            parts += [f"--{name}", *getattr(self, name)]
        for name in ("episodes", "seed", "seconds", "out", "keep", "v_safe"):
            parts += [f"--{name.replace('_', '-')}", str(getattr(self, name))]
        for name, value in asdict(self.separation).items():
            parts += [f"--{name.replace('_', '-')}", str(value)]
        if self.robot != DEFAULT:
            parts += ["--robot", self.robot]
        if self.sensor != NO_SENSOR:
            parts += ["--sensor", self.sensor]
        if self.trained.ticks != 1:
            parts += ["--ticks", str(self.trained.ticks)]
        if self.trained.normalise is not None:
            parts += ["--normalise", str(self.trained.normalise)]
        parts += [f"--{name.replace('_', '-')}" for name in ("pair_policies", "trust_pickle") if getattr(self, name)]
        return shlex.join(parts)


def _plain(one: Standing) -> dict[str, object]:
    return {
        "filter": one.filter,
        **{key: value for key, value in one.pooled.as_dict().items() if key in ("episodes", "rates", "means")},
        "rate_differences": as_json(one.rates),
        "mean_differences": as_json(one.means),
        "median_time_to_goal": median_time_to_goal(one.pooled),
        "slowdown": as_json(one.slowdown),
    }


def _show(ranked: list[Standing]) -> None:
    console = Terminal(width=140)
    titles = ("filter", "success and safe", "success", "collision", "moving contact", "fastest contact", "changed")
    table = table_of(*titles, title="over all tasks, people and policies, 95 % intervals")
    for one in ranked:
        rates, means = one.pooled.rates, one.pooled.means
        table.add_row(
            one.filter,
            *(str(rates[f"{name}_rate"]) for name in ("success_and_safe", "success", "collision", "moving_contact")),
            f"{means['contact_speed'].most:.2g} m/s",
            f"{100.0 * means['intervention_rate'].value:.1f} %",
        )
    console.print(table)
    console.print(_motion(ranked))


def _motion(ranked: list[Standing]) -> Table:
    """How smoothly the arm moves under each filter, and how long it takes."""
    motions = ("jumps by shield", "by policy", "status switches", "RMS jerk")
    titles = ("filter", "success untouched", *motions, "median time", f"ratio to {UNFILTERED}")
    table = table_of(*titles, title="how the arm moves, and for how long")
    for one in ranked:
        means, time = one.pooled.means, median_time_to_goal(one.pooled)
        table.add_row(
            one.filter,
            str(one.pooled.rates["success_untouched_rate"]),
            *(f"{100.0 * means[name].value:.2g} %" for name in ("jerk_jumps_shield", "jerk_jumps_nominal")),
            f"{means['status_switches'].value:.2g} /s",
            f"{100.0 * means['jerk_rms'].value:.2g} %",
            "-" if time is None else f"{short(time)} s",
            "-" if one.slowdown is None else one.slowdown.brief,
        )
    return table
