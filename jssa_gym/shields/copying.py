"""Filters are copied: each shield has one of its own, and environments are copied with theirs."""

import copy

import numpy as np

from jssa_gym.exceptions import InterfaceError
from jssa_gym.shields.filter import SafetyFilter


def own_copy(filter: SafetyFilter) -> SafetyFilter:
    """A copy of a filter that shares nothing with it.

    Raises:
        InterfaceError: An attribute of the filter is a view of another's memory. Copying parts them: the copy would go
            on writing into one and reading from the other, blind.
    """
    arrays = [(name, value) for name, value in vars(filter).items() if isinstance(value, np.ndarray)]
    for k, (name, array) in enumerate(arrays):
        for other, another in arrays[:k]:
            if array is not another and np.may_share_memory(array, another):
                raise InterfaceError(
                    f"{type(filter).__name__} cannot be copied: its attributes {other} and {name} share memory, which "
                    "those of a copy do not; make one of them a property"
                )
    return copy.deepcopy(filter)
