"""Who satisfies the rows: exact kernels, or OSQP under supervision."""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.projection import project_row, project_rows, scratch, violation
from jssa_gym.types import Array, HalfSpaces
from jssa_gym.validation import real_array


class Projection(NamedTuple):
    """A projector's answer."""

    jerk: Array
    """Shape (n,) [rad/s³], inside the box."""
    feasible: bool
    """Whether box and rows have a common point; else ``jerk`` violates the rows least."""
    violation: float
    """Largest violation of the rows by ``jerk``, computed from it [m²]."""
    note: str
    """What had to be repaired, or empty."""


class Projector(ABC):
    """Nearest jerk in box and rows, Eq. (14), in the metric of V.

    Args:
        n: Number of joints.
        weight: V: None for the identity, the diagonal of shape (n,), or a symmetric positive definite (n, n).

    Raises:
        ParameterError: V has another shape or is not symmetric positive definite.
    """

    def __init__(self, n: int, weight: ArrayLike | None = None) -> None:
        shape = (n, n) if np.ndim(np.asarray(weight, dtype=object)) == 2 else (n,)
        what = "None, the diagonal of V, or V"
        V = np.ones(n) if weight is None else real_array("weight", weight, shape, what)
        full = np.diag(V) if V.ndim == 1 else V
        if not np.allclose(full, full.T) or np.linalg.eigvalsh(full).min() <= 0.0:
            raise ParameterError("weight has to be symmetric positive definite")
        self.n = n
        self.weight = full
        self.diagonal = V if V.ndim == 1 else None

    @abstractmethod
    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        """Project ``nominal`` (n,) [rad/s³]; the answer's arrays are the caller's to keep."""


class ExactProjector(Projector):
    """Closed form for one row and a diagonal V, dual active set otherwise."""

    def __init__(self, n: int, weight: ArrayLike | None = None) -> None:
        super().__init__(n, weight)
        self._inverse = np.linalg.inv(self.weight)
        self._floats, self._active = scratch(n)

    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        jerk = np.empty(self.n)
        count = len(rows.S)
        if count == 1 and self.diagonal is not None:
            left = project_row(nominal, rows.L[0], rows.S[0], lower, upper, self.diagonal, jerk)
            # a violation of rounding size is no infeasibility
            kept = left < np.inf and left <= 1e-12 * max(1.0, abs(rows.S[0]))
            return Projection(jerk, kept, max(left, 0.0), "")
        feasible, left = project_rows(
            nominal, rows.L, rows.S, count, lower, upper, self._inverse, self._floats, self._active, jerk
        )
        return Projection(jerk, feasible, left, "")


class OSQPProjector(Projector):
    """OSQP, updated in place, started cold, its step size fixed, polished - and never trusted.

    Its status is not looked at. Its jerk is clipped to the box and the violation computed; if more than
    ``tolerance`` is left, :class:`ExactProjector` answers and the projection's note says so.
    """

    tolerance = 1e-9
    """Violation of the rows that is accepted [m²]."""

    def __init__(self, n: int, weight: ArrayLike | None = None) -> None:
        super().__init__(n, weight)
        self._exact = ExactProjector(n, weight)
        self._solver: Any = None
        self._capacity = 0

    def __getstate__(self) -> dict[str, Any]:
        """Copies start with a solver of their own: OSQP's cannot be copied."""
        return {**self.__dict__, "_solver": None, "_capacity": 0}

    def _setup(self, capacity: int) -> None:
        import osqp
        from scipy import sparse

        m = capacity + self.n
        mean = np.trace(self.weight) / self.n
        pattern = sparse.csc_matrix(np.ones((m, self.n)))
        self._solver = osqp.OSQP()
        self._solver.setup(
            sparse.csc_matrix(np.triu(self.weight / mean)),
            np.zeros(self.n),
            pattern,
            np.full(m, -np.inf),
            np.full(m, np.inf),
            verbose=False,
            warm_starting=False,
            adaptive_rho=False,
            scaling=0,
            rho=1.0,
            polishing=True,
            eps_abs=1e-8,
            eps_rel=1e-8,
            max_iter=4000,
        )
        self._metric = self.weight / mean
        self._capacity = capacity
        self._matrix = np.zeros((m, self.n))
        self._lower, self._upper = np.full(m, -np.inf), np.full(m, np.inf)

    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        count = len(rows.S)
        try:
            jerk = self._solve(nominal, rows, lower, upper, count)
        except Exception as error:  # whatever a solver throws, the arm must go on safely
            return self._repair(nominal, rows, lower, upper, f"osqp raised {type(error).__name__}")
        if jerk is None or jerk.shape != (self.n,) or not np.all(np.isfinite(jerk)):
            return self._repair(nominal, rows, lower, upper, "osqp gave no finite answer")
        jerk = np.clip(jerk, lower, upper)
        left = violation(rows.L, rows.S, count, jerk)
        if not left <= self.tolerance:
            return self._repair(nominal, rows, lower, upper, f"osqp left {left:.1e} m²")
        return Projection(jerk, True, max(left, 0.0), "")

    def _solve(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array, count: int) -> Array | None:
        if self._solver is None or count > self._capacity:
            self._setup(max(count, 2 * self._capacity, 8))
        # jerks in units of the largest bound, rows of unit length: the solver sees numbers of order one
        unit = float(np.max(np.abs([lower, upper]))) or 1.0
        length = np.linalg.norm(rows.L, axis=1)
        length[length == 0.0] = 1.0
        self._matrix[:] = 0.0
        self._matrix[:count] = rows.L / length[:, None]
        self._matrix[self._capacity :] = np.eye(self.n)
        self._lower[:] = -np.inf
        self._lower[:count] = rows.S / (length * unit)
        self._lower[self._capacity :] = lower / unit
        self._upper[self._capacity :] = upper / unit
        self._solver.update(
            q=-self._metric @ (nominal / unit),
            Ax=self._matrix.ravel(order="F"),
            l=self._lower,
            u=self._upper,
        )
        self._solver.warm_start(x=np.zeros(self.n), y=np.zeros(len(self._lower)))
        answer = self._solver.solve(raise_error=False)
        return None if answer.x is None else np.asarray(answer.x, float) * unit

    def _repair(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array, why: str) -> Projection:
        jerk, feasible, left, _ = self._exact.project(nominal, rows, lower, upper)
        return Projection(jerk, feasible, left, f"{why}, repaired")


PROJECTORS: dict[str, type[Projector]] = {"exact": ExactProjector, "osqp": OSQPProjector}
"""Projectors by name."""
