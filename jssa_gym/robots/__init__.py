"""Robots: read from MJCF, limits with their sources."""

import functools
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.robots.lr_mate_200id_7l import lr_mate_200id_7l
from jssa_gym.robots.model import JointLimits, LimitsError, RobotModel
from jssa_gym.storage import read_text
from jssa_gym.types import Array

ROBOTS: dict[str, Callable[[], RobotModel]] = {
    "lr_mate_200id_7l": lr_mate_200id_7l,
}
"""Robots by name; add yours to use it in ``gym.make(..., robot=name)``."""

__all__ = ["ROBOTS", "JointLimits", "RobotModel", "lr_mate_200id_7l", "make_robot"]

_LARGEST = 2**20
"""Size from which no file of limits is read [bytes]."""


@functools.lru_cache(maxsize=32)
def _built(build: Callable[[], RobotModel]) -> RobotModel:
    return build()


def make_robot(robot: str | Path | RobotModel) -> RobotModel:
    """A robot from its name in :data:`ROBOTS` or from an MJCF file; a model as it is.

    The limits of ``arm.xml``, which MJCF has no place for, are read from ``arm.limits.toml`` beside it::

        unit = "deg"          # or "rad"
        velocity = [370, 310] # one number a joint
        acceleration = [641, 576]
        jerk = [3798, 3408]

    Raises:
        ParameterError: Neither a name nor a file.
        RobotModelError: The file is not a serial arm, or its limits are missing or wrong.
    """
    if isinstance(robot, RobotModel):
        return robot
    if isinstance(robot, str) and robot in ROBOTS:
        return _built(ROBOTS[robot])
    if not isinstance(robot, str | Path) or Path(robot).suffix != ".xml":
        raise ParameterError(
            f"unknown robot {robot!r}; valid: a RobotModel, an MJCF file (.xml), or one of {', '.join(ROBOTS)}"
        )
    path = Path(robot)
    if not path.is_file():
        raise RobotModelError(f"no MJCF file at {path}")
    velocity, acceleration, jerk = _limits_beside(path)
    try:
        return RobotModel.from_mjcf(path, velocity=velocity, acceleration=acceleration, jerk=jerk)
    except LimitsError as error:
        raise RobotModelError(f"{path.with_suffix('.limits.toml').name}: {error}") from error
    except UnicodeDecodeError as error:  # of a file that it includes
        raise RobotModelError(f"{path} has a name that is not in UTF-8: {error}") from error


def _limits_beside(path: Path) -> tuple[Array, Array, Array]:
    beside = path.with_suffix(".limits.toml")
    if not beside.is_file():
        raise RobotModelError(f"no {beside.name} beside {path.name} with its velocity, acceleration, jerk limits")
    try:
        table = tomllib.loads(read_text(beside, RobotModelError, _LARGEST))
    except RobotModelError:
        raise
    except (ValueError, RecursionError) as error:  # the former of numbers that are too long, too
        raise RobotModelError(f"{beside.name} is not valid TOML: {error}") from error
    names = ("velocity", "acceleration", "jerk")
    missing = [name for name in names if name not in table]
    if missing or table.get("unit") not in ("deg", "rad"):
        raise RobotModelError(f"{beside.name} needs velocity, acceleration, jerk, and unit = 'deg' or 'rad'")
    factor = np.pi / 180.0 if table["unit"] == "deg" else 1.0
    try:
        velocity, acceleration, jerk = (factor * np.asarray(table[name], float) for name in names)
    except (ValueError, TypeError, OverflowError) as error:
        raise RobotModelError(
            f"{beside.name}: velocity, acceleration, jerk have to be lists of numbers: {error}"
        ) from error
    return velocity, acceleration, jerk
