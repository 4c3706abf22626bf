r"""Triangular factor of the active normals, kept up as constraints come and go.

With the inverse of V split as :math:`J J^\top`, J is turned such that :math:`J^\top N` is R, upper triangular, over
zeros for the active normals N; the columns of J behind those span what is still free. Turning squares nothing, so
that nearly parallel rows stay tellable apart.
"""

import numpy as np

from jssa_gym.kernels.jit import jit


@jit
def turn_in(constraint, count, L, scale, J, d):
    r"""Normal of a constraint in the frame of J, :math:`d = J^\top \mathrm{normal}`; returns its squared length."""
    n, square = scale.shape[0], 0.0
    for j in range(n):
        d[j] = 0.0
    for k in range(n):
        if constraint < count:
            part = L[constraint, k] * scale[k]
        elif constraint == count + k:
            part = 1.0
        elif constraint == count + n + k:
            part = -1.0
        else:
            continue
        for j in range(n):
            d[j] += part * J[k, j]
    for j in range(n):
        square += d[j] * d[j]
    return square


@jit
def add(used, n, d, slope, J, R):
    """Make the constraint with the normal d the last active one: J is turned by a reflection (Householder)."""
    pivot = -np.sqrt(slope) if d[used] > 0.0 else np.sqrt(slope)
    for i in range(used):
        R[i, used] = d[i]
    R[used, used] = pivot
    d[used] -= pivot
    for i in range(n):
        along = 0.0
        for j in range(used, n):
            along += J[i, j] * d[j]
        along /= pivot * d[used]
        for j in range(used, n):
            J[i, j] += along * d[j]


@jit
def drop(position, used, n, active, multiplier, J, R):
    """Take one constraint out of the active ones: R loses a column and is made triangular again (Givens)."""
    for a in range(position, used - 1):
        active[a] = active[a + 1]
        multiplier[a] = multiplier[a + 1]
        for i in range(a + 2):
            R[i, a] = R[i, a + 1]
        length = np.sqrt(R[a, a] * R[a, a] + R[a + 1, a] * R[a + 1, a])
        c = R[a, a] / length
        s = R[a + 1, a] / length
        for b in range(a, used):
            upper = R[a, b]
            R[a, b] = c * upper + s * R[a + 1, b]
            R[a + 1, b] = c * R[a + 1, b] - s * upper
        for i in range(n):
            left = J[i, a]
            J[i, a] = c * left + s * J[i, a + 1]
            J[i, a + 1] = c * J[i, a + 1] - s * left
    multiplier[used - 1] = multiplier[used]
    return used - 1
