"""What a data set is made of."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.people import make_person
from jssa_gym.evaluation.play import POLICY_SEEDS
from jssa_gym.evaluation.rows import Setting
from jssa_gym.evaluation.study import Study, put_filter
from jssa_gym.humans import HUMANS
from jssa_gym.humans.files import is_file
from jssa_gym.policies import Policy
from jssa_gym.registration import ENTRIES, HORIZON
from jssa_gym.robots import DEFAULT
from jssa_gym.shields import TASK_SHIELD
from jssa_gym.validation import known_name


@dataclass(frozen=True, slots=True)
class Recipe:
    """All that decides about a data set.

    Episodes end as those of the task's id do: by success, a moving contact, or the horizon.

    Raises:
        ParameterError: An unknown name or a number out of range.
    """

    task: str = "reach"
    policy: str = "jpc"
    """Name, file, or ``"package.module:factory"``."""
    shield: str = TASK_SHIELD
    """As :func:`~jssa_gym.shields.read_name` reads it; ``"none"`` leaves every jerk as it is."""
    human: str = ""
    """People by name or a file; empty for the task's own."""
    episodes: int = 100
    seed: int = 0
    """Seed of the first episode; episode k has seed + k."""
    steps: int = HORIZON
    """Control steps of an episode, at most."""
    robot: str = DEFAULT
    trust_pickle: bool = False
    """See :func:`~jssa_gym.policies.load_policy`."""

    def __post_init__(self) -> None:
        known_name("task", self.task, TASKS)
        object.__setattr__(self, "human", self.human or TASKS[self.task].human)
        study = self.study()
        for name in ("episodes", "seed", "steps"):
            object.__setattr__(self, name, getattr(study, name))  # JSON holds no numbers of numpy

    def study(self) -> Study:
        """The evaluation of the same names: its rules are those of a data set."""
        names = ((name,) for name in self.cell)
        return Study(
            *names,
            episodes=self.episodes,
            seed=self.seed,
            steps=self.steps,
            trust_pickle=self.trust_pickle,
            robot=self.robot,
        )

    @property
    def cell(self) -> Setting:
        """Its names."""
        return Setting(self.task, self.shield, self.human, self.policy)

    @property
    def name(self) -> str:
        """Name of the data set where it has no other, with namespace and version, as Minari's are."""
        policy = Path(self.policy).stem if self.policy.endswith((".npz", ".zip")) else self.policy
        human = Path(self.human).stem if is_file(self.human) else self.human
        parts = (re.sub(r"\W+", "-", part) for part in (self.task, policy, self.shield, human))
        return f"jssa_gym/{'-'.join(parts)}-v0"

    def make_env(self) -> gym.Env:
        """The environment of the task's id, and the shield around it."""
        # a name stays one, so that the environment's spec can be written down
        human: Any = self.human if self.human in HUMANS or is_file(self.human) else make_person(self.human)
        options: dict[str, Any] = {} if self.robot == DEFAULT else {"robot": self.robot}
        env = gym.make(ENTRIES[self.task].env_id(), human=human, max_episode_steps=self.steps, **options)
        return put_filter(env, self.shield)

    def make_policy(self, env: gym.Env, seed: int) -> Policy:
        """The policy of the episode with a seed."""
        return self.study().make_policy(self.cell, env, POLICY_SEEDS + seed)
