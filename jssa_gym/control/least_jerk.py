r"""Least squared jerk through waypoints, within limits: a banded quadratic programme.

Time is counted in ticks here: with jerk :math:`u\tau^3`, acceleration :math:`a\tau^2` and speed :math:`v\tau` nothing
depends on the tick's length. The jerk of every tick is free. Waypoints and rest at the end are linear equalities
:math:`A u = r`; their least-norm solution is :math:`A^\top (A A^\top)^{-1} r`.

With limits, the motion is written as a cubic B-spline whose knots are the ticks: piecewise-constant jerk, and
of the coefficients :math:`c`

.. math:: u_k = c_{k+2} - 3 c_{k+1} + 3 c_k - c_{k-1},\quad a_k = c_{k+1} - 2 c_k + c_{k-1},\quad
          v_k = \tfrac12 (c_{k+1} - c_{k-1}),\quad q_k = \tfrac16 (c_{k+1} + 4 c_k + c_{k-1}).

Every limit touches four neighbours at most, the start fixes the first three, rest at the end the last three, and a
waypoint one more by its neighbours. What is left is free of equalities, and a Newton step of an interior-point method
costs one factorisation of a matrix with three bands.
"""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from jssa_gym.kernels.interior import longest, newton_right, newton_step, times
from jssa_gym.types import Array

FEWEST = 4
"""Ticks from one waypoint to the next, at least: what the elimination of a waypoint by its neighbours needs."""

_BANDS = 3
_ROUNDS = 60
"""Interior-point steps at most; problems that have a solution take 4 to 15."""

_STALL = 10
"""Steps without progress after which it gives up."""

_SHY = 1e-8
"""Share of the limits that the interior-point method stays away from them: more than it is off when it ends."""


_factorise, _solve = linalg.get_lapack_funcs(("pbtrf", "pbtrs"), dtype=np.float64)
"""Cholesky's factors of a banded matrix, and a solution with them: scipy.linalg's own, called without its checks."""


class Equalities(NamedTuple):
    """What has to be met, A u = r."""

    marks: NDArray[np.int64]
    """Tick at which each waypoint is met, shape (K,)."""
    matrix: Array
    """A: positions at the waypoints, then speed and acceleration at the end, by the jerks; shape (K + 2, H)."""
    scale: Array
    """What its rows are divided by before they are factorised, shape (K + 2,)."""
    Q: Array
    R: Array


class Splines(NamedTuple):
    """What the coefficients that no equality fixes do, f of them."""

    rows: sparse.csr_array
    """Jerk, acceleration, speed and position at all ticks by the free coefficients, shape (4 H - 3, f)."""
    columns: sparse.csr_array
    """The transpose of ``rows``."""
    products: sparse.csr_array
    """Bands of ``rows.T @ diag(w) @ rows`` by w, shape (4 f, 4 H - 3)."""
    fixed: NDArray[np.int64]
    """Rows that nothing free moves: the positions at the waypoints."""


@functools.lru_cache(maxsize=256)  # many arms have plans of many lengths
def equalities(ticks: tuple[int, ...]) -> Equalities:
    """The equalities of waypoints so many ticks apart, each at least :data:`FEWEST`."""
    marks = np.cumsum(ticks)
    H = int(marks[-1])
    left = marks[:, None] - 1 - np.arange(H)
    A = np.zeros((len(marks) + 2, H))
    A[:-2] = np.where(left >= 0, 1.0 / 6.0 + left / 2.0 + left**2 / 2.0, 0.0)
    A[-2] = 0.5 + left[-1]
    A[-1] = 1.0
    scale = np.linalg.norm(A, axis=1)
    Q, R = linalg.qr((A / scale[:, None]).T, mode="economic")
    return Equalities(marks, A, scale, Q, R)


@functools.lru_cache(maxsize=256)  # many arms have plans of many lengths
def splines(ticks: tuple[int, ...]) -> Splines:
    """The splines of waypoints so many ticks apart, each at least :data:`FEWEST`."""
    marks = np.cumsum(ticks)
    H = int(marks[-1])

    def difference(weights: tuple[float, ...], first: int, count: int) -> sparse.csr_array:
        # column j stands for the coefficient j - 1
        return sparse.csr_array(
            sparse.diags_array(
                [np.full(count, w) for w in weights], offsets=range(first, first + len(weights)), shape=(count, H + 3)
            )
        )

    all_rows = sparse.vstack(
        [
            difference((-1.0, 3.0, -3.0, 1.0), 0, H),
            difference((1.0, -2.0, 1.0), 1, H - 1),
            difference((-0.5, 0.0, 0.5), 1, H - 1),
            difference((1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0), 1, H - 1),
        ]
    )
    # coefficients 2 .. H - 2 but the inner waypoints' are free; those are -(left + right) / 4
    bound = marks[:-1] + 1
    free = np.setdiff1d(np.arange(3, H), bound)
    number = np.full(H + 3, -1)
    number[free] = np.arange(len(free))
    entries = [(free, number[free], np.ones(len(free)))]
    for side in (bound - 1, bound + 1):
        kept = number[side] >= 0
        entries.append((bound[kept], number[side[kept]], np.full(int(kept.sum()), -0.25)))
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    rows = sparse.csr_array(all_rows @ sparse.csr_array((value, (row, column)), shape=(H + 3, len(free))))
    rows.eliminate_zeros()
    return Splines(rows, sparse.csr_array(rows.T), _products(rows), np.flatnonzero(np.diff(rows.indptr) == 0))


def _products(rows: sparse.csr_array) -> sparse.csr_array:
    """Maps weights w to the upper bands of ``rows.T @ diag(w) @ rows``, as LAPACK stores them."""
    m, f = rows.shape
    by_column, entries = sparse.csc_array(rows), []
    for apart in range(min(_BANDS + 1, f)):
        product = sparse.coo_array(by_column[:, : f - apart].multiply(by_column[:, apart:]))
        r, c = product.coords
        entries.append(((_BANDS - apart) * f + c + apart, r, product.data))
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return sparse.csr_array((value, (row, column)), shape=((_BANDS + 1) * f, m))


def required(equal: Equalities, state: Array, waypoints: Array) -> Array:
    """What the jerks have to bring about, r of A u = r, shape (K + 2, n).

    Args:
        equal: The equalities.
        state: Position, velocity, acceleration in ticks, shape (3, n).
        waypoints: Shape (K, n).
    """
    q, v, a = state
    t = equal.marks[:, None].astype(float)
    return np.vstack([waypoints - (q + t * v + t**2 / 2.0 * a), -(v + t[-1:] * a), -a[None]])


def corrected(equal: Equalities, right: Array, jerk: Array) -> Array:
    """The nearest jerks that meet the equalities to rounding; from zero jerk, the solution of least norm.

    Args:
        equal: The equalities.
        right: r, shape (K + 2, n).
        jerk: Shape (H, n).
    """
    for _ in range(3):  # once, and twice for the digits that were lost
        rest = (right - equal.matrix @ jerk) / equal.scale[:, None]
        jerk = jerk + equal.Q @ linalg.solve_triangular(equal.R, rest, trans="T", check_finite=False)
    return jerk


def limited(
    spline: Splines, jerk: Array, motion: Array, J: float, A: float, V: Array, low: Array, high: Array
) -> Array:
    """One joint's jerks of least norm that keep its limits at every tick, if there are any.

    Minimises the squared distance from the least-norm solution, which is the same, by Mehrotra's predictor and
    corrector. There is no status: whether limits and equalities are kept is for the caller to compute.

    Args:
        spline: The free coefficients.
        jerk: The least-norm solution, shape (H,).
        motion: Position, velocity, acceleration after every tick of it but the last, shape (3, H - 1).
        J, A: Jerk and acceleration limit, in ticks.
        V: Speed limit after every tick but the last, in ticks, shape (H - 1,).
        low, high: Position limits after every tick but the last, shape (H - 1,).

    Returns:
        Jerks (H,).
    """
    H, f = len(jerk), spline.rows.shape[1]
    if f == 0:
        return jerk
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    # rows in shares of their limits; the unit of the unknowns is the jerk limit
    size = np.concatenate([np.ones(H), np.full(H - 1, J / A), J / V, J / half])
    at = np.concatenate([jerk / J, motion[2] / A, motion[1] / V, (motion[0] - middle) / half])
    at[spline.fixed] = 0.0
    lower, upper = _SHY - 1.0 - at, 1.0 - _SHY - at
    cost = np.zeros(len(size))
    cost[:H] = 1.0
    edge, side = np.array([upper, -lower]), np.array([[1.0], [-1.0]])
    rows, columns, products = (_parts(matrix) for matrix in (spline.rows, spline.columns, spline.products))
    y, reach = np.zeros(f), np.zeros_like(size)  # reach is what the rows make of y
    s, z = np.maximum(edge, 0.1), np.full_like(edge, 0.1)
    slope, right, bands = np.empty(f), np.empty(f), np.empty((_BANDS + 1, f))
    pull, step = np.empty_like(size), (np.empty_like(size), np.empty_like(s), np.empty_like(s))
    dr, ds, dz = step
    best, since = np.inf, 0
    for _ in range(_ROUNDS):
        p = s + side * reach - edge
        gap = (s[0] @ z[0] + s[1] @ z[1]) / (2.0 * len(size))
        miss = np.abs(p).max()
        best, since = (miss, 0) if miss < 0.9 * best else (best, since + 1)
        if (miss <= 0.5 * _SHY and gap <= _SHY) or since > _STALL or not np.isfinite(gap):
            break
        times(columns, cost * reach + size * (z[0] - z[1]), slope)
        w = z / s
        times(products, size * size * (w[0] + w[1]) + cost, bands.reshape(-1))
        factor, failed = _factorise(bands)
        if failed:
            break
        both = s * z
        for corrects in (False, True):
            c = both
            if corrects:
                primal, dual = longest(s, ds), longest(z, dz)
                later_s, later_z = s + primal * ds, z + dual * dz
                after = later_s[0] @ later_z[0] + later_s[1] @ later_z[1]
                c = both + ds * dz - (after / (2.0 * len(size)) / gap) ** 3 * gap
            newton_right(columns, size, slope, (s, w, p), c, pull, right)
            dy, _ = _solve(factor, right)
            newton_step(rows, size, dy, (s, z, p), c, step)
        along = min(1.0, 0.995 * min(longest(s, ds), longest(z, dz)))
        y, reach = y + along * dy, reach + along * dr
        s, z = s + along * ds, z + along * dz
    moved = np.empty_like(size)
    times(rows, y, moved)
    return jerk + J * moved[:H]


def _parts(matrix: sparse.csr_array) -> tuple[Array, NDArray[np.int32], NDArray[np.int32]]:
    """A matrix as kernels take it."""
    return matrix.data, matrix.indices, matrix.indptr
