"""Filters that need no projection: a repulsive field, a sliding mode, and the protective stop."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.safety.index import DEFAULT, IndexParams
from jssa_gym.safety.pairs import ROWS, Rows
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.tick.proposals.pairs import reported
from jssa_gym.tick.proposals.repulsion import Repulsion, SlidingMode
from jssa_gym.tick.proposals.separation import ProtectiveDistance
from jssa_gym.validation import check_fields, known_name, number_within, positive_number, share


@dataclass(frozen=True, slots=True)
class PFMParams:
    """Parameters of :class:`PFMFilter`.

    Raises:
        ParameterError: A number is not positive and finite, or ``rows`` unknown.
    """

    influence: float = 0.5
    """Distance beyond which there is no force [m]."""
    strength: float = 1.0
    """Strength of the potential, per unit of joint inertia [m²/s²]."""
    damping: float = 5.0
    """Damping of the approach, per unit of joint inertia [1/(m² s)]."""
    lag: float = 0.05
    """Time constant with which the arm's acceleration follows the force [s]."""
    rows: Rows = "closest"
    """Whether the closest pair repels, or all pairs do."""

    def __post_init__(self) -> None:
        check_fields(self, ("influence", "strength", "damping", "lag"), positive_number)
        known_name("rows", self.rows, ROWS)


class PFMFilter(SafetyFilter):
    r"""The potential field method: people repel the arm.

    The force of a pair within the distance of influence :math:`D_0` is Khatib's, with damping,

    .. math:: F = k \Bigl(\frac1D - \frac1{D_0}\Bigr)\frac1{D^2} - b\dot D,

    and acts through the closest point's Jacobian transpose on joints of unit inertia: the acceleration
    :math:`J^\top n F`. It is lifted to jerks by letting the distance's own acceleration follow it with a time constant
    T, :math:`u = \mathrm{clip}(\bar u + J^\top n \max(F - \ddot D, 0)/T)`: people repel, they never attract. Nothing is
    promised and no row is kept, so that the slack is always 0. The index that is reported is :math:`D_0^2 - D|D|`.

    Khatib: *Real-time obstacle avoidance for manipulators and mobile robots*, IEEE ICRA 1985.
    """

    params_type = PFMParams
    params: PFMParams

    @property
    def proposal(self) -> Repulsion:
        """A repulsive force."""
        p = self.params
        return Repulsion(
            reported(p.influence, 0.0, 0.0), p.influence, p.strength, p.damping, p.lag, p.rows == "closest"
        )


@dataclass(frozen=True, slots=True)
class SMAParams:
    """Parameters of :class:`SMAFilter`.

    Raises:
        ParameterError: A number is not positive and finite, ``rows`` unknown, ``gain`` not in (0, 1], or the index is
            none: see :class:`~jssa_gym.safety.index.IndexParams`.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = DEFAULT.lambda1
    """[m·s]."""
    lambda2: float = DEFAULT.lambda2
    """[m·s²]."""
    gain: float = 1.0
    """Jerk that is added, as a share of the jerk bound of the joint that has to give most."""
    rows: Rows = "all"
    """Whether the closest pair counts, or all pairs do: then their gradients are added."""

    def __post_init__(self) -> None:
        IndexParams(d_min=self.d_min, lambda1=self.lambda1, lambda2=self.lambda2)
        check_fields(self, ("d_min", "lambda1", "lambda2", "gain"), positive_number)
        share("gain", self.gain)
        known_name("rows", self.rows, ROWS)


class SMAFilter(SafetyFilter):
    r"""The sliding mode algorithm: where :math:`\phi > 0`, a constant jerk along :math:`-\partial\dot\phi/\partial u`.

    The index is Eq. (6); its gradient is :math:`-\lambda_2 n^\top J`. The jerk that is added is as large as its gain
    says whatever the index is, and is gone where the index is 0 or less: the arm chatters along :math:`\phi = 0`.
    RELAXED where no joint moves the pair.

    Gracia, Garelli, Sala: *Reactive sliding-mode algorithm for collision avoidance in robotic systems*, IEEE
    Transactions on Control Systems Technology 21(6), 2013; as jerk added to a nominal, Wei and Liu, IEEE CDC 2019.
    """

    params_type = SMAParams
    params: SMAParams

    @property
    def proposal(self) -> SlidingMode:
        """A jerk of one size."""
        p = self.params
        return SlidingMode(reported(p.d_min, p.lambda1, p.lambda2), p.gain, p.rows == "closest")


@dataclass(frozen=True, slots=True)
class SSMParams:
    """Parameters of :class:`SSMFilter`, the terms of the protective separation distance.

    Raises:
        ParameterError: A number is negative or not finite, or ``human_speed`` not positive.
    """

    human_speed: float | None = 1.6
    """Speed of people towards the arm, :math:`v_h` [m/s]; None for the measured one."""
    latency: float = 0.0
    """Reaction time beyond one control step [s]."""
    intrusion: float = 0.0
    """Intrusion distance C [m]."""
    human_error: float = 0.0
    """Position uncertainty of people, :math:`Z_d` [m]."""
    robot_error: float = 0.0
    """Position uncertainty of the arm, :math:`Z_r` [m]."""
    hysteresis: float = 0.1
    """By how much the distance has to exceed the one at which the arm stopped before it goes on [m]."""

    def __post_init__(self) -> None:
        if self.human_speed is not None:
            check_fields(self, ("human_speed",), positive_number)
        check_fields(self, ("latency", "intrusion", "human_error", "robot_error", "hysteresis"), number_within, 0.0)


class SSMFilter(SafetyFilter):
    r"""Speed and separation monitoring: stops the arm while anybody is closer than the protective distance,

    .. math:: S_p = S_h + S_r + S_s + C + Z_d + Z_r, \quad S_h = v_h (T_r + T_s).

    :math:`T_r` is one step, in which the nominal jerk is applied, and the latency. :math:`T_s` and
    :math:`S_r + S_s` are computed for each pair from the arm's own jerk-limited stop after that step: the farthest
    that the robot capsule comes towards the person, along the pair's normal. As a plane across the normal lies between
    the two capsules, a person who keeps :math:`v_h` is not met before the arm rests, if neither latency nor sensor
    adds more than is said. The arm goes on when every distance exceeds that at which it stopped by the hysteresis. The
    index that is reported is the largest :math:`S_p^2 - D|D|`.

    ISO/TS 15066:2016, 5.5.4.
    """

    params_type = SSMParams
    params: SSMParams

    @property
    def proposal(self) -> ProtectiveDistance:
        """A protective distance."""
        p = self.params
        speed = np.nan if p.human_speed is None else p.human_speed
        terms = (speed, p.latency, p.intrusion, p.human_error, p.robot_error, p.hysteresis)
        return ProtectiveDistance(reported(0.0, 0.0, 0.0), *map(float, terms))
