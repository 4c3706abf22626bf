"""What the second judge says about an episode."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from jssa_gym.envs.arm import MOVING
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array


@dataclass(frozen=True, slots=True)
class Overlap:
    """Two things that touch or penetrate for some time; seen at sub-steps, so up to one earlier and later."""

    one: str
    """Robot capsule."""
    other: str
    """Human capsule, robot capsule or half-space."""
    start: float
    """First moment at which it was seen [s]."""
    end: float
    """Last moment [s]."""
    depth: float
    """Largest penetration [m]."""


@dataclass(frozen=True, slots=True)
class Contact(Overlap):
    """A robot capsule that touches a person; speeds are the largest during the contact."""

    person: int
    speed: float
    """Speed of the robot's touching surface point [m/s]."""
    approach: float
    """Its component towards the person along the contact normal [m/s]; negative if it only moves away."""
    human_approach: float
    """Component of the person's touching point towards the robot [m/s]."""

    @property
    def moving(self) -> bool:
        """Whether the robot's touching point was faster than 1e-3 m/s."""
        return not self.speed <= MOVING

    @property
    def fault(self) -> Literal["robot", "human", "shared"]:
        """Who moved into whom.

        ``"human"`` if and only if the robot's touching point never moves towards the person, along the contact
        normal, faster than 1e-3 m/s; it may stand, move away or slide along. Otherwise ``"robot"`` if the person's
        never moves towards the robot faster than that, and ``"shared"`` if it does.
        """
        if self.approach <= MOVING:
            return "human"
        return "robot" if self.human_approach <= MOVING else "shared"


class Excess(NamedTuple):
    """The share of its limit by which a joint exceeds it at most; negative where all stay below."""

    position: float
    """Share of the joint's range."""
    velocity: float
    acceleration: float
    jerk: float

    @classmethod
    def of(cls, state: Array, jerk: Array, limits: JointLimits) -> "Excess":
        """The largest excess of states (s, 3, n) and jerks (T, n)."""
        low, high = limits.position.T
        return cls(
            float((np.maximum(state[:, 0] - high, low - state[:, 0]) / (high - low)).max()),
            float((np.abs(state[:, 1]) / limits.velocity).max() - 1.0),
            float((np.abs(state[:, 2]) / limits.acceleration).max() - 1.0),
            float((np.abs(jerk) / limits.jerk).max() - 1.0),
        )


@dataclass(frozen=True, slots=True)
class Judgement:
    """What MuJoCo finds in a recorded episode; errors are the largest disagreements with the record."""

    samples: int
    """Moments that were looked at."""
    distance: float
    """Smallest robot-human surface distance [m]; 10.0 if it is more, inf without a human."""
    distance_error: float
    """Largest error of the recorded distances at the ticks [m]; those beyond 10 m count as 10 m."""
    contact_error: int
    """Ticks recorded with a contact that is none, or without one that is; distances within the tolerance are either."""
    speed_error: float
    """Largest error of the recorded contact speeds at the ticks where both see a contact, or both none [m/s]."""
    state_error: float
    """Largest deviation of a recorded joint state from what Eq. (1) makes of the last one; share of the limits."""
    contacts: tuple[Contact, ...]
    """Contacts with people, in the order of their beginning."""
    self_collisions: tuple[Overlap, ...]
    plane_collisions: tuple[Overlap, ...]
    """Overlaps with table or floor."""
    excess: Excess
    """Excess over the joint limits, at the sub-steps."""
    tolerance: float
    """The largest error with which the record :attr:`agrees`."""

    @property
    def agrees(self) -> bool:
        """Whether distances and contacts are those that were recorded, and states follow from the jerks."""
        errors = (self.distance_error, self.contact_error, self.speed_error, self.state_error)
        return all(error <= self.tolerance for error in errors)

    @property
    def same_course(self) -> bool:
        """:attr:`agrees` but for contact speeds: where axes cross deep inside each other no touching point is the
        right one.
        """
        return self.contact_error == 0 and max(self.distance_error, self.state_error) <= self.tolerance

    @property
    def contact_speed(self) -> float:
        """Largest speed of a touching point of the robot [m/s]; 0 without contact."""
        return max((contact.speed for contact in self.contacts), default=0.0)

    @property
    def moving_contact(self) -> bool:
        """Whether the robot moved at some touching point."""
        return any(contact.moving for contact in self.contacts)
