"""The fewest ticks of a symmetric jerk-limited move: every choice is looked at."""

import math

import numpy as np

from jssa_gym.kernels.jit import jit


@jit
def search(total, distance, limits, dt, square):
    """Ticks n_j, n_a, n_v of the least jerk of a move that takes ``total`` ticks, or as few more as it needs.

    Args:
        total: Ticks that it cannot do with less than.
        distance: Positive [rad].
        limits: Of speed, acceleration and jerk [rad/s, rad/s², rad/s³].
        dt, square: The tick [s], and its square [s²].
    """
    V, A, J = limits
    while True:
        least, found = np.inf, (0, 0, 0)
        for n_j in range(1, total // 4 + 1):
            # of all n_a the largest needs the least jerk; the speed limit has the last word, to rounding
            fastest = math.floor(total - 2 * n_j - distance / (V * dt))
            most = min((total - 4 * n_j) // 2, fastest)
            for n_a in range(most - 2, most + 3):
                n_a = max(n_a, 0)
                n_v = total - 4 * n_j - 2 * n_a
                if n_v < 0:
                    continue
                speed = n_j * (n_j + n_a) * square
                jerk = distance / (speed * (2 * n_j + n_a + n_v) * dt)
                if jerk < least and not (jerk > J or jerk * n_j * dt > A or jerk * speed > V):
                    least, found = jerk, (n_j, n_a, n_v)
        if least < np.inf:
            return found
        total += 1
