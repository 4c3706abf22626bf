"""Somebody who is where a table says: a recorded or prescribed walk."""

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.motion import Point, Walk, check_clearance
from jssa_gym.types import Array
from jssa_gym.validation import real_array


class Waypoints(Walk):
    """A walk through given points at given times, straight and at constant velocity between them; nothing is random.

    Args:
        points: Rows of time [s] and root's x and y [m], shape (k, 3); times start at 0 and increase. After the last
            one the person stands still.
        heading: Where the body looks [rad]; it does not turn.

    Raises:
        ParameterError: The rows are no such table, or the path comes within the clearance of the base axis.
    """

    def __init__(self, points: ArrayLike, *, heading: float = np.pi) -> None:
        shape = np.shape(points)
        if len(shape) != 2 or shape[0] < 2 or shape[1] != 3:
            raise ParameterError(f"points have to be rows of time, x and y, at least two; got shape {shape}")
        table = real_array("points", points, shape, "rows of time [s], x and y [m]")
        self._times, self._points = table[:, 0].copy(), table[:, 1:].copy()
        if self._times[0] != 0.0 or not np.all(np.diff(self._times) > 0.0):
            raise ParameterError(f"the times of points have to start at 0 and increase, got {self._times.tolist()}")
        self.heading = float(real_array("heading", heading, (), "an angle [rad]"))
        steps = np.diff(self._points, axis=0)
        self.speed_bound = float((np.hypot(*steps.T) / np.diff(self._times)).max())
        for begin, step in zip(self._points, steps, strict=False):
            way = float(step @ step)
            nearest = begin + step * np.clip(-(begin @ step) / way if way > 0.0 else 0.0, 0.0, 1.0)
            check_clearance(nearest)

    def check_start(self, start: Array) -> None:
        if not np.allclose(start, self._points[0]):
            raise ParameterError(f"this walk starts at {self._points[0].tolist()}, got {start.tolist()}")

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        return self._points[0], self.heading

    def _next_velocity(self, dt: float) -> Point:
        if dt == 0.0:
            # before the first step its length is not known: the first leg's velocity
            x, y = ((self._points[1] - self._points[0]) / self._times[1]).tolist()
            return x, y
        ahead = self._time + dt
        x, y = (float(np.interp(ahead, self._times, column)) for column in self._points.T)
        return (x - self._root[0]) / dt, (y - self._root[1]) / dt
