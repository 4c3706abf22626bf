"""Observations with the goal apart: what was achieved, what is desired, and what that is worth, for hindsight too."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from jssa_gym.envs.observation import FAR
from jssa_gym.envs.tasks import COMMON_TERMS, RewardTerm, Task
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array
from jssa_gym.validation import positive_number

GOAL_TERMS = (RewardTerm("goal", -1.0, "1 farther from the desired goal than the tolerance, else 0"),)
"""What takes the place of a task's own terms."""

_BEYOND = 1.5
"""How far achieved joint positions go, in half ranges from the middle, as in the other observations."""

_COMMON = tuple(f"reward/{term.name}" for term in COMMON_TERMS)


class Goals:
    """Achieved and desired goals of a task as float32: points for the tool from the robot's base, or joint positions.

    Args:
        task: Says by its ``space`` which, and by its ``tolerance`` how near counts.
        robot: The arm, where it stands.

    Raises:
        ParameterError: The task has no tolerance.
    """

    def __init__(self, task: Task, robot: RobotModel) -> None:
        if not hasattr(task, "tolerance"):
            raise ParameterError(
                f"observation='goal' needs a task with a tolerance, which task {task.name!r} has not: take 'closest'"
            )
        self._tolerance = positive_number("tolerance", task.tolerance)
        self._tip = task.space == "tip"
        if self._tip:
            self._origin, low, high = np.array(robot.mount), np.full(3, -FAR), np.full(3, FAR)
        else:
            low, high = robot.limits.position.T
            middle, half = (low + high) / 2.0, _BEYOND * (high - low) / 2.0
            self._origin, low, high = np.zeros(robot.n), middle - half, middle + half
        self.space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        """Space of an achieved and of a desired goal."""

    def told(self, place: Array) -> NDArray[np.float32]:
        """A tool's place in the world, shape (3,) [m], or a joint position, shape (n,) [rad], as it is observed."""
        return np.clip((place - self._origin).astype(np.float32), self.space.low, self.space.high)

    def missed(self, achieved: ArrayLike, desired: ArrayLike) -> NDArray[np.bool_]:
        """Whether goals are farther off than the tolerance, shapes (..., k): by distance, or root mean square."""
        gap = np.asarray(achieved, np.float64) - np.asarray(desired, np.float64)
        square = np.sum(gap * gap, axis=-1)
        return np.sqrt(square if self._tip else square / gap.shape[-1]) > self._tolerance

    def reward(self, achieved: ArrayLike, desired: ArrayLike, info: Mapping[str, Any] | Sequence[Any]) -> Any:
        """What it is worth to have achieved one thing where another was desired.

        Args:
            achieved, desired: As observed, shape (k,), or (N, k) for many at once.
            info: Of the step, or a sequence of N of them; terms that it lacks count as 0.

        Returns:
            −1 where they are farther apart than the task's tolerance, else 0, and the common terms of ``info``: exactly
            what ``step`` has returned for what it has observed. A number, or an array of shape (N,).
        """
        missed = self.missed(achieved, desired)
        total = np.where(missed, GOAL_TERMS[0].weight, 0.0)
        infos = [info] if isinstance(info, Mapping) else info
        for key in _COMMON:  # one after the other, in the order of the environment's own sum
            costs = np.array([one.get(key, 0.0) for one in infos], np.float64)
            total = total + (costs[0] if isinstance(info, Mapping) else costs.reshape(missed.shape))
        return total if missed.ndim else float(total)
