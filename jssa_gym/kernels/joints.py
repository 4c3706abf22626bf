"""Which joint readings are believed: those that are where the applied jerks must have led."""

import numpy as np

from jssa_gym.kernels.jit import jit, part

ROUNDING = 1e-9
"""Share of the limits (of the range for positions) by which a reading may differ for rounding's sake."""

AGREES, MISSING, FROZEN, ASTRAY, LAGS = range(5)
"""What a reading is; from LAGS on it is that of ``code - LAGS + 1`` ticks ago."""


@jit
def deviates(state, expected, bounds, tolerance):
    """Whether a joint state is farther from the expected one than the tolerance (3, n) and rounding. NaN is.

    Where the tolerance is infinite nothing is compared: that number is not measured.
    """
    for j in range(state.shape[1]):
        for row in range(3):
            allowed = tolerance[row, j]
            if allowed == np.inf:
                continue
            limit = bounds[1, j] - bounds[0, j] if row == 0 else bounds[row + 1, j]
            if not abs(state[row, j] - expected[row, j]) <= allowed + ROUNDING * limit:
                return True
    return False


@part
def judge_joints(reading, readable, expected, last, anchor, past, newest, bounds, tolerance):
    """What a tick's reading of the joints is; then the tick is over.

    Args:
        reading: Rows position, velocity, acceleration, shape (3, n) [rad, rad/s, rad/s²].
        readable: Whether there is one.
        expected: Where the applied jerks must have led, shape (3, n).
        last: The reading before, shape (3, n), NaN for none; becomes this one.
        anchor: What was expected when ``last`` came for the first time, shape (3, n); kept up likewise.
        past: What was expected in the ticks before, a ring of shape (k, 3, n), NaN where there was nothing.
        newest: Where in it is what was expected one tick ago; what is expected now comes behind it.
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        tolerance: How far a reading may be from the expected state, shape (3, n); inf for what is not measured.

    Returns:
        ``AGREES``; ``MISSING``, there is none or a measured number is not finite; ``FROZEN``, bit for bit the reading
        before though the arm has moved on by more than the tolerance; ``LAGS`` and the ticks by which it does, less
        one; or ``ASTRAY``.
    """
    code = MISSING
    if readable and _finite(reading, tolerance):
        code = _judge(reading, expected, last, anchor, past, newest, bounds, tolerance)
    following = (newest + 1) % past.shape[0]
    for row in range(3):
        for j in range(reading.shape[1]):
            past[following, row, j] = expected[row, j]
    return code


@part
def _finite(reading, tolerance):
    for row in range(3):
        for j in range(reading.shape[1]):
            if tolerance[row, j] != np.inf and not np.isfinite(reading[row, j]):
                return False
    return True


@jit
def _judge(reading, expected, last, anchor, past, newest, bounds, tolerance):
    repeated = True
    for row in range(3):
        for j in range(reading.shape[1]):
            # an unmeasured number says nothing about whether a reading is new
            if tolerance[row, j] != np.inf and reading[row, j] != last[row, j]:
                repeated = False
    for row in range(3):
        for j in range(reading.shape[1]):
            last[row, j] = reading[row, j]
            if not repeated:
                anchor[row, j] = expected[row, j]
    if repeated and deviates(expected, anchor, bounds, tolerance):
        return FROZEN
    if not deviates(reading, expected, bounds, tolerance):
        return AGREES
    for k in range(past.shape[0]):
        if not deviates(reading, past[(newest - k) % past.shape[0]], bounds, tolerance):
            return LAGS + k
    return ASTRAY
