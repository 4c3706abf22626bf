"""A control step as filters see it that are not compiled."""

from dataclasses import dataclass, replace
from functools import cached_property

from numpy.typing import NDArray

from jssa_gym.kernels.projection import clip
from jssa_gym.robots import RobotModel
from jssa_gym.safety.pairs import Pairs, measure_pairs
from jssa_gym.shields.reasons import of_clipping
from jssa_gym.types import Array, Scene


@dataclass(frozen=True, eq=False)
class Tick:
    """One control step as a filter sees it: sound, complete and finite."""

    robot: RobotModel
    """The arm, where it stands."""
    scene: Scene
    """What is shown; what is believed of it is below."""
    state: Array
    """Joint state, rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²]."""
    people: NDArray
    """Human capsules at present, shape (k,) of :data:`~jssa_gym.kernels.records.AGENT`."""
    nominal: Array
    """The policy's jerk, shape (n,) [rad/s³]."""
    lower: Array
    """The box, shape (n,) [rad/s³]: the jerk bounds, or what the viability box leaves of them."""
    upper: Array
    clipped: Array
    """The nominal clipped to the box, shape (n,) [rad/s³]."""

    @cached_property
    def pairs(self) -> Pairs:
        """Robot capsules against human capsules at present."""
        return measure_pairs(self.robot, self.state, self.people)

    @property
    def inside(self) -> bool:
        """Whether the nominal lies in the box."""
        return bool((self.clipped == self.nominal).all())

    @property
    def why_clipped(self) -> str:
        """Which of bounds and viability box a nominal outside the box met."""
        return of_clipping(self.nominal, self.clipped, self.robot.limits.jerk)

    def holding(self, held: int, halt: Array) -> "Tick":
        """The same control step with a box that leaves the first ``held`` joints no choice but ``halt`` (n,)."""
        lower, upper, clipped = self.lower.copy(), self.upper.copy(), self.clipped.copy()
        lower[:held] = upper[:held] = halt[:held]
        clip(self.nominal, lower, upper, clipped)
        return replace(self, lower=lower, upper=upper, clipped=clipped)
