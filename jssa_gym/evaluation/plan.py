"""What is played: cells, which are kinds of episodes, the seeds of each, and how an episode is made and measured."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import gymnasium as gym

from jssa_gym.evaluation.judgement import Judgement
from jssa_gym.evaluation.rows import Cell, Row, Setting
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import Policy
from jssa_gym.robots import RobotModel
from jssa_gym.types import Trace
from jssa_gym.validation import positive_integer

SPACING = 10_000
"""Most episodes of a cell: seeds of two cells differ by a multiple of it."""

AnyRow = TypeVar("AnyRow", bound=Row)
AnyCell = TypeVar("AnyCell", Setting, Cell)


class EpisodePlan(ABC, Generic[AnyRow]):
    """What is played. Every field takes part in the results; how many processes work at it does not.

    :class:`~jssa_gym.evaluation.study.Study` has all combinations of some names,
    :class:`~jssa_gym.evaluation.study.Single` an environment and a policy of one's own, and
    :class:`~jssa_gym.evaluation.campaign.Campaign` combinations that are to break shields.
    """

    __slots__ = ()

    row: ClassVar[type[Row]]
    """Class of an episode in numbers: a row of the table."""
    steps: int
    """Control steps of an episode."""

    @abstractmethod
    def seeds(self) -> dict[Any, list[int]]:
        """Seeds of every cell, in the order in which they are played."""

    @abstractmethod
    def config(self) -> dict[str, Any]:
        """All that decides about the results, as JSON can hold it."""

    @abstractmethod
    def make_env(self, cell: Any) -> gym.Env:
        """The environment of a cell."""

    @abstractmethod
    def make_policy(self, cell: Any, env: gym.Env, seed: int) -> Policy:
        """The policy of an episode in the environment of a cell.

        Raises:
            PolicyFileError: Its file is not what it was when the plan was made.
        """

    def named_policy(self, cell: Any) -> Any:
        """What :meth:`make_policy` makes it of: a name, or what a user gave."""
        return cell.policy

    @abstractmethod
    def measure(self, cell: Any, seed: int, trace: Trace, robot: RobotModel, begin: float) -> AnyRow:
        """An episode in numbers.

        Args:
            cell: What kind of episode it is.
            seed: Its seed.
            trace: Its recording.
            robot: The robot that it was recorded with.
            begin: When it began, by ``time.perf_counter`` [s].
        """

    @abstractmethod
    def origin(self, cell: Any, seed: int, digest: str) -> dict[str, Any]:
        """Where an episode comes from, for its recording."""

    def spoiled(self, cell: Any) -> bool:
        """Whether something is wrong on purpose, so that a shield's warnings of it are no news."""
        return False

    def doubts(self, row: AnyRow) -> bool:
        """Whether an episode is to be played again and judged by MuJoCo."""
        return False

    def judged(self, row: AnyRow, again: Trace, verdict: Judgement) -> AnyRow:
        """An episode with what playing it again and MuJoCo say about it."""
        return row

    def total(self) -> int:
        """How many episodes there are."""
        return sum(map(len, self.seeds().values()))


def episodes_of_a_cell(count: Any) -> int:
    """How many episodes a cell has.

    Raises:
        ParameterError: It is not in [1, 10000].
    """
    count = positive_integer("episodes", count)
    if count > SPACING:
        raise ParameterError(f"episodes has to be at most {SPACING} of a combination, got {count}")
    return count


def paired_seeds(
    wanted: Iterable[tuple[AnyCell, int]], seed: int, paired: Sequence[str] = ("filter",)
) -> dict[AnyCell, list[int]]:
    """Seeds of every cell: the same for cells that differ in nothing but ``paired``, others for others.

    Args:
        wanted: Cells, each with its number of episodes, at most :data:`SPACING`.
        seed: The first one.
        paired: Fields of a cell.
    """
    alike: dict[str, Any] = dict.fromkeys(paired, "")
    first: dict[Setting | Cell, int] = {}
    seeds: dict[AnyCell, list[int]] = {}
    for cell, episodes in wanted:
        start = first.setdefault(cell._replace(**alike), seed + SPACING * len(first))
        if episodes > len(seeds.get(cell, ())):
            seeds[cell] = list(range(start, start + episodes))
    return seeds
