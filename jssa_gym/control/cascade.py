"""A jerk-level PD controller with bounded references."""

from dataclasses import dataclass

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_share


@dataclass(frozen=True, slots=True, eq=False)
class Cascade:
    r"""Position, velocity and acceleration loops, one inside the other, each reference clipped to its limit.

    .. math:: v^* = \mathrm{clip}(k_p (q^* - q)),\quad a^* = \mathrm{clip}(k_v (v^* - v)),\quad
              u = \mathrm{clip}(k_a (a^* - a))

    The position reference is clipped to the position limits first. The clipped velocity reference falls towards the
    target as a braking arm must, so that the arm arrives without overshoot for the default gains.

    Raises:
        ParameterError: A gain or the share of the limits is out of range.
    """

    limits: JointLimits
    share: float = 0.5
    """Share of the velocity and acceleration limits that the references may use, in (0, 1]."""
    kp: float = 1.5
    """[1/s]."""
    kv: float = 6.0
    """[1/s]."""
    ka: float = 25.0
    """[1/s]."""

    def __post_init__(self) -> None:
        positive_share("share", self.share)
        if not all(np.isfinite(k) and k > 0.0 for k in (self.kp, self.kv, self.ka)):
            raise ParameterError(f"gains have to be positive, got {(self.kp, self.kv, self.ka)}")

    def jerk(self, state: JointState, target: Array) -> Array:
        """Jerk towards a joint position, shape (n,) [rad/s³].

        Args:
            state: Joint state.
            target: Shape (n,) [rad].
        """
        return self.jerk_at_speed(state, self.velocity(state, target))

    def velocity(self, state: JointState, target: Array) -> Array:
        """What the outer loop asks for, before it is clipped, shape (n,) [rad/s]; arguments as of :meth:`jerk`."""
        position = self.limits.position
        return self.kp * (np.clip(target, position[:, 0], position[:, 1]) - state.position)

    def jerk_at_speed(self, state: JointState, velocity: Array) -> Array:
        """Jerk towards a joint velocity by the inner loops alone, shape (n,) [rad/s³].

        Args:
            state: Joint state.
            velocity: Shape (n,) [rad/s]; clipped to the share of the limits.
        """
        limits = self.limits
        return self.within(state, velocity, self.share * limits.velocity, self.share * limits.acceleration)

    def within(self, state: JointState, velocity: Array, fastest: Array, hardest: Array) -> Array:
        """The same with other bounds of the references; of many arms too, then of shape (E, n).

        Args:
            state: Joint state.
            velocity: Shape (n,) [rad/s].
            fastest: Of the velocity reference, shape (n,) [rad/s].
            hardest: Of the acceleration reference, shape (n,) [rad/s²].
        """
        bound = self.limits.jerk
        v = np.clip(velocity, -fastest, fastest)
        a = np.clip(self.kv * (v - state.velocity), -hardest, hardest)
        return np.clip(self.ka * (a - state.acceleration), -bound, bound)
