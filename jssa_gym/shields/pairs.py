"""What filters share that decide from the distances of all pairs as they are now."""

from abc import abstractmethod

import numpy as np

from jssa_gym.safety.pairs import Pairs
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.reasons import REASONS
from jssa_gym.shields.tick import Tick
from jssa_gym.tick import codes
from jssa_gym.types import Array, Decision, Status


class PairFilter(SafetyFilter):
    r"""A filter that looks at the pairs of robot and human capsules at the present time.

    A subclass implements :meth:`answer`. Decisions hold the measured index, of :meth:`coefficients`, and the measured
    distance, not predicted ones.
    """

    def coefficients(self) -> tuple[float, float, float]:
        r""":math:`d_{min}, \lambda_1, \lambda_2` of the index that the filter reports."""
        return 0.0, 0.0, 0.0

    @abstractmethod
    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        """Decide with somebody there; ``index`` (p,) is that of the pairs [m²]."""

    def respond(self, tick: Tick) -> Decision:
        """Measure the pairs, and let :meth:`answer` decide."""
        pairs = tick.pairs
        if pairs.closest < 0:
            return self.untouched(tick, -np.inf)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is found by its value
            index = pairs.index(*self.coefficients())
            if not np.isfinite(pairs.motion).all() or np.isnan(index).any():
                return self.failed(tick, REASONS[codes.DERIVATIVE])
            return self.answer(tick, pairs, index)

    def amend(self, tick: Tick, decision: Decision, held: int, halt: Array) -> Array:
        """Asked once more, in a box that leaves the held joints no choice."""
        answer = self.respond(tick.holding(held, halt)) if tick.pairs.closest >= 0 else None
        if answer is None or answer.status == Status.FAULT:
            return super().amend(tick, decision, held, halt)
        return answer.jerk

    def foresee(self, decision: Decision, jerk: Array) -> tuple[float, float, tuple[int, int]]:
        """What is measured stays as it is."""
        return decision.phi, decision.distance, decision.pair

    def untouched(self, tick: Tick, phi: float) -> Decision:
        """Nothing stands against the nominal but perhaps the box."""
        status, reason = (Status.NOMINAL, "") if tick.inside else (Status.PROJECTED, tick.why_clipped)
        return self.decided(tick, tick.clipped, status, reason, phi)

    def decided(
        self, tick: Tick, jerk: Array, status: Status, reason: str, phi: float, slack: float = 0.0, rows: int = 0
    ) -> Decision:
        """A decision with what is measured."""
        pairs = tick.pairs
        return Decision(
            jerk, tick.nominal, status, reason, float(phi), pairs.distance, pairs.pair, float(slack), rows
        )  # fmt: skip
