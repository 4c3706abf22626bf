r"""Exact projection of a jerk onto half-spaces and a box, Eq. (14).

:math:`\min_u (u-\bar u)^\top V (u-\bar u)` subject to :math:`L u \ge S`, :math:`l \le u \le h`. One row with a diagonal
:math:`V` has a closed form; many rows go to a dual active-set method. Both say how much violation is left,
computed from the jerk they return.
"""

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.jit import jit

_TOLERANCE = 1e-12
"""Violation left over by the active-set method, relative to rows of unit length in the scaled metric."""

_DEPENDENT = 1e-11
"""Relative length under which a normal counts as a combination of the active ones."""

_SLACK_WEIGHT = 1e9
"""Weight of the common slack when the rows are infeasible, relative to jerks scaled by their range."""


def scratch(n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Memory for :func:`project_rows` with n joints."""
    size = max(n + 2, 8)
    return np.zeros((5, size, size)), np.zeros(size, np.int64)


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
def _softness(mode, soft, row):
    """Whether a row is granted the slack: mode 0 no row, 1 every row, 2 those that ``soft`` says."""
    return float(mode) if mode < 2 else soft[row]


@jit
def _normal(constraint, count, n, mode, soft, L, scales, normal):
    """Normal of a constraint in scaled variables; rows first, then lower and upper bounds, then the slack's."""
    for k in range(n + 1):
        normal[k] = 0.0
    if constraint < count:
        for k in range(n):
            normal[k] = L[constraint, k] * scales[k]
        normal[n] = _softness(mode, soft, constraint)
    elif constraint < count + n:
        normal[constraint - count] = 1.0
    elif constraint < count + 2 * n:
        normal[constraint - count - n] = -1.0
    else:
        normal[n] = 1.0


@jit
def _solve_gram(gram, size, right, x):
    """Solve the small symmetric positive definite system in place by Cholesky; False if it is singular."""
    for i in range(size):
        for j in range(i + 1):
            total = gram[i, j]
            for k in range(j):
                total -= gram[i, k] * gram[j, k]
            if i == j:
                if not (total > 0.0):
                    return False
                gram[i, i] = np.sqrt(total)
            else:
                gram[i, j] = total / gram[j, j]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= gram[i, k] * x[k]
        x[i] = total / gram[i, i]
    for i in range(size - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, size):
            total -= gram[k, i] * x[k]
        x[i] = total / gram[i, i]
    return True


@jit
def _dual_active_set(
    nominal, L, S, count, lower, upper, scales, inverse, mode, soft, normals, mapped, gram, vectors, active, x
):
    """Goldfarb and Idnani's method in scaled variables, the slack last.

    Returns:
        The number of active constraints, whose numbers are in ``active``; -1 if no solution was found.

    The nominal is the unconstrained optimum. Constraint after constraint is added, most violated first; one that
    blocks with a vanishing multiplier is dropped. ``inverse`` (n+1, n+1) is the inverse of the scaled V.
    """
    n = nominal.shape[0]
    size = n + 1
    total = count + 2 * n + (1 if mode > 0 else 0)
    right, response, step, multiplier, normal, image = (
        vectors[0],
        vectors[1],
        vectors[2],
        vectors[3],
        vectors[4],
        vectors[5],
    )
    used, free = 0, size if mode > 0 else n
    for k in range(n):
        x[k] = nominal[k] / scales[k]
    x[n] = 0.0

    for _ in range(20 * (total + 1)):
        # the most violated constraint, in the metric of V
        # the slack's weight makes multipliers, and with them rounding, large
        worst, chosen = _TOLERANCE if mode == 0 else 1e4 * _TOLERANCE, -1
        for c in range(total):
            taken = False
            for a in range(used):
                if active[a] == c:
                    taken = True
                    break
            if taken:
                continue
            if c < count:
                softness = _softness(mode, soft, c)
                gap = S[c] - softness * x[n]
                for i in range(n):
                    gap -= L[c, i] * scales[i] * x[i]
                if gap <= 0.0:
                    continue
                length2 = softness * inverse[n, n]
                for i in range(n):
                    li = L[c, i] * scales[i]
                    length2 += li * inverse[i, i] * li
                    for j in range(i):
                        length2 += 2.0 * li * inverse[i, j] * L[c, j] * scales[j]
                gap /= np.sqrt(length2) if length2 > 0.0 else 1.0
            elif c < count + n:
                k = c - count
                gap = (lower[k] / scales[k] - x[k]) / np.sqrt(inverse[k, k])
            elif c < count + 2 * n:
                k = c - count - n
                gap = (x[k] - upper[k] / scales[k]) / np.sqrt(inverse[k, k])
            else:
                gap = -x[n] / np.sqrt(inverse[n, n])
            if np.isnan(gap):
                return -1
            if gap > worst:
                worst, chosen = gap, c
        if chosen < 0:
            return used
        _normal(chosen, count, n, mode, soft, L, scales, normal)
        normal2 = 0.0
        for i in range(size):
            image[i] = 0.0
            for j in range(size):
                image[i] += inverse[i, j] * normal[j]
        for i in range(size):
            normal2 += normal[i] * image[i]
        gap = worst * np.sqrt(normal2)
        multiplier[used] = 0.0
        added = False
        while not added:
            for a in range(used):
                right[a] = 0.0
                for i in range(size):
                    right[a] += normals[a, i] * image[i]
                for b in range(a + 1):
                    gram[a, b] = 0.0
                    for i in range(size):
                        gram[a, b] += normals[a, i] * mapped[b, i]
            if not _solve_gram(gram, used, right, response):
                return -1
            slope = 0.0
            for i in range(size):
                step[i] = image[i]
                for a in range(used):
                    step[i] -= mapped[a, i] * response[a]
                slope += step[i] * normal[i]
            partial, dropped = np.inf, -1
            for a in range(used):
                if response[a] > 0.0 and multiplier[a] / response[a] < partial:
                    partial, dropped = multiplier[a] / response[a], a
            full = gap / slope if slope > _DEPENDENT * normal2 and used < free else np.inf
            length = min(partial, full)
            if length == np.inf:
                return -1
            for a in range(used):
                multiplier[a] = max(multiplier[a] - length * response[a], 0.0)
            multiplier[used] += length
            if full != np.inf:
                for i in range(size):
                    x[i] += length * step[i]
                gap -= length * slope
            if full <= partial:
                active[used] = chosen
                for i in range(size):
                    normals[used, i] = normal[i]
                    mapped[used, i] = image[i]
                used += 1
                added = True
            else:
                used -= 1
                for a in range(dropped, used):
                    active[a] = active[a + 1]
                    multiplier[a] = multiplier[a + 1]
                    for i in range(size):
                        normals[a, i] = normals[a + 1, i]
                        mapped[a, i] = mapped[a + 1, i]
                multiplier[used] = multiplier[used + 1]
    return -1


@jit
def project_rows(nominal, L, S, count, lower, upper, inverse_weight, floats, active, out):
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
        floats: Scratch, shape (5, N, N) with N ≥ max(n + 2, 8); see :func:`scratch`.
        active: Scratch, int64, shape (N,).
        out: Result, shape (n,) [rad/s³].

    Returns:
        Whether the rows were feasible, and the largest violation of ``out`` [m²]; NaN if no solution was found: then
        ``out`` is the smallest jerk of the box.
    """
    n = nominal.shape[0]
    if clip(nominal, lower, upper, out) and violation(L, S, count, out) <= 0.0:
        return True, 0.0
    size = n + 1
    inverse, normals, mapped, gram, vectors = floats[0], floats[1], floats[2], floats[3], floats[4]
    scales, x = vectors[6], vectors[7]
    # jerks in units of their half range, the metric normalised to order one
    mean = 0.0
    for k in range(n):
        half = (upper[k] - lower[k]) / 2.0
        scales[k] = half if half > 0.0 else 1.0
        mean += inverse_weight[k, k] / scales[k] ** 2 / n
    for i in range(size):
        for j in range(size):
            inverse[i, j] = 0.0
    for i in range(n):
        for j in range(n):
            inverse[i, j] = inverse_weight[i, j] / (scales[i] * scales[j] * mean)
    # the larger the violation to be granted, the less its weight: their product is what rounding is relative to
    size_of_rows = 1.0
    for i in range(count):
        size_of_rows = max(size_of_rows, 10.0 * abs(S[i]))
    inverse[n, n] = size_of_rows / _SLACK_WEIGHT

    mode, used, soft, right, least, kept = 0, -1, S, S, np.inf, out
    # One call site only: the method is long, and compiled into every place it is called from. Without a solution
    # (mode 0) all rows get the same slack (1); then the rows that decide about its size keep it, and the others try
    # to do with less (2), so that one hopeless row does not switch off those that can be kept.
    for attempt in range(3):
        found = _dual_active_set(
            nominal,
            L,
            right,
            count,
            lower,
            upper,
            scales,
            inverse,
            mode,
            soft,
            normals,
            mapped,
            gram,
            vectors,
            active,
            x,
        )
        if found < 0 and attempt == 2:
            break
        used = found
        if found < 0:
            mode = 1
            continue
        for k in range(n):
            out[k] = min(max(x[k] * scales[k], lower[k]), upper[k])
        if mode == 0 and not (violation(L, S, count, out) <= 1e-10 * size_of_rows):
            # nearly dependent normals can make an infeasible problem look solved
            used, mode = -1, 1
            continue
        if mode == 2 and not (violation(L, S, count, out) <= least * (1.0 + 1e-7) + 1e-9):
            out[:] = kept
        if mode != 1:
            break
        least, kept = violation(L, S, count, out), out.copy()
        soft, right, mode = np.ones(count), S.copy(), 2
        for a in range(found):
            if active[a] < count:
                soft[active[a]] = 0.0
                right[active[a]] -= least * (1.0 + 1e-9) + 1e-12
    if used < 0:
        # not solved: say so, and answer with the smallest jerk of the box, never with the nominal
        for k in range(n):
            out[k] = min(max(0.0, lower[k]), upper[k])
        return False, np.nan
    _mend(lower, upper, out)
    left = violation(L, S, count, out)
    return mode == 0, left
