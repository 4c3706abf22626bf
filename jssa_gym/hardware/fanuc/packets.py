"""The packets of Stream Motion, by ``airo-fanuc``."""

import importlib
from typing import Any

from jssa_gym.exceptions import MissingExtraError


def airo(module: str) -> Any:
    """A module of ``airo_fanuc``.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        return importlib.import_module(f"airo_fanuc.{module}")
    except ImportError as error:
        raise MissingExtraError("FANUC arms need airo-fanuc: pip install 'jssa-gym[fanuc]'") from error
