"""Problems of projection, and how far from optimal an answer is."""

import numpy as np
import reference as ref


def positive_definite(rng, n):
    """A full weight, shape (n, n)."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.2 * np.eye(n)


def box(rng, n):
    """Bounds of a box around 0, shapes (n,)."""
    return -rng.uniform(20.0, 200.0, n), rng.uniform(20.0, 200.0, n)


def feasible_rows(rng, lower, upper, m):
    """Rows of the size that the safety index makes, all kept by one jerk of the box; up to n - 1 just so."""
    L = 1e-3 * rng.normal(size=(m, len(lower)))
    room = 0.05 * rng.uniform(0.0, 1.0, m)
    room[: rng.integers(0, min(m, len(lower) - 1) + 1)] = 0.0
    return L, L @ rng.uniform(lower, upper) - room


def row_scale(L, S, lower, upper):
    """Size of the numbers that cancel in S - L u."""
    most = np.abs(L).reshape(-1, len(lower)) @ np.maximum(np.abs(lower), np.abs(upper))
    return float(max(np.max(np.abs(S), initial=0.0), np.max(most, initial=0.0), 1e-300))


def kkt_residual(u, nominal, L, S, lower, upper, V):
    """How far V (u - nominal) is from a non-negative combination of active normals, relative to its terms."""
    gradient = V @ (u - nominal)
    L, S = np.reshape(L, (-1, len(u))), np.reshape(S, -1)
    scale = row_scale(L, S, lower, upper)
    length = np.linalg.norm(L, axis=1)
    rows = L[(np.abs(L @ u - S) <= 1e-9 * scale) & (length > 0.0)]
    eye = np.eye(len(u))
    unit = np.max(np.abs([lower, upper]))
    near = 1e-12 * unit
    normals = np.vstack([rows, eye[u <= lower + near], -eye[u >= upper - near]])
    size = float(np.max(np.abs(V) @ np.maximum(np.abs(u - nominal), 1e-4 * unit)))
    if len(normals) == 0:
        return float(np.linalg.norm(gradient)) / size
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    _, residual = ref.scipy.optimize.nnls(normals.T, gradient / size, maxiter=1000)
    return float(residual)
