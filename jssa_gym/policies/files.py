"""Trained policies on disk: numbers and names, complete and unchanged, or an error. Nothing in a file is ever run."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import PolicyFileError
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.network import MOST_LAYERS, Network
from jssa_gym.robots import JointLimits
from jssa_gym.storage import open_archive, read_array, read_header, read_member, read_sealed, refused, write_sealed
from jssa_gym.types import Array

WHAT, VERSION = "policy", 1

LARGEST, LARGEST_HEADER = 64 * 2**20, 2**20
"""Size from which no file and no header is read [bytes]."""

_HEADER = "policy.json"

_LIMITS = ("position", "velocity", "acceleration", "jerk")
_PLAIN = ("control", "share", "ticks", "observes_intervention", "task", "robot", "provenance")
"""Fields of a policy that the header holds as they are."""

_NETWORK = ("activation", "output", "clip")
"""Those of its network; an infinite ``clip`` is null."""

_KEYS = frozenset({"format", "version", "limits", *_PLAIN, *_NETWORK})


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
    header: dict[str, Any] = {"format": f"jssa_gym {WHAT}", "version": VERSION}
    header |= {field: getattr(policy, field) for field in _PLAIN}
    header |= {field: getattr(network, field) for field in _NETWORK}
    header["clip"] = None if np.isinf(network.clip) else network.clip
    header["limits"] = {name: getattr(limits, name).tolist() for name in _LIMITS}
    text = json.dumps(header, allow_nan=False, indent=1, sort_keys=True).encode()
    if len(text) > LARGEST_HEADER:
        raise PolicyFileError(f"{_HEADER} has {len(text)} bytes, at most {LARGEST_HEADER}: less provenance, please")
    members: dict[str, Any] = {_HEADER: text, "mean": network.mean.astype("<f8"), "std": network.std.astype("<f8")}
    for k, (weight, bias) in enumerate(network.layers):
        members |= {f"weight_{k}": weight.astype("<f4"), f"bias_{k}": bias.astype("<f4")}
    write_sealed(Path(path), members, PolicyFileError, LARGEST)


def read_policy(path: str | Path) -> LearnedPolicy:
    """Read what :func:`save_policy` wrote, bit for bit.

    Raises:
        PolicyFileError: The file cannot be read, was truncated or changed, is something else or of another version, or
            holds anything beyond a policy.
    """
    content = read_sealed(Path(path), WHAT, PolicyFileError, LARGEST)
    with refused(PolicyFileError, f"{path} holds no policy"), open_archive(content) as archive:
        names = archive.namelist()
        layers = min(max(1, sum(name.startswith("weight_") for name in names)), MOST_LAYERS)
        kinds = {"mean": "<f8", "std": "<f8"}
        kinds |= {f"{kind}_{k}": "<f4" for k in range(layers) for kind in ("weight", "bias")}
        if other := {_HEADER, *(f"{name}.npy" for name in kinds)} ^ set(names):
            raise ValueError(f"unexpected or missing members: {', '.join(map(repr, sorted(other)))[:300]}")
        header = _header(read_member(archive, _HEADER))
        arrays = {name: read_array(archive, name) for name in kinds}
        for name, kind in kinds.items():
            if arrays[name].dtype != np.dtype(kind):
                raise ValueError(f"{name}.npy is of type {arrays[name].dtype}, not {kind}")
        return _policy(header, arrays)


def _header(text: bytes) -> dict[str, Any]:
    """What ``policy.json`` says, with the right keys."""
    if len(text) > LARGEST_HEADER:
        raise ValueError(f"{_HEADER} has {len(text)} bytes, more than {LARGEST_HEADER}")
    header = read_header(text, WHAT, VERSION)
    for what, holder, keys in ((_HEADER, header, _KEYS), ("limits", header.get("limits"), frozenset(_LIMITS))):
        if not isinstance(holder, dict):
            raise ValueError(f"{what} is no object")
        if other := holder.keys() ^ keys:
            raise ValueError(f"unexpected or missing keys of {what}: {', '.join(map(repr, sorted(other)))}")
    return header


def _policy(header: dict[str, Any], arrays: dict[str, Array]) -> LearnedPolicy:
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


def _numbers(name: str, value: Any) -> Any:
    """Lists of numbers, and nothing that numpy would make one of."""
    if isinstance(value, list):
        return [_numbers(name, one) for one in value]
    if isinstance(value, bool) or not isinstance(value, float | int):
        raise ValueError(f"{name} limits have to be numbers, got {value!r}")
    return float(value)
