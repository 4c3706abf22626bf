"""Machine code on disk: whole and this kernel's own, or as good as not there.

Numba writes an index of signatures (``.nbi``) and a file of machine code for each (``.nbc``), and runs what it finds. A
full disk, a crash or a copy that was cut short must cost a compilation and no more: every file ends with a checksum,
and what is damaged, missing, unreadable or another signature's is compiled anew and written over.
"""

import functools
import hashlib
import io
import logging
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType
from typing import Any

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
    _SourceFileBackedLocatorMixin,
)

from jssa_gym.kernels import second_compiler
from jssa_gym.kernels.garbage import collecting_seldom

_logger = logging.getLogger("jssa_gym")


@functools.cache
def _warn(message: str, folder: str) -> None:
    """Say the same of a folder once only; it concerns every kernel in it."""
    _logger.warning(message, folder)


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()


class _Place(_SourceFileBackedLocatorMixin, _CacheLocator):
    """A folder for each folder of sources; unlike numba's own it need not be writable, as what is there can be used."""

    def __init__(self, folder: Path, file: str, line: int) -> None:
        self._py_file, self._lineno = file, line
        self._cache_path = str(folder / self.get_suitable_cache_subpath(file))

    def get_cache_path(self) -> str:
        return self._cache_path


class _Files(CompileResultCacheImpl):
    """Names of a kernel's files, and how what they hold is read and written."""

    def __init__(self, folder: Path, function: FunctionType) -> None:
        # not numba's own: that looks through the places it knows for one that can be written to
        file = function.__code__.co_filename
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Place(folder, file, self._lineno)
        name = f"{Path(file).stem}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(name, getattr(sys, "abiflags", ""))


class _Entries(IndexDataCacheFile):
    """A kernel's index and machine code, a checksum behind each."""

    def save(self, key: Any, data: Any) -> None:
        # with the key: two processes that begin at once may give one name to the code of two signatures
        super().save(key, (key, data))

    def load(self, key: Any) -> Any:
        found = super().load(key)
        return found[1] if found is not None and found[0] == key else None

    @contextmanager
    def _open_for_write(self, filepath: str) -> Generator[io.BytesIO]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + _checksum(content.getvalue()))

    def _load_index(self) -> dict[Any, str]:
        try:
            return super()._load_index() if self._is_whole(self._index_path) else {}
        except Exception:  # whatever it names, the kernel can be compiled
            _warn("Compiled kernels in %s do not load; compiling them anew.", self._cache_path)
            return {}

    def _load_data(self, name: str) -> Any:
        return super()._load_data(name) if self._is_whole(self._data_path(name)) else None

    def _is_whole(self, path: str) -> bool:
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return False
        except OSError:
            _warn("Compiled kernels in %s cannot be read; compiling them anew.", self._cache_path)
            return False
        # what follows the end of a pickle is not looked at when it is read
        end = len(content) - len(_checksum(b""))
        if end > 0 and _checksum(content[:end]) == content[end:]:
            return True
        _warn("Compiled kernels in %s are damaged; compiling them anew.", self._cache_path)
        return False


class KernelCache(FunctionCache):
    """Numba's cache of one kernel; never raises because of what is in the folder or because nothing can be written.

    Args:
        function: The kernel's Python function.
        folder: Of this version of all kernels.
        writable: Whether to write what is compiled.
    """

    def __init__(self, function: FunctionType, folder: Path, writable: bool = True) -> None:
        self._impl_class = functools.partial(_Files, folder)
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Entries(self._cache_path, self._impl.filename_base, stamp)
        self._writable, self._kernel = writable, second_compiler.full_name(function)

    def holds(self, sig: Any, target_context: Any) -> bool:
        """Whether machine code of a signature is there, by the index."""
        return self._index_key(sig, target_context.codegen()) in self._cache_file._load_index()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = self._load(sig, target_context)
        if found is None and any(other.has_compiled((self._kernel, sig)) for other in second_compiler.running):
            found = self._load(sig, target_context)
        if found is not None:
            self._tell(sig)
        return found

    def _tell(self, sig: Any) -> None:
        for other in second_compiler.running:
            other.tell_of((self._kernel, sig))

    def _load(self, sig: Any, target_context: Any) -> Any:
        try:
            with collecting_seldom():  # with the first one the rest of the compiler is imported
                return super().load_overload(sig, target_context)
        except Exception:  # whatever a file makes of itself, the kernel can be compiled
            _warn("Compiled kernels in %s do not load; compiling them anew.", self._cache_path)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if not self._writable:
            return
        try:
            super().save_overload(sig, data)
        except OSError as error:
            reason = error.strerror or error
            _warn(f"Compiled kernels cannot be kept in %s ({reason}): the next start compiles anew.", self._cache_path)
        self._tell(sig)
