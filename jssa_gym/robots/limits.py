"""Limits of velocity, acceleration and jerk: read from a small table, stated by a file, or guessed and marked so."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import RobotModelError
from jssa_gym.storage import read_text
from jssa_gym.types import Array

LIMITS = ("velocity", "acceleration", "jerk")
"""What a table of limits holds."""

_LARGEST = 2**20
"""Size from which no table is read [bytes]."""

GUESSED_VELOCITY = np.pi
"""Velocity of a joint about which nothing is stated [rad/s]: that of a mid-sized arm's joints."""

_RISE, _EASE = 0.304, 0.152
"""Times from rest to full velocity and from rest to full acceleration [s], with which the paper's jerk limits of the
LR Mate were made: acceleration = velocity / 0.304 s, jerk = 0.9 · acceleration / 0.152 s."""


@dataclass(frozen=True, slots=True, eq=False)
class LimitTable:
    """Limits of n joints, and where they come from."""

    velocity: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (n,) [rad/s²]."""
    jerk: Array
    """Shape (n,) [rad/s³]."""
    guessed: tuple[str, ...] = ()
    """Which of them nobody has stated."""
    source: str = ""
    """Who has stated the others."""
    uncovered: tuple[str, ...] = ()
    """Links that draw something outside of capsules, and that nothing is promised about."""
    group: int | None = None
    """Geom group of the arm's file that holds the capsules; None for the usual one."""


def read_limits(path: Path, partial: bool = False) -> LimitTable:
    """Read a table of limits: ``unit``, ``velocity``, ``acceleration``, ``jerk``; it may say more.

    Args:
        path: Of the table.
        partial: Whether jerk, or acceleration and jerk, may be missing; they are guessed then.

    Raises:
        RobotModelError: It is not there, no such table, lacks something, or has a limit that is none.
    """
    try:
        table = tomllib.loads(read_text(path, RobotModelError, _LARGEST))
    except RobotModelError:
        raise
    except (ValueError, RecursionError) as error:  # the former of numbers that are too long, too
        raise RobotModelError(f"{path.name} is not valid TOML: {error}") from error
    missing = [name for name in LIMITS if name not in table]
    guessed = missing if partial and missing in (["jerk"], ["acceleration", "jerk"]) else []
    if missing != guessed or table.get("unit") not in ("deg", "rad"):
        raise RobotModelError(f"{path.name} needs velocity, acceleration, jerk, and unit = 'deg' or 'rad'")
    factor = np.pi / 180.0 if table["unit"] == "deg" else 1.0
    try:
        given = {name: factor * np.asarray(table[name], float) for name in LIMITS if name in table}
    except (ValueError, TypeError, OverflowError) as error:
        raise RobotModelError(
            f"{path.name}: velocity, acceleration, jerk have to be lists of numbers: {error}"
        ) from error
    for name, values in given.items():
        if not (np.all(values > 0.0) and np.all(np.isfinite(values))):
            raise RobotModelError(
                f"{path.name}: {name} limits have to be positive and finite, got {table[name]} {table['unit']}"
            )
    velocity = given["velocity"]
    acceleration = given.get("acceleration", velocity / _RISE)
    jerk = given.get("jerk", _guessed_jerk(acceleration))
    return LimitTable(
        velocity,
        acceleration,
        jerk,
        tuple(guessed) or _names(path, table, "guessed"),
        str(table.get("source", "")),
        _names(path, table, "uncovered"),
        _group(path, table),
    )


def _names(path: Path, table: Mapping[str, Any], key: str) -> tuple[str, ...]:
    names = table.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise RobotModelError(f"{path.name}: {key} has to be a list of names, got {names!r}")
    return tuple(names)


def _group(path: Path, table: Mapping[str, Any]) -> int | None:
    group = table.get("group")
    if group is not None and (not isinstance(group, int) or isinstance(group, bool)):
        raise RobotModelError(f"{path.name}: group has to be the number of a geom group, got {group!r}")
    return group


def guess_limits(joints: Sequence[str], velocity: Mapping[str, float], source: str) -> LimitTable:
    """Limits of joints of which at most the velocity is stated.

    Args:
        joints: Names.
        velocity: What is stated, by name [rad/s].
        source: Who states it.
    """
    speeds = np.array([velocity.get(name, GUESSED_VELOCITY) for name in joints])
    stated = all(name in velocity for name in joints)
    guessed = ("acceleration", "jerk") if stated else LIMITS
    acceleration = speeds / _RISE
    return LimitTable(speeds, acceleration, _guessed_jerk(acceleration), guessed, source if velocity else "")


def _guessed_jerk(acceleration: Array) -> Array:
    """Jerk limits to go with acceleration limits."""
    return 0.9 * acceleration / _EASE
