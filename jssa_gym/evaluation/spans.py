"""Spans of steps in which something holds."""

import numpy as np
from numpy.typing import NDArray

Span = tuple[int, int]
"""First step, and the one after the last."""


def spans(holds: NDArray[np.bool_], gap: int = 0) -> list[Span]:
    """Where a condition (T,) holds.

    Args:
        holds: Step by step.
        gap: Interruptions of at most so many steps do not end a span.
    """
    edges = np.flatnonzero(np.diff(holds.astype(np.int8), prepend=0, append=0)).reshape(-1, 2).tolist()
    joined: list[Span] = []
    for first, last in edges:
        if joined and first - joined[-1][1] <= gap:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined


def longest(holds: NDArray[np.bool_]) -> int:
    """Most steps in a row in which a condition (T,) holds."""
    return max((last - first for first, last in spans(holds)), default=0)
