"""A training, described completely; :data:`PRESETS` has those that were tuned."""

import json
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.identity import robot_identity
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS
from jssa_gym.humans.files import is_file, load
from jssa_gym.robots import DEFAULT, ROBOTS
from jssa_gym.storage import sha256
from jssa_gym.train.settings import ALGORITHMS, PPO, SAC, OffPolicy, PPOLagrangian, SACLagrangian, Settings
from jssa_gym.train.wrappers import LEAST_SHARE
from jssa_gym.validation import check_fields, known_name, number_within, positive_integer, true_or_false, whole_number

LearnFrom = Literal["policy", "executed", "penalty", "both"]
Control = Literal["jerk", "velocity", "position", "tip"]

LARGEST_SEED = 2**32 - 1
"""Largest seed of a training; what torch and numpy take."""

EVALUATION_SEED = 1_500_000_000
"""First seed of the evaluations during a training."""


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """What is trained, in what environment, by which algorithm.

    Raises:
        ParameterError: A name is unknown, a number out of range, or a combination makes no sense.
    """

    task: str = "reach"
    """A name in :data:`~jssa_gym.envs.tasks.TASKS`."""
    settings: Settings = field(default_factory=PPO)
    """Algorithm and hyper-parameters."""
    human: str | None = None
    """People by name, or a file of a person; None for the task's own."""
    shield: bool = True
    """Whether the learner acts through the shield of the task's shielded id."""
    control: Control = "velocity"
    """What an action means; see :class:`~jssa_gym.JPCAction` for all but the jerk."""
    share: float = 0.5
    """Share of the velocity and acceleration limits that commands may use."""
    ticks: int = 10
    """Control steps for which an action is repeated: 10 is a policy at 12.5 Hz."""
    learn_from: LearnFrom = "policy"
    """What the learner is told of the shield: nothing (``policy``); the executed action in place of its own
    (``executed``, algorithms with a replay buffer only); a penalty for interventions; or both."""
    penalty: float = 0.1
    """Weight of the penalty; see :class:`~jssa_gym.train.InterventionPenalty`."""
    observe_intervention: bool = False
    """Whether the shield's last change is part of the observation."""
    normalise: bool = True
    """Whether observations, and for ``ppo`` rewards, are scaled by their running statistics."""
    steps: int = 1_000_000
    """Policy steps."""
    seed: int = 0
    envs: int = 8
    """Environments that are stepped together."""
    processes: bool = False
    """Whether every environment has a process of its own; it pays from about four cores on."""
    vector: bool | None = None
    """Whether all environments are stepped in one compiled call, which gives the same sooner; None: unless
    there are processes, or executed actions to learn from."""
    interval: int = 50_000
    """Policy steps between checkpoints, which are also the points of evaluation."""
    eval_episodes: int = 20
    """Episodes of an evaluation."""
    robot: str = DEFAULT
    """Name of a robot, or its file or prepared folder."""

    def __post_init__(self) -> None:
        known_name("task", self.task, TASKS)
        if self.human is not None:
            if is_file(self.human):
                load(self.human)
            else:
                known_name("human", self.human, HUMANS)
        known_name("control", self.control, get_args(Control))
        if not isinstance(self.robot, str):
            raise ParameterError(f"robot has to be a name, a file or a folder, got {self.robot!r}")
        if self.robot != DEFAULT:
            robot_identity(self.robot)  # there is such a robot
        if self.control == "tip" and self.robot not in ROBOTS:  # its policies hold the robot's name alone
            raise ParameterError(
                f"control='tip' needs one of the package's robots, {', '.join(ROBOTS)}, got {self.robot!r}; take "
                "control='velocity'"
            )
        known_name("learn_from", self.learn_from, ("policy", "executed", "penalty", "both"))
        check_fields(self, ("shield", "observe_intervention", "normalise", "processes"), true_or_false)
        if self.vector is not None:
            check_fields(self, ("vector",), true_or_false)
        if self.vector and self.processes:
            raise ParameterError("a vector is one process: give either vector or processes")
        if self.vector and self.stores_executed:
            raise ParameterError(
                f"learn_from={self.learn_from!r} asks every environment what it executed, which a vector does not "
                "tell: train without vector, or with learn_from='policy' or 'penalty'"
            )
        check_fields(self, ("ticks", "steps", "envs", "interval", "eval_episodes"), positive_integer)
        check_fields(self, ("seed",), whole_number)
        if self.seed > LARGEST_SEED:
            raise ParameterError(f"seed has to be at most {LARGEST_SEED}, got {self.seed}")
        check_fields(self, ("share",), number_within, LEAST_SHARE, 1.0)
        check_fields(self, ("penalty",), number_within, 0.0)
        if not isinstance(self.settings, Settings):
            raise ParameterError(f"settings have to be one of {', '.join(ALGORITHMS)}, got {self.settings!r}")
        if not self.shield and (self.learn_from != "policy" or self.observe_intervention):
            raise ParameterError(
                "without a shield there are no interventions to learn from or to observe: take learn_from='policy' and "
                "observe_intervention=False"
            )
        if self.stores_executed and not isinstance(self.settings, OffPolicy):
            raise ParameterError(
                f"{self.settings.algorithm} needs the probability with which its policy chose an action, and it did "
                f"not choose the executed one: learn_from={self.learn_from!r} needs an algorithm with a replay buffer, "
                "sac, td3 or tqc"
            )
        if isinstance(self.settings, PPO) and (
            self.settings.rollout % self.envs or self.settings.rollout < 2 * self.envs
        ):
            raise ParameterError(
                f"rollout has to be a multiple of the {self.envs} environments, at least {2 * self.envs}, got "
                f"{self.settings.rollout}"
            )

    @property
    def stores_executed(self) -> bool:
        """Whether the replay buffer gets executed actions."""
        return self.learn_from in ("executed", "both")

    @property
    def steps_as_vector(self) -> bool:
        """Whether environments are stepped in one compiled call."""
        return not (self.processes or self.stores_executed) if self.vector is None else self.vector

    @property
    def penalises(self) -> bool:
        """Whether interventions cost reward."""
        return self.learn_from in ("penalty", "both")

    def as_dict(self) -> dict[str, Any]:
        """The training as JSON can hold it."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if self.robot == DEFAULT:  # what was begun before there were others is the same as ever
            del values["robot"]
        if self.vector is None:
            del values["vector"]
        return {**values, "settings": self.settings.as_dict()}

    @classmethod
    def of(cls, data: dict[str, Any]) -> "TrainConfig":
        """The training that :meth:`as_dict` has written.

        Raises:
            ParameterError: It is not one.
        """
        try:
            settings: dict[str, Any] = dict(data["settings"])
            kind = ALGORITHMS[settings.pop("algorithm")]
            values: dict[str, Any] = {**data, "settings": kind(**settings)}
            return cls(**values)
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise ParameterError(f"this is no training: {error}") from error

    @property
    def digest(self) -> str:
        """What tells it from trainings whose results differ.

        How its environments are stepped does not count, and how long it goes on only if its learning rate depends on
        it.
        """
        data = {**self.as_dict(), "processes": False}
        data.pop("vector", None)
        if "robot" in data:
            data["robot"] = robot_identity(self.robot)
        if not self.settings.decay:
            data["steps"] = 0
        return sha256(json.dumps(data, sort_keys=True).encode())[:16]


_TIP: dict[str, Any] = {"control": "tip", "share": 1.0, "ticks": 25}
"""Where the goal is a point: commands of the tool, few and long. One that is held for 0.2 s matters more than one of
0.08 s, and nearer is better at once, so that a short horizon (``gamma``) will do."""


def _ppo(task: str, kind: type[PPO] = PPO) -> TrainConfig:
    settings = kind(rollout=1024, batch_size=128, learning_rate=7e-4, gamma=0.9, log_std=0.0)
    return TrainConfig(task=task, settings=settings, steps=300_000, interval=10_240, eval_episodes=40, **_TIP)


def _sac(task: str, kind: type[SAC] = SAC) -> TrainConfig:
    settings = kind(
        learning_rate=1e-3, batch_size=256, width=128, gamma=0.9, tau=0.01, updates=1.0, learning_starts=1000
    )
    return TrainConfig(task=task, settings=settings, steps=60_000, interval=5_000, eval_episodes=20, **_TIP)


PRESETS: dict[tuple[str, str], TrainConfig] = {
    ("reach", "sac"): replace(_sac("reach"), learn_from="executed", steps=30_000),
    ("reach", "ppo"): _ppo("reach"),
    ("handover", "ppo"): _ppo("handover"),
    ("reach", "ppo-lagrangian"): _ppo("reach", PPOLagrangian),
    ("reach", "sac-lagrangian"): _sac("reach", SACLagrangian),
}
"""Trainings that were tuned, by task and algorithm; what is missing has the defaults. With a limit on the cost they are
those without, told nothing of a shield."""


def tuned_algorithm(task: str) -> str:
    """The first algorithm that was tuned for a task; PPO where none was.

    Raises:
        ParameterError: The task is unknown.
    """
    known_name("task", task, TASKS)
    return next((algorithm for name, algorithm in PRESETS if name == task), "ppo")


def preset(task: str, algorithm: str) -> TrainConfig:
    """The tuned training of a task by an algorithm; see ``docs/training.md`` for how it was tuned.

    Raises:
        ParameterError: A name is unknown.
    """
    known_name("task", task, TASKS)
    settings = ALGORITHMS[known_name("algorithm", algorithm, ALGORITHMS)]()
    return PRESETS.get((task, algorithm), TrainConfig(task=task, settings=settings))
