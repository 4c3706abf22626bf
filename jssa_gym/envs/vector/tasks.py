"""The package's tasks for many arms at once: the same numbers as :mod:`jssa_gym.envs.tasks` has for one."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.tasks import Deliver, Handover, Home, Progress, Reach, Task, Track
from jssa_gym.envs.tasks.deliver import ROUNDING
from jssa_gym.envs.tasks.tip import HAND, NEAR, TipTask
from jssa_gym.exceptions import ParameterError
from jssa_gym.tick.moves import before_hands, distances, ease, squash
from jssa_gym.types import Array
from jssa_gym.vectors import Mask

_POWERS = np.array([3.0, 2.0])


class Moments(NamedTuple):
    """Many arms after a step; fields as of :class:`~jssa_gym.envs.tasks.Moment`."""

    position: Array
    """Shape (E, n) [rad]."""
    velocity: Array
    """Shape (E, n) [rad/s]."""
    tip: Array
    """Shape (E, 3) [m]."""
    tip_speed: Array
    """Shape (E,) [m/s]."""


def root_mean_square(gap: Array) -> Array:
    """Root mean square of every row, shape (E, n): by the very scalar product that a single row has."""
    return np.sqrt((gap[:, None, :] @ gap[:, :, None])[:, 0, 0] / gap.shape[1])


class TaskBatch(ABC):
    """A task of many arms; subclasses say which. Methods as of :class:`~jssa_gym.envs.tasks.Task`."""

    task: Any

    def __init__(self, task: Task, goal: Array) -> None:
        self.task, self.goal = task, goal

    def begin(self, e: int, goal: Array, progress: Progress) -> None:
        """An episode of arm ``e`` begins."""
        self.goal[e] = goal

    def goal_of(self, e: int) -> Array:
        """Arm ``e``'s goal; a view."""
        return self.goal[e]

    def advance(self, moments: Moments, ends: Array, live: Mask, dt: float) -> None:  # noqa: B027  # none may
        """Let goals go with people, whose capsules' ends are of shape (E, 4, k, 3), and count what was done of them."""

    @abstractmethod
    def value(self, moments: Moments) -> Array:
        """Shape (E,)."""

    @abstractmethod
    def reached(self, value: Array, moments: Moments) -> Mask:
        """Shape (E,)."""

    @abstractmethod
    def rewarded(self, value: Array, success: Mask) -> tuple[Array, ...]:
        """Values of the task's terms, shape (E,) each."""

    @abstractmethod
    def observe(self, moments: Moments) -> Array:
        """Raw values of the task's features, shape (E, size)."""

    def metrics(self, value: Array) -> dict[str, NDArray[Any]]:
        """Further entries of ``info``, shape (E,) each."""
        return {}


class TipBatch(TaskBatch):
    """Tool centre points go to points."""

    def __init__(self, task: TipTask, count: int, n: int, names: Sequence[str]) -> None:
        super().__init__(task, np.zeros((count, 3)))

    def value(self, moments: Moments) -> Array:
        out = np.empty(len(self.goal))
        distances(self.goal, moments.tip, out)
        return out

    def reached(self, value: Array, moments: Moments) -> Mask:
        return (moments.tip_speed < self.task.speed) & (value <= self.task.tolerance)

    def rewarded(self, value: Array, success: Mask) -> tuple[Array, ...]:
        near = np.empty(len(value))
        squash(value, NEAR, near)
        return value, near, success.astype(np.float64)

    def observe(self, moments: Moments) -> Array:
        return self.goal - moments.tip


class HandoverBatch(TipBatch):
    """Tool centre points go to hands."""

    def __init__(self, task: Handover, count: int, n: int, names: Sequence[str]) -> None:
        super().__init__(task, count, n, names)
        self._hand = tuple(names).index(HAND)

    def advance(self, moments: Moments, ends: Array, live: Mask, dt: float) -> None:
        before_hands(ends[:, 1, self._hand], self.task.offset, self.goal)


class DeliverBatch(TipBatch):
    """Tool centre points go back and forth; ``goal`` are the places that are next."""

    def __init__(self, task: Deliver, count: int, n: int, names: Sequence[str]) -> None:
        super().__init__(task, count, n, names)
        self._arms, self._places = np.arange(count), np.zeros((count, 2, 3))
        self._visited = np.zeros(count, np.int64)
        self._clock, self._stayed, self._apart = np.zeros((3, count))

    def begin(self, e: int, goal: Array, progress: Progress) -> None:
        self._places[e], self._apart[e] = goal, math.dist(*goal)
        self._visited[e], self._clock[e], self._stayed[e] = progress.visited, progress.clock, progress.stayed
        super().begin(e, self.task.present(goal, progress), progress)

    def advance(self, moments: Moments, ends: Array, live: Mask, dt: float) -> None:
        task, under_way = self.task, live & (self._visited < self.task.legs)
        there = super().reached(self.value(moments), moments)
        stayed = np.where(there, self._stayed + dt, 0.0)
        done = under_way & (stayed >= task.stay - ROUNDING)
        self._visited += done
        self._stayed = np.where(under_way & ~done, stayed, 0.0)
        self._clock = np.where(under_way, self._clock + dt, self._clock)
        self.goal = self._places[self._arms, self._following()]

    def _following(self) -> NDArray[np.int64]:
        """Which place is next, or was the last, shape (E,)."""
        return np.minimum(self._visited, self.task.legs - 1) % 2

    def reached(self, value: Array, moments: Moments) -> Mask:
        return (self._visited == self.task.legs) & (value <= self.task.tolerance)

    def rewarded(self, value: Array, success: Mask) -> tuple[Array, ...]:
        after = np.maximum(self.task.legs - 1 - self._visited, 0)
        _, near, succeeded = super().rewarded(value, success)
        return value + after * self._apart, near + after, succeeded

    def observe(self, moments: Moments) -> Array:
        other = self._places[self._arms, 1 - self._following()] - moments.tip
        done = self._visited / self.task.legs
        return np.concatenate([super().observe(moments), other, done[:, None], self._stayed[:, None]], axis=1)

    def metrics(self, value: Array) -> dict[str, NDArray[Any]]:
        deliveries = self._visited // 2
        rate = np.zeros(len(deliveries))
        np.divide(60.0 * deliveries, self._clock, out=rate, where=self._clock > 0.0)
        return {"deliver/legs": self._visited.copy(), "deliver/deliveries": deliveries, "deliver/per_minute": rate}


class HomeBatch(TaskBatch):
    """Arms stay at home."""

    def __init__(self, task: Home, count: int, n: int, names: Sequence[str]) -> None:
        super().__init__(task, np.zeros((count, n)))

    def value(self, moments: Moments) -> Array:
        return root_mean_square(self.goal - moments.position)

    def reached(self, value: Array, moments: Moments) -> Mask:
        return value <= self.task.tolerance

    def rewarded(self, value: Array, success: Mask) -> tuple[Array, ...]:
        return (value,)

    def observe(self, moments: Moments) -> Array:
        return self.goal - moments.position


class TrackBatch(TaskBatch):
    """Arms follow waypoints; goals of shape (E, K, n), of which the first ``counts`` are somebody's."""

    def __init__(self, task: Track, count: int, n: int, names: Sequence[str]) -> None:
        super().__init__(task, np.zeros((count, task.count, n)))
        self._arms = np.arange(count)
        self._counts, self._visited = np.ones((2, count), np.int64)
        self._start, self._arrived = np.zeros((count, n)), np.zeros(count, np.bool_)
        self._clock, self._lateness = np.zeros((2, count))

    def begin(self, e: int, goal: Array, progress: Progress) -> None:
        if len(goal) > self.goal.shape[1]:
            more = np.zeros((len(self.goal), len(goal) - self.goal.shape[1], self.goal.shape[2]))
            self.goal = np.concatenate([self.goal, more], axis=1)
        self.goal[e, : len(goal)], self._counts[e] = goal, len(goal)
        self._start[e], self._visited[e], self._clock[e], self._lateness[e], self._arrived[e] = progress[:5]

    def goal_of(self, e: int) -> Array:
        return self.goal[e, : self._counts[e]]

    def advance(self, moments: Moments, ends: Array, live: Mask, dt: float) -> None:
        task, visited, clock = self.task, self._visited, self._clock
        gap = root_mean_square(self._next() - moments.position)
        visited += (visited < self._counts) & (gap <= task.tolerance) & live
        due = self._due()
        now = np.minimum(clock + dt, due)
        late = np.where(visited < self._counts, np.maximum(clock + dt - now, 0.0), 0.0)
        self._lateness += late
        rests = root_mean_square(moments.velocity) <= task.speed
        self._arrived = (visited == self._counts) & (now >= due) & rests
        self._clock = now

    def _next(self) -> Array:
        """The waypoint that is to come, or was the last, shape (E, n) [rad]."""
        return self.goal[self._arms, np.minimum(self._visited, self._counts - 1)]

    def _due(self) -> Array:
        """When it is due, or was, shape (E,) [s]."""
        return np.minimum(self._visited + 1, self._counts) * self.task.period

    def _reference(self) -> Array:
        """Where arms are to be, shape (E, n) [rad]."""
        elapsed = self._clock / self.task.period
        leg = np.minimum(elapsed.astype(np.int64), self._counts - 1)
        share = np.empty(len(leg))
        ease(np.minimum(elapsed - leg, 1.0), _POWERS, share)
        begin = np.where((leg > 0)[:, None], self.goal[self._arms, leg - 1], self._start)
        return begin + share[:, None] * (self.goal[self._arms, leg] - begin)

    def value(self, moments: Moments) -> Array:
        return root_mean_square(self._reference() - moments.position)

    def reached(self, value: Array, moments: Moments) -> Mask:
        return self._arrived & (value <= self.task.tolerance)

    def rewarded(self, value: Array, success: Mask) -> tuple[Array, ...]:
        return value, success.astype(np.float64)

    def observe(self, moments: Moments) -> Array:
        due, visited = self._due() - self._clock, self._visited / self._counts
        gaps = self._next() - moments.position, self._reference() - moments.position
        return np.concatenate([*gaps, due[:, None], visited[:, None]], axis=1)

    def metrics(self, value: Array) -> dict[str, NDArray[Any]]:
        return {"track/visited": self._visited.copy(), "track/lateness": self._lateness.copy(), "track/error": value}


_BATCHES: dict[type[Task], type[Any]] = {
    Home: HomeBatch, Reach: TipBatch, Track: TrackBatch, Handover: HandoverBatch, Deliver: DeliverBatch,
}  # fmt: skip


def batched(task: Task, count: int, n: int, names: Sequence[str]) -> Any:
    """A task of so many arms of n joints, beside people with such body parts.

    Raises:
        ParameterError: It is a task of somebody's own, which is asked in Python.
    """
    if type(task) not in _BATCHES:
        raise ParameterError(
            f"task {task.name!r} ({type(task).__name__}) is asked in Python, one arm at a time: vectors are made of "
            f"{', '.join(sorted(kind.name for kind in _BATCHES))}; for another task take vectorization_mode='sync'"
        )
    return _BATCHES[type(task)](task, count, n, names)
