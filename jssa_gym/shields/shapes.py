"""Whether arrays of people are what they are taken for."""

from typing import Any

import numpy as np

from jssa_gym.types import CapsuleSet


def fit_together(human: CapsuleSet, age: Any, valid: Any) -> bool:
    """Whether the shapes of the people's arrays do."""
    start, end, start_velocity, end_velocity, radius, names, person = human
    shape, ends = radius.shape, (*radius.shape, 3)
    return (
        len(shape) == 1
        and start.shape == end.shape == start_velocity.shape == end_velocity.shape == ends
        and person.shape == age.shape == valid.shape == shape
        and len(names) == shape[0]
    )


def unlike(human: Any, age: Any, valid: Any) -> str:
    """Which of the people's arrays is none, or masked; empty if all are arrays."""
    arrays = (*CapsuleSet._fields[:5], "person")
    parts = {**{name: getattr(human, name, None) for name in arrays}, "age": age, "valid": valid}
    for name, part in parts.items():
        if isinstance(part, np.ma.MaskedArray):
            return f"{name} is masked"
        if not isinstance(part, np.ndarray):
            return f"{name} is of type {type(part).__name__}, no array"
    return ""
