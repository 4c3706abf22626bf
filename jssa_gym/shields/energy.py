"""Filters that keep an energy function from growing: SSA, SSS and CBF."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.kernels.projection import violation
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT, PUBLISHED, IndexParams
from jssa_gym.safety.pairs import ROWS, Pairs, Rows
from jssa_gym.safety.projectors import ExactProjector
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.shields.tick import Tick
from jssa_gym.types import Array, Decision, HalfSpaces, Status
from jssa_gym.validation import known_name, positive_number

_UNBOUNDED = 1e6
"""Acceleration bound of a method that knows none [rad/s²]."""

_TOLERANCE = 1e-9
"""Violation of a row by rounding [m²]."""


class RowFilter(PairFilter):
    """A filter that projects what is wanted onto the half-spaces of some pairs.

    Args:
        robot, dt, params, viability, failsafe: See :class:`~jssa_gym.shields.filter.SafetyFilter`.
        weight: V of the projection's metric, as in Eq. (14): None for the identity, a diagonal (n,), or a full
            symmetric positive definite (n, n).

    Raises:
        ParameterError: A number is out of range.
    """

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: Any = None,
        *,
        weight: ArrayLike | None = None,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        super().__init__(robot, dt, params, viability=viability, failsafe=failsafe)
        self._projector = ExactProjector(robot.n, weight)

    def projected(self, tick: Tick, L: Array, S: Array, phi: float) -> Decision:
        """The nearest jerk in box and rows; the nominal if it is there already."""
        left = violation(L, S, len(S), tick.clipped)
        if left <= 0.0:
            return self.untouched(tick, phi)
        jerk, feasible, left, _ = self._projector.project(tick.nominal, HalfSpaces(L, S), tick.lower, tick.upper)
        if not left < np.inf:
            return self.failed(tick, "the projection found no solution")
        status, reason = (Status.PROJECTED, "safety rows") if feasible else (Status.RELAXED, "no jerk keeps all rows")
        return self.decided(tick, jerk, status, reason, phi, left, len(S))


@dataclass(frozen=True, slots=True)
class SSAParams:
    """Parameters of :class:`SSAFilter`.

    Raises:
        ParameterError: A number is not positive and finite, or ``rows`` unknown.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = PUBLISHED.lambda1
    """[m·s]; the paper's."""
    eta: float = 1.0
    """Rate at which an index above 0 has to fall [m²/s]."""
    rows: Rows = "closest"
    """Whether the closest pair makes a row, as in the paper, or all pairs do."""

    def __post_init__(self) -> None:
        for name in ("d_min", "lambda1", "eta"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        known_name("rows", self.rows, ROWS)


class SSAFilter(RowFilter):
    r"""The safe set algorithm on accelerations, the paper's baseline (Section 4.3).

    Where :math:`\phi = d_{min}^2 - D|D| - \lambda_1\dot D \ge 0` the acceleration has to satisfy
    :math:`\dot\phi \le -\eta`. The nominal jerk's acceleration :math:`\ddot\theta + \tau\bar u` is projected onto that
    half-space, without a bound, and the jerk is what leads there in one step, saturated:
    :math:`u = \mathrm{clip}((\ddot\theta^S - \ddot\theta)/\tau)`. Where saturation breaks the row the decision says
    RELAXED. The slack is by how much :math:`\phi` falls short of its fall in this step [m²].

    Liu, Tomizuka: *Control in a safe set: addressing safety in human-robot interactions*, ASME DSCC 2014.
    """

    params_type = SSAParams
    params: SSAParams

    def coefficients(self) -> tuple[float, float, float]:
        return self.params.d_min, self.params.lambda1, 0.0

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        tau, now, watched = self.dt, tick.state[2], pairs.watched(self.params.rows, self.robot.limits.jerk)
        phi = index[watched].max(initial=-np.inf)
        active = watched[index[watched] >= 0.0]
        L = tau * self.params.lambda1 * pairs.rows[active]
        S = tau * (self.params.eta + self.rate_of_index(pairs, active)) + L @ now
        count, wanted = len(S), now + tau * tick.clipped
        if violation(L, S, count, wanted) <= 0.0:
            return self.untouched(tick, phi)
        unbounded = np.full(self.robot.n, _UNBOUNDED)
        safe = self._projector.project(wanted, HalfSpaces(L, S), -unbounded, unbounded).jerk
        jerk = np.clip((safe - now) / tau, tick.lower, tick.upper)
        left = violation(L, S, count, now + tau * jerk)
        if not left < np.inf:
            return self.failed(tick, "the projection found no solution")
        status, reason = Status.PROJECTED, "safety rows"
        if left > _TOLERANCE:
            status, reason = Status.RELAXED, "the jerk bounds cut off the safe acceleration"
        return self.decided(tick, jerk, status, reason, phi, left, count)


@dataclass(frozen=True, slots=True)
class SSSParams:
    """Parameters of :class:`SSSFilter`.

    Raises:
        ParameterError: A number is not positive and finite, ``rows`` unknown, or the index is none: see
            :class:`~jssa_gym.safety.index.IndexParams`.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = DEFAULT.lambda1
    """[m·s]."""
    lambda2: float = DEFAULT.lambda2
    """[m·s²]."""
    c: float = 2.0
    """Rate at which an index above 0 has to decay [1/s]."""
    rows: Rows = "all"
    """Whether the closest pair makes a row, or all pairs do."""

    def __post_init__(self) -> None:
        IndexParams(d_min=self.d_min, lambda1=self.lambda1, lambda2=self.lambda2)
        for name in ("d_min", "lambda1", "lambda2", "c"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        known_name("rows", self.rows, ROWS)


class SSSFilter(RowFilter):
    r"""The sublevel safe set algorithm on jerks: :math:`\dot\phi \le -c\phi` where :math:`\phi \ge 0`.

    The index is Eq. (6), of which the jerk enters the rate. Below 0 nothing is asked for, which is all that makes it
    differ from a control barrier function :math:`-\phi`. The slack is that of :math:`\phi` over this step [m²].

    Wei, Liu: *Safe control algorithms using energy functions: a unified framework, benchmark, and new directions*,
    IEEE CDC 2019.
    """

    params_type = SSSParams
    params: SSSParams

    def coefficients(self) -> tuple[float, float, float]:
        return self.params.d_min, self.params.lambda1, self.params.lambda2

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        watched = pairs.watched(self.params.rows, self.robot.limits.jerk)
        phi = index[watched]
        active, above = watched[phi >= 0.0], phi[phi >= 0.0]
        L = self.dt * self.params.lambda2 * pairs.rows[active]
        S = self.dt * (self.params.c * above + self.rate_of_index(pairs, active))
        return self.projected(tick, L, S, phi.max(initial=-np.inf))


@dataclass(frozen=True, slots=True)
class CBFParams:
    """Parameters of :class:`CBFFilter`.

    Raises:
        ParameterError: A number is not positive and finite, or ``rows`` unknown.
    """

    d_min: float = 0.05
    """[m]."""
    k1: float = 1.5
    """Gain of the distance's approach to ``d_min`` [1/s]."""
    k2: float = 4.0
    """Gain of the second function [1/s]."""
    k3: float = 20.0
    """Gain of the third function [1/s]."""
    rows: Rows = "all"
    """Whether the closest pair makes a row, or all pairs do."""

    def __post_init__(self) -> None:
        for name in ("d_min", "k1", "k2", "k3"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        known_name("rows", self.rows, ROWS)


class CBFFilter(RowFilter):
    r"""A high-order control barrier function of relative degree three, :math:`h = D - d_{min}`, for every pair.

    With :math:`\psi_0 = h` and :math:`\psi_i = \dot\psi_{i-1} + k_i\psi_{i-1}` the jerk has to keep
    :math:`\psi_3 \ge 0`, which is

    .. math:: \dddot D + (k_1 + k_2 + k_3)\ddot D + (k_1k_2 + k_1k_3 + k_2k_3)\dot D + k_1k_2k_3 (D - d_{min}) \ge 0.

    With these linear gains it is an exponential control barrier function with poles at :math:`-k_i`. The slack is
    that of :math:`\psi_3` [m/s³]; the index that is reported is :math:`d_{min}^2 - D|D|`, above 0 where h is below.

    Xiao, Belta: *Control barrier functions for systems with high relative degree*, IEEE CDC 2019; Nguyen, Sreenath:
    *Exponential control barrier functions for enforcing high relative-degree safety-critical constraints*, ACC 2016.
    """

    params_type = CBFParams
    params: CBFParams

    def coefficients(self) -> tuple[float, float, float]:
        return self.params.d_min, 0.0, 0.0

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        watched, p = pairs.watched(self.params.rows, self.robot.limits.jerk), self.params
        D, rate, curvature, drift = pairs.motion[watched].T
        L = pairs.rows[watched]
        S = -(
            drift
            + (p.k1 + p.k2 + p.k3) * curvature
            + (p.k1 * p.k2 + p.k1 * p.k3 + p.k2 * p.k3) * rate
            + p.k1 * p.k2 * p.k3 * (D - p.d_min)
        )
        return self.projected(tick, L, S, index.max())
