"""Somebody's own filter or policy on the seeds that are on the leaderboard."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import gymnasium as gym

from jssa_gym.board.episodes import Board, BoardCell, Episodes
from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.evaluation.factories import load_factory
from jssa_gym.evaluation.identity import code_digest
from jssa_gym.evaluation.metrics import SeparationParams
from jssa_gym.evaluation.people import make_person
from jssa_gym.evaluation.policy import check_unchanged, make_policy, policy_code, policy_factory
from jssa_gym.evaluation.rows import Setting
from jssa_gym.evaluation.study import Evaluation, put_filter
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import Policy
from jssa_gym.robots import DEFAULT, make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import STOP, SafetyFilter, Shield, read_name
from jssa_gym.validation import known_name, positive_integer

PURPOSEFUL = "jpc"
"""Policy of the board in whose place a submitted one acts."""


@dataclass(frozen=True, slots=True)
class Submission(Evaluation):
    """What is played of a submission: cells of the board, each on the first seeds that it has there.

    Raises:
        ParameterError: There are no such cells, the filter or policy cannot be loaded, or a number is out of range.
    """

    by_name: ClassVar[bool] = False

    cells: tuple[tuple[BoardCell, tuple[int, ...]], ...]
    """Cells of the board, with their seeds."""
    filter: str
    """As :func:`~jssa_gym.shields.read_name` reads it, or ``"module:factory"``, see :func:`filter_factory`."""
    policy: str = ""
    """In the place of ``jpc``: name, file or ``"module:factory"``; empty for the board's own policies."""
    episodes: int = 0
    """Most of a cell; 0 for all."""
    seed: int = 0
    steps: int = 1000
    v_safe: float = MOVING
    separation: SeparationParams = field(default_factory=SeparationParams)
    trust_pickle: bool = False
    code: tuple[str, str] = field(init=False, repr=False)
    """Digests of the files that define filter and policy, when the submission was made."""

    def __post_init__(self) -> None:
        if self.episodes:
            kept = positive_integer("episodes", self.episodes)
            object.__setattr__(self, "cells", tuple((cell, seeds[:kept]) for cell, seeds in self.cells))
        object.__setattr__(self, "episodes", max((len(seeds) for _, seeds in self.cells), default=1))
        Evaluation.__post_init__(self)
        if not self.cells:
            raise ParameterError("no cell of the leaderboard has these tasks, people and policies")
        if ":" in self.filter:
            code = code_digest(filter_factory(self.filter))
        else:
            read_name(self.filter)
            code = ""
        if self.policy:
            policy_factory(self.policy, self.trust_pickle)
        object.__setattr__(self, "code", (code, policy_code(self.policy) if self.policy else ""))

    @classmethod
    def of(
        cls,
        board: Board,
        filter: str,
        policy: str = "",
        *,
        tasks: Sequence[str] = (),
        humans: Sequence[str] = (),
        episodes: int = 0,
        trust_pickle: bool = False,
    ) -> "Submission":
        """The submission to a board.

        Args:
            board: The leaderboard.
            filter, policy, episodes, trust_pickle: As the fields.
            tasks, humans: Only these; all without any.
        """
        for task in tasks:
            known_name("task", task, sorted({cell[0] for cell in board.episodes}))
        for human in humans:
            known_name("human", human, sorted({cell[1] for cell in board.episodes}))
        cells = tuple(
            (cell, tuple(sorted(next(iter(filters.values())))))
            for cell, filters in board.episodes.items()
            if (not tasks or cell[0] in tasks)
            and (not humans or cell[1] in humans)
            and (not policy or cell[2] == PURPOSEFUL)
        )
        asked = board.asked[0]
        return cls(
            cells,
            filter,
            policy,
            episodes,
            steps=asked["steps"],
            v_safe=asked["v_safe"],
            separation=SeparationParams(**asked["separation"]),
            trust_pickle=trust_pickle,
        )

    @property
    def label(self) -> str:
        """What it is called in the tables."""
        return f"{self.policy} in {self.filter}" if self.policy else self.filter

    def seeds(self) -> dict[Setting, list[int]]:
        """Seeds of every setting, the board's."""
        return {
            Setting(task, self.filter, human, self.policy or policy): list(seeds)
            for (task, human, policy), seeds in self.cells
        }

    def config(self) -> dict[str, Any]:
        told = asdict(self)
        return {**told, "cells": [[*cell, seeds[0], len(seeds)] for cell, seeds in self.cells]}

    def make_env(self, cell: Setting) -> gym.Env:
        env = ArmEnv(cell.task, human=make_person(cell.human), terminate_on=())
        if ":" not in self.filter:
            return put_filter(env, self.filter)
        made = filter_factory(self.filter)(env.robot, env.dt, **_stop_options(self.filter))
        if not isinstance(made, SafetyFilter):
            raise ParameterError(f"{self.filter} has to make a SafetyFilter, got {type(made).__name__}")
        return Shield(env, made)

    def uncovered(self) -> tuple[str, ...]:
        return make_robot(DEFAULT).uncovered

    def make_policy(self, cell: Setting, env: gym.Env, seed: int) -> Policy:
        policy = make_policy(cell.policy, env.unwrapped, seed, seen=env, trust_pickle=self.trust_pickle)
        if self.policy:
            check_unchanged(self.policy, self.code[1])
        return policy

    def beside(self, board: Board, played: Episodes) -> Episodes:
        """The cells that were played, of everybody on the board and of this submission, on the same seeds.

        Args:
            board: The leaderboard.
            played: This submission's episodes.
        """
        both: Episodes = {}
        for (task, human, policy), seeds in self.cells:
            own = played[task, human, self.policy or policy][self.filter]
            others = {
                name: {seed: episodes[seed] for seed in seeds if seed in episodes}
                for name, episodes in board.episodes[task, human, policy].items()
                if name != self.label
            }
            both[task, human, policy] = {**others, self.label: own}
        return both


def filter_factory(name: str) -> Callable[..., SafetyFilter]:
    """What makes a filter for a robot and a control step of ``"package.module:factory"``: a class, or a function.

    With ``+stop`` behind the name it is called with ``viability=True`` and ``failsafe=FailsafeParams()`` as well.

    Raises:
        ParameterError: It cannot be loaded, or called with the two.
    """
    options = _stop_options(name)
    asked = ", viability=True and failsafe=FailsafeParams()" if options else ""
    called = f"a robot, a control step{asked}, and takes others"
    return load_factory("filter", name, "a robot and a control step", None, 0.0, called=called, suffix=STOP, **options)


def _stop_options(name: str) -> dict[str, Any]:
    """What a filter is made with beside robot and control step: with ``+stop`` behind its name the layers."""
    return {"viability": True, "failsafe": FailsafeParams()} if name.endswith(STOP) else {}
