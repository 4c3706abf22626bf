"""Trained policies on disk: numbers and names, complete and unchanged, or an error. Nothing in a file is ever run."""

import hashlib
import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import PolicyFileError
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.network import MOST_LAYERS, Network
from jssa_gym.robots import JointLimits
from jssa_gym.storage import read_whole, write_whole
from jssa_gym.types import Array

FORMAT, VERSION = "jssa_gym policy", 1

LARGEST, LARGEST_HEADER = 64 * 2**20, 2**20
"""Size from which no file and no header is read [bytes]."""

_HEADER = "policy.json"

_DIGEST = 64
"""Length of a SHA-256 in hexadecimal digits, with which a file ends."""

_MOMENT = (1980, 1, 1, 0, 0, 0)
"""Time of every member: the same policy, the same bytes."""

_LIMITS = ("position", "velocity", "acceleration", "jerk")
_PLAIN = ("control", "share", "ticks", "observes_intervention", "task", "robot", "provenance")
"""Fields of a policy that the header holds as they are."""

_NETWORK = ("activation", "output", "clip")
"""Those of its network; an infinite ``clip`` is null."""

_KEYS = frozenset({"format", "version", "limits", *_PLAIN, *_NETWORK})

_ARRAY = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(<f[48])', 'fortran_order': False, "
    rb"'shape': \((\d{1,5}),(?: (\d{1,5}))?\), \} *\n",
    re.DOTALL,
)
"""Beginning of an ``.npy`` of one or two dimensions; matched, where numpy would evaluate it."""

_MALFORMED = (
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    EOFError,
    MemoryError,
    RuntimeError,  # also of deep JSON and of encrypted members
    zipfile.BadZipFile,
    OSError,
)
"""What ``zipfile``, ``json`` and the constructors raise about content that is none of ours."""


def save_policy(path: str | Path, policy: LearnedPolicy) -> None:
    """Write a policy into one file that is complete or not there; the same policy, the same bytes.

    The file is a zip of plain, uncompressed arrays, which ``numpy.load`` reads without pickles too, and
    ``policy.json``. It ends with the SHA-256 of all before, as the archive's comment.

    Args:
        path: Of the file, by custom ``name.npz``; it is replaced.
        policy: The policy.

    Raises:
        PolicyFileError: It is larger than a file may be.
        StorageError: The file cannot be written.
    """
    network, limits = policy.network, policy.limits
    header: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    header |= {field: getattr(policy, field) for field in _PLAIN}
    header |= {field: getattr(network, field) for field in _NETWORK}
    header["clip"] = None if np.isinf(network.clip) else network.clip
    header["limits"] = {name: getattr(limits, name).tolist() for name in _LIMITS}
    text = json.dumps(header, allow_nan=False, indent=1, sort_keys=True).encode()
    if len(text) > LARGEST_HEADER:
        raise PolicyFileError(f"{_HEADER} has {len(text)} bytes, at most {LARGEST_HEADER}: less provenance, please")
    members = {_HEADER: text, "mean.npy": _packed(network.mean, "<f8"), "std.npy": _packed(network.std, "<f8")}
    for k, (weight, bias) in enumerate(network.layers):
        members |= {f"weight_{k}.npy": _packed(weight, "<f4"), f"bias_{k}.npy": _packed(bias, "<f4")}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(_entry(name), content)
        archive.comment = b"0" * _DIGEST
    body = buffer.getvalue()[:-_DIGEST]
    if len(body) + _DIGEST > LARGEST:
        raise PolicyFileError(f"a policy has at most {LARGEST} bytes, this one has {len(body) + _DIGEST}")
    write_whole(Path(path), body + hashlib.sha256(body).hexdigest().encode())


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _MOMENT)
    entry.create_system, entry.external_attr = 3, 0o644 << 16  # the same bytes on every system
    return entry


def _packed(array: Array, kind: str) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.ascontiguousarray(array, kind), version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def read_policy(path: str | Path) -> LearnedPolicy:
    """Read what :func:`save_policy` wrote, bit for bit.

    Raises:
        PolicyFileError: The file cannot be read, was truncated or changed, is something else or of another version, or
            holds anything beyond a policy.
    """
    content = content_of(path)
    if hashlib.sha256(content[:-_DIGEST]).hexdigest().encode() != content[-_DIGEST:]:
        raise PolicyFileError(f"{path} is no policy, or not as it was written: its SHA-256 does not fit")
    try:
        members = _members(content)
        header = _header(members.pop(_HEADER))
        return _policy(header, members)
    except _MALFORMED as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error) or type(error).__name__
        raise PolicyFileError(f"{path} holds no policy: {what}") from error


def content_of(path: str | Path) -> bytes:
    """All bytes of a file that is not too large.

    Raises:
        PolicyFileError: It is, or it cannot be read.
    """
    return read_whole(Path(path), PolicyFileError, LARGEST)


def _members(content: bytes) -> dict[str, bytes]:
    """Name and content of every member, of which none is larger than the file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = archive.infolist()
        names = [entry.filename for entry in entries]
        if len(set(names)) < len(names):
            raise ValueError(f"members of the same name among {sorted(names)}")
        layers = min(max(1, sum(name.startswith("weight_") for name in names)), MOST_LAYERS)
        wanted = {_HEADER, "mean.npy", "std.npy"}
        wanted |= {f"{kind}_{k}.npy" for k in range(layers) for kind in ("weight", "bias")}
        if set(names) != wanted:
            raise ValueError(
                f"unexpected or missing members: {', '.join(map(repr, sorted(set(names) ^ wanted)))[:300]}"
            )
        for entry in entries:
            if entry.flag_bits & 1 or entry.compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{entry.filename} is encrypted or compressed")
        if sum(entry.file_size for entry in entries) > len(content):
            raise ValueError("its members claim to be larger than the file")
        return {name: archive.read(name) for name in names}


def _header(text: bytes) -> dict[str, Any]:
    """What ``policy.json`` says, with the right keys."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len(found := dict(pairs)) < len(pairs):
            raise ValueError(f"{_HEADER} has a key twice")
        return found

    if len(text) > LARGEST_HEADER:
        raise ValueError(f"{_HEADER} has {len(text)} bytes, more than {LARGEST_HEADER}")
    header = json.loads(text.decode(), object_pairs_hook=once)
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError(f"{_HEADER} does not say that it is one")
    if header.get("version") != VERSION or isinstance(header["version"], bool):
        raise ValueError(f"version {header.get('version')!r}; this package reads {VERSION}")
    for what, holder, keys in ((_HEADER, header, _KEYS), ("limits", header.get("limits"), frozenset(_LIMITS))):
        if not isinstance(holder, dict):
            raise ValueError(f"{what} is no object")
        if other := holder.keys() ^ keys:
            raise ValueError(f"unexpected or missing keys of {what}: {', '.join(map(repr, sorted(other)))}")
    return header


def _policy(header: dict[str, Any], members: dict[str, bytes]) -> LearnedPolicy:
    arrays = {name.removesuffix(".npy"): _array(name, content) for name, content in members.items()}
    clip = header["clip"]
    network = Network(
        layers=tuple((arrays[f"weight_{k}"], arrays[f"bias_{k}"]) for k in range(len(arrays) // 2 - 1)),
        activation=header["activation"],
        output=header["output"],
        mean=arrays["mean"],
        std=arrays["std"],
        clip=np.inf if clip is None else clip,
    )
    limits = JointLimits(**{name: np.array(_numbers(name, header["limits"][name])) for name in _LIMITS})
    return LearnedPolicy(network, limits=limits, **{field: header[field] for field in _PLAIN})


def _array(name: str, content: bytes) -> Array:
    """An array, of which nothing is evaluated and nothing allocated beyond the content."""
    kind = "<f8" if name in ("mean.npy", "std.npy") else "<f4"
    found = _ARRAY.match(content)
    if found is None or int.from_bytes(content[8:10], "little") + 10 != found.end() or found[1].decode() != kind:
        raise ValueError(f"{name} is no plain array of type {kind}")
    shape = tuple(int(length) for length in found.groups()[1:] if length is not None)
    return np.frombuffer(content[found.end() :], kind).reshape(shape)


def _numbers(name: str, value: Any) -> Any:
    """Lists of numbers, and nothing that numpy would make one of."""
    if isinstance(value, list):
        return [_numbers(name, one) for one in value]
    if isinstance(value, bool) or not isinstance(value, float | int):
        raise ValueError(f"{name} limits have to be numbers, got {value!r}")
    return float(value)
