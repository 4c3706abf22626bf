"""Lengths of vectors, rounded as Python's own ``math.hypot`` and ``math.dist`` round them.

A plain square root of a sum of squares is off by its last bit now and then; what a single environment measures with
Python's functions and thousands measure in one call have to be the same bits.
"""

import numpy as np

from jssa_gym.kernels.jit import jit

_SPLITTER = 134217729.0
"""2²⁷ + 1: a number times this, and less, is its upper half (Dekker)."""


@jit
def _add_square(total, rest, x):
    """A sum of squares and what rounding took from it, with the square of ``x`` added, exact to about 100 bits."""
    t = x * _SPLITTER
    high = t - (t - x)
    low = x - high
    for part in (high * high, 2.0 * high * low, low * low):
        before = total
        total = before + part
        back = total - before
        rest += (before - (total - back)) + (part - back)
    return total, rest


@jit
def length(x, y, z):
    """Length of a vector, rounded correctly but for one case in very many; infinity and NaN give what is not finite."""
    total, rest = _add_square(0.0, 0.0, x)
    total, rest = _add_square(total, rest, y)
    total, rest = _add_square(total, rest, z)
    root = np.sqrt(total + rest)
    if not (0.0 < root < np.inf):
        return root
    # one step of Newton's iteration on the exact remainder
    square, more = _add_square(0.0, 0.0, root)
    return root + ((total - square) + (rest - more)) / (2.0 * root)
