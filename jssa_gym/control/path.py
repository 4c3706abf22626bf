"""A plan that yields: its path is kept, at a pace that follows how near people are."""

import numpy as np

from jssa_gym.control.plan import Plan
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.override import along, propose
from jssa_gym.kernels.rest import REST_JOINTS
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array
from jssa_gym.validation import number_within

FULL_PACE = 0.1
"""Margin from which on the full pace is asked for; nothing at margin 0, and proportional between [m]."""

SLOWER, FASTER = 6.0, 2.0
"""How fast the pace that is asked for may fall and rise [1/s]."""

GENTLE, HARD, HARDEST = (5.0, 25.0), (8.0, 60.0), (30.0, 600.0)
"""What acceleration and jerk of the pace may not exceed [1/s, 1/s²], where the joints' limits let them get so far."""

PACES = (0.6, 0.3, 0.0)
"""Paces that are offered beside the one that is asked for where it is faster."""

ASTRAY = np.array([[1e-3], [1e-2], [0.3]])
"""Deviation from the path that is left to feedback [rad, rad/s, rad/s²]; what is farther off was thrown off."""

HURRY = 1.12
"""Pace at most while a schedule is behind; of plans within 0.7 of the jerk limits it needs 0.98."""


def pace_of(margin: float) -> float:
    """The pace that a margin [m] asks for, in [0, 1]; 0 where it is no number."""
    return min(max(margin / FULL_PACE, 0.0), 1.0) if margin > 0.0 else 0.0  # NaN is not


class PacedPath:
    r"""Alternatives for a shield: a plan's path at several paces, in order of preference.

    In every tick :meth:`alternatives` gives jerks that go on along the path, and :meth:`took` says which of them was
    applied; only then does anything move on, so that asking twice does no harm. The first alternative follows the pace

    .. math:: \sigma = \mathrm{sat}(h / h_0)

    of the margin :math:`h` to people, slewed; then come slower paces, and braking along the path, ever harder. All keep
    the joints' limits until they have got where they lead, and stay within :data:`ASTRAY` of the path.

    Args:
        plan: The path; at pace 1 it is played as it is. One within 0.7 of acceleration and jerk limits leaves room for
            changes of the pace, one at the limits hardly any.
        limits: Of the joints.
        pace: The pace that was asked for before, in [0, 1.12]; what an arm at rest begins with.
        schedule: Whether time that is lost is to be made up for, at a pace up to :data:`HURRY`.

    Raises:
        ParameterError: The limits are for another number of joints, or the pace is out of range.
    """

    def __init__(self, plan: Plan, limits: JointLimits, *, pace: float = 1.0, schedule: bool = False) -> None:
        n = len(limits.jerk)
        if plan.states.shape[2] != n:
            raise ParameterError(f"the plan is for {plan.states.shape[2]} joints, the limits are for {n}")
        self.plan, self._played = plan, (plan.jerk, plan.states, plan.dt)
        self._override = number_within("pace", pace, 0.0, HURRY)
        self._bounds = limits.bounds()
        self._limits, self._schedule = limits, schedule
        self._fastest = self._most(limits) if schedule else 1.0
        begun = bool(np.any(np.abs(plan.states[0, 1:]) > REST_JOINTS))
        # a plan from rest can begin at any pace, as nothing moves yet
        self._pace = np.array([0.0, 1.0 if begun else min(self._override, 1.0), 0.0])
        self._behind = 0.0
        self._asked = self._override
        self.margin = np.inf
        """The margin that the last alternatives were for [m]."""
        self._wishes = np.array(
            [(0.0, *GENTLE)] + [(pace, *GENTLE) for pace in PACES] + [(0.0, *HARD), (0.0, *HARDEST), (1.0, *GENTLE)]
        )
        m = len(self._wishes)
        self._offered = np.zeros((m, n)), np.zeros((m, 3)), np.zeros(m, np.int64)
        self._count = 0
        self._point = np.zeros((2, 4, n))

    def _most(self, limits: JointLimits) -> float:
        """The fastest pace that all of the plan can be played at within the limits."""
        peaks = np.abs(self.plan.states).max(axis=0)
        jerk = np.abs(self.plan.jerk).max(axis=0, initial=0.0)
        with np.errstate(divide="ignore"):
            bounds = (
                limits.velocity / peaks[1],
                (limits.acceleration / peaks[2]) ** 0.5,
                (limits.jerk / jerk) ** (1 / 3),
            )
        return max(1.0, min(HURRY, *(float(bound.min()) for bound in bounds)))

    def onto(self, plan: Plan, played: int) -> "PacedPath":
        """The same motion on a plan that is this one's from tick ``played`` on, and goes elsewhere later."""
        path = PacedPath(plan, self._limits, pace=self._override, schedule=self._schedule)
        path._pace[:] = self._pace
        path._pace[0] -= played * plan.dt
        path._behind, path.margin = self._behind, self.margin
        return path

    @property
    def override(self) -> float:
        """The pace that was asked for last."""
        return self._override

    @property
    def pace(self) -> float:
        """The pace at which path time runs."""
        return float(self._pace[1])

    @property
    def ticks(self) -> int:
        """Ticks of the plan that have been played, whole ones."""
        return min(int(self._pace[0] / self.plan.dt + 1e-6), len(self.plan))

    @property
    def ended(self) -> bool:
        """Whether path time is at its end; the arm follows within :data:`ASTRAY`."""
        return self.ticks == len(self.plan)

    @property
    def reference(self) -> Array:
        """Where the arm is to be: rows position, velocity, acceleration, shape (3, n)."""
        point = self._point[0]
        s, rate, acceleration = self._pace
        along(self._played, s, point)
        return np.array([point[0], point[1] * rate, point[2] * rate**2 + point[1] * acceleration])

    def astray(self, state: Array) -> bool:
        """Whether a joint state (3, n) is off the path by more than feedback is for; one that is not finite is."""
        return not bool(np.all(np.abs(state - self.reference) <= ASTRAY))

    def alternatives(self, state: Array, margin: float) -> Array:
        """Jerks for this tick in order of preference.

        Args:
            state: Rows position, velocity, acceleration as they are now, shape (3, n).
            margin: Of the tick before, infinite where nothing moves [m]; what is no number counts as none.

        Returns:
            Shape (a, n) [rad/s³], a <= 8; none where the arm is off the path, or limits let it keep none.
        """
        self.margin, self._count = float(margin), 0
        self._asked = self._slewed(self.margin)
        wishes = self._wishes
        wishes[0, 0] = self._asked
        wishes[1:4, 0] = np.minimum(PACES, self._asked)
        if not self.astray(state):
            now = np.ascontiguousarray(state, float)
            self._count = propose(self._played, self._pace, wishes, now, self._bounds, self._point, self._offered)
        return self._offered[0][: self._count].copy()

    def took(self, choice: int) -> None:
        """The decision on the last alternatives: the number of the one that was applied, -1 for none of them."""
        self._override = self._asked
        if not 0 <= choice < self._count:
            self._count = 0
            self._behind += self.plan.dt
            return
        before = self._pace[0]
        self._pace[:] = self._offered[1][choice]
        end = self.plan.duration
        self._behind = max(self._behind + self.plan.dt - (self._pace[0] - before), 0.0)
        self._pace[0] = min(self._pace[0], end)
        # what it was on the way to was seen to be within the limits: offered again, it still is
        self._wishes[-1] = self._wishes[self._offered[2][choice]]
        self._count = 0

    def _slewed(self, margin: float) -> float:
        """The pace that a margin asks for, as fast as it may change."""
        most = self._fastest if self._behind > self.plan.dt else 1.0
        dt = self.plan.dt
        return min(max(most * pace_of(margin), self._override - SLOWER * dt), self._override + FASTER * dt)
