"""The look-ahead filter: gives way early, seldom and softly."""

from dataclasses import dataclass

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.ahead import Foresight
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.tick.proposals.ahead import PredictedRows
from jssa_gym.validation import check_fields, number_within, positive_number

_MOST_MOMENTS = 250
"""That are looked at."""


@dataclass(frozen=True, slots=True)
class AheadParams:
    """Parameters of :class:`AheadFilter`.

    Raises:
        ParameterError: A number is negative or not finite, one that has to be positive is not, or the horizon has more
            than 250 steps.
    """

    d_min: float = 0.05
    """Distance that is to be left [m] ..."""
    growth: float = 0.05
    """... and by how much more with time, for what constant velocities do not know [m/s]."""
    horizon: float = 1.2
    """How far ahead is looked [s]: the farther, the earlier it gives way, and the less gets done."""
    step: float = 0.04
    """Between the moments that are looked at [s]."""
    soonest: float = 0.2
    """No row asks the arm to be out of the way sooner [s]: the shorter, the harder it evades."""
    deepest: float = 0.15
    """Pairs closer than wanted by more than this make no rows [m]: inside a body its normal says nothing."""
    min_authority: float = 0.5
    """Pairs that the jerk bounds move by less make no rows [m/s³]."""

    def __post_init__(self) -> None:
        check_fields(self, ("d_min", "horizon", "step", "soonest", "deepest"), positive_number)
        check_fields(self, ("growth", "min_authority"), number_within, 0.0)
        if self.horizon > _MOST_MOMENTS * self.step:
            raise ParameterError(
                f"a horizon of {self.horizon:g} s has more than {_MOST_MOMENTS} steps of {self.step:g} s"
            )


class AheadFilter(SafetyFilter):
    r"""Keeps out of people's way by rows from a predicted miss.

    The arm is predicted to take the nominal step and to stop, people to go on with constant velocity (Eq. 4). A pair
    whose gap g stays above the margin :math:`m(t) = d_{min} + \gamma t` all the time asks for nothing, however fast it
    comes nearer: without a conflict the nominal passes bit for bit. Else its most demanding moment T makes a row, the
    first jerk of the minimum-jerk move that has left by then,

    .. math:: n^\top J u \ge \frac{60}{T^3} x - \frac{36}{T^2} n^\top J \dot q - \frac9T n^\top J \ddot q, \quad
        x = m - g + n^\top J (q_\pi - q),

    and the nearest jerk in rows and box is applied, Eq. (14). Recomputed in every step, that is a high-order barrier
    whose poles scale with the time that is left: rows are soft where there is time. It promises nothing; the verified
    stop around it does. The index that is reported is :math:`d_{min}^2 - g|g|` of the smallest gap that is predicted.
    """

    params_type = AheadParams
    params: AheadParams

    @property
    def proposal(self) -> PredictedRows:
        """How far ahead is looked."""
        p = self.params
        return PredictedRows(
            Foresight(p.d_min, p.growth, p.horizon, p.step, p.soonest, p.deepest, p.min_authority)
        )  # fmt: skip
