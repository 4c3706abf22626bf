"""Archives of arrays, with or without a seal: nothing in them is ever run, and nothing is larger than it seems.

All are ``.npz`` files that ``numpy.load`` reads without pickles. A sealed one ends with the SHA-256 of all before, as
the archive's comment.
"""

import io
import json
import re
import zipfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import JSSAGymError
from jssa_gym.storage.files import read_whole, sha256, write_whole

_DIGEST = 64
"""Length of a SHA-256 in hexadecimal digits."""

_MOMENT = (1980, 1, 1, 0, 0, 0)
"""Time of every member: the same content, the same bytes."""

_ARRAY = re.compile(
    rb"\{(?=.*'descr': *'([<>|=]?[biufcSU]\d+)')(?=.*'fortran_order': *(True|False))"
    rb"(?=.*'shape': *\(([\d, ]*)\)).*\} *\n"
)
"""What an ``.npy`` says of itself; matched, where numpy would evaluate it."""


def write_archive(
    file: IO[bytes], members: Mapping[str, NDArray[Any] | bytes], *, compressed: bool = False, comment: bytes = b""
) -> None:
    """Write an archive; the same members, the same bytes.

    Args:
        file: New, for writing.
        members: By name; arrays become members of the name with ``.npy`` behind.
        compressed: Or as they are.
        comment: What it ends with.
    """
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            plain = isinstance(content, bytes)
            entry = zipfile.ZipInfo(name if plain else f"{name}.npy", _MOMENT)
            entry.create_system, entry.external_attr = 3, 0o644 << 16  # the same bytes on every system
            entry.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            entry.file_size = len(content) if plain else content.nbytes  # where 4 GB need another format
            with archive.open(entry, "w") as member:
                if isinstance(content, bytes):
                    member.write(content)
                else:
                    np.lib.format.write_array(member, np.asarray(content, order="C"), allow_pickle=False)
        archive.comment = comment


def write_sealed(
    path: Path,
    members: Mapping[str, NDArray[Any] | bytes],
    failure: type[JSSAGymError],
    largest: int,
    *,
    compressed: bool = False,
) -> None:
    """Write a sealed archive into one file that is complete or not there.

    Args:
        path: Of the file; it is replaced.
        members: As of :func:`write_archive`.
        failure: What to raise.
        largest: Size from which nobody reads it [bytes].
        compressed: As of :func:`write_archive`.

    Raises:
        JSSAGymError: ``failure``: it is larger.
        StorageError: It cannot be written.
    """
    buffer = io.BytesIO()
    write_archive(buffer, members, compressed=compressed, comment=b"0" * _DIGEST)
    body = buffer.getvalue()[:-_DIGEST]
    if len(body) + _DIGEST > largest:
        raise failure(f"{path} would have {len(body) + _DIGEST:,} bytes, more than {largest:,}")
    write_whole(path, body + sha256(body).encode())


def read_sealed(path: Path, what: str, failure: type[JSSAGymError], largest: int) -> bytes:
    """All bytes of a file that :func:`write_sealed` wrote.

    Args:
        path: Of the file.
        what: It should be, for the message.
        failure: What to raise.
        largest: Size from which it is not read [bytes].

    Raises:
        JSSAGymError: ``failure``: it cannot be read, or its seal is none, or broken.
    """
    content = read_whole(path, failure, largest)
    if sha256(content[:-_DIGEST]).encode() != content[-_DIGEST:]:
        raise failure(f"{path} is no {what}, or not as it was written: its SHA-256 does not fit")
    return content


@contextmanager
def open_archive(source: IO[bytes] | bytes, largest: int | None = None) -> Generator[zipfile.ZipFile]:
    """An archive of which nothing takes more memory than it may.

    Args:
        source: Its content, or a file.
        largest: Most that it may unpack to [bytes]; None: its own size, and nothing may be compressed.

    Raises:
        ValueError: It would, or has two members of a name.
        zipfile.BadZipFile: It is none.
    """
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        names, unpacked = sorted(entry.filename for entry in entries), sum(entry.file_size for entry in entries)
        if len(set(names)) < len(names):
            raise ValueError(f"members of the same name among {names}")
        if largest is None:
            if any(entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1 for entry in entries):
                raise ValueError("its members are encrypted or compressed")
            if unpacked > file.seek(0, io.SEEK_END):
                raise ValueError("its members claim to be larger than the file")
        elif unpacked > largest:
            raise ValueError(f"it unpacks to {unpacked} bytes, more than {largest}")
        yield archive


def read_member(archive: zipfile.ZipFile, name: str) -> bytes:
    """A member of an archive that :func:`open_archive` has opened.

    Raises:
        ValueError: There is none of that name, or it is damaged in one of the many ways of ``zipfile``.
    """
    if name not in archive.namelist():
        raise ValueError(f"{name} is missing")
    with archive.open(name) as member:
        return member.read(archive.getinfo(name).file_size)  # a damaged one would unpack to more


def read_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """An array of an archive, of which nothing is evaluated and nothing allocated beyond the content.

    Raises:
        ValueError: As of :func:`read_member`; or it is no array of numbers or text, or shorter or longer than it says.
    """
    content = read_member(archive, f"{name}.npy")
    start = 10 if content[6:7] == b"\x01" else 12
    end = start + int.from_bytes(content[8:start], "little")
    said = _ARRAY.fullmatch(content[start:end])
    if content[:6] != b"\x93NUMPY" or said is None:
        raise ValueError(f"{name}.npy is no plain array, such as numpy reads with allow_pickle=False")
    shape = tuple(int(length) for length in said[3].split(b",") if length.strip())
    order = "F" if said[2] == b"True" else "C"
    array = np.ndarray(shape, np.dtype(said[1].decode()), content[end:], order=order)
    if array.nbytes != len(content) - end:
        raise ValueError(f"{name}.npy holds more than it says")
    return array.copy()


def read_header(text: bytes, what: str, *versions: int) -> dict[str, Any]:
    """What a file says of itself in JSON: its ``format``, ``jssa_gym`` and what it is, its ``version``, and more.

    Raises:
        ValueError: It is something else, or of another version, or says something twice.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len(found := dict(pairs)) < len(pairs):
            raise ValueError("its header has a key twice")
        return found

    header = json.loads(text.decode(), object_pairs_hook=once)
    if not isinstance(header, dict) or header.get("format") != f"jssa_gym {what}":
        raise ValueError("its header does not say that it is one")
    if header.get("version") not in versions or isinstance(header["version"], bool):
        known = " and ".join(map(str, sorted(versions)))
        raise ValueError(f"it is of version {header.get('version')!r}; this package reads {known}")
    return header
