"""Filters that keep an energy function from growing: SSA, SSS and CBF."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT, PUBLISHED, IndexParams
from jssa_gym.safety.pairs import ROWS, Rows
from jssa_gym.safety.projectors import ExactProjector
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.tick.layout import StepSettings
from jssa_gym.tick.proposals.energy import BarrierRows, SafeAcceleration, SublevelRows
from jssa_gym.tick.proposals.pairs import reported
from jssa_gym.validation import check_fields, known_name, positive_number


class RowFilter(SafetyFilter):
    """A filter that projects what is wanted onto the half-spaces of some pairs; decisions hold what is measured.

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
        self.projector = ExactProjector(robot.n, weight)
        """Projector of the nominal onto the rows; part of the compiled step."""

    def settings(self) -> StepSettings:
        """The numbers that the control step goes by."""
        return super().settings()._replace(**self.projector.metric())


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
        check_fields(self, ("d_min", "lambda1", "eta"), positive_number)
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

    @property
    def proposal(self) -> SafeAcceleration:
        """Rows of the acceleration."""
        p = self.params
        return SafeAcceleration(reported(p.d_min, p.lambda1, 0.0), p.eta, p.rows == "closest")


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
        check_fields(self, ("d_min", "lambda1", "lambda2", "c"), positive_number)
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

    @property
    def proposal(self) -> SublevelRows:
        """Rows of the index's rate."""
        p = self.params
        return SublevelRows(reported(p.d_min, p.lambda1, p.lambda2), p.c, p.rows == "closest")


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
        check_fields(self, ("d_min", "k1", "k2", "k3"), positive_number)
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

    @property
    def proposal(self) -> BarrierRows:
        """Rows of the distance's third derivative."""
        p = self.params
        return BarrierRows(reported(p.d_min, 0.0, 0.0), p.k1, p.k2, p.k3, p.rows == "closest")
