"""The one place for compile flags and for the compile cache.

Kernels never use fastmath: it folds ``isnan`` away, and a NaN must not read as safe.

Numba's own cache does not see a change in a callee that lives in another file. The cache directory is
therefore keyed by a hash of all kernel sources, so that an edit or an upgrade can never run stale code.
"""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import config, njit


def source_hash() -> str:
    """Of all kernels."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", tempfile.gettempdir()))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _cache_directory() -> Path | None:
    """A writable directory for this version of the kernels, or None: then nothing is cached."""
    root = Path(config.CACHE_DIR) if config.CACHE_DIR else _cache_root() / "jssa_gym" / "numba"
    directory = root / source_hash()
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return directory if os.access(directory, os.W_OK) else None


CACHE_DIRECTORY = _cache_directory()

# nobody calls kernels from C: without those wrappers everything compiles faster
_FLAGS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}


def jit(function: Callable[..., Any]) -> Any:
    """Compile a kernel on first use: cached on disk, IEEE arithmetic, division by zero gives inf."""
    return _compiled(function, _FLAGS)


def jit_released(function: Callable[..., Any]) -> Any:
    """The same for a loop of seconds: other threads of Python run meanwhile, which costs a short kernel too much."""
    return _compiled(function, {**_FLAGS, "nogil": True})


def _compiled(function: Callable[..., Any], flags: dict[str, Any]) -> Any:
    if CACHE_DIRECTORY is None:
        return njit(**flags)(function)
    previous = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE_DIRECTORY)
    try:
        return njit(cache=True, **flags)(function)
    finally:
        config.CACHE_DIR = previous
