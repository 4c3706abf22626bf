"""What filters share that decide from the distances of all pairs as they are now."""

from abc import abstractmethod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.derivatives import derivatives
from jssa_gym.kernels.records import FRAME, PAIR, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.reasons import of_clipping
from jssa_gym.types import Array, Decision, Scene, Status

Rows = Literal["closest", "all"]
"""Which pairs a filter answers."""
ROWS = ("closest", "all")

_AUTHORITY = 5.0
"""Pairs that the jerk bounds move by less than this normal jerk [m/s³] make no rows, as in JSSAFilter."""


class PairFilter(SafetyFilter):
    r"""A filter that looks at the pairs of robot and human capsules at the present time.

    A subclass implements :meth:`_respond`, which finds, a row a pair: ``self._motion`` (p, 4), that is
    :math:`D, \dot D, \ddot D` and :math:`\dddot D` at zero joint jerk; ``self._rows`` (p, n), that is
    :math:`n^\top J`; ``self._normals`` (p, 3); and ``self._phi`` (p,), the index of Eq. (6) with the parameters that
    the subclass gave. Decisions hold this measured index and distance, not predicted ones.
    """

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: Any = None,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        super().__init__(robot, dt, params, viability=viability, failsafe=failsafe)
        # d_min, lambda1, lambda2 of the index; the sliding term is left out
        self._index = np.array([*self._coefficients(), 0.0, 1.0, 0.0])
        self._frames, self._segments = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
        self._resize(0)

    def _coefficients(self) -> tuple[float, float, float]:
        r""":math:`d_{min}, \lambda_1, \lambda_2` of the index that the filter reports."""
        return 0.0, 0.0, 0.0

    def _resize(self, columns: int) -> None:
        count = len(self._segments) * columns
        self._pairs = records((len(self._segments), columns), PAIR)
        self._motion, self._rows = np.zeros((count, 4)), np.zeros((count, self.robot.n))
        self._normals = np.zeros((count, 3))
        self._pair, self._distance, self._closest = (-1, -1), np.inf, -1

    @property
    def _phi(self) -> Array:
        # made when it is read: a view that is kept would be parted from its array where the filter is copied
        return self._pairs["phi"].reshape(-1)

    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        if self._pairs.shape[1] != len(agents):
            self._resize(len(agents))
        row, column, self._distance = derivatives(
            self.robot.links,
            self.robot.capsules,
            state,
            agents,
            self._index,
            self._frames,
            self._segments,
            self._pairs,
            self._motion,
            self._rows,
            self._normals,
        )
        self._pair, self._closest = (row, column), row * len(agents) + column
        if row < 0:
            return self._untouched(nominal, inside, -np.inf)
        if not np.isfinite(self._motion).all() or np.isnan(self._phi).any():
            return self._failed(nominal, "a distance or one of its derivatives is not finite")
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is found by its value
            return self._respond(nominal, inside)

    @abstractmethod
    def _respond(self, nominal: Array, inside: bool) -> Decision:
        """Decide with somebody there; ``self._state`` and ``self._clipped`` as in :meth:`_filter`."""

    def _watched(self, rows: Rows) -> NDArray[np.intp]:
        """Numbers of the pairs that make rows: the closest, or all that the jerk bounds move noticeably."""
        if rows == "closest":
            return np.array([self._closest])
        return np.flatnonzero(~(np.abs(self._rows) @ self._bounds[4] < _AUTHORITY))

    def _rate(self, pairs: NDArray[np.intp]) -> Array:
        """Rate of the index of some pairs at zero joint jerk [m²/s]."""
        D, rate, curvature, drift = self._motion[pairs].T
        return -2.0 * np.abs(D) * rate - self._index[1] * curvature - self._index[2] * drift

    def _foresee(self, jerk: Array) -> tuple[float, float, tuple[int, int]]:
        return self._shown, self._distance, self._pair

    def _amended(self, decision: Decision, held: int, halt: Array) -> Array:
        """Asked once more, in a box that leaves the held joints no choice."""
        if self._closest < 0:
            return super()._amended(decision, held, halt)
        with self._held(decision.nominal, held, halt), np.errstate(over="ignore", invalid="ignore"):
            answer = self._respond(decision.nominal, False)
        return super()._amended(decision, held, halt) if answer.status == Status.FAULT else answer.jerk

    def _untouched(self, nominal: Array, inside: bool, phi: float) -> Decision:
        """Nothing stands against the nominal but perhaps the box."""
        status, reason = Status.NOMINAL, ""
        if not inside:
            status, reason = Status.PROJECTED, of_clipping(nominal, self._clipped, self._bounds[4])
        return self._decided(self._clipped.copy(), nominal, status, reason, phi)

    def _decided(
        self,
        jerk: Array,
        nominal: Array,
        status: Status,
        reason: str,
        phi: float,
        slack: float = 0.0,
        rows: int = 0,
    ) -> Decision:
        self._shown = float(phi)
        return Decision(jerk, nominal, status, reason, self._shown, self._distance, self._pair, float(slack), rows)
