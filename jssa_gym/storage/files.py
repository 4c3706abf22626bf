"""Files that are complete or not there (atomic writes), and readers that say what is wrong with one."""

import contextlib
import csv
import hashlib
import io
import os
import secrets
import zipfile
import zlib
from collections.abc import Generator
from pathlib import Path
from typing import IO, Any

from jssa_gym.exceptions import JSSAGymError, StorageError

LARGEST = 2**30
"""Size from which no file is read [bytes]."""

_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
"""Nobody's file and nobody's link, whoever else may write to the folder."""


@contextlib.contextmanager
def whole_file(path: Path) -> Generator[IO[bytes]]:
    """A new file to write to, under a name that nobody guesses; at the end it is flushed to the disk and renamed.

    Args:
        path: Name that it gets; what has it is replaced. If anything is raised, that is unchanged.

    Raises:
        StorageError: It cannot be written. What else goes wrong while it is filled is raised as it is.
    """
    unfinished = path.with_name(f".{secrets.token_hex(8)}.part")
    with _told(path):
        handle = os.open(unfinished, _NEW, 0o666)  # less what the umask takes away
    try:
        with io.BufferedRandom(_File(handle, path)) as file:
            yield file
            file.flush()
            with _told(path):
                # the name must not reach the disk before the content
                os.fsync(file.fileno())
        with _told(path):
            unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


class _File(io.FileIO):
    """Says that it cannot be written, whoever writes to it; other errors of theirs are not its own."""

    def __init__(self, handle: int, path: Path) -> None:
        super().__init__(handle, "w+b")
        self._path = path

    def write(self, content: Any) -> int:
        with _told(self._path):
            return super().write(content)


def write_whole(path: Path, content: bytes | str) -> None:
    """Write a file that is complete or not there; text as UTF-8.

    Args:
        path: Of the file; it is replaced.
        content: All of it.

    Raises:
        StorageError: It cannot be written; what was there is unchanged.
    """
    with whole_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def append_whole(path: Path, content: bytes, after: int | None = None) -> int | None:
    """Add to a file and flush it to the disk, all or nothing; other writers of this package are kept out meanwhile.

    Args:
        path: Of the file; it is made if there is none.
        content: What to add.
        after: Bytes that it has to have before; None for any.

    Returns:
        How many bytes it has now; None if nothing was added, because it had others than ``after``.

    Raises:
        StorageError: It cannot be written.
    """
    with _told(path), path.open("ab", buffering=0) as file:  # a buffer would try again while it is closed
        _lock(file)
        before = os.fstat(file.fileno()).st_size
        if after not in (None, before):
            return None
        try:
            left = memoryview(content)
            while left:
                left = left[file.write(left) :]
            os.fsync(file.fileno())
        except BaseException:
            file.truncate(before)
            raise
        return before + len(content)


def _lock(file: IO[bytes]) -> None:
    """Keep other writers out until the file is closed."""
    try:
        import fcntl
    except ImportError:  # Windows: a second writer is seen by what it leaves
        return
    fcntl.flock(file, fcntl.LOCK_EX)


@contextlib.contextmanager
def _told(path: Path) -> Generator[None]:
    try:
        yield
    except StorageError:
        raise
    except OSError as error:
        raise StorageError(f"cannot write {path}: {error.strerror or error}") from error


_MALFORMED = (
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,  # also of deep JSON and of encrypted members
    TypeError,
    ValueError,
    csv.Error,
    zipfile.BadZipFile,
    zlib.error,
    ArithmeticError,
)
"""What ``zipfile``, ``numpy``, ``json`` and constructors raise about content that is none of theirs."""


@contextlib.contextmanager
def refused(failure: type[JSSAGymError], message: str) -> Generator[None]:
    """Whatever goes wrong with a file's content is one error; one of its own type goes on as it is.

    Args:
        failure: What to raise.
        message: That names the file and what it should be.

    Raises:
        JSSAGymError: ``failure``, of the message and what went wrong.
    """
    try:
        yield
    except failure:
        raise
    except _MALFORMED as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error) or type(error).__name__
        raise failure(f"{message}: {what}") from error


@contextlib.contextmanager
def open_whole(path: Path, failure: type[JSSAGymError], largest: int = LARGEST) -> Generator[IO[bytes]]:
    """A file to read, which is no folder and no device, and not too large.

    Args:
        path: Of the file.
        failure: What to raise.
        largest: Size from which it is not read [bytes].

    Raises:
        JSSAGymError: ``failure``: it cannot be read; the message names the file.
    """
    try:
        if path.exists() and not path.is_file():
            raise failure(f"cannot read {path}: it is no file")
        file = path.open("rb")
    except failure:
        raise
    except (OSError, ValueError) as error:  # the latter of names that no file can have
        raise failure(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from error
    with file:
        size = os.fstat(file.fileno()).st_size
        if size > largest:
            raise failure(f"cannot read {path}: it has {size:,} bytes, more than {largest:,}")
        yield file


def read_whole(path: Path, failure: type[JSSAGymError], largest: int = LARGEST) -> bytes:
    """All bytes of a file, as of :func:`open_whole`."""
    with open_whole(path, failure, largest) as file, refused(failure, f"cannot read {path}"):
        return file.read(os.fstat(file.fileno()).st_size)


def whole_lines(path: Path, failure: type[JSSAGymError]) -> tuple[bytes, bytes]:
    """The whole lines of a file that grows, and what comes after them: a line that a crash cut off.

    Args:
        path: Of the file; if there is none, it has no lines.
        failure: As of :func:`open_whole`.
    """
    if not path.exists():
        return b"", b""
    whole, end, cut = read_whole(path, failure).rpartition(b"\n")
    return whole + end, cut


def read_text(path: Path, failure: type[JSSAGymError], largest: int = LARGEST) -> str:
    """All text of a file in UTF-8, with or without a byte order mark; ends of lines become ``\\n``.

    Args:
        path: Of the file.
        failure: What to raise.
        largest: Size from which it is not read [bytes].

    Raises:
        JSSAGymError: ``failure``: it cannot be read, or is something else; the message names the file and the line.
    """
    content = read_whole(path, failure, largest)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise failure(
            f"{path} is no text in UTF-8: byte 0x{byte:02x} in line {line}; save it in UTF-8 (it may be in Latin-1, "
            "cp1252 or UTF-16)"
        ) from error
    if (at := text.find("\0")) >= 0:
        raise failure(f"{path} is no text: a NUL in line {text.count(chr(10), 0, at) + 1}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def sha256(content: bytes | IO[bytes]) -> str:
    """SHA-256 of bytes, or of all of a file, in hexadecimal digits."""
    if isinstance(content, bytes):
        return hashlib.sha256(content).hexdigest()
    file: Any = content
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()


def file_name(name: str) -> str:
    """A name as a part of a file's: letters, digits and ``-_.+``; a digest tells apart what that makes alike."""
    plain = "".join(c if c.isalnum() or c in "-_.+" else "_" for c in name)
    if plain != name or len(plain) > 100:  # paths can be long
        plain = f"{plain[:80]}-{sha256(name.encode('utf-8', 'surrogatepass'))[:8]}"
    return plain
