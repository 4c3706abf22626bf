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

    def metric(self) -> dict[str, Any]:
        """V as fields of :class:`~jssa_gym.tick.layout.StepSettings`."""
        diagonal = np.ones(self.n) if self.diagonal is None else self.diagonal.copy()
        inverse = np.asarray(np.linalg.inv(self.weight), np.float64)
        return {"diagonal": self.diagonal is not None, "weight": diagonal, "inverse": inverse}

    @abstractmethod
    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        """Project ``nominal`` (n,) [rad/s³]; the answer's arrays are the caller's to keep."""


class ExactProjector(Projector):
    """Closed form for one row and a diagonal V, dual active set otherwise."""

    def __init__(self, n: int, weight: ArrayLike | None = None) -> None:
        super().__init__(n, weight)
        self._inverse = np.linalg.inv(self.weight)
        self._scratch = scratch(n, 0)

    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        jerk = np.empty(self.n)
        count = len(rows.S)
        if count == 1 and self.diagonal is not None:
            left = project_row(nominal, rows.L[0], rows.S[0], lower, upper, self.diagonal, jerk)
            # a violation of rounding size is no infeasibility
            kept = left < np.inf and left <= 1e-12 * max(1.0, abs(rows.S[0]))
            return Projection(jerk, kept, max(left, 0.0), "")
        if count > self._scratch[2].shape[1]:
            self._scratch = scratch(self.n, 2 * count)
        feasible, left = project_rows(nominal, rows.L, rows.S, count, lower, upper, self._inverse, *self._scratch, jerk)
        return Projection(jerk, feasible, left, "")


class OSQPProjector(Projector):
    """OSQP, updated in place, started cold, its step size fixed, polished - and never trusted.

    Its status is not looked at. Its jerk is clipped to the box and the violation computed; its multipliers have to
    prove that no jerk much nearer to the nominal keeps the rows, too. If more than ``tolerance`` is left or the proof
    fails by more than ``nearness``, :class:`ExactProjector` answers and the projection's note says so.
    """

    tolerance = 1e-9
    """Violation of the rows that is accepted [m²]."""
    nearness = 1e-3
    """Distance from the nearest jerk that is accepted, in the metric of V at a mean weight of 1 and in units of the
    largest bound. Polished answers prove about 1e-8, unpolished ones about 1e-4."""

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
        self._inverse = np.linalg.inv(self._metric)
        self._capacity = capacity
        self._matrix = np.zeros((m, self.n))
        self._lower, self._upper = np.full(m, -np.inf), np.full(m, np.inf)

    def project(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array) -> Projection:
        count = len(rows.S)
        try:
            jerk, dual = self._solve(nominal, rows, lower, upper, count)
        except Exception as error:  # whatever a solver throws, the arm must go on safely
            return self._repair(nominal, rows, lower, upper, f"osqp raised {type(error).__name__}")
        if jerk is None or jerk.shape != (self.n,) or not np.all(np.isfinite(jerk)):
            return self._repair(nominal, rows, lower, upper, "osqp gave no finite answer")
        jerk = np.clip(jerk, lower, upper)
        left = violation(rows.L, rows.S, count, jerk)
        if not left <= self.tolerance:
            return self._repair(nominal, rows, lower, upper, f"osqp left {left:.1e} m²")
        if dual is None or dual.shape != self._lower.shape or not np.all(np.isfinite(dual)):
            return self._repair(nominal, rows, lower, upper, "osqp gave no finite multipliers")
        unit = _unit(lower, upper)
        far = self._distance(nominal / unit, jerk / unit, -dual)
        if not far <= self.nearness:
            return self._repair(nominal, rows, lower, upper, f"osqp may be {far:.1e} of the largest bound off")
        return Projection(jerk, True, max(left, 0.0), "")

    def _distance(self, nominal: Array, jerk: Array, push: Array) -> float:
        r"""Most that a jerk can be from the nearest one, if it keeps rows and box; all in the solver's units.

        Multipliers :math:`\lambda`, whosever they are, bound the objective from below (weak duality); with
        :math:`w = A^\top \lambda` the jerk's own exceeds that by its residuals of stationarity and complementarity,
        :math:`|V(u - \bar u) - w|^2_{V^{-1}}/2 + \lambda^\top (A u - b)`, and half the square of its distance from
        the nearest by no more (strong convexity). What is positive pushes away from a lower side, else from an upper.
        """
        side = np.where(push > 0.0, self._lower, self._upper)
        there = np.isfinite(side)
        normals, push = self._matrix[there], push[there]
        with np.errstate(over="ignore", invalid="ignore"):  # no number is no proof
            slack = np.abs(normals @ jerk - side[there])
            residual = self._metric @ (jerk - nominal) - normals.T @ push
            return float(np.sqrt(residual @ self._inverse @ residual + 2.0 * slack @ np.abs(push)))

    def _solve(
        self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array, count: int
    ) -> tuple[Array | None, Array | None]:
        if self._solver is None or count > self._capacity:
            self._setup(max(count, 2 * self._capacity, 8))
        # jerks in units of the largest bound, rows of unit length: the solver sees numbers of order one
        unit = _unit(lower, upper)
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
        jerk = None if answer.x is None else np.asarray(answer.x, float) * unit
        return jerk, None if answer.y is None else np.asarray(answer.y, float)

    def _repair(self, nominal: Array, rows: HalfSpaces, lower: Array, upper: Array, why: str) -> Projection:
        jerk, feasible, left, _ = self._exact.project(nominal, rows, lower, upper)
        return Projection(jerk, feasible, left, f"{why}, repaired")


def _unit(lower: Array, upper: Array) -> float:
    """The largest bound [rad/s³]."""
    return float(np.max(np.abs([lower, upper]))) or 1.0


PROJECTORS: dict[str, type[Projector]] = {"exact": ExactProjector, "osqp": OSQPProjector}
"""Projectors by name."""
