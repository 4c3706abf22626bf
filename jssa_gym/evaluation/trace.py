"""Recorded episodes on disk: complete and unchanged, or an error."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

from jssa_gym.exceptions import TraceError
from jssa_gym.robots import RobotModel
from jssa_gym.storage import open_archive, read_array, read_header, read_sealed, refused, write_sealed
from jssa_gym.types import Array, CapsuleSet, Planes, Status, Trace

_WHAT, _VERSION, _EARLIER = "trace", 3, (2,)

LATER = {"margin": np.nan, "kind": "", "choice": -1, "override": np.nan}
"""What files of version 2, and steps without a shield, do not say; and what stands there instead."""

WITHOUT_SHIELD: dict[str, Any] = {
    "status": int(Status.NOMINAL), "reason": "", "intervened": False, "correction": np.nan, "phi": np.nan,
    "slack": np.nan, **LATER,
}  # fmt: skip
"""What a shield says of a step, and what stands there without one."""

TASKLESS: dict[str, Any] = {"dynamics": "kinematic", "task": "", "holds": False}
TASKLESS_STEP: dict[str, Any] = {"goal": (), "reward": 0.0, "success": False, "shield_time": np.nan}
"""What stands in a trace of a motion that is no episode of an environment, throughout and of a step."""

LARGEST = 512 * 2**20
"""Size from which nothing is read, on disk and unpacked [bytes]."""

_HINTS = get_type_hints(Trace, include_extras=True)

_SHAPED = {field: get_args(hint) for field, hint in _HINTS.items() if get_origin(hint) is Annotated}
"""Type and shape of what has one; a letter stands for the same length everywhere."""

_NAMES = tuple(field for field, (kind, _) in _SHAPED.items() if get_origin(kind) is tuple)

_ARRAYS = {
    field: np.dtype(get_args(get_args(kind)[1])[0]) for field, (kind, _) in _SHAPED.items() if field not in _NAMES
}
"""Type of every array; strings have a length, which is any."""

_PLAIN = {field: hint for field, hint in _HINTS.items() if field not in _SHAPED}
"""Type of every text and number, which the file's header holds, as it does the names."""


def beginning(robot: RobotModel, state: Array, human: CapsuleSet, planes: Planes) -> dict[str, Any]:
    """What a trace holds once of where it begins, by field; copied.

    Args:
        robot: Where it stands.
        state: Joint state before the first step, shape (3, n) [rad, rad/s, rad/s²].
        human: People before the first step.
        planes: Half-spaces.
    """
    return {
        "robot": robot.name,
        "mount": np.array(robot.mount),
        "initial_state": np.array(state),
        "initial_human": np.array([human.start, human.end]),
        "human_radius": np.array(human.radius),
        "human_person": np.array(human.person),
        "human_names": human.names,
        "plane_normal": np.array(planes.normal),
        "plane_offset": np.array(planes.offset),
        "plane_names": planes.names,
    }


def trace_of(once: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Trace:
    """A trace of what holds throughout, and of the other fields after every control step.

    Args:
        once: By field.
        rows: One a control step, by field; those of :data:`LATER` may be missing.
    """
    whole = [{**LATER, **row} for row in rows]
    arrays = {
        field: np.array([row[field] for row in whole], kind) for field, kind in _ARRAYS.items() if field not in once
    }
    return Trace(**once, **arrays)


def trace_of_columns(once: Mapping[str, Any], columns: Mapping[str, Any]) -> Trace:
    """A trace from what its fields are after all control steps.

    Args:
        once: By field.
        columns: Arrays or lists with a row a control step, by field; copied.
    """
    return Trace(**once, **{field: np.array(column, _ARRAYS[field], order="C") for field, column in columns.items()})


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
        TraceError: The trace's arrays do not fit together or are too large, or JSON cannot hold ``meta``.
        StorageError: The file cannot be written.
    """
    _check(trace)
    header = {"format": f"jssa_gym {_WHAT}", "version": _VERSION, "meta": dict(meta or {})}
    header |= {field: getattr(trace, field) for field in (*_PLAIN, *_NAMES)}
    try:
        text = json.dumps(header, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise TraceError(f"name, dt and meta have to be what JSON can hold: {error}") from error
    arrays = {"header": np.frombuffer(text.encode(), np.uint8)} | {field: getattr(trace, field) for field in _ARRAYS}
    write_sealed(Path(path), arrays, TraceError, LARGEST, compressed=True)


def load_trace(path: str | Path) -> Trace:
    """Read what :func:`save_trace` wrote, bit for bit. Nothing in a file is ever run: no pickles.

    Raises:
        TraceError: The file cannot be read, is something else, was truncated or changed, or is of another version.
    """
    header, arrays = _read(Path(path))
    with refused(TraceError, f"{path} holds no complete trace"):
        plain = {field: header[field] for field in _PLAIN}
        names = {field: tuple(header[field]) for field in _NAMES}
    trace = Trace(**plain, **names, **arrays)
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
    content = read_sealed(path, _WHAT, TraceError, LARGEST)
    with refused(TraceError, f"{path} holds no complete trace"), open_archive(content, LARGEST) as archive:
        header = read_header(read_array(archive, "header").tobytes(), _WHAT, _VERSION, *_EARLIER)
        late = LATER if header["version"] in _EARLIER else {}
        arrays = {field: read_array(archive, field) for field in _ARRAYS if field not in late}
        count = len(arrays["time"])
        return header, arrays | {field: np.full(count, value, _ARRAYS[field]) for field, value in late.items()}


def every_step(trace: Trace) -> bool:
    """Whether the rows are one control step apart, from the first step on: not so with repeated actions."""
    return bool(np.allclose(trace.time, trace.dt * np.arange(1, len(trace.time) + 1), rtol=0.0, atol=1e-9))


def _check(trace: Trace) -> None:
    """Types and shapes of everything.

    Raises:
        TraceError: One is wrong; names it.
    """
    for field, kind in _PLAIN.items():
        value = getattr(trace, field)
        if not isinstance(value, kind) or (kind is float and not 0.0 < value < np.inf):
            wanted = {float: "a positive number", bool: "True or False", str: "a string"}[kind]
            raise TraceError(f"a trace's {field} has to be {wanted}, got {value!r}")
    lengths: dict[str, int] = {}
    for field, (_, shape) in _SHAPED.items():
        value, letters = getattr(trace, field), shape.split()
        if field in _NAMES:
            count = lengths[shape]
            if not (isinstance(value, tuple) and len(value) == count and all(isinstance(name, str) for name in value)):
                raise TraceError(f"a trace's {field} have to be {count} strings, got {value!r}")
            continue
        kind = _ARRAYS[field]
        found = value.dtype if isinstance(value, np.ndarray) else None
        if found is None or not (found.kind == "U" if kind.kind == "U" else found == kind):
            wanted = f"{kind.kind}{kind.itemsize or ''}"
            raise TraceError(f"a trace's {field} has to be an array of type {wanted}, got {found or type(value)}")
        if value.ndim == len(letters):
            lengths = dict(zip(letters, value.shape, strict=True)) | lengths
        wanted = tuple(int(letter) if letter.isdigit() else lengths.get(letter, letter) for letter in letters)
        if value.shape != wanted:
            raise TraceError(f"a trace's {field} has to have shape {wanted}, got {value.shape}")
