"""What the verified stop assumes about people, sensors and drives; how far an arm's points can swing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array
from jssa_gym.validation import known_name, number_within, positive_number

SLOW_PARTS = (
    "head",
    "neck",
    "torso",
    "trunk",
    "body",
    "chest",
    "spine",
    "hip",
    "pelvis",
    "leg",
    "knee",
    "foot",
    "ankle",
)
"""A body part whose name contains one of these, in any case, keeps ``human_speed``; all others may be upper limbs."""

LIMB_PARTS = ("arm", "elbow", "wrist", "hand", "palm", "fist", "finger", "thumb")
"""A body part whose name contains one of these, in any case, may move at ``limb_speed``, whatever else it contains: the
wrist of a body is a wrist."""

HARDNESS = (0.4, 0.55, 0.7, 0.85, 1.0)
"""Shares of the acceleration and jerk limits that graded stops are planned with, softest first."""


@dataclass(frozen=True, slots=True)
class FailsafeParams:
    """Assumptions of the verified stop, and how it gives way; its promise holds as far as they do.

    Args:
        human_speed: No point of a person moves faster [m/s].
        limb_speed: The same for upper limbs and parts of unknown names [m/s].
        position_error: Largest error of a measured capsule end [m].
        actuation_lag: Time from a command to the arm's motion [s].
        tracking_error: Largest distance of a point of the arm from where the command puts it [m].
        max_age: Measurements are grown by their age up to this; older ones are a fault [s].
        contact_speed: What the arm's touching point may have in a contact [m/s], for all body parts or by name.
        state_tolerance: How far a reading of the joints' position, velocity and acceleration may be from where the
            applied jerks must have led [rad, rad/s, rad/s²], each for all joints or one a joint.
        graded: Whether the arm is slowed down by and by where only a harder stop is verified.

    Raises:
        ParameterError: A number is negative or not finite, or a speed or ``max_age`` is not positive.
    """

    human_speed: float = 1.6
    """No point of a person moves faster [m/s]; ISO 13855's walking speed."""
    limb_speed: float = 2.0
    """The same for upper limbs, and for all parts whose name is not in :data:`SLOW_PARTS` [m/s]; ISO 13855."""
    position_error: float = 0.0
    """Largest error of a measured capsule end [m]."""
    actuation_lag: float = 0.0
    """Time from a command to the arm's motion [s]."""
    tracking_error: float = 0.0
    """Largest distance of a point of the arm from where the command puts it [m]."""
    max_age: float = 0.2
    """Measurements are grown by their age up to this; older ones are a fault [s]."""
    contact_speed: float | Mapping[str, float] = 0.0
    """Speed of the arm's touching point that a contact may have [m/s], for all body parts or by name; the parts not
    named may be touched at rest only."""
    state_tolerance: tuple[float | Sequence[float], ...] = (0.0, 0.0, 0.0)
    """How far a reading of the joints' position, velocity and acceleration may be from where the applied jerks must
    have led [rad, rad/s, rad/s²], each for all joints or one a joint; velocity and acceleration may be inf: not
    measured. 0 is for readings of the commanded state, and allows for rounding. What lies beyond is a fault; what lies
    within may be the arm's own deviation, so that the position's is kept as a distance from people too."""

    graded: bool = False
    """Whether the arm is slowed down by and by where only a harder stop is verified, see :data:`HARDNESS`; else it goes
    on as it is asked to until none is, and then brakes as hard as it can. No assumption, the promise is the same."""

    def __post_init__(self) -> None:
        if not isinstance(self.graded, bool):
            raise ParameterError(f"graded has to be True or False, got {self.graded!r}")
        for name in ("human_speed", "limb_speed", "max_age"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        for name in ("position_error", "actuation_lag", "tracking_error"):
            object.__setattr__(self, name, number_within(name, getattr(self, name), 0.0))
        speeds = self.contact_speed
        if isinstance(speeds, Mapping):
            checked = {
                str(part): number_within(f"contact_speed[{part!r}]", speed, 0.0) for part, speed in speeds.items()
            }
            object.__setattr__(self, "contact_speed", checked)
        else:
            object.__setattr__(self, "contact_speed", number_within("contact_speed", speeds, 0.0))
        object.__setattr__(self, "state_tolerance", _checked_tolerance(self.state_tolerance))

    @property
    def hardness(self) -> tuple[float, ...]:
        """Shares of acceleration and jerk limits that stops are planned with, softest first."""
        return HARDNESS if self.graded else HARDNESS[-1:]

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The assumptions of a mapping of fields, such as a JSON object holds; the others keep their defaults.

        Raises:
            ParameterError: A field is unknown or out of range.
        """
        for name in values:
            known_name("assumption", name, [field.name for field in fields(cls)])
        return cls(**values)

    def speed_of(self, part: str) -> float:
        """Speed bound of a body part [m/s]: the limbs' unless its name says that it is none."""
        name = part.casefold()
        known = any(slow in name for slow in SLOW_PARTS) and not any(limb in name for limb in LIMB_PARTS)
        return self.human_speed if known else max(self.limb_speed, self.human_speed)

    def contact_speed_of(self, part: str) -> float:
        """Allowed speed of the arm when it touches a body part [m/s]."""
        speeds = self.contact_speed
        return float(speeds.get(part, 0.0)) if isinstance(speeds, Mapping) else speeds

    def tolerance_of(self, robot: RobotModel) -> Array:
        """:attr:`state_tolerance` of a robot's joints, rows position, velocity, acceleration, shape (3, n).

        Raises:
            ParameterError: It has another number of joints.
        """
        for name, row in zip(_STATE, self.state_tolerance, strict=True):
            if isinstance(row, tuple) and len(row) != robot.n:
                raise ParameterError(f"state_tolerance has {len(row)} numbers for {name}, the robot {robot.n} joints")
        return np.array([np.broadcast_to(row, robot.n) for row in self.state_tolerance], np.float64)

    def displacement(self, robot: RobotModel) -> float:
        """How far a point of the arm may be from where the shield takes it to be [m]: tracking and state tolerance.

        Raises:
            ParameterError: :attr:`state_tolerance` has another number of joints.
        """
        return self.tracking_error + float((levers(robot) @ self.tolerance_of(robot)[0]).max(initial=0.0))


_STATE = ("position", "velocity", "acceleration")


def _checked_tolerance(value: Any) -> tuple[float | tuple[float, ...], ...]:
    wanted = (
        "state_tolerance has to be three times a number of at least 0, or one a joint: position [rad], velocity "
        "[rad/s], acceleration [rad/s²]; the last two may be inf"
    )
    try:
        rows = [np.array(row, np.float64) for row in value]
    except (TypeError, ValueError):
        rows = []
    if len(rows) != 3 or not all(row.ndim <= 1 and row.size and np.all(row >= 0.0) for row in rows):
        raise ParameterError(f"{wanted}; got {value!r}")
    if not np.all(np.isfinite(rows[0])):
        raise ParameterError(f"{wanted}; positions have to be measured, got {value!r}")
    return tuple(float(row) if row.ndim == 0 else tuple(row.tolist()) for row in rows)


def levers(robot: RobotModel) -> Array:
    """How far from each joint's axis the axis of each capsule can be, over all postures: shape (m, n) [m].

    A joint turning by an angle moves no point of the capsule's axis by more than lever times angle; 0 where the
    joint does not move the capsule.
    """
    out = np.zeros((len(robot.capsules), robot.n))
    for i, capsule in enumerate(robot.capsules):
        link = int(capsule["link"])
        for end in (capsule["start"], capsule["end"]):
            # largest distance of the end from the origin of the joint after the one looked at
            beyond = 0.0
            for j in range(link, -1, -1):
                axis = robot.links[j]["axis"]
                arm = end if j == link else robot.links[j + 1]["offset"]
                across = np.linalg.norm(arm - arm.dot(axis) * axis)
                out[i, j] = max(out[i, j], across + beyond)
                beyond += np.linalg.norm(arm)
    return out
