"""What counts as an action."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import InvalidActionError
from jssa_gym.types import Array


def checked_action(action: Any, n: int) -> Array:
    """An action as float64, shape (n,), a copy.

    Raises:
        InvalidActionError: Another shape, or not an array of real numbers. NaN and infinity pass: they are for the
            caller to answer.
    """
    if type(action) is np.ndarray and action.shape == (n,) and action.dtype.char in "fd":
        return action.astype(np.float64)  # the usual case, three times in every shielded step
    return _as_float64(taken_action(action, n))


def taken_action(action: Any, n: int) -> NDArray[Any]:
    """An action in its own type, shape (n,), a copy: read once, whatever it would say the next time.

    Raises:
        InvalidActionError: See :func:`checked_action`.
    """
    if type(action) is np.ndarray and action.shape == (n,) and action.dtype.char in "fd":
        return action.copy()
    if isinstance(action, np.ma.MaskedArray):
        raise InvalidActionError(f"an action is an array of {n} real numbers, got a masked one")
    try:
        array = np.array(np.asarray(action))
    except Exception as error:
        raise InvalidActionError(f"an action is an array of {n} real numbers: {error}") from error
    if array.dtype.kind not in "fiu":
        raise InvalidActionError(
            f"an action is an array of {n} real numbers, got {type(action).__name__} of type {array.dtype}"
        )
    if array.shape != (n,):
        raise InvalidActionError(f"an action has shape ({n},), got {array.shape}")
    return array


def _as_float64(array: NDArray[Any]) -> Array:
    if array.dtype.itemsize > 8:
        # what a longer float holds beyond float64 becomes infinity, which the caller answers
        with np.errstate(over="ignore"):
            return array.astype(np.float64)
    return array.astype(np.float64)
