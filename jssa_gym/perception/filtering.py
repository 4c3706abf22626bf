"""Velocities of keypoints: a constant-velocity Kalman filter that also bounds its own error."""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.types import Array

_KEPT = 60
"""How many of the latest inputs are told apart in the bound; those from before are added up."""


class VelocityFilter:
    r"""A Kalman filter for every keypoint of one person; all axes have the same gains.

    The state is position and velocity, the model :math:`\dot v = 0` with white acceleration of deviation
    ``acceleration``. Its estimate is linear in all that was ever measured, so that its largest error is known too: of
    measurements that are within their errors, of keypoints that accelerate by no more than ``acceleration``, it is at
    most the sum of what each of these inputs, at its worst, is worth by now (the filter's :math:`\ell_1` gain).

    Args:
        count: Keypoints.
        acceleration: No keypoint changes its velocity faster [m/s²].
        speed: None is faster [m/s].
        deviation: Standard deviation of a measurement's error along an axis, as a share of its largest error.
    """

    def __init__(self, count: int, acceleration: float, speed: float, deviation: float) -> None:
        self._acceleration, self._speed, self._deviation = acceleration, speed, deviation
        self.position = np.full((count, 3), np.nan)
        """Shape (count, 3) [m]."""
        self.velocity = np.zeros((count, 3))
        """Shape (count, 3) [m/s]."""
        self._covariance = np.zeros((count, 2, 2))
        # columns: what one unit of an input changes of position and velocity; the last two are those from before
        self._worth = np.zeros((count, _KEPT + 2, 2))

    @property
    def velocity_error(self) -> Array:
        """Bound on the velocities' errors, shape (count,) [m/s]."""
        reachable = np.linalg.norm(self.velocity, axis=1) + self._speed
        return np.minimum(np.abs(self._worth[:, :, 1]).sum(axis=1), reachable)

    def begin(self, which: NDArray[np.bool_], position: Array, error: Array) -> None:
        """Keypoints, shape (count,), that are measured for the first time, or anew; the others are left alone.

        Args:
            which: Which ones.
            position: Shape (count, 3) [m].
            error: Of each position, shape (count,) [m].
        """
        self.position[which], self.velocity[which] = position[which], 0.0
        self._covariance[which] = 0.0
        self._covariance[which, 0, 0] = (self._deviation * error[which]) ** 2
        self._covariance[which, 1, 1] = (self._speed / 3.0) ** 2
        self._worth[which] = 0.0
        self._worth[which, 0, 0], self._worth[which, 1, 1] = error[which], self._speed

    def advance(self, elapsed: float, measured: NDArray[np.bool_], position: Array, error: Array) -> None:
        """Go on to the next frame.

        Args:
            elapsed: Since the last one [s].
            measured: Which keypoints are, shape (count,); the others move on.
            position: Shape (count, 3) [m]; of those that are not measured anything.
            error: Shape (count,) [m].
        """
        t, a = elapsed, self._acceleration
        self.position += t * self.velocity
        moved = np.array([[1.0, t], [0.0, 1.0]])
        unsteady = a * a * np.array([[t**4 / 4.0, t**3 / 2.0], [t**3 / 2.0, t**2]])
        covariance = moved @ self._covariance @ moved.T + unsteady
        spread = covariance[:, 0, 0] + (self._deviation * error) ** 2
        gain = np.where(measured[:, None], covariance[:, :, 0] / np.maximum(spread, 1e-12)[:, None], 0.0)
        off = np.where(measured[:, None], position - self.position, 0.0)
        self.position += gain[:, :1] * off
        self.velocity += gain[:, 1:] * off
        self._covariance = covariance - gain[:, :, None] * covariance[:, None, 0]
        self._bound(moved, gain, np.where(measured, error, 0.0), t)

    def _bound(self, moved: Array, gain: Array, error: Array, elapsed: float) -> None:
        corrected = np.broadcast_to(np.eye(2), (len(gain), 2, 2)).copy()
        corrected[:, :, 0] -= gain
        worth = np.einsum("kij,knj->kni", corrected @ moved, self._worth)
        # an acceleration a(s) changes the velocity by its integral, at most a t, the place by t/2 times that and the
        # integral of (t/2 - s) a(s), at most a t²/4
        steady = np.array([elapsed**2 / 2.0, elapsed])
        new = (
            gain * error[:, None],
            self._acceleration * corrected @ steady,
            self._acceleration * corrected[:, :, 0] * (elapsed**2 / 4.0),
        )
        older = np.abs(worth[:, _KEPT - len(new) :]).sum(axis=1)
        self._worth[:, len(new) : _KEPT] = worth[:, : _KEPT - len(new)]
        for i, one in enumerate(new):
            self._worth[:, i] = one
        self._worth[:, _KEPT:] = older[:, None, :] * np.eye(2)


def velocity_lag(rate: float, error: float, acceleration: float, deviation: float) -> float:
    """The time by which velocities lag behind a steady acceleration, once the filter has settled [s].

    Args:
        rate: Frames a second [Hz].
        error: Largest error of a measurement [m].
        acceleration: Of the filter [m/s²].
        deviation: Of the filter.
    """
    filter_, nowhere = VelocityFilter(1, acceleration, 1.0, deviation), np.zeros((1, 3))
    filter_.begin(np.array([True]), nowhere, np.array([error]))
    settled = max(int(4.0 * rate), 200)
    for k in range(1, settled + 1):
        # 1 m/s² from rest: what the velocity is short of is the time
        place = np.array([[0.5 * (k / rate) ** 2, 0.0, 0.0]])
        filter_.advance(1.0 / rate, np.array([True]), place, np.array([error]))
    return float(settled / rate - filter_.velocity[0, 0])
