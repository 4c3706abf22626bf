"""Baselines: filters that add nothing to the layers around every filter.

A filter has a module of its own in ``shields/``, and its name in ``FILTERS`` of ``shields/registry.py``.
"""

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.tick.proposals.nothing import Nothing


class NoFilter(SafetyFilter):
    """Applies the nominal inside the jerk bounds: the baseline that protects nobody, but still fails closed."""

    @property
    def proposal(self) -> Nothing:
        """Nothing but the nominal, clipped to the box."""
        return Nothing()


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
