"""How well drives follow their commands, as the verified stop has to assume it: from radians to metres, from a log."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.rest import REST_COMMAND
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import levers
from jssa_gym.types import Array
from jssa_gym.validation import number_within, positive_number, real_array

_FINER = 8
"""Lags looked at between one tick and the next."""


class Tracking(NamedTuple):
    """What was measured of drives; ``actuation_lag`` and ``tracking_error`` are fields of ``FailsafeParams``."""

    lag: float
    """Time by which the arm follows its command, at which it deviates least [s]."""
    settling: float
    """Time from the command's coming to rest until no point of the arm is faster than asked for [s]."""
    tracking_error: float
    """Largest distance of a point of the arm from where the command of ``lag`` ago puts it, as a bound [m]."""

    @property
    def actuation_lag(self) -> float:
        """The longer of lag and settling time [s]: the arm may do at any time in between what it was told."""
        return max(self.lag, self.settling)


def tracking_error_metres(robot: RobotModel, error: ArrayLike) -> float:
    r"""How far a point of the arm can be from where the command puts it, in any posture [m].

    The largest :math:`\sum_j \rho_{ij} |e_j|` of all capsules i, with the levers :math:`\rho` of
    :func:`~jssa_gym.safety.failsafe.levers`: joint by joint, none moves a point of the capsule's axis farther. A
    capsule whose axis is off by that lies within the commanded one grown by it.

    Args:
        robot: The arm.
        error: Deviation of each joint, such as ``info["tracking_error"]``, shape (n,) or (T, n) for the largest of T
            [rad].

    Raises:
        ParameterError: The deviations have another shape or are not finite.
    """
    return float((np.abs(_rows("error", error, robot.n)) @ levers(robot).T).max(initial=0.0))


def measure_tracking(
    robot: RobotModel, commanded: ArrayLike, actual: ArrayLike, dt: float, *, still: float = 1e-3, longest: float = 0.25
) -> Tracking:
    """Lag, settling time and tracking error of drives from a recorded motion that stops at least once.

    The lag is the one, from 0 to ``longest``, by which the command has to be put off to be nearest to the motion.
    Between ticks the command is a cubic spline, which Eq. (1) is. What was not in the recording is not in the numbers:
    record the fastest motions that there will be, with stops, and leave a reserve.

    Args:
        robot: The arm.
        commanded: Joint positions at every tick, shape (T, n) [rad].
        actual: Where the arm was at the same moments, shape (T, n) [rad].
        dt: Tick [s].
        still: Speed of a point of the arm that counts as rest [m/s].
        longest: Largest lag looked for [s].

    Raises:
        ParameterError: An argument is out of range, there are fewer than four ticks, or the command never rests.
    """
    dt, still, longest = (
        positive_number("dt", dt),
        positive_number("still", still),
        number_within("longest", longest, 0.0),
    )
    command = _rows("commanded", commanded, robot.n)
    motion = real_array("actual", actual, command.shape, "joint positions [rad] at the same ticks")
    if len(command) < 4:
        raise ParameterError(f"a recording has at least four ticks, got {len(command)}")
    reach = levers(robot)
    time, spline = dt * np.arange(len(command)), CubicSpline(dt * np.arange(len(command)), command)

    def error(lag: float) -> float:
        # before the recording began the command was where it begins
        expected = np.where(time[:, None] < lag, command[0], spline(np.maximum(time - lag, 0.0)))
        return float((np.abs(motion - expected) @ reach.T).max())

    lags = np.arange(int(_FINER * longest / dt + 1e-9) + 1) * dt / _FINER
    errors = [error(lag) for lag in lags]
    best = int(np.argmin(errors))
    # the surface of a spinning capsule moves too
    surface = reach + robot.capsules["radius"][:, None] * (np.arange(robot.n) <= robot.capsules["link"][:, None])
    speed = (np.abs(np.diff(motion, axis=0)) @ surface.T).max(axis=1) / dt
    resting = np.abs(np.diff(command, axis=0)).max(axis=1) <= REST_COMMAND
    return Tracking(float(lags[best]), _settling(speed > still, resting) * dt, errors[best])


def _settling(moving: NDArray[np.bool_], resting: NDArray[np.bool_]) -> int:
    """Ticks from the beginning of a rest to the last one in it in which the arm still moves, the longest of all rests.

    Raises:
        ParameterError: The command never comes to rest out of a motion.
    """
    begins = np.flatnonzero(resting[1:] & ~resting[:-1]) + 1
    if not len(begins):
        raise ParameterError("the command never comes to rest out of a motion; record one that stops")
    longest = 0
    for begin in begins:
        ends = begin + np.flatnonzero(~resting[begin:])
        last = np.flatnonzero(moving[begin : ends[0] if len(ends) else None])
        longest = max(longest, int(last[-1]) + 1 if len(last) else 0)
    return longest


def _rows(name: str, value: ArrayLike, n: int) -> Array:
    """Angles of n joints, shape (T, n) [rad]; a single row may come without the first axis."""
    count = np.shape(value)[0] if np.ndim(value) == 2 else 1
    shape = (count, n) if np.ndim(value) == 2 else (n,)
    return real_array(name, value, shape, "angles of the joints [rad], one row a tick").reshape(count, n)
