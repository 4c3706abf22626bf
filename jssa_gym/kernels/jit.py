"""The one place for compile flags and for the compile cache.

Kernels never use fastmath: it folds ``isnan`` away, and a NaN must not read as safe.

Numba's own cache does not see a change in a callee that lives in another file. The cache directory is
therefore keyed by a hash of all kernel sources, so that an edit or an upgrade can never run stale code.
"""

import gc
import hashlib
import os
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

from numba import config, njit
from numba.core import event

from jssa_gym.kernels.cache import KernelCache


def source_hash() -> str:
    """Hash of all that is compiled."""
    digest = hashlib.sha256()
    package = Path(__file__).parent.parent
    for source in sorted(path for room in ("kernels", "tick") for path in (package / room).rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _user_cache() -> Path:
    """The user's folder for caches; RuntimeError where there is no home, as in containers with arbitrary users."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _private_folder() -> Path | None:
    """A temporary folder that nobody else can have filled: machine code from it is run. None if there is none."""
    if not hasattr(os, "getuid"):
        return None
    try:
        folder = Path(tempfile.gettempdir()) / f"jssa_gym-{os.getuid()}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if own else None


def _root() -> Path | None:
    """Where kernels are kept: where the user says, else with the user's other caches; None without a home."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR)
    try:
        return _user_cache() / "jssa_gym" / "numba"
    except RuntimeError:
        return None


def _directory_in(root: Path | None) -> Path | None:
    """The directory of this version of the kernels, writable or not; None if there is none and none can be made."""
    if root is None:
        return None
    directory = root / source_hash()
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return directory


CACHE_DIRECTORY = _directory_in(_root())
"""None: nothing is cached."""

CACHE_IS_TEMPORARY = CACHE_DIRECTORY is None and not config.CACHE_DIR
"""There is no home directory, or none that can be written to."""

if CACHE_IS_TEMPORARY:
    CACHE_DIRECTORY = _directory_in(_private_folder())

CACHE_IS_WRITABLE = CACHE_DIRECTORY is not None and os.access(CACHE_DIRECTORY, os.W_OK)
"""If not, what is cached is used all the same."""


class _FewerCollections(event.Listener):
    """While kernels are compiled Python looks for garbage less often: there is much, and hardly any in circles."""

    seldom = 50_000
    """New objects from which on it looks."""

    def __init__(self) -> None:
        self._depth, self._before = 0, gc.get_threshold()

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._before = gc.get_threshold()
            if 0 < self._before[0] < self.seldom:
                gc.set_threshold(self.seldom, *self._before[1:])
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._before)


event.register("numba:compile", _FewerCollections())

# nobody calls kernels from C: without those wrappers everything compiles faster
_FLAGS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}


def jit(function: FunctionType) -> Any:
    """Compile a kernel on first use: cached on disk, IEEE arithmetic, division by zero gives inf.

    It is lent all its arrays and makes none, so that it counts no references to them, which are atomic and took a
    fifth of a control step; what makes arrays is compiled by :func:`jit_owning`. Nor may it return one, or part of one,
    to a kernel that does count: that would give back what was never taken, and memory with it.
    """
    return _compiled(function, {**_FLAGS, "_nrt": False})


def jit_owning(function: FunctionType) -> Any:
    """The same for a kernel that makes arrays."""
    return _compiled(function, _FLAGS)


def part(function: FunctionType) -> Any:
    """A short part of one function, there to be read by itself: put into it before it is compiled.

    Machine code of everything that a function calls is optimised again with it, so that each storey of functions costs
    compile time; what is long or itself in parts costs more, as it is copied at every storey.
    """
    return _compiled(function, {**_FLAGS, "_nrt": False, "inline": "always"})


def inlined(function: FunctionType) -> Any:
    """The same for a few operations without branches: put into its callers' machine code, where loops can use lanes."""
    return _compiled(function, {**_FLAGS, "_nrt": False, "forceinline": True})


def jit_released(function: FunctionType) -> Any:
    """The same for a loop of seconds: other threads of Python run meanwhile, which costs a short kernel too much."""
    return _compiled(function, {**_FLAGS, "nogil": True})


def _compiled(function: FunctionType, flags: dict[str, Any]) -> Any:
    kernel = njit(**flags)(function)
    if CACHE_DIRECTORY is not None and not config.DISABLE_JIT:
        kernel._cache = KernelCache(function, CACHE_DIRECTORY, CACHE_IS_WRITABLE)
    return kernel
