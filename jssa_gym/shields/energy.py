"""Filters that keep an energy function from growing: SSA, SSS and CBF."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jssa_gym.kernels.projection import violation
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.types import Array, Decision, HalfSpaces, Status
from jssa_gym.validation import known_name, positive_number

ROWS = ("closest", "all")
Rows = Literal["closest", "all"]

_UNBOUNDED = 1e6
"""Acceleration bound of a method that knows none [rad/s²]."""

_TOLERANCE = 1e-9
"""Violation of a row by rounding [m²]."""


@dataclass(frozen=True, slots=True)
class SSAParams:
    """Parameters of :class:`SSAFilter`.

    Raises:
        ParameterError: A number is not positive and finite, or ``rows`` unknown.
    """

    d_min: float = 0.05
    """[m]."""
    lambda1: float = 3.0
    """[m·s]; the paper's."""
    eta: float = 1.0
    """Rate at which an index above 0 has to fall [m²/s]."""
    rows: Rows = "closest"
    """The closest pair, as in the paper, or ``"all"``."""

    def __post_init__(self) -> None:
        for name in ("d_min", "lambda1", "eta"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        known_name("rows", self.rows, ROWS)


class SSAFilter(PairFilter):
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

    def _coefficients(self) -> tuple[float, float, float]:
        return self.params.d_min, self.params.lambda1, 0.0

    def _respond(self, nominal: Array, inside: bool) -> Decision:
        tau, now, watched = self.dt, self._state[2], self._watched(self.params.rows)
        phi = self._phi[watched].max(initial=-np.inf)
        active = watched[self._phi[watched] >= 0.0]
        L = tau * self.params.lambda1 * self._rows[active]
        S = tau * (self.params.eta + self._rate(active)) + L @ now
        count, wanted = len(S), now + tau * self._clipped
        if violation(L, S, count, wanted) <= 0.0:
            return self._untouched(nominal, inside, phi)
        unbounded = np.full(self.robot.n, _UNBOUNDED)
        safe = self._projector.project(wanted, HalfSpaces(L, S), -unbounded, unbounded).jerk
        jerk = np.clip((safe - now) / tau, self.lower, self.upper)
        left = violation(L, S, count, now + tau * jerk)
        if not left < np.inf:
            return self._failed(nominal, "the projection found no solution")
        status, reason = Status.PROJECTED, "safety rows"
        if left > _TOLERANCE:
            status, reason = Status.RELAXED, "the jerk bounds cut off the safe acceleration"
        return self._decided(jerk, nominal, status, reason, phi, left, count)
