"""Baselines: filters that add nothing to the layers around every filter."""

import numpy as np

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter, Tick
from jssa_gym.tick import layout
from jssa_gym.types import Decision, Status


class NoFilter(SafetyFilter):
    """Applies the nominal inside the jerk bounds: the baseline that protects nobody, but still fails closed."""

    proposal = layout.NONE

    def respond(self, tick: Tick) -> Decision:
        """The nominal, clipped to the box."""
        status, reason = (Status.NOMINAL, "") if tick.inside else (Status.PROJECTED, tick.why_clipped)
        return Decision(tick.clipped, tick.nominal, status, reason, np.nan, np.nan, (-1, -1), 0.0, 0)


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
