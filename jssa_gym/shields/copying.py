"""Filters are copied: each shield has one of its own, and environments are copied and sent with theirs."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import InterfaceError
from jssa_gym.robots import RobotModel

_PLAIN = (RobotModel, ModuleType, type, str, bytes, int, float, bool, type(None))
"""What holds no memory that could be shared: of a robot all arrays are for reading alone."""


def refuse_shared_memory(filter: Any) -> None:
    """Refuse to copy a filter of which one attribute is a view of another's memory.

    Copying parts them: the copy would go on writing into one and reading from the other, blind.

    Raises:
        InterfaceError: There are such attributes; the message names them.
    """
    found = list(_arrays(filter, "", {}).values())
    for k, (name, array) in enumerate(found):
        for other, another in found[:k]:
            if (array.flags.writeable or another.flags.writeable) and np.may_share_memory(array, another):
                raise InterfaceError(
                    f"{type(filter).__name__} cannot be copied: its attributes {other} and {name} share memory, which "
                    "those of a copy do not; make one of them a property"
                )


def _arrays(thing: Any, path: str, seen: dict[int, Any]) -> dict[int, tuple[str, NDArray[Any]]]:
    """All arrays that a thing leads to, by identity, with the way there."""
    if isinstance(thing, _PLAIN) or id(thing) in seen:
        return {}
    seen[id(thing)] = thing
    if isinstance(thing, np.ndarray):
        return {id(thing): (path, thing)}
    if isinstance(thing, dict):
        parts = {f"{path}[{key!r}]": value for key, value in thing.items()}
    elif isinstance(thing, tuple | list | set | frozenset):
        parts = {f"{path}[{k}]": value for k, value in enumerate(thing)}
    else:
        slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        names = [name for name in (*getattr(thing, "__dict__", ()), *slots) if hasattr(thing, name)]
        parts = {f"{path}.{name}" if path else name: getattr(thing, name) for name in names}
    found = {}
    for where, part in parts.items():
        found |= _arrays(part, where, seen)
    return found
