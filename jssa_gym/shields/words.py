"""What a control step answered, in words: codes become text here, by the texts of ``reasons.py``."""

from collections import namedtuple
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.people import LOST, NEVER
from jssa_gym.kernels.verification import ENTRY, HALF_SPACE, REACH, STATIC
from jssa_gym.robots import RobotModel
from jssa_gym.shields.reading import Reading
from jssa_gym.shields.reasons import BAD_INPUTS, FIXTURES, REASONS, SAMPLES, UNFIT
from jssa_gym.shields.records import Records
from jssa_gym.tick import codes
from jssa_gym.tick.admit import GRADED, HALFWAY, STORED
from jssa_gym.tick.layout import ANSWER
from jssa_gym.tick.people import NO_TIME
from jssa_gym.types import Array, Kind

Told = namedtuple("Told", ANSWER.names or ())
"""An answer, but for the jerk, as Python's numbers; fields of :data:`~jssa_gym.tick.layout.ANSWER`."""


def in_words(told: Told, nominal: Array, robot: RobotModel, records: Records, reading: Reading) -> str:
    """Why the jerk is not the nominal; empty if it is."""
    if told.status == codes.NOMINAL:
        return ""
    if told.status == codes.FAILSAFE:
        obstacle = _obstacle(told, robot, records, reading)
        return f"slowed down: {obstacle}" if told.chosen == GRADED else obstacle
    if told.status != codes.FAULT:
        return REASONS[told.code]
    if codes.LIMITS <= told.code <= codes.ENTRY:
        return f"{REASONS[codes.UNVERIFIED]}: {_obstacle(told, robot, records, reading)}"
    reason = fault_in_words(told, records, reading)
    if records.settings.guarded and told.code != codes.NOT_FINITE_NOMINAL and not np.isfinite(nominal).all():
        reason = f"{BAD_INPUTS[1]}; {reason}"
    return f"{reason}; {REASONS[codes.UNVERIFIED]}" if told.unverified else reason


def kind_of(told: Told) -> Kind:
    """What kind of jerk it is that is applied."""
    if told.status == codes.FAULT:
        return "fault"
    if told.choice >= 0:
        return "alternative"
    if told.chosen == STORED:
        return "stop"
    if told.chosen in (HALFWAY, GRADED):
        return "graded"
    return "nominal" if told.status == codes.NOMINAL else "projected"


KINDS: tuple[Kind, ...] = get_args(Kind)
"""Kinds of jerks; :func:`kind_codes` says them by their place here."""


def kind_codes(told: NDArray[Any] | Mapping[str, NDArray[Any]]) -> NDArray[np.int64]:
    """:func:`kind_of` of many answers, shape (E,), as their places in :data:`KINDS`.

    Args:
        told: Shape (E,) of :data:`~jssa_gym.tick.layout.ANSWER`; or its fields ``status``, ``choice`` and ``chosen``.
    """
    status, chosen = told["status"], told["chosen"]
    graded = (chosen == HALFWAY) | (chosen == GRADED)
    which = (status == codes.FAULT, told["choice"] >= 0, chosen == STORED, graded, status == codes.NOMINAL)
    names: tuple[Kind, ...] = ("fault", "alternative", "stop", "graded", "nominal")
    return np.select(which, [KINDS.index(name) for name in names], KINDS.index("projected"))


def reason_codes(told: NDArray[Any], finite: NDArray[np.bool_], guarded: bool) -> NDArray[np.int64]:
    """:func:`~jssa_gym.shields.reasons.reason_code` of many answers: the number of what :func:`in_words` says of each.

    Args:
        told: Shape (E,) of :data:`~jssa_gym.tick.layout.ANSWER`.
        finite: Whether the nominal jerk was, shape (E,).
        guarded: Whether there is a verified stop.
    """
    status, code = told["status"], np.abs(told["code"])
    no_stop = (code >= codes.LIMITS) & (code <= codes.ENTRY)
    # "slowed down" stands before what is in the way, unless that begins with a name
    slowed = (status == codes.FAILSAFE) & (told["chosen"] == GRADED) & (code != codes.REACH) & (code != codes.MEETS)
    spoken = np.where(slowed | (code // 100 != status), 100 * status, code)
    fault = np.where(no_stop, codes.UNVERIFIED, code)
    if guarded:
        fault = np.where(finite | no_stop, fault, codes.NOT_FINITE_NOMINAL)
    return np.where(status == codes.NOMINAL, 0, np.where(status == codes.FAULT, fault, spoken))


def _obstacle(told: Told, robot: RobotModel, records: Records, reading: Reading) -> str:
    """What stands in the way of a stop."""
    if told.code == codes.LIMITS:
        return REASONS[told.code] + _outside(robot, records)
    if told.code in (codes.UNDECIDED, codes.CROWDED):
        return REASONS[told.code]
    part, when = robot.capsule_names[told.capsule], f"{told.moment:.3f} s"
    if told.detail == ENTRY:
        return f"somebody unseen could be at {part} before it rests, in {when}"
    if told.detail == REACH:
        names = reading.names or ()
        return f"{names[told.other]} can reach {part} before it rests, in {when}"
    names = {HALF_SPACE: reading.planes, STATIC: reading.statics}.get(told.detail, robot.capsule_names)
    return f"{part} would meet {names[told.other]} in {when}"


def _outside(robot: RobotModel, records: Records) -> str:
    """Which joint is where it should not be, or nothing."""
    position, (low, high) = records.memory.state[0, 0], records.settings.stop_limits[:2]
    for j in np.flatnonzero((position < low) | (position > high))[:1]:
        name = robot.joint_names[j]
        return f": {name} is at {position[j]:.4g} rad, outside [{low[j]:.4g}, {high[j]:.4g}] rad"
    return ""


def fault_in_words(told: Told, records: Records, reading: Reading) -> str:
    """What failed."""
    code, wrong, reason = told.code, reading.wrong, REASONS.get(told.code, "")
    arm, now = records.memory.arm[0], float(records.scene.now[0]["time"])
    if code < 0:
        why = fault_in_words(told._replace(code=-code), records, reading)
        return f"{why}; right again, but not for long enough to be believed"
    if code == codes.SCENE:
        return f"{reason}: {FIXTURES[told.detail] or wrong['people'] or wrong['fixtures']}"
    if code == codes.JOINTS:
        return f"{reason}: {wrong['joints']}"
    if code == codes.PEOPLE:
        time = f"the time went back from {arm['people_time']:g} s to {told.moment:g} s"
        if told.detail == NO_TIME:
            time = f"the time is {told.moment}"
        return f"{reason}: {time if told.detail else wrong['people'] or wrong['clock']}"
    if code == codes.LAGS:
        return f"{reason} {told.ticks} tick{'s' if told.ticks > 1 else ''}"
    if code == codes.CLOCK_UNREADABLE:
        return f"{reason}: {wrong['clock']}"
    if code == codes.CLOCK_NOT_FINITE:
        return f"{reason} {now}"
    if code == codes.CLOCK_BACK:
        return f"{reason} from {arm['time']:g} s to {now:g} s"
    if code == codes.CLOCK_STILL:
        return f"{reason} at {now:g} s: the joint state is not of this tick"
    if code == codes.FILTER_FAILED:
        return f"{reason}: ValueError: {wrong['fixtures'] or FIXTURES[1]}"
    if code == codes.ANSWER:
        return UNFIT[told.detail]
    if code == codes.UNWATCHED:
        return f"{reason} for {told.moment:.3g} s"
    if codes.TRUST < code < codes.TRUST + 10:
        return _distrust(told, records, reading)
    return _LONGER.get(code) or REASONS[code]


_LONGER = {
    codes.OTHER_TICK: "the people are of another tick",
    codes.FROZEN: f"{REASONS[codes.FROZEN]}: the same again though the arm has moved",
    codes.MOVING: f"{REASONS[codes.MOVING]}; with a state_tolerance it has to begin at rest",
}
"""Where a reason says more than its beginning in :data:`~jssa_gym.shields.reasons.REASONS`."""


def _distrust(told: Told, records: Records, reading: Reading) -> str:
    """Which body part's sample cannot be trusted, and why."""
    names, person = reading.names or (), records.memory.tracks[0, told.other]["person"]
    reason = f"{names[told.other]} of person {person}: {SAMPLES[told.code - codes.TRUST - 1]}"
    if told.detail == LOST:
        return f"{reason}, nothing to trust for {told.moment:.3g} s"
    return f"{reason}, nothing to trust yet" if told.detail == NEVER else reason
