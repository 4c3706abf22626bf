"""What the verified stop assumes about people, sensors and drives; how far an arm's points can swing.

Parameters only: that a step is FAILSAFE is decided in ``tick/admit.py``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.energy import speed_for
from jssa_gym.safety.parts import FOOT_PARTS, LIMB_PARTS, SLOW_PARTS, by_name, is_called
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.types import Array, JointState
from jssa_gym.validation import check_fields, known_name, number_within, positive_number, real_array, true_or_false

HARDNESS = (0.4, 0.55, 0.7, 0.85, 1.0)
"""Shares of the acceleration and jerk limits that graded stops are planned with, softest first."""

ARM_SPEEDS: Mapping[str, tuple[float, float]] = {"right_arm": (1.6, 2.0), "left_arm": (1.6, 2.0)}
"""For ``FailsafeParams(end_speeds=...)``: the arms of this package's own people, which begin at the shoulder; that
walks, a hand may reach [m/s], ISO 13855. Only for measurements that have start and end the same way round."""

LEG_SPEEDS: Mapping[str, tuple[float, float]] = {"right_leg": (1.6, 4.8), "left_leg": (1.6, 4.8)}
"""The same of legs that are one capsule, from a hip that walks to a foot that swings [m/s]. This package's own people
glide, but for the recorded ones, and need it not."""


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
        foot_speed: As ``limb_speed``, for feet [m/s].
        end_speeds: Speeds [m/s] that start and end of the capsules of these names do not exceed, instead of the above;
            None for one speed a part.
        human_acceleration: Neither end of a capsule changes its velocity faster [m/s²], for all body parts or by name;
            None if nobody knows.
        velocity_error: Largest error of a measured velocity of a capsule end [m/s]; used with ``human_acceleration``.
        contact_speed: What the arm's touching point may have in a contact [m/s], for all body parts or by name.
        contact_energy: What a contact may give a body part [J], for all body parts or by name; None for no such limit.
        state_tolerance: How far a reading of the joints' position, velocity and acceleration may be from where the
            applied jerks must have led [rad, rad/s, rad/s²], each for all joints or one a joint.
        graded: Whether the arm is slowed down by and by where only a harder stop is verified, or where what a filter
            wants leaves people less than 5 cm.
        watched: Where everybody is measured, so that people may come and go, as a
            :class:`~jssa_gym.safety.region.WatchedRegion` or a mapping of its fields; None: nobody may.

    Raises:
        ParameterError: A number is negative or not finite, or a speed, ``max_age`` or an acceleration is not positive.
    """

    human_speed: float = 1.6
    """No point of a person moves faster [m/s]; ISO 13855's walking speed."""
    limb_speed: float = 2.0
    """The same for upper limbs, and for all parts whose name says nothing that is known [m/s]; ISO 13855. That is below
    a foot's: at that, arms beside everybody who is not named would stop from more than twice as far. A foot under such
    a name fails open; ``jssa_gym.check_env`` says which names are unknown. See :mod:`jssa_gym.safety.parts`."""
    position_error: float = 0.0
    """Largest error of a measured capsule end [m]."""
    actuation_lag: float = 0.0
    """Time from a command to the arm's motion [s]."""
    tracking_error: float = 0.0
    """Largest distance of a point of the arm from where the command puts it [m]."""
    max_age: float = 0.2
    """Measurements are grown by their age up to this; older ones are a fault [s]."""
    foot_speed: float = 4.8
    """As ``limb_speed``, for the parts in :data:`~jssa_gym.safety.parts.FOOT_PARTS`, shins and shoes included [m/s]:
    three times ISO 13855's walking speed. A foot swings for 40 % of a stride, so 2.5 times as fast as the person walks
    in the mean; feet were recorded at 3.1 to 3.8 m/s. What is called a leg keeps
    ``human_speed`` though it may end in a foot, see :data:`LEG_SPEEDS`."""
    end_speeds: Mapping[str, tuple[float, float]] | None = None
    """Speeds [m/s] that start and end of the capsules of these names do not exceed, instead of the above, such as
    :data:`ARM_SPEEDS`; ends that are measured the other way round fail open. None: one speed a part. Names here and in
    the mappings below are the same in any case; those that no capsule has are said aloud when people are met."""
    human_acceleration: float | Mapping[str, float] | None = None
    """Neither end of a capsule changes its velocity faster [m/s²], for all body parts or by name, and velocities are
    measured; the parts not named, or None: nobody knows."""
    velocity_error: float = 0.0
    """Largest error of a measured velocity of a capsule end [m/s], a filter's lag times the acceleration included; used
    with ``human_acceleration``. The larger it is, the less is seen of who breaks that: samples are compared with the
    one before and with one about T = 0.25 s old, so that an acceleration that lasts is seen above
    ``human_acceleration`` + 2 ``velocity_error`` / T (+ 4 ``velocity_error`` / T where errors happen to hide it)."""
    contact_speed: float | Mapping[str, float] = 0.0
    """Speed of the arm's touching point that a contact may have [m/s], for all body parts or by name; the parts not
    named may be touched at rest only."""
    contact_energy: float | Mapping[str, float] | None = None
    """Energy that the arm may give a body part in a transient contact [J], for all body parts or by name, such as
    :data:`~jssa_gym.safety.energy.CONTACT_ENERGY`: the part may then be touched at the speed that keeps below it
    whatever mass the arm has, :func:`~jssa_gym.safety.energy.speed_for`, or at ``contact_speed`` where that is above 0
    and smaller. Of the arm's own motion, as if the person stood still. Indicative: no conformity follows from it."""
    state_tolerance: tuple[float | Sequence[float], ...] = (0.0, 0.0, 0.0)
    """How far a reading of the joints' position, velocity and acceleration may be from where the applied jerks must
    have led [rad, rad/s, rad/s²], each for all joints or one a joint; velocity and acceleration may be inf: not
    measured. 0 is for readings of the commanded state, and allows for rounding. What lies beyond is a fault; what lies
    within may be the arm's own deviation, so that the position's is kept as a distance from people too."""

    graded: bool = False
    """Whether the arm is slowed down by and by where only a harder stop is verified, see :data:`HARDNESS`; else it goes
    on as it is asked to until none is, and then brakes as hard as it can. No assumption, the promise is the same."""
    watched: WatchedRegion | None = None
    """Where everybody is measured, so that people may come and go; None: nobody may appear or leave until ``reset``."""

    def __post_init__(self) -> None:
        check_fields(self, ("graded",), true_or_false)
        check_fields(self, ("human_speed", "limb_speed", "foot_speed", "max_age"), positive_number)
        check_fields(self, ("position_error", "actuation_lag", "tracking_error", "velocity_error"), number_within, 0.0)
        check_fields(self, ("contact_speed",), _checked_parts, number_within, 0.0)
        if self.contact_energy is not None:
            check_fields(self, ("contact_energy",), _checked_parts, number_within, 0.0)
        if self.end_speeds is not None:
            object.__setattr__(self, "end_speeds", _checked_ends(self.end_speeds))
        if self.human_acceleration is not None:
            check_fields(self, ("human_acceleration",), _checked_parts, positive_number)
        object.__setattr__(self, "state_tolerance", _checked_tolerance(self.state_tolerance))
        if self.watched is not None:
            object.__setattr__(self, "watched", WatchedRegion.of(self.watched))

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
        """Speed bound of a body part [m/s], ``end_speeds`` aside: the limbs' unless its name says that it is none."""
        if is_called(part, FOOT_PARTS):
            return max(self.foot_speed, self.limb_speed, self.human_speed)
        known = is_called(part, SLOW_PARTS) and not is_called(part, LIMB_PARTS)
        return self.human_speed if known else max(self.limb_speed, self.human_speed)

    @property
    def entry_speed(self) -> float:
        """Nobody comes into the watched region faster [m/s]; 0 without one."""
        if self.watched is None:
            return 0.0
        fastest = (max(ends) for ends in (self.end_speeds or {}).values())
        return self.watched.entry_speed or max(self.human_speed, self.limb_speed, self.foot_speed, *fastest)

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        """Speed bounds of start and end of a body part's capsule [m/s]."""
        same = self.speed_of(part)
        return by_name(self.end_speeds or {}, part) or (same, same)

    def acceleration_of(self, part: str) -> float:
        """Acceleration bound of a body part [m/s²]; 0 if there is none."""
        bounds = self.human_acceleration
        return float((by_name(bounds, part) if isinstance(bounds, Mapping) else bounds) or 0.0)

    def contact_speed_of(self, part: str) -> float:
        """Allowed speed of the arm when it touches a body part [m/s]."""
        speeds, energies = self.contact_speed, self.contact_energy
        speed = float(by_name(speeds, part) or 0.0) if isinstance(speeds, Mapping) else speeds
        energy = by_name(energies, part) if isinstance(energies, Mapping) else energies
        if energy is None:
            return speed
        slow = speed_for(energy, part)
        return min(speed, slow) if speed > 0.0 else slow

    def names_beside(self, parts: Sequence[str]) -> dict[str, list[str]]:
        """Names in the mappings by body part that none of these body parts has."""
        there = {part.casefold() for part in parts}
        found = {}
        for field in ("end_speeds", "human_acceleration", "contact_speed", "contact_energy"):
            values = getattr(self, field)
            beside = [name for name in values if name.casefold() not in there] if isinstance(values, Mapping) else []
            if beside:
                found[field] = beside
        return found

    def tolerance_of(self, robot: RobotModel) -> Array:
        """:attr:`state_tolerance` of a robot's joints, rows position, velocity, acceleration, shape (3, n).

        Raises:
            ParameterError: It has another number of joints.
        """
        for name, row in zip(JointState._fields, self.state_tolerance, strict=True):
            if isinstance(row, tuple) and len(row) != robot.n:
                raise ParameterError(f"state_tolerance has {len(row)} numbers for {name}, the robot {robot.n} joints")
        return np.array([np.broadcast_to(row, robot.n) for row in self.state_tolerance], np.float64)

    def displacement(self, robot: RobotModel) -> float:
        """How far a point of the arm may be from where the shield takes it to be [m]: tracking and state tolerance.

        Raises:
            ParameterError: :attr:`state_tolerance` has another number of joints.
        """
        return self.tracking_error + float((levers(robot) @ self.tolerance_of(robot)[0]).max(initial=0.0))


def _told_once(field: str, values: dict[str, Any]) -> dict[str, Any]:
    """The mapping, if it names each body part once, whatever the case."""
    if len({part.casefold() for part in values}) < len(values):
        raise ParameterError(f"{field} has to name each body part once, upper and lower case are the same: {values!r}")
    return values


def _checked_parts(field: str, value: Any, check: Callable[..., float], *bounds: float) -> float | dict[str, float]:
    """A number that passes a check of :mod:`jssa_gym.validation`, for all body parts or by name."""
    if not isinstance(value, Mapping):
        return check(field, value, *bounds)
    return _told_once(field, {str(part): check(f"{field}[{part!r}]", one, *bounds) for part, one in value.items()})


def _checked_ends(value: Any) -> dict[str, tuple[float, float]]:
    wanted = "end_speeds has to map names of capsules to their speeds (start, end), positive numbers [m/s]"
    if not isinstance(value, Mapping):
        raise ParameterError(f"{wanted}; got {value!r}")
    found = {}
    for part, speeds in value.items():
        start, end = real_array(f"end_speeds[{part!r}]", speeds, (2,), "speeds (start, end)").tolist()
        if not (start > 0.0 and end > 0.0):
            raise ParameterError(f"{wanted}; got {speeds!r} for {part!r}")
        found[str(part)] = start, end
    return _told_once("end_speeds", found)


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
