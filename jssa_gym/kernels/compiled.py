"""Slow starts, compiling the kernels: tells the user, and has a second process help."""

import logging
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from numba import config

from jssa_gym.kernels import second_compiler
from jssa_gym.kernels.jit import CACHE_DIRECTORY, CACHE_IS_TEMPORARY, CACHE_IS_WRITABLE

_logger = logging.getLogger("jssa_gym")
_announced: list[Any] = []
_cached: set[Any] = set()


Parts = Callable[[], Sequence[tuple[Any, tuple[Any, ...]]]]
"""Makes kernels, each with the types of its arguments, in the order in which they will be needed."""


def announce_compilation(kernel: Any, beside: Parts = tuple) -> None:
    """Log that kernels are going to be compiled; silent once they are cached, or while that has been said already.

    A second process starts then, which takes it a second, to help.

    Args:
        kernel: What takes longest of all that the caller will need, and is compiled last.
        beside: What that process may compile at once.
    """
    if config.DISABLE_JIT or _is_cached(kernel) or not all(_is_cached(other) for other in _announced):
        return
    _announced.append(kernel)
    _have_compiled((), beside)
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


def compile_together(kernel: Any, types: tuple[Any, ...], parts: Parts) -> None:
    """Let a second process compile parts of a kernel, into the same cache, while this one goes on.

    Not where ``JSSA_GYM_SECOND_COMPILER=0``, a single core, or a cache that cannot be written to says no, nor in
    workers, which may be many.

    Args:
        kernel: What this process will compile.
        types: Its arguments, as numba types.
        parts: Those of its parts that are worth it.
    """
    if not config.DISABLE_JIT and types not in kernel.overloads:
        _have_compiled(((kernel, types),), parts)


def _have_compiled(wholes: Sequence[tuple[Any, tuple[Any, ...]]], parts: Parts) -> None:
    """Have parts compiled by the second process, unless the wholes that they are parts of are cached."""
    try:
        if CACHE_DIRECTORY is None or any(kernel._cache.holds(of, kernel.targetctx) for kernel, of in wholes):
            return
        if not _can_be_two():
            return
        if not any(other.runs for other in second_compiler.running):
            second_compiler.running[:] = [second_compiler.SecondCompiler(CACHE_DIRECTORY.parent)]
        named = [[(second_compiler.full_name(kernel.py_func), of) for kernel, of in some] for some in (wholes, parts())]
        second_compiler.running[0].ask(*named)
    except Exception:  # it is of no consequence but for time
        _logger.debug("no second process compiles", exc_info=True)


def _can_be_two() -> bool:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return (
        cores > 1
        and CACHE_IS_WRITABLE
        and os.environ.get("JSSA_GYM_SECOND_COMPILER", "1") != "0"
        and multiprocessing.parent_process() is None
        and sys.platform != "win32"  # whose pipes nobody can wait for
        and not sys.flags.ignore_environment  # which tells the other one where to import from
        # not a program that has Python inside
        and Path(sys.executable or "").name.startswith("python")
    )
