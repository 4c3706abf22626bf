"""``jssa-gym evaluate``: a policy under a filter beside people, in numbers."""

import json
import shlex
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from jssa_gym.cli.engine import Engine
from jssa_gym.cli.files import own_folder
from jssa_gym.cli.names import FILTER, HUMAN, POLICY, ROBOT, SENSOR, TASK, TRUST
from jssa_gym.cli.progress import episodes_bar
from jssa_gym.cli.terminal import Terminal
from jssa_gym.engine.cluster import Cluster
from jssa_gym.envs.arm import DT, MOVING
from jssa_gym.evaluation.contenders import NO_SENSOR
from jssa_gym.evaluation.ledger import CONFIG
from jssa_gym.evaluation.metrics import SeparationParams
from jssa_gym.evaluation.policy import AsTrained
from jssa_gym.evaluation.report import METRICS, Report
from jssa_gym.evaluation.runner import complete
from jssa_gym.evaluation.slowdown import slowdown
from jssa_gym.evaluation.statistics import short
from jssa_gym.evaluation.study import Evaluation, Study
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import DEFAULT
from jssa_gym.robots.model import unpromised
from jssa_gym.storage import as_json, write_json
from jssa_gym.text import counted


def ticks(seconds: float) -> int:
    """Control steps of an episode.

    Raises:
        ParameterError: Not between 0.1 s and 600 s.
    """
    if not 0.1 <= seconds <= 600.0:
        raise ParameterError(f"seconds has to be between 0.1 and 600, got {seconds}")
    return round(seconds / DT)


def find_policies_here(policies: Iterable[str]) -> None:
    """Let ``module:factory`` name a module of the working directory, as ``python -m`` does.

    Args:
        policies: As they were given; without any such name nothing of the working directory is ever imported.
    """
    if any(":" in policy for policy in policies) and (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)


def play(study: Evaluation, out: Path, jobs: int | Cluster, keep: int) -> list[Report]:
    """Play what is left of a study under a progress bar; an interrupt says how to go on."""
    own_folder(out, CONFIG)
    with episodes_bar(Terminal(stderr=True), out) as show:
        return complete(study, out, jobs=jobs, keep=keep, progress=show)


@dataclass(frozen=True)
class Separation:
    """What `ssm_margin` and its kin assume, after ISO/TS 15066, 5.5.4."""

    reaction_time: float = 0.1
    """T_r of speed and separation monitoring [s]."""
    separation_speed: float = 1.6
    """v_h of speed and separation monitoring [m/s]: 1.6 walking, 2 for hands and arms."""
    intrusion: float = 0.0
    """C of speed and separation monitoring: how far a person reaches before being seen [m]."""
    uncertainty: float = 0.0
    """Z_d + Z_r of speed and separation monitoring, of the person's and the robot's place [m]."""

    def params(self) -> SeparationParams:
        """The parameters of an evaluation."""
        return SeparationParams(self.separation_speed, self.reaction_time, self.intrusion, self.uncertainty)


@dataclass(frozen=True)
class Trained:
    """How a trained policy was trained; the file is read when the command runs, not with its options."""

    ticks: int = 1
    """For how many ticks a trained policy's action holds, as in the ActionRepeat of its training."""
    normalise: Path | None = None
    """File of VecNormalize.save, whose statistics a trained policy's observations are normalised with."""

    def told(self) -> AsTrained:
        """As evaluations have it."""
        return AsTrained(self.ticks, None if self.normalise is None else str(self.normalise))


@dataclass(frozen=True)
class Evaluate:
    """Play episodes of one policy under one filter and print all metrics with 95 % intervals.

    An evaluation that was interrupted goes on where it stopped when the same command is given again. The folder gets
    episodes.csv, summary.json and recordings of the worst episodes for `jssa-gym replay`. The exit code is 1 if every
    decision of the filter was a FAULT. 100 episodes take about half a minute of one core.
    """

    task: Annotated[str, TASK] = "reach"
    filter: Annotated[str, FILTER] = "jssa+stop"
    human: Annotated[str, HUMAN] = "walk_by"
    policy: Annotated[str, POLICY] = "jpc"
    episodes: int = 100
    """How many."""
    seed: int = 0
    """First seed."""
    seconds: float = 8.0
    """Length of an episode."""
    out: Path = Path("evaluation")
    """Folder for the results; an evaluation that is there already is continued."""
    keep: int = 3
    """How many recordings of the worst episodes are kept."""
    v_safe: float = MOVING
    """Speed of the robot's touching point from which a contact is critical [m/s]."""
    slowdown: bool = False
    """Play the goals without filter and people as well, into the folder's `alone`; slowdown.json compares times."""
    robot: Annotated[str, ROBOT] = DEFAULT
    sensor: Annotated[str, SENSOR] = NO_SENSOR
    separation: Annotated[Separation, tyro.conf.arg(name="")] = field(default_factory=Separation)
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    trained: Annotated[Trained, tyro.conf.arg(name="")] = field(default_factory=Trained)
    trust_pickle: Annotated[bool, TRUST] = False
    json: bool = False
    """Print JSON instead of a table."""

    def run(self) -> None:
        """Play, print."""
        find_policies_here([self.policy])
        study = Study(
            (self.task,),
            (self.filter,),
            (self.human,),
            (self.policy,),
            episodes=self.episodes,
            seed=self.seed,
            steps=ticks(self.seconds),
            v_safe=self.v_safe,
            separation=self.separation.params(),
            trust_pickle=self.trust_pickle,
            robot=self.robot,
            sensor=self.sensor,
            trained=self.trained.told(),
        )
        (report,) = play(study, self.out, self.workers.chosen(), self.keep)
        lost = None
        if self.slowdown:
            nobody = replace(study, filters=("none",), humans=("none",), sensor=NO_SENSOR)
            lost = slowdown(report, play(nobody, self.out / "alone", self.workers.chosen(), 0)[0])
            write_json(self.out / "slowdown.json", as_json(lost))
        if self.json:
            told = report.as_dict() | ({"slowdown": as_json(lost)} if self.slowdown else {})
            print(json.dumps(told, indent=2, allow_nan=False))
        else:
            _show(report)
            if self.slowdown:
                told = "no goal was reached there" if lost is None else lost
                Terminal().say(f"time to the goal over that without filter and people: {told}")
        console = Terminal(stderr=True)
        warn(report, console)
        console.say(f"wrote episodes.csv and summary.json to {self.out}")
        if report.blocked:
            raise SystemExit(1)


def warn(report: Report, console: Terminal) -> None:
    """Say what is wrong with the run or the policy itself, whatever the filter made of it."""
    for told in report.warnings:
        console.say(f"warning: {', '.join(report.setting)}: {told}")


def _show(report: Report) -> None:
    console = Terminal(width=140)
    table = Table(title=f"{', '.join(report.setting)}: {counted(len(report.episodes), 'episode')}, 95 % intervals")
    for title in ("metric", "rate or mean", "least", "largest", "unit"):
        table.add_column(title, justify="left" if title in ("metric", "unit") else "right")
    units = {metric.over_episodes: metric.unit for metric in METRICS}
    for name, rate in report.rates.items():
        table.add_row(name, str(rate))
    for name, mean in report.means.items():
        table.add_row(name, str(mean), short(mean.least), short(mean.most), units[name])
    if report.uncovered:
        console.say(unpromised(report.uncovered))
    console.print(table)
    for path in report.traces:
        command = shlex.join(["jssa-gym", "replay", str(path), "--verify"])
        console.say(f"one of the worst: {command}")
    if report.unlike:
        console.say(f"went otherwise when played again: seeds {', '.join(map(str, report.unlike))}")
