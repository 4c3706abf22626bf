"""Tells the user about slow starts: compiling the kernels."""

import logging
from pathlib import Path
from typing import Any

from numba import config

from jssa_gym.kernels.jit import CACHE_DIRECTORY, CACHE_IS_TEMPORARY, CACHE_IS_WRITABLE

_logger = logging.getLogger("jssa_gym")
_announced: list[Any] = []
_cached: set[Any] = set()


def announce_compilation(kernel: Any) -> None:
    """Log that kernels are going to be compiled; silent once they are cached, or while that has been said already.

    Args:
        kernel: What takes longest of all that the caller will need, and is compiled last.
    """
    if config.DISABLE_JIT or _is_cached(kernel) or not all(_is_cached(other) for other in _announced):
        return
    _announced.append(kernel)
    if not CACHE_IS_WRITABLE:
        _logger.warning("Compiling kernels; no cache directory is writable, so every start will (up to a minute).")
    elif CACHE_IS_TEMPORARY:
        _logger.warning(
            "Compiling kernels, up to a minute; cached in %s, which may be deleted, as there is no home directory "
            "to write to. NUMBA_CACHE_DIR says where else.",
            CACHE_DIRECTORY,
        )
    else:
        _logger.warning(
            "Compiling kernels once for this version when they are first needed, up to a minute; cached in %s.",
            CACHE_DIRECTORY,
        )


def _is_cached(kernel: Any) -> bool:
    """Whether numba keeps machine code of this kernel on disk, for whatever arguments."""
    if not hasattr(kernel, "stats"):  # a plain function in a kernel's place: nothing to compile
        return True
    if kernel not in _cached:
        folder = kernel.stats.cache_path
        name = f"{Path(kernel.py_func.__code__.co_filename).stem}.{kernel.__name__}"
        if folder is None or not any(Path(folder).glob(f"{name}-*.nbi")):
            return False
        _cached.add(kernel)
    return True
