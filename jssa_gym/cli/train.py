"""``jssa-gym train``: from one command to a policy with the numbers to judge it."""

import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.table import Table

from jssa_gym.cli.engine import Engine
from jssa_gym.cli.files import writable_folder
from jssa_gym.cli.film import require_film, save_film
from jssa_gym.cli.names import ROBOT, TASK
from jssa_gym.cli.progress import Bar, counting
from jssa_gym.cli.terminal import Terminal, table_of
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.robots import DEFAULT, make_robot
from jssa_gym.shields import TASK_SHIELD
from jssa_gym.train.config import EVALUATION_SEED, Control, LearnFrom, TrainConfig, preset, tuned_algorithm
from jssa_gym.train.environment import control_env
from jssa_gym.train.history import Leg, as_rows
from jssa_gym.train.settings import Algorithm
from jssa_gym.train.sweep import SeedOutcome
from jssa_gym.validation import positive_integer

_AS_TUNED = (
    *("human", "control", "share", "ticks", "learn_from", "penalty", "observe_intervention"),
    *("steps", "envs", "interval", "eval_episodes"),
)
"""Options without which the tuned training's value stays."""

_KEPT = ("checkpoints", "history.csv", "tensorboard")
"""What tells a training's folder."""


@dataclass(frozen=True)
class Train:
    """Train a policy inside the shield, with checkpoints, evaluations and their safety on the way.

    A training that was interrupted, in whatever way, goes on where it stopped when the same command is given again. The
    folder gets best.npz and last.npz, which `jssa-gym evaluate --policy` takes, history.csv, TensorBoard's logs, and a
    film of the best policy at the end. The tuned trainings of reach take about five minutes of one core.
    """

    task: Annotated[str, TASK] = "reach"
    algorithm: Algorithm | None = None
    """Algorithm of Stable-Baselines3; tqc of sb3-contrib; those with -lagrangian keep a limit on the cost, --set
    cost_limit=... None: the one that was tuned for the task, else ppo."""
    out: Path = Path("training")
    """Folder for everything; a training that is there already is continued."""
    robot: Annotated[str, ROBOT] = DEFAULT
    human: str | None = None
    """People by name, or a file .npz, .csv or .bvh; None: as tuned, else the task's own."""
    shield: bool = True
    """Whether the learner acts through the shield of the task's shielded id."""
    control: Control | None = None
    """What an action means: the jerk itself, or a velocity or position that loops turn into jerk; None: as tuned."""
    share: float | None = None
    """Share of the velocity and acceleration limits that commands may use; None: as tuned."""
    ticks: int | None = None
    """Control steps for which an action is repeated; None: as tuned."""
    learn_from: LearnFrom | None = None
    """What the learner is told of the shield: nothing (policy), the executed action (sac, td3, tqc), a penalty, both.
    None: as tuned; without a shield nothing."""
    penalty: float | None = None
    """Weight of the penalty; None: as tuned."""
    observe_intervention: bool | None = None
    """Whether the shield's last change is part of the observation; None: as tuned."""
    steps: int | None = None
    """Policy steps; None: as tuned."""
    seed: int = 0
    """Seed of everything that is drawn."""
    seeds: int | None = None
    """Train so many times, with the seeds from --seed on, in seed-0, seed-1 and so on below --out; `jssa-gym curves`
    puts them together. A seed that fails is told of, and the others go on."""
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    envs: int | None = None
    """Environments that are stepped together; None: as tuned."""
    processes: bool = False
    """Whether every environment has a process of its own."""
    vector: bool = True
    """Whether all environments are stepped in one compiled call, which gives the same sooner, unless they have
    processes or learn_from is executed or both."""
    interval: int | None = None
    """Policy steps between checkpoints; None: as tuned."""
    eval_episodes: int | None = None
    """Episodes of the evaluation at every checkpoint; None: as tuned."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = field(default=())
    """Hyper-parameters of the algorithm, such as learning_rate=0.001 width=128."""
    threads: int = 1
    """Threads of torch, in each training; small networks are fastest with one."""
    video: bool = True
    """Whether a film of the best policy is made at the end; it needs the extra plots."""
    json: bool = False
    """Print JSON instead of a table."""

    def config(self) -> TrainConfig:
        """The training that is asked for.

        Raises:
            ParameterError: Something is unknown or out of range.
        """
        tuned = preset(self.task, self.algorithm or tuned_algorithm(self.task))
        given = {name: value for name in _AS_TUNED if (value := getattr(self, name)) is not None}
        if not self.shield:  # of which there is nothing to tell
            given.setdefault("learn_from", "policy")
        changes: dict[str, str] = {}
        for change in self.set:
            name, equals, value = change.partition("=")
            if not equals:
                raise ParameterError(f"--set takes name=value, got {change!r}")
            changes[name] = value
        return replace(
            tuned,
            settings=tuned.settings.changed(changes),
            shield=self.shield,
            seed=self.seed,
            processes=self.processes,
            vector=None if self.vector else False,
            robot=self.robot,
            **given,
        )

    def run(self) -> None:
        """Train, print, film."""
        config = self.config()
        positive_integer("threads", self.threads)
        if self.seeds is None and self.workers != Engine():
            raise ParameterError("--jobs, --engine and --address are for several trainings: give --seeds as well")
        if self.seeds is not None:
            self._several(config, positive_integer("seeds", self.seeds))
            return
        if self.video:
            require_film()  # better now than after hours
        from jssa_gym.train import train  # torch: not for --help; says what is missing

        import torch  # isort: skip

        torch.set_num_threads(self.threads)
        writable_folder(self.out, *_KEPT)
        console = Terminal(stderr=True)
        with Bar(console, *counting()) as progress:
            bar = progress.add_task("policy steps", total=config.steps)
            try:
                training = train(
                    config,
                    self.out,
                    say=console.say,
                    watch=lambda steps: progress.update(bar, completed=steps),
                    command=shlex.join(["jssa-gym", *sys.argv[1:]]),
                )
            except KeyboardInterrupt:
                console.say(f"stopped; the same command goes on from the last checkpoint in {self.out}")
                raise SystemExit(130) from None
        if self.json:
            print(json.dumps({"training": config.as_dict(), "history": as_rows(training.history)}, allow_nan=False))
        else:
            _show(training.history)
            if not config.observe_intervention:  # whose observation only training_env makes
                human = config.human or TASKS[config.task].human
                guard = TASK_SHIELD if config.shield else "none"
                words = ("--task", config.task, "--human", human, "--filter", guard)
                words += () if self.robot == DEFAULT else ("--robot", self.robot)
                words = ("jssa-gym", "evaluate", *words, "--policy", str(self.out / "best.npz"), "--episodes", "1000")
                shown = Terminal()
                shown.say()
                shown.say(shlex.join(words))
        if self.video:
            self._film(training.policy, config)

    def _several(self, config: TrainConfig, count: int) -> None:
        """Train with several seeds, and print what each has come to."""
        jobs = self.workers.chosen()
        seeds = range(config.seed, config.seed + count)
        replace(config, seed=seeds[-1])  # is one, too
        from jssa_gym.train import train_seeds

        writable_folder(self.out, "seed-*")
        command = shlex.join(["jssa-gym", *sys.argv[1:]])
        try:
            outcomes = train_seeds(config, seeds, self.out, jobs, threads=self.threads, say=_say, command=command)
        except KeyboardInterrupt:
            _say(f"stopped; the same command goes on from the last checkpoints in {self.out}")
            raise SystemExit(130) from None
        if self.json:
            print(json.dumps([_plain(one) for one in outcomes], allow_nan=False))
        else:
            _show_seeds(outcomes)
        if any(one.error for one in outcomes):
            raise SystemExit(1)

    def _film(self, policy: LearnedPolicy, config: TrainConfig) -> None:
        """The best policy's first episode of the evaluations."""
        trace = rollout(control_env(config, ("success",)), policy, seed=EVALUATION_SEED)
        save_film(self.out / "best.mp4", [trace], make_robot(config.robot).mounted(trace.mount))


def _say(line: str) -> None:
    """A line of whoever trains, in a process of its own maybe."""
    Terminal(stderr=True).say(line)


def _plain(one: SeedOutcome) -> dict[str, Any]:
    return {"seed": one.seed, "folder": str(one.folder), "error": one.error, "history": as_rows(one.history)}


def _show_seeds(outcomes: Sequence[SeedOutcome]) -> None:
    table = Table(title="at the end of every training")
    for title in ("seed", "steps", "episodes", "moving contacts", "eval: success", "safe", "moving", "failed"):
        table.add_column(title, justify="left" if title == "failed" else "right")
    for one in outcomes:
        if not one.history:
            table.add_row(str(one.seed), *("–",) * 6, one.error)
            continue
        last = one.history[-1]
        episodes, contacts = (
            sum(getattr(leg, name) for leg in one.history) for name in ("episodes", "moving_contacts")
        )
        shares = (f"{last.eval_success:.0%}", f"{last.eval_safe:.0%}", f"{last.eval_moving_contacts}")
        table.add_row(str(one.seed), f"{last.steps:,}", f"{episodes:,}", f"{contacts:,}", *shares, "")
    shown = Terminal(width=120)
    shown.print(table)
    shown.say(shlex.join(["jssa-gym", "curves", str(outcomes[0].folder.parent)]))


def _show(history: tuple[Leg, ...]) -> None:
    titles = ("steps", "episodes", "success", "moving contacts", "changed", "eval: success", "safe", "moving", "time")
    table = table_of(*titles, left=0, title="the training, leg by leg")
    for leg in history:
        table.add_row(
            f"{leg.steps:,}",
            f"{leg.episodes:,}",
            _told(leg.success, ".0%"),
            f"{leg.moving_contacts}",
            _told(leg.interventions, ".1%"),
            f"{leg.eval_success:.0%}",
            f"{leg.eval_safe:.0%}",
            f"{leg.eval_moving_contacts}",
            _told(leg.eval_time, ".1f", " s"),
        )
    Terminal(width=120).print(table)


def _told(number: float, form: str, unit: str = "") -> str:
    """A number, or a dash for none."""
    return "–" if number != number else f"{number:{form}}{unit}"
