"""``jssa-gym demo``: the paper's scene, or a trained policy's task, under several shields with the same human."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
from rich.table import Table

from jssa_gym import plots
from jssa_gym.cli.files import writable_folder, write_figure
from jssa_gym.cli.film import require_film, save_film
from jssa_gym.cli.names import ROBOT
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.envs.arm import DT
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation import Summary, make_policy, rollout, summarise
from jssa_gym.evaluation.blocked import blocked, warning
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import ApproachRetreat, HumanMotion
from jssa_gym.policies import HoldPolicy, LearnedPolicy, Policy, load_policy
from jssa_gym.robots import DEFAULT
from jssa_gym.shields import JSSAShield
from jssa_gym.storage import as_json, write_json
from jssa_gym.validation import positive_number, whole_number

_SHIELDS: dict[str, Callable[[gym.Env], gym.Env]] = {
    "no shield": lambda env: env,
    "as published": JSSAShield.as_published,
    "JSSAShield": JSSAShield,
    "profile yield": partial(JSSAShield, profile="yield"),
}


TRIED = 50
"""Seeds that are played without a shield to find one that shows something."""


@dataclass(frozen=True)
class Demo:
    """A person walks up to the arm, stops and leaves; without a shield, with the paper's, with two of ours.

    It takes about 20 s of one core, most of them for the film.
    """

    out: Path = Path("demo")
    """Folder for figure, film and metrics."""
    speed: float = 0.8
    """The person's walking speed [m/s]."""
    robot: Annotated[str, ROBOT] = DEFAULT
    policy: str | None = None
    """A trained policy, by name or file, on its own task beside that task's person, instead of the paper's scene."""
    seed: int | None = None
    """Seed of a policy's episode; None: the first of 50 in which somebody touches the arm if nothing is between, or in
    which somebody comes nearest."""
    seconds: float = 8.0
    """Length of an episode."""
    video: bool = True
    """Also film the runs side by side."""
    pretty: bool = False
    """Shadows and smooth edges in the film: ten times slower."""
    capsules: bool = False
    """Also draw the capsules, which are what is measured, in the film."""
    json: bool = False
    """Print the metrics as JSON instead of a table."""

    def run(self) -> None:
        """Run, print, write."""
        if not 0.1 <= self.seconds <= 60.0:
            raise ParameterError(f"seconds has to be between 0.1 and 60, got {self.seconds}")
        require_film() if self.video else plots.require()
        steps = round(self.seconds / DT)
        make, drive = self._scene(steps)
        writable_folder(self.out, "metrics.json")
        console = Terminal(stderr=True)
        traces, summaries = [], []
        robot = None
        seed = self._seed(make, drive, steps)
        with Bar(console) as progress:
            task = progress.add_task("simulating", total=len(_SHIELDS))
            for name, wrap in _SHIELDS.items():
                env = wrap(make())
                base: Any = env.unwrapped
                robot = base.robot
                rollout(env, drive(env), seed=seed, steps=5)  # compiles: not to be timed
                trace = rollout(env, drive(env), seed=seed, steps=steps, name=name)
                traces.append(trace)
                summaries.append(summarise(trace, robot.limits))
                env.close()
                progress.advance(task)
            assert robot is not None
            write_json(self.out / "metrics.json", as_json(summaries))
            figure = plots.profile(traces, robot.limits, traces[0].d_min)
            write_figure(self.out / "profile.png", figure)
            written = ["metrics.json", "profile.png"]
            if self.video:
                written.append("side_by_side.mp4")
                path, pretty, capsules = self.out / written[-1], self.pretty, self.capsules
                save_film(path, traces, robot, progress, pretty=pretty, capsules=capsules)
        if self.json:
            print(json.dumps(as_json(summaries), indent=2))
        else:
            Terminal(width=100).print(_table(summaries, f", seed {seed}" if self.policy else ""))
        console.say(f"wrote {', '.join(str(self.out / name) for name in written)}")
        reasons = {trace.name: reason for trace in traces if (reason := blocked(trace))}
        for name, reason in reasons.items():
            console.say(f"warning: {name}: {warning(reason)}")
        if reasons:
            raise SystemExit(1)

    def _scene(self, steps: int) -> tuple[Callable[[], gym.Env], Callable[[gym.Env], Policy]]:
        """What makes the environment, and what drives the arm in it."""
        free: dict[str, Any] = {"terminate_on": (), "max_episode_steps": steps, "robot": self.robot}
        speed = positive_number("speed", self.speed)
        if self.seed is not None:
            whole_number("seed", self.seed)
        if self.policy is None:
            return partial(gym.make, "jssa_gym/Home-v0", human=paper_scene(speed), **free), HoldPolicy
        learned = load_policy(self.policy)
        if not isinstance(learned, LearnedPolicy) or learned.task not in TASKS:
            raise ParameterError(f"{self.policy} does not say which of {', '.join(TASKS)} it was trained for")
        make = partial(gym.make, "jssa_gym/Home-v0", task=learned.task, **free)
        return make, lambda env: make_policy(learned, env, 0)  # it draws nothing

    def _seed(self, make: Callable[[], gym.Env], drive: Callable[[gym.Env], Policy], steps: int) -> int:
        """The episode's seed: the one that was asked for, or one that shows what a shield is for."""
        if self.seed is not None or self.policy is None:
            return self.seed or 0
        env, nearest, found = make(), np.inf, 0
        for seed in range(TRIED):
            distance = rollout(env, drive(env), seed=seed, steps=steps).distance.min()
            if distance < nearest:
                nearest, found = distance, seed
            if nearest < 0.0:
                break
        env.close()
        return found


def paper_scene(speed: float) -> HumanMotion:
    """The human of the paper's Fig. 5, with nothing left to chance: up to 0.68 m in front of the base axis.

    The velocity changes at once: the hardest case for a filter, and the one of the documents' figures.
    """
    return ApproachRetreat(
        start=2.2,
        nearest=(0.68, 0.68),
        side=(0.0, 0.0),
        speed=(speed, speed),
        wait=(0.5, 0.5),
        stay=(1.0, 1.0),
        acceleration=None,
    )


def _table(summaries: list[Summary], told: str) -> Table:
    """The episodes side by side.

    Args:
        summaries: One a shield.
        told: What the title says besides, of a policy's episode; empty for the paper's scene, which has no goal.
    """
    names = (summary.name for summary in summaries)
    table = table_of("", *names, title=f"the same person under every shield{told}")

    def row(title: str, show: Callable[[Summary], str]) -> None:
        table.add_row(title, *(show(summary) for summary in summaries))

    def moment(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} s"

    def micros(value: float | None) -> str:
        return "-" if value is None else f"{value * 1e6:.0f} µs"

    row("min distance", lambda s: f"{s.min_distance:+.3f} m")
    row("contact", lambda s: "no" if not s.collision else "arm moving" if s.moving_contact else "arm at rest")
    if told:
        row("success", lambda s: "yes" if s.success else "no")
        row("time to the goal", lambda s: moment(s.time_to_goal))
    row("first trigger", lambda s: moment(s.first_trigger))
    row("last trigger", lambda s: moment(s.last_trigger))
    row("active", lambda s: f"{s.active_duration:.3f} s")
    row("steps changed", lambda s: f"{100.0 * s.intervention_rate:.1f} %")
    row("activations", lambda s: str(s.n_activations))
    row("peak joint speed / limit", lambda s: f"{s.speed_limit_ratio:.2f}")
    row("peak jerk / bound", lambda s: f"{s.jerk_limit_ratio:.2f}")
    row("shield time p50", lambda s: micros(s.shield_p50))
    row("shield time p99", lambda s: micros(s.shield_p99))
    return table
