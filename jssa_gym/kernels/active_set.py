r"""Dual active set of Goldfarb and Idnani (1983), and the least violation of rows that exclude each other.

Constraints are numbered: rows first, then the lower bounds of the jerks, then the upper ones. Normals and steps are in
scaled jerks, :math:`(u - \bar u) / s` with s half the width of the box.
"""

import numpy as np

from jssa_gym.kernels.factor import add, drop, turn_in
from jssa_gym.kernels.jit import jit

_ROUNDING = 1e-12
"""Violation that counts as none, relative to what the box and S can make of the row."""

_DEPENDENT = 1e-22
"""Squared sine of the angle under which a normal counts as a combination of the active ones."""

_NEGLIGIBLE = 1e-9
"""Relative part of a proof of infeasibility, or of the least violation, that does not count."""

_DOUBTS = 8
"""How often an end is checked on exact numbers before it counts.

Where normals are nearly combinations of each other the check drops what the search then adds again, for ever. What
counts then keeps what was granted, but may be farther from the nominal than it need be.
"""


@jit
def _row_gap(row, L, granted, u):
    """How much a jerk lacks to keep a row [m²]."""
    gap = granted[row]
    for k in range(L.shape[1]):
        gap -= L[row, k] * u[k]
    return gap


@jit
def _restate(used, count, L, granted, nominal, lower, upper, scale, active, multiplier, y, J, R, u):
    """The optimum on the active constraints, from scratch; those that hold it back from the nominal are dropped.

    Whatever rounding did on the way, and whatever was granted meanwhile, is accounted for after it.
    """
    n = scale.shape[0]
    while True:
        for a in range(used):
            c = active[a]
            if c < count:
                y[a] = _row_gap(c, L, granted, nominal)
            elif c < count + n:
                y[a] = (lower[c - count] - nominal[c - count]) / scale[c - count]
            else:
                y[a] = (nominal[c - count - n] - upper[c - count - n]) / scale[c - count - n]
            for b in range(a):
                y[a] -= R[b, a] * y[b]
            y[a] /= R[a, a]
        for k in range(n):
            step = 0.0
            for a in range(used):
                step += J[k, a] * y[a]
            u[k] = nominal[k] + scale[k] * step
        lowest, dropped = 0.0, np.int64(-1)
        for a in range(used - 1, -1, -1):
            multiplier[a] = y[a]
            for b in range(a + 1, used):
                multiplier[a] -= R[a, b] * multiplier[b]
            multiplier[a] /= R[a, a]
            if multiplier[a] < lowest:
                lowest, dropped = multiplier[a], a
        if dropped < 0:
            return used
        used = drop(dropped, used, n, active, multiplier, J, R)


@jit
def _most_violated(used, count, L, granted, u, lower, upper, scale, active):
    """The constraint that a jerk violates most, rows by their length: its number, -1 if none, and the gap."""
    n = scale.shape[0]
    chosen, worst, chosen_gap = -1, 0.0, 0.0
    for c in range(count + 2 * n):
        length = size = 1.0
        if c < count:
            gap = _row_gap(c, L, granted, u)
            if gap <= 0.0:
                continue
            square = 0.0
            for k in range(n):
                part = L[c, k] * scale[k]
                square += part * part
            length = np.sqrt(square)
            size = length + abs(granted[c])
            length = length if length > 0.0 else 1.0
        else:
            k = c - count if c < count + n else c - count - n
            gap = lower[k] - u[k] if c < count + n else u[k] - upper[k]
            if gap <= 0.0:
                continue
            gap /= scale[k]
        if gap <= _ROUNDING * size or gap <= worst * length:
            continue
        if np.isnan(gap):
            return c, gap
        taken = False
        for a in range(used):
            taken = taken or active[a] == c
        if not taken:
            chosen, worst, chosen_gap = c, gap / length, gap
    return chosen, chosen_gap


@jit
def _admit(chosen, gap, used, count, L, scale, active, multiplier, rate, d, J, R, u):
    """Move to where one more constraint holds, past those whose multipliers vanish on the way.

    Returns:
        The number of active constraints and 0; or, if no jerk keeps the chosen one and those then active, how much it
        lacks. The proof is in ``active`` and, as negative weights, in ``rate``, the chosen one last.
    """
    n = scale.shape[0]
    active[used] = chosen
    multiplier[used] = 0.0
    while True:
        square, slope = turn_in(chosen, count, L, scale, J, d), 0.0
        for j in range(used, n):
            slope += d[j] * d[j]
        # as the multiplier of the chosen grows, the others fall at the rate `rate` until the first one vanishes
        partial, dropped = np.inf, np.int64(-1)
        for a in range(used - 1, -1, -1):
            rate[a] = d[a]
            for b in range(a + 1, used):
                rate[a] -= R[a, b] * rate[b]
            rate[a] /= R[a, a]
            if rate[a] > 0.0 and multiplier[a] < partial * rate[a]:
                partial, dropped = multiplier[a] / rate[a], a
        full = gap / slope if slope > _DEPENDENT * square else np.inf
        length = min(partial, full)
        if length == np.inf:
            rate[used] = -1.0
            return used, gap
        for a in range(used):
            multiplier[a] = max(multiplier[a] - length * rate[a], 0.0)
        multiplier[used] += length
        if full < np.inf:
            for k in range(n):
                step = 0.0
                for j in range(used, n):
                    step += J[k, j] * d[j]
                u[k] += length * scale[k] * step
            gap -= length * slope
        if full <= partial:
            add(used, n, d, slope, J, R)
            return used + 1, 0.0
        used = drop(dropped, used, n, active, multiplier, J, R)
        active[used] = chosen


@jit
def _grant(gap, size, active, rate, first, S, count, least, others, decides, granted):
    """Grant the rows what a proof of infeasibility asks for; the new least violation and that of the other rows.

    The proof weighs the ``size`` constraints in ``active`` with the negative of ``rate`` and leaves ``gap``.
    """
    total = undecided = 0.0
    for a in range(size):
        if active[a] < count and rate[a] < 0.0:
            total -= rate[a]
            undecided -= rate[a] if first or decides[active[a]] == 0.0 else 0.0
    bound = 0.0
    if undecided <= _NEGLIGIBLE * total:
        # all of them keep the least violation already: it was short by rounding
        least += gap / total
    elif first:
        bound = least + gap / total
        if bound > least * (1.0 + _NEGLIGIBLE):
            for i in range(count):
                decides[i] = 0.0
        least = bound * (1.0 + 1e-15)  # grows in any case
    else:
        others = bound = others + gap / undecided
    if bound >= least * (1.0 - _NEGLIGIBLE):
        others = 0.0
        for a in range(size):
            if active[a] < count and -rate[a] > _NEGLIGIBLE * total:
                decides[active[a]] = 1.0
    for i in range(count):
        granted[i] = S[i] - (least if first or decides[i] > 0.0 else others)
    return least, others


@jit
def nearest(nominal, L, S, count, lower, upper, scale, tolerance, J, R, vectors, active, relief, out):
    r"""Nearest jerk that keeps rows and box, or that violates the rows least.

    Constraint after constraint is added, most violated first; one that blocks with a vanishing multiplier is dropped.
    If nothing blocks and nothing is free, the constraints exclude each other, and multipliers :math:`\lambda \ge 0`
    prove it (Farkas): the normals weighed with them cancel, the right-hand sides leave a gap. Whatever the jerk, one
    row of the proof then lacks :math:`\mathrm{gap} / \sum \lambda` or more. That much is granted to every row, and the
    search goes on from where it is. What has been granted at its end is the least, not nearly so: it suffices, and a
    proof asked for it. Then the rows of that proof keep it and all others start again with nothing, so that one
    hopeless row does not switch off those that can be kept.

    Args:
        nominal: Nominal jerk, shape (n,) [rad/s³].
        L: Rows, shape (≥ count, n) [m²/(rad/s³)].
        S: Right-hand sides, shape (≥ count,) [m²].
        count: Number of rows.
        lower, upper: Jerk bounds, shape (n,) [rad/s³].
        scale: Unit of each jerk, shape (n,) [rad/s³].
        tolerance: Violation that is rounding, not conflict [m²].
        J: Root of the inverse of V in these units, shape (≥ n, ≥ n); changed.
        R: Scratch, shape (≥ n, ≥ n).
        vectors: Scratch, shape (≥ 4, ≥ n + 1).
        active: Scratch, int64, shape (≥ n + 1,).
        relief: Scratch, shape (2, ≥ count).
        out: Result, shape (n,) [rad/s³]; to be clipped to the box.

    Returns:
        Whether a solution was found; if not, ``out`` is undefined.
    """
    n = nominal.shape[0]
    multiplier, rate, d, u = vectors[0], vectors[1], vectors[2], vectors[3]
    used, stale, found = np.int64(0), True, False
    # memory of their own from the first conflict on: what is left of S, and 1 for the rows that decide about `least`
    granted, decides, least, others, level, doubts = S, S, 0.0, 0.0, 0, 0
    for _ in range(50 * (count + 2 * n)):
        if stale:
            used = _restate(used, count, L, granted, nominal, lower, upper, scale, active, multiplier, rate, J, R, u)
        chosen, gap = _most_violated(used, count, L, granted, u, lower, upper, scale, active)
        if np.isnan(gap):
            break
        if chosen < 0:
            if not stale and doubts < _DOUBTS:  # once more on exact numbers
                stale, doubts = True, doubts + 1
                continue
            for k in range(n):
                out[k] = u[k]
            found = True
            if level != 1 or least <= tolerance:
                return True
            level, stale, doubts = 2, True, 0
            for i in range(count):
                granted[i] = S[i] - least * decides[i]
            continue
        used, gap = _admit(chosen, gap, used, count, L, scale, active, multiplier, rate, d, J, R, u)
        stale = gap > 0.0
        if stale:
            doubts = 0
            if level == 0:
                level, granted, decides = 1, relief[0], relief[1]
                for i in range(count):
                    decides[i] = 0.0
            least, others = _grant(gap, used + 1, active, rate, level == 1, S, count, least, others, decides, granted)
            if not (least < np.inf):
                break
    return found
