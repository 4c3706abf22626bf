"""Recorded episodes on disk: complete and unchanged, or an error."""

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import TraceError
from jssa_gym.storage import read_whole, write_whole
from jssa_gym.types import Trace

_FORMAT, _VERSION = "jssa_gym trace", 2

_DIGEST = 64
"""Length of a SHA-256 in hexadecimal digits, with which a file ends."""

_LARGEST = 512 * 2**20
"""Size from which nothing is read, on disk and unpacked [bytes]."""

_MALFORMED = (KeyError, ValueError, OSError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What ``zipfile``, ``numpy.load`` and ``json`` raise about content that is none of theirs."""

_TEXTS = ("name", "robot", "dynamics", "task", "ended")
_NAMES = ("human_names", "plane_names")
_PLAIN = ("dt", "d_min", "holds")
"""Fields that the header holds; all others are arrays."""

_LAYOUT: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "mount": ("f8", (3,)),
    "initial_state": ("f8", (3, "n")),
    "initial_human": ("f8", (2, "m", 3)),
    "human_radius": ("f8", ("m",)),
    "human_person": ("i8", ("m",)),
    "plane_normal": ("f8", ("p", 3)),
    "plane_offset": ("f8", ("p",)),
    "time": ("f8", ("T",)),
    "position": ("f8", ("T", "n")),
    "velocity": ("f8", ("T", "n")),
    "acceleration": ("f8", ("T", "n")),
    "jerk": ("f8", ("T", "n")),
    "nominal": ("f8", ("T", "n")),
    "goal": ("f8", ("T", "g")),
    "reward": ("f8", ("T",)),
    "success": ("b1", ("T",)),
    "limit_violation": ("b1", ("T",)),
    "distance": ("f8", ("T",)),
    "speed": ("f8", ("T",)),
    "acceleration_of_distance": ("f8", ("T",)),
    "pair": ("i8", ("T", 2)),
    "contact": ("b1", ("T",)),
    "contact_speed": ("f8", ("T",)),
    "status": ("i8", ("T",)),
    "reason": ("U", ("T",)),
    "intervened": ("b1", ("T",)),
    "correction": ("f8", ("T",)),
    "phi": ("f8", ("T",)),
    "slack": ("f8", ("T",)),
    "shield_time": ("f8", ("T",)),
    "human_start": ("f8", ("T", "m", 3)),
    "human_end": ("f8", ("T", "m", 3)),
}
"""Type and shape of every array; a letter stands for the same length everywhere."""


def save_trace(trace: Trace, path: str | Path, meta: Mapping[str, Any] | None = None) -> None:
    """Write a trace into one file that is complete or not there.

    The file is an ``.npz`` that ``numpy.load`` reads without pickles: the arrays, and a ``header`` in JSON. It ends
    with the SHA-256 of all before, as the archive's comment.

    Args:
        trace: The episode.
        path: Of the file; it is replaced.
        meta: Where the episode comes from, as JSON can hold it: seed, environment's id, filter, human, policy;
            evaluations, campaigns and certificates add the package's ``version`` and the hash of its ``source``.

    Raises:
        TraceError: The trace's arrays do not fit together, or JSON cannot hold ``meta``.
        StorageError: The file cannot be written.
    """
    path = Path(path)
    _check(trace)
    header = {"format": _FORMAT, "version": _VERSION, "meta": dict(meta or {})}
    header |= {field: getattr(trace, field) for field in (*_PLAIN, *_TEXTS, *_NAMES)}
    try:
        text = json.dumps(header, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise TraceError(f"name, dt and meta have to be what JSON can hold: {error}") from error
    arrays = {field: getattr(trace, field) for field in _LAYOUT}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, header=np.frombuffer(text.encode(), np.uint8), **arrays)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.comment = b"0" * _DIGEST
    body = buffer.getvalue()[:-_DIGEST]
    write_whole(path, body + hashlib.sha256(body).hexdigest().encode())


def load_trace(path: str | Path) -> Trace:
    """Read what :func:`save_trace` wrote, bit for bit. Nothing in a file is ever run: no pickles.

    Raises:
        TraceError: The file cannot be read, is something else, was truncated or changed, or is of another version.
    """
    header, arrays = _read(Path(path))
    try:
        texts = {field: header[field] for field in (*_PLAIN, *_TEXTS)}
        names = {field: tuple(header[field]) for field in _NAMES}
        trace = Trace(**texts, **names, **{field: arrays[field] for field in _LAYOUT})
    except (KeyError, TypeError) as error:
        raise TraceError(f"{path} holds no complete trace: {error} is missing or of a wrong type") from error
    _check(trace)
    return trace


def read_meta(path: str | Path) -> dict[str, Any]:
    """Where a saved episode comes from: the ``meta`` of :func:`save_trace`.

    Raises:
        TraceError: As of :func:`load_trace`.
    """
    meta = _read(Path(path))[0].get("meta")
    if not isinstance(meta, dict):
        raise TraceError(f"{path} holds no complete trace: meta is missing or of a wrong type")
    return meta


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and arrays of a file whose digest is right."""
    content = read_whole(path, TraceError, _LARGEST)
    body, digest = content[:-_DIGEST], content[-_DIGEST:]
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise TraceError(f"{path} is no trace, or not as it was written: its SHA-256 does not fit")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > _LARGEST:
            raise ValueError(f"it unpacks to {unpacked} bytes, more than {_LARGEST}")
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            arrays = {field: np.asarray(archive[field]) for field in ("header", *_LAYOUT)}
        header = json.loads(arrays.pop("header").tobytes())
    except _MALFORMED as error:
        raise TraceError(f"{path} holds no complete trace: {error}") from error
    if not isinstance(header, dict) or header.get("format") != _FORMAT:
        raise TraceError(f"{path} holds no trace: its header does not say so")
    if header.get("version") != _VERSION:
        raise TraceError(f"{path} is a trace of version {header.get('version')!r}; this package reads {_VERSION}")
    return header, arrays


def every_step(trace: Trace) -> bool:
    """Whether the rows are one control step apart, from the first step on: not so with repeated actions."""
    return bool(np.allclose(trace.time, trace.dt * np.arange(1, len(trace.time) + 1), rtol=0.0, atol=1e-9))


def _check(trace: Trace) -> None:
    """Types and shapes of everything.

    Raises:
        TraceError: One is wrong; names it.
    """
    for field in ("dt", "d_min"):
        number = getattr(trace, field)
        if not (isinstance(number, float) and 0.0 < number < np.inf):
            raise TraceError(f"a trace's {field} has to be a positive number, got {number!r}")
    if not isinstance(trace.holds, bool):
        raise TraceError(f"a trace's holds has to be True or False, got {trace.holds!r}")
    for field in _TEXTS:
        if not isinstance(getattr(trace, field), str):
            raise TraceError(f"a trace's {field} has to be a string, got {getattr(trace, field)!r}")
    lengths: dict[str, int] = {}
    for field, (kind, shape) in _LAYOUT.items():
        array = getattr(trace, field)
        found = array.dtype if isinstance(array, np.ndarray) else None
        # strings have a length, which is any
        if found is None or not (found.kind == "U" if kind == "U" else found == np.dtype(kind)):
            raise TraceError(f"a trace's {field} has to be an array of type {kind}, got {found or type(array)}")
        wanted = shape
        if array.ndim == len(shape):
            wanted = tuple(
                lengths.setdefault(length, found) if isinstance(length, str) else length
                for length, found in zip(shape, array.shape, strict=True)
            )
        if array.shape != wanted:
            raise TraceError(f"a trace's {field} has to have shape {wanted}, got {array.shape}")
    for field, length in zip(_NAMES, ("m", "p"), strict=True):
        names = getattr(trace, field)
        if not (
            isinstance(names, tuple) and len(names) == lengths[length] and all(isinstance(name, str) for name in names)
        ):
            raise TraceError(f"a trace's {field} have to be {lengths[length]} strings, got {names!r}")
