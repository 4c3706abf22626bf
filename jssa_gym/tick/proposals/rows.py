"""What filters share that project the nominal onto rows, Eq. (14)."""

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.projection import project_row, project_rows
from jssa_gym.tick import codes

PROJECT = 1
"""Rows have been made, ``told["rows"]`` of them in ``work.L`` and ``work.S``: a jerk has to be projected onto them."""


@jit
def project(settings, nominal, count, lower, upper, work):
    """What is nearest to ``nominal`` (n,) in box and first rows, into ``work.wanted``; feasible, violation left."""
    if count == 1 and settings.diagonal:
        row, right = work.L[0], work.S[0]
        left = project_row(nominal, row, right, lower, upper, settings.weight, work.wanted)
        # a violation of rounding size is no infeasibility
        return left < np.inf and left <= 1e-12 * max(1.0, abs(right)), max(left, 0.0)
    return project_rows(
        nominal, work.L, work.S, count, lower, upper, settings.inverse,
        work.multipliers, work.active, work.relief, work.wanted,
    )  # fmt: skip


@jit
def of_rows(told):
    """What became of the rows, as a code; 0 if there was nothing to project."""
    if not told["kept"]:
        return codes.INFEASIBLE
    if told["rows"] == 0:
        return 0
    return codes.RECOVERING if told["recovering"] else codes.ROWS
