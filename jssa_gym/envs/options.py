"""Checks of what users pass to an environment, before anything changes."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jssa_gym.envs.observation import OBSERVATIONS
from jssa_gym.envs.tasks import Task
from jssa_gym.envs.window import check_display
from jssa_gym.envs.world import SUBSTEP
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HumanMotion
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array
from jssa_gym.validation import known_name, number_within, positive_integer, real_array

ENDINGS = ("success", "contact", "moving_contact", "limit_violation")
"""What may end an episode."""

SHORTEST, LONGEST = 0.001, 0.02
"""Control steps: 1,000 to 50 Hz [s]."""

OPTIONS = ("joint_position", "goal", "human_start")
"""What ``reset`` may be told."""


def check_arguments(
    dynamics: Any, terminate_on: Any, observation: Any, render_mode: Any, width: Any, height: Any
) -> tuple[int, int]:
    """Refuse what :class:`~jssa_gym.envs.ArmEnv` cannot be built with.

    Returns:
        Width and height of pictures.

    Raises:
        ParameterError: An argument is unknown or out of range.
        DisplayError: A window without a display.
    """
    known_name("dynamics", dynamics, ("kinematic", "servo"))
    known_name("observation", observation, OBSERVATIONS)
    if isinstance(terminate_on, str) or not isinstance(terminate_on, Sequence):
        raise ParameterError(f"terminate_on has to be a tuple of {', '.join(ENDINGS)}; got {terminate_on!r}")
    for ending in terminate_on:
        known_name("ending in terminate_on", ending, ENDINGS)
    if render_mode is not None:
        known_name("render_mode", render_mode, ("rgb_array", "human"))
    size = positive_integer("width", width), positive_integer("height", height)
    if render_mode == "human":
        check_display()
    return size


def checked_step(dt: Any, dynamics: str) -> float:
    """A control step [s] that the arm can be simulated with.

    Raises:
        ParameterError: It is not between :data:`SHORTEST` and :data:`LONGEST`, or with servos no multiple of 1 ms.
    """
    step = number_within("dt", dt, SHORTEST, LONGEST)
    if dynamics == "servo" and abs(step / SUBSTEP - round(step / SUBSTEP)) > 1e-9:
        raise ParameterError(
            f"dynamics='servo' simulates whole milliseconds: dt has to be a multiple of {SUBSTEP} s, got {dt!r}"
        )
    return step


class Beginning(NamedTuple):
    """What a user wants an episode to begin with; None is drawn."""

    position: Array
    """Joint position, shape (n,) [rad]."""
    goal: Array | None
    """See the task."""
    human_start: Array | None
    """The first person's root, shape (2,) [m]."""


def checked_options(options: dict[str, Any] | None, robot: RobotModel, human: HumanMotion, task: Task) -> Beginning:
    """The options of ``reset``.

    Raises:
        ParameterError: An option is unknown or out of range.
    """
    options = {} if options is None else options
    unknown = [key for key in options if key not in OPTIONS]
    if unknown:
        raise ParameterError(f"unknown reset options {unknown}; valid: {', '.join(OPTIONS)}")
    position = _checked_position(options.get("joint_position"), robot)
    start, goal = options.get("human_start"), options.get("goal")
    if start is not None:
        start = real_array("human_start", start, (2,), "a point on the floor [m]")
        human.check_start(start)
    if goal is not None:
        goal = task.check_goal(goal, robot)
    return Beginning(position, goal, start)


def _checked_position(position: Any, robot: RobotModel) -> Array:
    if position is None:
        return np.array(robot.home)
    array = real_array("joint_position", position, (robot.n,), "a joint position [rad]")
    if not robot.limits.contain(array):
        raise ParameterError(f"joint_position has to lie inside the position limits, got {position!r}")
    return array
