"""Whether an arm passes clear of what stands still, along a motion."""

import math

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.postures import smallest_gap


@jit
def passes_clear(standing, positions, every, clear, way, posture):
    """Whether a motion stays clear of what stands still and of the arm itself, or comes no closer than it starts.

    Args:
        standing: The arm, and what stands still.
        positions: Of the joints along the motion, shape (m, n) [rad].
        every: No joint moves further between two postures that are looked at [rad]; the last is looked at first.
        clear: Distance to be kept [m].
        way: Scratch, shape (m,).
        posture: Scratch, shape (n,).
    """
    last, n = positions.shape[0] - 1, positions.shape[1]
    least = min(clear, smallest_gap(standing, positions[0]))
    way[0] = 0.0
    for k in range(last):
        most = 0.0
        for j in range(n):
            moved = abs(positions[k + 1, j] - positions[k, j])
            if not moved < np.inf:  # what is no number is not known to be clear
                return False
            most = max(most, moved)
        way[k + 1] = way[k] + most
    parts = math.ceil(way[last] / every)
    k = last
    for part in range(parts, -1, -1):
        at = way[last] if part == parts else part * (way[last] / parts)
        while way[k] > at:
            k -= 1
        for j in range(n):
            posture[j] = positions[k, j]
            if way[k] < at:
                slope = (positions[k + 1, j] - positions[k, j]) / (way[k + 1] - way[k])
                posture[j] = slope * (at - way[k]) + positions[k, j]
        if not smallest_gap(standing, posture) >= least:
            return False
    return True
