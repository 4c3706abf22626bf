"""Robots: read from MJCF, limits with their sources.

A new arm is an MJCF file and its ``.limits.toml`` in ``assets/``, and a name in ``ROBOTS``; the paper's has a module
of its own, for its two sets of limits. ``limits`` reads such files, ``model`` has ``JointLimits`` and ``RobotModel``,
``prepare`` takes anybody's file, ``menagerie`` those of MuJoCo Menagerie.
"""

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.robots.limits import LIMITS, read_limits
from jssa_gym.robots.lr_mate_200id_7l import lr_mate_200id_7l
from jssa_gym.robots.menagerie import MENAGERIE, prepared_folder, published_limits
from jssa_gym.robots.model import ASSETS, JointLimits, LimitsError, RobotModel


def ur5e() -> RobotModel:
    """Universal Robots UR5e, standing at the world's origin; sources in ``assets/ur5e.xml`` and its limits' file."""
    return make_robot(ASSETS / "ur5e.xml")


def fr3() -> RobotModel:
    """Franka Research 3, standing at the world's origin; sources in ``assets/fr3.xml`` and its limits' file."""
    return make_robot(ASSETS / "fr3.xml")


ROBOTS: dict[str, Callable[[], RobotModel]] = {
    "lr_mate_200id_7l": lr_mate_200id_7l,
    "ur5e": ur5e,
    "fr3": fr3,
}
"""Robots by name; add yours to use it in ``gym.make(..., robot=name)``."""

__all__ = [
    "DEFAULT",
    "MENAGERIE",
    "ROBOTS",
    "JointLimits",
    "RobotModel",
    "fr3",
    "lr_mate_200id_7l",
    "make_robot",
    "ur5e",
]

DEFAULT = "lr_mate_200id_7l"
"""Name of the paper's arm, which is meant where none is named."""

PREPARED = "robot.xml"
"""Name of the model's file in a folder that ``jssa-gym robot check --write`` has made."""


@functools.lru_cache(maxsize=32)
def _built(build: Callable[[], RobotModel]) -> RobotModel:
    return build()


def guessed_limits(name: str) -> tuple[str, ...]:
    """Which limits of an arm of :data:`ROBOTS` or ``MENAGERIE`` nobody has stated; nothing is downloaded for it."""
    if name in ROBOTS:
        return make_robot(name).guessed
    table = published_limits(name)
    return LIMITS if table is None else table.guessed


def make_robot(robot: str | Path | RobotModel) -> RobotModel:
    """A robot from its name, an MJCF or URDF file or a prepared folder; a model as it is.

    Names are those of :data:`ROBOTS` and of :data:`~jssa_gym.robots.menagerie.MENAGERIE`, folders those that
    ``jssa-gym robot check --write`` has made.

    The limits of ``arm.xml`` or ``arm.urdf``, which those have no place for, are read from ``arm.limits.toml`` beside
    it::

        unit = "deg"          # or "rad"
        velocity = [370, 310] # one number a joint
        acceleration = [641, 576]
        jerk = [3798, 3408]
        uncovered = []        # joints of links that may draw something outside of capsules: nothing is promised there
        group = 3             # geom group that holds the capsules; without it 3, and of a URDF 0, its <collision>
        guessed = ["jerk"]    # which of these nobody has stated

    Raises:
        ParameterError: Neither a name nor a file.
        MissingExtraError: The name is one of Menagerie's, whose package is not installed.
        RobotModelError: The file is not a serial arm, or its limits are missing or wrong.
    """
    if isinstance(robot, RobotModel):
        return robot
    if isinstance(robot, str) and robot in ROBOTS:
        return _built(ROBOTS[robot])
    if isinstance(robot, str) and robot in MENAGERIE:
        return replace(make_robot(prepared_folder(robot)), name=robot)
    if isinstance(robot, str | Path) and (Path(robot) / PREPARED).is_file():
        robot = Path(robot) / PREPARED
    if not isinstance(robot, str | Path) or Path(robot).suffix not in (".xml", ".urdf"):
        raise ParameterError(
            f"unknown robot {robot!r}; valid: a RobotModel, an MJCF or URDF file (.xml, .urdf), a folder of `jssa-gym "
            f"robot check --write`, or one of {', '.join((*ROBOTS, *MENAGERIE))}"
        )
    path = Path(robot)
    if not path.is_file():
        raise RobotModelError(f"no {'URDF' if path.suffix == '.urdf' else 'MJCF'} file at {path}")
    beside = path.with_suffix(".limits.toml")
    if not beside.is_file():
        raise RobotModelError(
            f"no {beside.name} beside {path.name} with its velocity, acceleration, jerk limits; `jssa-gym robot check "
            f"{path.name}` says what else is missing"
        )
    table = read_limits(beside)
    try:
        model = RobotModel.from_mjcf(
            path,
            velocity=table.velocity,
            acceleration=table.acceleration,
            jerk=table.jerk,
            uncovered=table.uncovered,
            group=table.group,
        )
    except LimitsError as error:
        raise RobotModelError(f"{path.with_suffix('.limits.toml').name}: {error}") from error
    except UnicodeDecodeError as error:  # of a file that it includes
        raise RobotModelError(f"{path} has a name that is not in UTF-8: {error}") from error
    return replace(model, guessed=table.guessed)
