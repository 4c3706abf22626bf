r"""Exact projection of a jerk onto half-spaces and a box, Eq. (14).

:math:`\min_u (u-\bar u)^\top V (u-\bar u)` subject to :math:`L u \ge S`, :math:`l \le u \le h`. One row with a diagonal
:math:`V` has a closed form; many rows go to a dual active-set method. Both say how much violation is left,
computed from the jerk they return.
"""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.active_set import nearest
from jssa_gym.kernels.jit import jit

_TOLERANCE = 1e-10
"""Violation that counts as rounding, not as infeasibility, relative to the larger of 1 m² and S."""

_POINT = 1e-13
"""Half the width of a box, relative to its bounds, that is rounding."""


def scratch(n: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Memory for :func:`project_rows` with n joints and up to ``count`` rows."""
    size = max(n + 2, 8)
    return np.zeros((3, size, size)), np.zeros(size, np.int64), np.zeros((2, count))


@jit
def violation(L, S, count, u):
    """Largest violation :math:`S - L u` of the first ``count`` rows, 0 if none [unit of S]. NaN if any is NaN."""
    worst = 0.0
    for i in range(count):
        gap = S[i]
        for k in range(u.shape[0]):
            gap -= L[i, k] * u[k]
        if not (gap <= worst):
            worst = gap
            if np.isnan(gap):
                return gap
    return worst


@jit
def clip(u, lower, upper, out):
    """Nearest jerk inside the box, into ``out``; True if nothing had to change."""
    unchanged = True
    for k in range(u.shape[0]):
        out[k] = min(max(u[k], lower[k]), upper[k])
        unchanged = unchanged and out[k] == u[k]
    return unchanged


@jit
def _mend(lower, upper, u):
    """Where rows that are no numbers made a jerk that is none, put the smallest jerk of the box."""
    for k in range(u.shape[0]):
        if np.isnan(u[k]):
            u[k] = min(max(0.0, lower[k]), upper[k])


@jit
def project_row(nominal, row, right, lower, upper, weight, out):
    r"""Project onto one half-space and the box, exactly.

    The dual is one multiplier: :math:`u(\mu) = \mathrm{clip}(\bar u + \mu V^{-1}L^\top, l, h)`, along which
    :math:`L u` is piecewise linear and never falls. The breakpoints are walked in order until it reaches S.

    Args:
        nominal: Nominal jerk :math:`\bar u`, shape (n,) [rad/s³].
        row: :math:`L`, shape (n,) [m²/(rad/s³)].
        right: :math:`S` [m²].
        lower, upper: Jerk bounds, shape (n,) [rad/s³].
        weight: Diagonal of V, positive, shape (n,).
        out: Result, shape (n,) [rad/s³].

    Returns:
        The violation left [m²]: 0 unless the row excludes the whole box; then ``out`` violates it least.
    """
    n = nominal.shape[0]
    clip(nominal, lower, upper, out)
    gap = right
    for k in range(n):
        gap -= row[k] * out[k]
    mu = 0.0
    # at most one entry into and one exit from the box a joint
    for _ in range(2 * n + 1):
        if gap <= 0.0:
            return 0.0
        slope, mu_next = 0.0, np.inf
        for k in range(n):
            if row[k] == 0.0:
                continue
            rate = row[k] / weight[k]
            near, far = (lower[k], upper[k]) if rate > 0.0 else (upper[k], lower[k])
            entry, leave = (near - nominal[k]) / rate, (far - nominal[k]) / rate
            if leave <= mu or near == far:
                continue
            if entry > mu:
                mu_next = min(mu_next, entry)
                continue
            slope += row[k] * rate
            mu_next = min(mu_next, leave)
        if slope > 0.0 and gap <= slope * (mu_next - mu):
            mu += gap / slope
            for k in range(n):
                out[k] = min(max(nominal[k] + mu * row[k] / weight[k], lower[k]), upper[k])
            break
        if mu_next == np.inf:
            break
        mu = mu_next
        gap = right
        for k in range(n):
            out[k] = min(max(nominal[k] + mu * row[k] / weight[k], lower[k]), upper[k])
            gap -= row[k] * out[k]
    left = _settle(row, right, lower, upper, weight, out)
    _mend(lower, upper, out)
    return left


@jit
def _settle(row, right, lower, upper, weight, u):
    """Push a jerk that rounding left short of the row across it; the violation that remains."""
    gap = right
    for _ in range(3):
        gap, slope = right, 0.0
        for k in range(u.shape[0]):
            gap -= row[k] * u[k]
        if gap <= 0.0:
            return 0.0
        for k in range(u.shape[0]):
            if (row[k] > 0.0 and u[k] < upper[k]) or (row[k] < 0.0 and u[k] > lower[k]):
                slope += row[k] ** 2 / weight[k]
        if slope == 0.0:
            break
        for k in range(u.shape[0]):
            if (row[k] > 0.0 and u[k] < upper[k]) or (row[k] < 0.0 and u[k] > lower[k]):
                moved = u[k] + gap / slope * (1.0 + 1e-15) * row[k] / weight[k]
                u[k] = min(max(moved, lower[k]), upper[k])
    return gap


@jit
def _root(inverse_weight, scale, root):
    r"""Lower triangular root of :math:`V^{-1}` in units of ``scale`` (Cholesky); False if there is none."""
    n = scale.shape[0]
    for i in range(n):
        for j in range(n):
            if j > i:
                root[i, j] = 0.0
                continue
            total = inverse_weight[i, j] / (scale[i] * scale[j])
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = total / root[j, j]
            elif total > 0.0:
                root[i, i] = np.sqrt(total)
            else:
                return False
    return True


@jit
def project_rows(nominal, L, S, count, lower, upper, inverse_weight, floats, active, relief, out):
    r"""Project onto many half-spaces and the box: dual active set; least violation when they exclude each other.

    If rows and box have no common point, the largest violation is made as small as possible; among the jerks with
    it, the largest violation of the rows that do not decide about it; and the nearest jerk of those is returned.

    Args:
        nominal: Nominal jerk, shape (n,) [rad/s³].
        L: Rows, shape (≥ count, n) [m²/(rad/s³)].
        S: Right-hand sides, shape (≥ count,) [m²].
        count: Number of rows.
        lower, upper: Jerk bounds, shape (n,) [rad/s³].
        inverse_weight: Inverse of V, symmetric positive definite, shape (n, n).
        floats: Scratch, shape (3, N, N) with N ≥ max(n + 2, 8); see :func:`scratch`.
        active: Scratch, int64, shape (N,).
        relief: Scratch, shape (2, ≥ count).
        out: Result, shape (n,) [rad/s³].

    Returns:
        Whether the rows were feasible, and the largest violation of ``out`` [m²]; NaN if no solution was found: then
        ``out`` is the smallest jerk of the box.
    """
    n = nominal.shape[0]
    if clip(nominal, lower, upper, out) and violation(L, S, count, out) <= 0.0:
        return True, 0.0
    J, R, vectors = floats[0], floats[1], floats[2]
    # nearest() uses the first four vectors
    scale, tolerance = vectors[4, :n], 1.0
    for k in range(n):
        half = (upper[k] - lower[k]) / 2.0
        # in units of a box a few roundings wide every rounding is a gap: such a box is a point
        scale[k] = half if half > _POINT * max(abs(lower[k]), abs(upper[k])) else 1.0
    for i in range(count):
        tolerance = max(tolerance, S[i])
    tolerance *= _TOLERANCE
    finite = _root(inverse_weight, scale, J)
    for i in range(count):
        finite = finite and S[i] < np.inf
        for k in range(n):
            finite = finite and np.isfinite(L[i, k])
    if finite and nearest(nominal, L, S, count, lower, upper, scale, tolerance, J, R, vectors, active, relief, out):
        clip(out, lower, upper, out)
        left = violation(L, S, count, out)
        return left <= tolerance, left
    # not solved: say so, and answer with the smallest jerk of the box, never with the nominal
    for k in range(n):
        out[k] = min(max(0.0, lower[k]), upper[k])
    return False, np.nan
