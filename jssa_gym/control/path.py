"""A plan that yields: its path is kept, at a pace that follows how near people are."""

import numpy as np

from jssa_gym.control.plan import Plan
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels import pacing
from jssa_gym.kernels.override import along
from jssa_gym.kernels.pacing import FAR, FAST, FASTER, HARD_PULLED, SLOWER, Paces, pace_of, paced
from jssa_gym.kernels.profile import peaks
from jssa_gym.kernels.rest import REST_JOINTS
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array
from jssa_gym.validation import number_within

__all__ = ["ASTRAY", "FASTER", "HURRY", "SLOWER", "PacedPath", "pace_of"]

ASTRAY = np.array([[FAR], [FAST], [HARD_PULLED]])
"""Deviation from the path that is left to feedback [rad, rad/s, rad/s²]; what is farther off was thrown off."""

HURRY = 1.12
"""Pace at most while a schedule is behind; of plans within 0.7 of the jerk limits it needs 0.98."""


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
        self._bounds = limits.bounds()
        self._limits, self._schedule = limits, schedule
        self.paced: Paces = paced(1, n)
        """What is remembered of its pace, of an arm by itself."""
        kept = self.paced.kept
        kept["override"] = kept["asked"] = override = number_within("pace", pace, 0.0, HURRY)
        kept["fastest"] = self._most(limits) if schedule else 1.0
        begun = bool(np.any(np.abs(plan.states[0, 1:]) > REST_JOINTS))
        # a plan from rest can begin at any pace, as nothing moves yet
        self.paced.pace[0, 1] = 1.0 if begun else min(override, 1.0)

    def _most(self, limits: JointLimits) -> float:
        """The fastest pace that all of the plan can be played at within the limits."""
        velocity, acceleration, jerk = most = np.zeros((3, len(limits.jerk)))
        peaks(self.plan.jerk, self.plan.states, most)
        with np.errstate(divide="ignore"):
            bounds = (
                limits.velocity / velocity,
                (limits.acceleration / acceleration) ** 0.5,
                (limits.jerk / jerk) ** (1 / 3),
            )
        return max(1.0, min(HURRY, *(float(bound.min()) for bound in bounds)))

    def onto(self, plan: Plan, played: int) -> "PacedPath":
        """The same motion on a plan that is this one's from tick ``played`` on, and goes elsewhere later."""
        path = PacedPath(plan, self._limits, pace=self.override, schedule=self._schedule)
        path.paced.pace[:] = self.paced.pace
        path.paced.pace[0, 0] -= played * plan.dt
        for name in ("behind", "margin"):
            path.paced.kept[name] = self.paced.kept[name]
        return path

    @property
    def override(self) -> float:
        """The pace that was asked for last."""
        return float(self.paced.kept["override"][0])

    @property
    def margin(self) -> float:
        """The margin that the last alternatives were for [m]."""
        return float(self.paced.kept["margin"][0])

    @property
    def pace(self) -> float:
        """The pace at which path time runs."""
        return float(self.paced.pace[0, 1])

    @property
    def ticks(self) -> int:
        """Ticks of the plan that have been played, whole ones."""
        return pacing.ticks_of(self._played, self.paced.pace[0, 0])

    @property
    def ended(self) -> bool:
        """Whether path time is at its end; the arm follows within :data:`ASTRAY`."""
        return self.ticks == len(self.plan)

    @property
    def reference(self) -> Array:
        """Where the arm is to be: rows position, velocity, acceleration, shape (3, n)."""
        point = self.paced.point[0]
        s, rate, acceleration = self.paced.pace[0]
        along(self._played, s, point)
        return np.array([point[0], point[1] * rate, point[2] * rate**2 + point[1] * acceleration])

    def astray(self, state: Array) -> bool:
        """Whether a joint state (3, n) is off the path by more than feedback is for; one that is not finite is."""
        return pacing.astray(self._played, self.paced, np.ascontiguousarray(state, float), 0)

    def alternatives(self, state: Array, margin: float) -> Array:
        """Jerks for this tick in order of preference.

        Args:
            state: Rows position, velocity, acceleration as they are now, shape (3, n).
            margin: Of the tick before, infinite where nothing moves [m]; what is no number counts as none.

        Returns:
            Shape (a, n) [rad/s³], a <= 8; none where the arm is off the path, or limits let it keep none.
        """
        now, most = np.ascontiguousarray(state, float), self.paced.jerks.shape[1]
        count = pacing.offer(self._played, self.paced, now, float(margin), self._bounds, most, 0)
        return self.paced.jerks[0, : max(count, 0)].copy()

    def took(self, choice: int) -> None:
        """The decision on the last alternatives: the number of the one that was applied, -1 for none of them."""
        pacing.go_on(self._played, self.paced, choice, 0)
