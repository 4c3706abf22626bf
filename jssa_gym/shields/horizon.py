"""One control step ahead: index and rows of all pairs, in memory that is made once."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.printed import measure_present, printed_rows
from jssa_gym.kernels.records import FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.kernels.tick import look_ahead, look_back, rows_ahead
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array, HalfSpaces


class Horizon:
    """The arm and its agents now and one step later, and the rows that follow; :meth:`meet` says whom it meets.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        index: Parameters of the safety index.
    """

    def __init__(self, robot: RobotModel, dt: float, index: IndexParams) -> None:
        self.robot, self.dt = robot, dt
        self._index, self._parameters = index.kernel(), index.array()
        # the arm at the end of the step, and at its beginning
        self._after, self._before = np.zeros((3, robot.n)), np.zeros((3, robot.n))
        self._frames, self._frames_now = records(robot.n, FRAME), records(robot.n, FRAME)
        self._segments, self._segments_now = (records(len(robot.capsules), SEGMENT) for _ in range(2))
        self._planes = records(0, PLANE)
        self._resize(0)

    @property
    def columns(self) -> int:
        """Agents and half-spaces: pairs a robot capsule."""
        return self._pairs.shape[1]

    def meet(self, agents: int, planes: NDArray) -> None:
        """From now on there are so many agents and these half-spaces (p,) of ``PLANE``."""
        self._planes = planes
        if self.columns != agents + len(planes):
            self._resize(agents + len(planes))

    def _resize(self, columns: int) -> None:
        count = len(self._segments) * columns
        self._pairs, self._pairs_now = (records((len(self._segments), columns), PAIR) for _ in range(2))
        self._L = np.zeros((max(count, 1), self.robot.n))
        self._S = np.zeros(max(count, 1))
        self._owner = np.zeros(max(count, 1), np.int64)
        self._target = np.zeros(max(count, 1))

    def rows(self, count: int) -> HalfSpaces:
        """The first rows that were made last."""
        return HalfSpaces(self._L[:count], self._S[:count])

    def ahead(
        self, state: Array, agents: NDArray, jerk: Array, humans: int, move: bool, rows: int
    ) -> tuple[float, float, int, int, float]:
        """Look ahead under ``jerk`` (n,); see :func:`~jssa_gym.kernels.tick.look_ahead`."""
        return look_ahead(
            self.robot.links,
            self.robot.capsules,
            state,
            jerk,
            agents,
            self._planes,
            humans,
            self.dt,
            self._parameters,
            move,
            self._after,
            self._frames,
            self._segments,
            self._pairs,
            self._owner,
            self._target,
            rows,
        )

    def look_back(self, state: Array, agents: NDArray) -> None:
        """Index of every pair at the beginning of the step."""
        look_back(
            self.robot.links,
            self.robot.capsules,
            state,
            agents,
            self._planes,
            self.dt,
            self._parameters,
            self._before,
            self._frames_now,
            self._segments_now,
            self._pairs_now,
        )

    def rows_at(
        self,
        agents: NDArray,
        jerk: Array,
        only: int,
        lower: Array,
        upper: Array,
        bound: Array,
        authority: float,
        recovery: float,
    ) -> tuple[int, float, bool]:
        """Make the exact rows at ``jerk`` (n,); see :func:`~jssa_gym.kernels.tick.rows_ahead`."""
        return rows_ahead(
            self._frames,
            self._segments,
            agents,
            self._planes,
            self._pairs,
            jerk,
            lower,
            upper,
            self.dt,
            self._parameters,
            only,
            bound,
            authority,
            recovery,
            self._pairs_now,
            self._L,
            self._S,
            self._owner,
            self._target,
        )

    def measure(self, state: Array, agents: NDArray) -> tuple[int, int, float]:
        """Distances at the present, for :meth:`printed`: row and column of the closest pair, and its distance."""
        return measure_present(
            self.robot.links, self.robot.capsules, state, agents, self._frames, self._segments, self._pairs
        )

    def printed(self, agents: NDArray, only: int, lower: Array, upper: Array, authority: float) -> int:
        """Make the rows of Eq. (13) as printed; how many there are."""
        return printed_rows(
            self._frames,
            self._segments,
            agents,
            self._pairs,
            lower,
            upper,
            self.dt,
            self._index,
            only,
            authority,
            self._L,
            self._S,
            self._owner,
        )
