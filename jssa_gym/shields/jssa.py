"""The jerk-based safe set algorithm as a filter."""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.contact import unsound
from jssa_gym.kernels.printed import printed_rows
from jssa_gym.kernels.projection import violation
from jssa_gym.kernels.records import AGENT, PLANE, records
from jssa_gym.kernels.tick import rows_ahead
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.projectors import PROJECTORS
from jssa_gym.safety.proximity import agent_records, plane_records
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.horizon import Horizon
from jssa_gym.shields.reasons import of_clipping
from jssa_gym.types import Array, Decision, Scene, Status
from jssa_gym.validation import known_name, positive_number

_TOLERANCE = 1e-6
"""Index [m²] up to which a row counts as kept once the arm's true motion is computed."""

_LINEARISATIONS = 3
"""How often the exact row is linearised anew at the projected jerk; once is the rule."""


class _UnsolvedError(Exception):
    """There is no jerk to go on with; the message says why."""


class JSSAFilter(SafetyFilter):
    r"""Keeps :math:`\phi_{k+1} \le 0` (Eq. 6) by the nearest jerk in rows and box, Eq. (14).

    The nominal is kept bit for bit if it satisfies box and rows. Else the rows are linearised at it, the projection
    is computed, and the index is evaluated again with the arm's true motion; what linearisation missed is projected
    once more. When box and rows exclude each other the rows' common violation is made as small as possible, and the
    decision says RELAXED.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        index: Parameters of the safety index.
        rows: ``"all"`` robot-human pairs, or the ``"closest"`` one as in the paper.
        gradient: ``"exact"``, or ``"printed"`` for Eq. (11)-(13) to the letter (surface points, plain square, the
            printed L, which is about twice the true gradient).
        projector: ``"exact"`` or ``"osqp"``.
        weight: V of Eq. (14): None for the identity, a diagonal (n,), or a full (n, n).
        static_rows: Whether table, floor and static capsules make rows too.
        min_authority: Rows of pairs that the jerks move by less than this normal jerk [m/s³] are left out.
        recovery: Share of its authority by which an index above 0 has to fall in a step: 0.5 asks for
            :math:`\phi_{k+1} \le \max(0, \phi_k - \eta\tau)` with half of the fastest possible rate; 0 for 0 at once.
        viability, failsafe: See :class:`~jssa_gym.shields.filter.SafetyFilter`.

    Raises:
        ParameterError: An option is unknown or a number out of range; the message says what is valid.
    """

    params_type = IndexParams

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        index: IndexParams | None = None,
        *,
        rows: Literal["all", "closest"] = "all",
        gradient: Literal["exact", "printed"] = "exact",
        projector: Literal["exact", "osqp"] = "exact",
        weight: ArrayLike | None = None,
        static_rows: bool = False,
        min_authority: float = 5.0,
        recovery: float = 0.5,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        super().__init__(robot, dt, index, viability=viability, failsafe=failsafe)
        known_name("rows", rows, ("all", "closest"))
        known_name("gradient", gradient, ("exact", "printed"))
        known_name("projector", projector, PROJECTORS)
        if min_authority != 0.0:
            min_authority = positive_number("min_authority", min_authority)
        if not isinstance(static_rows, bool):
            raise ParameterError(f"static_rows has to be True or False, got {static_rows!r}")
        if static_rows and (gradient == "printed" or rows == "closest"):
            raise ParameterError(
                "the printed row and the closest pair are for humans only: static_rows needs gradient='exact' "
                "and rows='all'"
            )
        if recovery != 0.0 and not positive_number("recovery", recovery) <= 1.0:
            raise ParameterError(f"recovery has to be between 0 and 1, got {recovery!r}")
        self.recovery = float(recovery)
        self.index: IndexParams = self.params
        self.rows, self.gradient, self.static_rows = rows, gradient, static_rows
        self._projector = PROJECTORS[projector](robot.n, weight)
        self._authority = min_authority * self.index.lambda2 * self.dt
        self._horizon = Horizon(robot, self.dt, self.index)
        announce_compilation(printed_rows if gradient == "printed" else rows_ahead)
        self._static_agents, self._planes = records(0, AGENT), records(0, PLANE)
        self._all_agents = records(0, AGENT)

    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        humans = len(agents)
        if self.static_rows:
            agents = self._with_static(scene, agents)
        self._horizon.meet(len(agents), self._planes)
        if self.gradient == "printed":
            return self._printed(state, agents, nominal, inside)
        return self._exact(state, agents, humans, nominal, inside)

    def _with_static(self, scene: Scene, agents: NDArray) -> NDArray:
        """Humans, then static capsules; the half-spaces go to ``self._planes``. Raises if they are no such thing."""
        static, self._planes = agent_records(scene.static, self._static_agents), plane_records(scene.planes)
        self._static_agents = static
        if unsound(self._state, self._clipped, static):
            raise ValueError("a static capsule is not finite")
        normals, offsets = self._planes["normal"], self._planes["offset"]
        if not (np.all(np.abs(np.linalg.norm(normals, axis=-1) - 1.0) < 1e-6) and np.all(np.isfinite(offsets))):
            raise ValueError("a half-space needs a unit normal and a finite offset")
        if len(self._all_agents) != len(agents) + len(static):
            self._all_agents = records(len(agents) + len(static), AGENT)
        self._all_agents[: len(agents)] = agents
        self._all_agents[len(agents) :] = static
        return self._all_agents

    def _foresee(self, jerk: Array) -> tuple[float, float, tuple[int, int]]:
        if self.gradient == "printed":
            return super()._foresee(jerk)
        # the agents are at the end of the step since the rows were made
        worst, _, row, column, distance = self._horizon.ahead(self._state, self._seen, jerk, self._humans, False, 0)
        return worst, distance, (row, column)

    def _exact(self, state: Array, agents: NDArray, humans: int, nominal: Array, inside: bool) -> Decision:
        """Exact rows; ``agents`` are moved to the end of the step."""
        self._seen, self._humans = agents, humans
        try:
            kept, recovering, jerk, left, rows, note, worst, distance, pair = self._solve(nominal, True)
        except _UnsolvedError as error:
            return self._failed(nominal, str(error))
        decision = self._decision(nominal, jerk, inside, kept, left, rows, note, worst, distance, pair)
        if recovering and decision.status == Status.PROJECTED:
            return decision._replace(status=Status.RELAXED, reason="recovering" + (f"; {note}" if note else ""))
        return decision

    def _amended(self, decision: Decision, held: int, halt: Array) -> Array:
        """Projected once more, in a box that leaves the held joints no choice."""
        if self.gradient == "printed":
            return super()._amended(decision, held, halt)
        try:
            with self._held(decision.nominal, held, halt):
                return self._solve(decision.nominal, False)[2].copy()
        except _UnsolvedError:
            return super()._amended(decision, held, halt)

    def _solve(
        self, nominal: Array, move: bool
    ) -> tuple[bool, bool, Array, float, int, str, float, float, tuple[int, int]]:
        """Project the nominal into rows and box; moves the agents to the end of the step first if asked to.

        Returns:
            Whether the rows are kept, whether some are recovering, the jerk, what is left of the rows [m²], their
            number, the projector's note; index, distance and pair at the end of the step.
        """
        state, agents, humans, horizon = self._state, self._seen, self._humans, self._horizon
        jerk, feasible, left, rows, note, recovering = self._clipped, True, 0.0, 0, "", False
        worst, _, row, column, distance = horizon.ahead(state, agents, jerk, humans, move, 0)
        if not worst < np.inf:
            raise _UnsolvedError("the safety index is not finite")
        if worst > 0.0:
            only = -1
            if self.rows == "closest":
                only = row * horizon.columns + column
            if self.recovery > 0.0:
                horizon.look_back(state, agents)
            left = np.nan
            for attempt in range(_LINEARISATIONS + 1):
                count, left, below = horizon.rows_at(
                    agents, jerk, only, self.lower, self.upper, self._bounds[4], self._authority, self.recovery
                )
                if left <= (_TOLERANCE if attempt else 0.0) or attempt == _LINEARISATIONS:
                    break
                rows, recovering = count, below
                projection = self._projector.project(nominal, horizon.rows(count), self.lower, self.upper)
                jerk, feasible, note = projection.jerk, projection.feasible, projection.note
                if math.isnan(projection.violation):
                    raise _UnsolvedError("the projection found no solution")
                worst, left, row, column, distance = horizon.ahead(state, agents, jerk, humans, False, rows)
                if left <= _TOLERANCE or not feasible:
                    break
            if not (left < np.inf and worst < np.inf):
                raise _UnsolvedError("the safety index is not finite")
        kept = feasible and left <= _TOLERANCE
        return kept, recovering, jerk, left, rows, note, worst, distance, (row, column)

    def _printed(self, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        """Rows of Eq. (13) from the present, projected once; the index is their own S - L u."""
        horizon = self._horizon
        row, column, distance = horizon.measure(state, agents)
        jerk, feasible, left, rows, note, phi = self._clipped, True, 0.0, 0, "", -np.inf
        if row >= 0:
            only = row * len(agents) + column if self.rows == "closest" else -1
            authority = 0.0 if self.rows == "closest" else self._authority
            made = horizon.rows(horizon.printed(agents, only, self.lower, self.upper, authority))
            count = len(made.S)
            left = violation(made.L, made.S, count, jerk)
            if not (left <= 0.0):
                rows = count
                jerk, feasible, left, note = self._projector.project(nominal, made, self.lower, self.upper)
            phi = max((made.S[i] - made.L[i] @ jerk for i in range(count)), default=-np.inf)
            if not (left < np.inf and phi < np.inf):
                return self._failed(nominal, "the printed row is not finite")
        return self._decision(nominal, jerk, inside, feasible, left, rows, note, phi, distance, (row, column))

    def _decision(
        self,
        nominal: Array,
        jerk: Array,
        inside: bool,
        kept: bool,
        left: float,
        rows: int,
        note: str,
        phi: float,
        distance: float,
        pair: tuple[int, int],
    ) -> Decision:
        if rows == 0 and kept:
            jerk = jerk.copy()
            status, reason = Status.NOMINAL, ""
            if not inside:
                status, reason = Status.PROJECTED, of_clipping(nominal, self._clipped, self._bounds[4])
        elif kept:
            status, reason = Status.PROJECTED, "safety rows"
        else:
            status, reason = Status.RELAXED, "no jerk keeps all rows"
        if note:
            reason = f"{reason}; {note}"
        return Decision(jerk, nominal, status, reason, phi, distance, pair, max(left, 0.0), rows)
