"""What filters of others answer, taken so that nothing that comes after can fail for it."""

import numpy as np

from jssa_gym.types import Decision, Status

_MOST = 2**31
"""Numbers of capsules and rows lie below."""


def sound(decision: Decision, shape: tuple[int, ...]) -> Decision:
    """A filter's answer, its numbers as Python's.

    Raises:
        AttributeError, TypeError, ValueError: It is no decision, its jerk no float64 array of that shape, or another
            field not what it should be.
    """
    jerk = decision.jerk
    if jerk.shape != shape or jerk.dtype != np.float64:
        raise ValueError(f"the answer has shape {jerk.shape} and type {jerk.dtype}")
    if not isinstance(decision, Decision):
        raise TypeError(f"the answer is {type(decision).__name__}, no Decision")
    if (
        type(decision.phi) is type(decision.distance) is type(decision.slack) is float
        and type(decision.status) is Status
        and type(decision.reason) is str
        and type(decision.pair) is tuple
        and len(decision.pair) == 2
        and type(decision.pair[0]) is type(decision.pair[1]) is type(decision.rows) is int
        and max(decision.pair[0], decision.pair[1], decision.rows) < _MOST
        and min(decision.pair[0], decision.pair[1], decision.rows) >= -1
    ):
        return decision
    row, column = decision.pair
    if not all(-1 <= int(number) < _MOST for number in (row, column, decision.rows)):
        raise ValueError(f"the answer's pair {decision.pair} or rows {decision.rows} are no numbers")
    return decision._replace(
        status=Status(decision.status),
        reason=str(decision.reason),
        phi=float(decision.phi),
        distance=float(decision.distance),
        pair=(int(row), int(column)),
        slack=float(decision.slack),
        rows=int(decision.rows),
    )
