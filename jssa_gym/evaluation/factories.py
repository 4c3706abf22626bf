"""Policies and filters of somebody's own, named as ``"package.module:factory"``."""

import importlib
import inspect
from collections.abc import Callable
from typing import Any

from jssa_gym.exceptions import ParameterError


def load_factory(
    kind: str, name: str, told: str, *args: Any, called: str = "", suffix: str = "", **options: Any
) -> Callable[..., Any]:
    """What a name stands for, if it can be called.

    Args:
        kind: What it makes, for messages.
        name: ``"package.module:factory"``.
        told: What it is called with, in words.
        *args: Values like those that it is called with.
        called: The same as ``told`` in the message about a factory that takes others, where that says more.
        suffix: What may stand behind the name and is no part of it.
        **options: Keywords that it is called with.

    Raises:
        ParameterError: It cannot be loaded, or called with these.
    """
    module, _, attribute = name.removesuffix(suffix).partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ParameterError(
            f"cannot load the {kind} {name!r}: {error}; it is module:factory, of a module in the working directory or "
            "installed"
        ) from error
    if not callable(found):
        raise ParameterError(f"the {kind} {name!r} is no factory that can be called with {told}")
    try:
        inspect.signature(found).bind(*args, **options)
    except TypeError as error:
        raise ParameterError(f"the factory {name!r} is called with {called or told}: {error}") from error
    except ValueError:
        pass  # something built in, which does not say what it takes
    return found
