"""Checks of what users pass in, before anything happens."""

import math
from collections.abc import Callable, Iterable
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError


def positive_number(name: str, value: Any) -> float:
    """A positive, finite number.

    Raises:
        ParameterError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, Real) or not 0.0 < float(value) < math.inf:
        raise ParameterError(f"{name} has to be a positive number, got {value!r}")
    return float(value)


def real_array(name: str, value: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """A finite array of real numbers of one shape, as a new float64 array.

    Args:
        name: Of the argument.
        value: What was passed.
        shape: What it has to have.
        what: What it stands for, for the message.

    Raises:
        ParameterError: It is something else.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (ValueError, TypeError):
        array = None
    if array is None or array.shape != shape or not np.all(np.isfinite(array)):
        raise ParameterError(f"{name} has to be {what}, finite and of shape {shape}, got {value!r}")
    return array


def low_high(name: str, value: Any, least: float = 0.0) -> tuple[float, float]:
    """A range (low, high) of numbers that are in order and not below ``least``.

    Raises:
        ParameterError: It is something else.
    """
    low, high = real_array(name, value, (2,), "(low, high)").tolist()
    if not least <= low <= high:
        raise ParameterError(f"{name} has to be (low, high) with {least} <= low <= high, got {value!r}")
    return low, high


def share(name: str, value: Any) -> float:
    """A number in [0, 1].

    Raises:
        ParameterError: It is something else.
    """
    number = float(real_array(name, value, (), "a number in [0, 1]"))
    if not 0.0 <= number <= 1.0:
        raise ParameterError(f"{name} has to be in [0, 1], got {value!r}")
    return number


def positive_share(name: str, value: Any) -> float:
    """A number in (0, 1].

    Raises:
        ParameterError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, Real) or not 0.0 < float(value) <= 1.0:
        raise ParameterError(f"{name} has to be in (0, 1], got {value!r}")
    return float(value)


def known_name(name: str, value: Any, valid: Any) -> str:
    """A string that is one of the valid ones.

    Raises:
        ParameterError: It is not; the message lists them.
    """
    if not isinstance(value, str) or value not in valid:
        begun = [one for one in valid if isinstance(value, str) and value and one.startswith(f"{value} ")]
        hint = f"; names with spaces need quotes: '{begun[0]}'" if begun else ""
        raise ParameterError(f"unknown {name} {value!r}; valid: {', '.join(valid)}{hint}")
    return value


def number_within(name: str, value: Any, low: float, high: float = math.inf) -> float:
    """A finite number in [low, high].

    Raises:
        ParameterError: It is something else.
    """
    wanted = f"in [{low:g}, {high:g}]" if high < math.inf else f"of at least {low:g}"
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value) or not low <= value <= high:
        raise ParameterError(f"{name} has to be a number {wanted}, got {value!r}")
    return float(value)


def true_or_false(name: str, value: Any) -> bool:
    """A truth value, not what counts as one.

    Raises:
        ParameterError: It is something else.
    """
    if not isinstance(value, bool | np.bool_):
        raise ParameterError(f"{name} has to be True or False, got {value!r}")
    return bool(value)


def positive_integer(name: str, value: Any) -> int:
    """An integer of at least 1.

    Raises:
        ParameterError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ParameterError(f"{name} has to be a positive integer, got {value!r}")
    return int(value)


def whole_number(name: str, value: Any) -> int:
    """An integer of at least 0.

    Raises:
        ParameterError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 0:
        raise ParameterError(f"{name} has to be a whole number of at least 0, got {value!r}")
    return int(value)


def check_fields(instance: Any, names: Iterable[str], check: Callable[..., Any], *bounds: Any) -> None:
    """Check fields of a frozen dataclass, and keep what the check makes of each: JSON holds no numbers of numpy.

    Args:
        instance: The dataclass, as it is being made.
        names: Of the fields, in the order in which they are checked.
        check: One of the checks of this module, which takes a field's name, its value and the ``bounds``.
        *bounds: What else it takes.

    Raises:
        ParameterError: A field is something else than the check wants.
    """
    for name in names:
        object.__setattr__(instance, name, check(name, getattr(instance, name), *bounds))
