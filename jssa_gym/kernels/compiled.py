"""Tells the user about the one slow start: compiling the kernels."""

import functools
import logging

from numba import config

from jssa_gym.kernels.jit import CACHE_DIRECTORY

_logger = logging.getLogger("jssa_gym")


@functools.cache
def announce_compilation() -> None:
    """Log, before a first use, that kernels are going to be compiled; silent once they are cached."""
    if config.DISABLE_JIT:
        return
    if CACHE_DIRECTORY is None:
        _logger.warning("Compiling kernels; no cache directory is writable, so every start will (about half a minute).")
    elif not any(CACHE_DIRECTORY.rglob("*.nbi")):
        _logger.warning("Compiling kernels once for this version, about half a minute; cached in %s.", CACHE_DIRECTORY)
