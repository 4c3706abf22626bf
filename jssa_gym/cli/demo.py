"""``jssa-gym demo``: the paper's scene three times on the same human."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from jssa_gym import plots
from jssa_gym.cli.files import writable_folder, write_figure, write_json
from jssa_gym.cli.film import EVERY, film, pictures
from jssa_gym.envs.arm import DT
from jssa_gym.evaluation import Summary, rollout, summarise
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import ApproachRetreat, HumanMotion
from jssa_gym.policies import HoldPolicy
from jssa_gym.shields import JSSAShield
from jssa_gym.validation import positive_number

_SHIELDS: dict[str, Callable[[gym.Env], gym.Env]] = {
    "no shield": lambda env: env,
    "as published": JSSAShield.as_published,
    "JSSAShield": JSSAShield,
}


@dataclass(frozen=True)
class Demo:
    """A person walks up to the arm, stops and leaves; without a shield, with the paper's, with ours."""

    out: Path = Path("demo")
    """Folder for figure, film and metrics."""
    speed: float = 0.8
    """The person's walking speed [m/s]."""
    seconds: float = 8.0
    """Length of an episode."""
    video: bool = True
    """Also film the three runs side by side."""
    pretty: bool = False
    """Shadows and smooth edges in the film: ten times slower."""
    json: bool = False
    """Print the metrics as JSON instead of a table."""

    def run(self) -> None:
        """Run, print, write."""
        if not 0.1 <= self.seconds <= 60.0:
            raise ParameterError(f"seconds has to be between 0.1 and 60, got {self.seconds}")
        plots.require(film=self.video)
        human = paper_scene(positive_number("speed", self.speed))
        writable_folder(self.out)
        console = Console(stderr=True)
        steps = round(self.seconds / DT)
        traces, summaries = [], []
        robot, d_min = None, 0.05
        with Progress(console=console, transient=True) as progress:
            task = progress.add_task("simulating", total=len(_SHIELDS))
            for name, wrap in _SHIELDS.items():
                env = wrap(gym.make("jssa_gym/Home-v0", human=human, terminate_on=(), max_episode_steps=steps))
                base: Any = env.unwrapped
                robot, d_min = base.robot, base.d_min
                rollout(env, HoldPolicy(env), seed=0, steps=5)  # compiles: not to be timed
                trace = rollout(env, HoldPolicy(env), seed=0, steps=steps, name=name)
                traces.append(trace)
                summaries.append(summarise(trace, robot.limits))
                env.close()
                progress.advance(task)
            assert robot is not None
            write_json(self.out / "metrics.json", [_plain(summary) for summary in summaries])
            figure = plots.profile(traces, robot.limits, d_min)
            write_figure(self.out / "profile.png", figure)
            written = ["metrics.json", "profile.png"]
            if self.video:
                frames = film(traces, robot, d_min=d_min, pretty=self.pretty)
                bar = progress.track(frames, total=pictures(traces), description="filming")
                plots.write_film(self.out / "side_by_side.mp4", iter(bar), rate=round(1.0 / (DT * EVERY)))
                written.append("side_by_side.mp4")
        if self.json:
            print(json.dumps([_plain(summary) for summary in summaries], indent=2))
        else:
            Console().print(_table(summaries))
        console.print(f"wrote {', '.join(str(self.out / name) for name in written)}")


def paper_scene(speed: float) -> HumanMotion:
    """The human of the paper's Fig. 5, with nothing left to chance: up to 0.68 m in front of the base axis."""
    return ApproachRetreat(
        start=2.2, nearest=(0.68, 0.68), side=(0.0, 0.0), speed=(speed, speed), wait=(0.5, 0.5), stay=(1.0, 1.0)
    )


def _plain(summary: Summary) -> dict[str, Any]:
    """A summary as JSON can hold it: no infinity."""
    values = dataclasses.asdict(summary)
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()}


def _table(summaries: list[Summary]) -> Table:
    table = Table(title="the same person, three times")
    table.add_column("")
    for summary in summaries:
        table.add_column(summary.name, justify="right")

    def row(title: str, show: Callable[[Summary], str]) -> None:
        table.add_row(title, *(show(summary) for summary in summaries))

    def moment(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} s"

    def micros(value: float | None) -> str:
        return "-" if value is None else f"{value * 1e6:.0f} µs"

    row("min distance", lambda s: f"{s.min_distance:+.3f} m")
    row("contact", lambda s: "no" if not s.collision else "arm moving" if s.moving_contact else "arm at rest")
    row("first trigger", lambda s: moment(s.first_trigger))
    row("last trigger", lambda s: moment(s.last_trigger))
    row("active", lambda s: f"{s.active_duration:.3f} s")
    row("activations", lambda s: str(s.n_activations))
    row("peak joint speed / limit", lambda s: f"{s.speed_limit_ratio:.2f}")
    row("peak jerk / bound", lambda s: f"{s.jerk_limit_ratio:.2f}")
    row("shield time p50", lambda s: micros(s.shield_p50))
    row("shield time p99", lambda s: micros(s.shield_p99))
    return table
