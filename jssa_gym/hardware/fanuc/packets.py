"""The packets of Stream Motion, by ``airo-fanuc``."""

import importlib
from typing import Any

from jssa_gym.exceptions import MissingExtraError, how_to_install


def airo(module: str) -> Any:
    """A module of ``airo_fanuc``.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        return importlib.import_module(f"airo_fanuc.{module}")
    except ImportError as error:
        raise MissingExtraError(f"FANUC arms need airo-fanuc: {how_to_install('fanuc')}") from error
