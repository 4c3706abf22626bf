"""Steps of an interior-point method for limits on both sides: what is between its factorisations and dot products.

Of m rows with a slack each below the upper and above the lower limit: ``s`` are the slacks, ``z`` what they cost, ``p``
by how much they are off, each of shape (2, m). Matrices are in compressed sparse rows: values, columns and where each
row begins.
"""

from jssa_gym.kernels.jit import jit


@jit
def times(matrix, x, out):
    """A matrix times a vector, into ``out``."""
    values, columns, begins = matrix
    for i in range(out.shape[0]):
        total = 0.0
        for k in range(begins[i], begins[i + 1]):
            total += values[k] * x[columns[k]]
        out[i] = total


@jit
def newton_right(columns, size, slope, point, c, pull, out):
    """Right-hand side of Newton's equations.

    Args:
        columns: The rows' transpose, (f, m).
        size: What one of each row is, shape (m,).
        slope: Of the Lagrangian, shape (f,).
        point: ``s``, ``z / s`` and ``p``.
        c: What the products s z are to become less, shape (2, m).
        pull: Scratch, shape (m,).
        out: Shape (f,).
    """
    s, w, p = point
    for i in range(pull.shape[0]):
        pull[i] = size[i] * (w[0, i] * p[0, i] - c[0, i] / s[0, i] - w[1, i] * p[1, i] + c[1, i] / s[1, i])
    times(columns, pull, out)
    for k in range(out.shape[0]):
        out[k] = -slope[k] - out[k]


@jit
def newton_step(rows, size, dy, point, c, out):
    """What else a step of the unknowns changes.

    Args:
        rows: (m, f).
        size, c: As of :func:`newton_right`.
        dy: Shape (f,).
        point: ``s``, ``z`` and ``p``.
        out: Results: changes of what the rows make of the unknowns, shape (m,), of ``s`` and of ``z``.
    """
    (s, z, p), (dr, ds, dz) = point, out
    times(rows, dy, dr)
    for i in range(dr.shape[0]):
        dr[i] *= size[i]
        ds[0, i], ds[1, i] = -p[0, i] - dr[i], -p[1, i] + dr[i]
        for side in range(2):
            dz[side, i] = -(c[side, i] + z[side, i] * ds[side, i]) / s[side, i]


@jit
def longest(values, changes):
    """Longest step, at most 1, that keeps positive values non-negative, shapes (2, m)."""
    most = 1.0
    for side in range(2):
        for i in range(values.shape[1]):
            most = max(most, -changes[side, i] / values[side, i])
    return 1.0 / most
