"""The jerk-based safe set algorithm as a filter."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.projectors import PROJECTORS
from jssa_gym.shields.filter import SafetyFilter, Tick
from jssa_gym.tick import layout, loop
from jssa_gym.tick.proposals.exact import ExactRows
from jssa_gym.tick.proposals.printed import PrintedRows
from jssa_gym.tick.proposals.rows import PROJECT
from jssa_gym.types import Array, Decision, HalfSpaces, Status
from jssa_gym.validation import known_name, positive_number, true_or_false


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
    fixed = SafetyFilter.fixed | {"index", "rows", "gradient", "static_rows", "recovery"}

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
        static_rows = true_or_false("static_rows", static_rows)
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
        self.projector = PROJECTORS[projector](robot.n, weight)
        """Projector of the nominal onto the rows; the exact one is part of the compiled step and cannot be replaced."""
        self._foreign = projector != "exact"
        self._authority = min_authority * self.index.lambda2 * self.dt

    @property
    def proposal(self) -> ExactRows | PrintedRows:
        """Exact rows, or those of the paper."""
        index, closest, authority = self.index.kernel(), self.rows == "closest", float(self._authority)
        if self.gradient == "printed":
            return PrintedRows(index, closest, authority)
        return ExactRows(index, closest, authority, self.recovery)

    @property
    def compiled(self) -> bool:
        return super().compiled and not self._foreign

    def settings(self) -> layout.StepSettings:
        """The numbers that the control step goes by."""
        return super().settings()._replace(static_rows=self.static_rows, **self.projector.metric())

    def respond(self, tick: Tick) -> Decision:
        """The compiled step's rows, projected by whatever projector this filter has."""
        code, note = self._solve(tick, True)
        view = self.records.view
        loop.name_status(view.arms, view.nominal, code)
        return self._proposed(tick, note)

    def amend(self, tick: Tick, decision: Decision, held: int, halt: Array) -> Array:
        """Projected once more, in a box that leaves the held joints no choice."""
        if self.gradient == "printed":
            return super().amend(tick, decision, held, halt)
        work, narrow = self.records.work, tick.holding(held, halt)
        box = work.lower.copy(), work.upper.copy()
        work.lower[:], work.upper[:], work.clipped[:] = narrow.lower, narrow.upper, narrow.clipped
        code, _ = self._solve(narrow, False)
        work.lower[:], work.upper[:] = box
        if code // 100 == Status.FAULT:
            return np.concatenate([halt[:held], decision.jerk[held:]])
        return work.wanted.copy()

    def _solve(self, tick: Tick, first: bool) -> tuple[int, str]:
        """A jerk into the step's ``wanted``: what became of the nominal, as a code, and the projector's note."""
        view, work, note = self.records.view, self.records.work, ""
        told = view.told if first else work.told
        stage = loop.begin_rows(view.arms, view.nominal, first)
        while stage == PROJECT:
            count = int(told["rows"][0])
            rows = HalfSpaces(work.L[:count], work.S[:count])
            jerk, feasible, left, note = self.projector.project(tick.nominal, rows, tick.lower, tick.upper)
            work.wanted[:] = jerk
            stage = loop.after_projection(view.arms, view.nominal, bool(feasible), float(left), first)
        return stage, note
