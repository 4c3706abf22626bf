"""A filter's control step for whoever has no environment: the same step, in records that are made once."""

import math
from typing import Any, NamedTuple

import numpy as np

from jssa_gym.kernels.rest import at_rest
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.reading import words_of
from jssa_gym.shields.reasons import BAD_INPUTS
from jssa_gym.shields.records import ONE
from jssa_gym.shields.words import Told
from jssa_gym.tick import loop
from jssa_gym.types import Array, Scene, Status

_STATUSES = tuple(Status)


class Outcome(NamedTuple):
    """What became of a nominal; the jerk is :attr:`InPlace.jerk`."""

    status: Status
    reason: str
    margin: float
    """See :class:`~jssa_gym.types.Decision`."""


class InPlace:
    """Decides like :meth:`SafetyFilter.decide`, by the same compiled step, and allocates nothing.

    The clock of its scenes is that of whoever asks, for one decision a tick
    (:attr:`~jssa_gym.tick.layout.StepSettings.paced`).

    Args:
        filter: With a verified stop; it belongs to this object from now on.
    """

    def __init__(self, filter: SafetyFilter) -> None:
        self._filter = filter
        records = filter.records
        records.settings = records.settings._replace(paced=True)

    @property
    def state(self) -> Array:
        """Where the applied jerks have led, the last one included, shape (3, n): the filter's own."""
        return self._filter.expected

    @property
    def jerk(self) -> Array:
        """The last decision's, shape (n,) [rad/s³]: the filter's own."""
        return self._filter.records.view.jerk

    @property
    def failsafe(self) -> FailsafeParams:
        """Assumptions of the verified stop."""
        return self._filter.failsafe or FailsafeParams()

    @property
    def rests(self) -> bool:
        """Whether the arm is to be at rest."""
        return bool(at_rest(self._filter.expected))

    def start(self, scene: Scene) -> None:
        """Forget the past: the arm is where ``scene`` says."""
        self._filter.reset(scene)

    def decide(self, scene: Any, nominal: Array, wrong: str = "") -> Outcome:
        """The jerk to apply in this tick instead of a nominal one; never raises.

        Args:
            scene: The present.
            nominal: Shape (n,) [rad/s³]; NaN where there is none.
            wrong: Why there is none.
        """
        filter, decided = self._filter, False
        try:
            if not filter.compiled:
                return Outcome(*self._asked(scene, nominal, wrong))
            filter.reading.read(scene)
            view = filter.records.view
            view.nominal[0] = nominal
            loop.decide_all(view.arms, view.nominal, ONE)
            decided = True
            numbers = view.told.item()
            status, margin = _STATUSES[numbers[0]], numbers[-1]
            if status == Status.NOMINAL:
                filter._alarm.well()
                return Outcome(status, "", margin)
            told = Told(*numbers)
            reason = filter._say(told, nominal)
            if wrong:
                reason = reason.replace(BAD_INPUTS[1], wrong, 1)
            if status == Status.FAULT:
                filter._alarm.fault(reason, told.persistent)
            else:
                filter._alarm.well()
            return Outcome(status, reason, margin)
        except Exception as error:  # reading raises for no scene: this came from the step itself
            reason = f"the control step failed: {type(error).__name__}: {words_of(error)}"
            reason = filter._emergency(scene, np.array(nominal), reason, decided).reason
            return Outcome(Status.FAULT, reason, math.nan)

    def _asked(self, scene: Any, nominal: Array, wrong: str) -> tuple[Status, str, float]:
        """The decision of a filter that is not compiled, whose projection is OSQP's, say."""
        decision = self._filter.decide(scene, nominal)
        return decision.status, decision.reason.replace(BAD_INPUTS[1], wrong or BAD_INPUTS[1], 1), decision.margin
