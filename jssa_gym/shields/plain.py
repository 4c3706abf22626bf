"""Filters that add nothing to the layers around every filter."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.reasons import of_clipping
from jssa_gym.types import Array, Decision, Scene, Status


class NoFilter(SafetyFilter):
    """Applies the nominal inside the jerk bounds: the baseline that protects nobody, but still fails closed."""

    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        status, reason = Status.NOMINAL, ""
        if not inside:
            status, reason = Status.PROJECTED, of_clipping(nominal, self._clipped, self._bounds[4])
        return Decision(self._clipped.copy(), nominal, status, reason, np.nan, np.nan, (-1, -1), 0.0, 0)


class StopFilter(NoFilter):
    """The verified stop alone: the nominal as long as a verified stop follows it, inside the viability box.

    Both layers are always there, whatever ``viability`` says; ``failsafe`` None stands for its defaults.
    """

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: None = None,
        *,
        viability: bool = True,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        super().__init__(robot, dt, params, viability=True, failsafe=failsafe or FailsafeParams())
