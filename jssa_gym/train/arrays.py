"""Arrays in a file: read only where they are what they should be, before memory is given to them."""

import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import CheckpointError

_LONGEST_HEADER = 1000
"""Of an array in a file [bytes]."""


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name into an uncompressed ``.npz``.

    Raises:
        OSError: They cannot be written.
    """
    np.savez(path, allow_pickle=False, **arrays)


def read_arrays(
    path: Path, like: Mapping[str, NDArray[Any]], *, among: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Read what :func:`write_arrays` wrote.

    Args:
        path: Of the file.
        like: By name, arrays of the shape and type that is expected.
        among: Names of what else is there, and not read.

    Raises:
        CheckpointError: The file is no such one, or an array is missing, too many, or of another shape or type.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            check_stored(archive, path.stat().st_size)
            wanted, names = {f"{name}.npy" for name in (*like, *among)}, archive.namelist()
            if sorted(names) != sorted(wanted):
                raise ValueError(f"it holds {', '.join(sorted(names))[:300]} instead of {', '.join(sorted(wanted))}")
            return {name: _array(archive, name, expected) for name, expected in like.items()}
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        EOFError,
        OverflowError,
        MemoryError,
        RuntimeError,  # also of encrypted members
        SyntaxError,
        zipfile.BadZipFile,
    ) as error:
        raise CheckpointError(f"{path} does not hold what belongs to this training: {error}") from error


def check_stored(archive: zipfile.ZipFile, size: int) -> None:
    """Whether an archive holds no more than it seems to: nothing compressed, all members within its size.

    Args:
        archive: Open for reading.
        size: Of its file [bytes].

    Raises:
        ValueError: It does.
    """
    entries = archive.infolist()
    if any(entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & 1 for entry in entries):
        raise ValueError("its members are compressed or encrypted")
    if sum(entry.file_size for entry in entries) > size:
        raise ValueError("its members claim to be larger than the file")


def _array(archive: zipfile.ZipFile, name: str, expected: NDArray[Any]) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as member:
        if (shape_and_type := _header(member)) != (expected.shape, expected.dtype):
            raise ValueError(f"{name} has {shape_and_type} instead of {expected.shape}, {expected.dtype}")
        return np.frombuffer(member.read(), expected.dtype).reshape(expected.shape).copy()


def _header(member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type that an array claims to have."""
    if np.lib.format.read_magic(member) != (1, 0):
        raise ValueError("an array of another version")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(member, max_header_size=_LONGEST_HEADER)
    if fortran:
        raise ValueError("an array in another order")
    return shape, kind
