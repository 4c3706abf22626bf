"""A robot's log: what is read from a file, and the motion on the control grid that it stands for.

``.csv``, by the rules of people's tables (:mod:`jssa_gym.storage.tables`): a column ``time`` and one a joint, in the
robot's order, ``q1`` ... ``qn`` or ``<joint>.position``; beside them, for all joints or none, ``<joint>.velocity`` and
``<joint>.acceleration``. A unit may stand behind a name, ``time [ms]``, ``q1 [deg]``; other columns are left out.
``.npz``, no pickles: ``time`` (T,) [s], ``position`` (T, n) [rad], and maybe ``velocity`` and ``acceleration`` of the
same shape. ``.parquet``: the columns of a table.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import LogError, MissingExtraError
from jssa_gym.storage import open_archive, open_whole, read_array, read_text, refused
from jssa_gym.storage.tables import INDEX, as_numbers, check_lengths, check_times, table_lines
from jssa_gym.types import Array

SUFFIXES = (".csv", ".npz", ".parquet")

_ELSEWHERE = (".mcap", ".bag", ".db3")
"""Recordings of ROS: messages of types that only their definitions tell."""

_LARGEST = 2**30
_MOST = 2**21
"""Samples from which on a log is not read: 4.6 hours at 125 Hz."""

_JOINT = re.compile(r"^(?P<joint>.+?)(?:\.(?P<what>position|velocity|acceleration|pos|vel|acc))?$", re.IGNORECASE)
_UNIT = re.compile(r"^(.*?)(?:\s*[\[(]\s*([\w/²^]+)\s*[\])])?$")
_NUMBERED = re.compile(r"(?:j|q|joint)[_ ]?(\d+)", re.IGNORECASE)

_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_DEGREE = float(np.pi / 180.0)
_ANGLES = {"rad": 1.0, "deg": _DEGREE}

_TURNS = 4.0 * np.pi
"""Angle of a joint from which a column is taken to be in degrees [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotLog:
    """Joint states over time.

    Raises:
        LogError: The arrays do not fit together, are not finite, or time does not increase; the message says where.
    """

    time: Array
    """Increasing, shape (T,) [s], T at least 2."""
    position: Array
    """Shape (T, n) [rad]."""
    velocity: Array | None = None
    """Shape (T, n) [rad/s]; None where it was not logged."""
    acceleration: Array | None = None
    """Shape (T, n) [rad/s²]; None where it was not logged."""
    rows: Sequence[int] | None = None
    """Line of every sample in its file."""
    joints: tuple[str, ...] = ()
    """Their names in the file."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _finite("time", self.time, self))
        shape = np.shape(self.position)
        if self.time.ndim != 1 or len(self.time) < 2 or len(shape) != 2 or shape[0] != len(self.time) or not shape[1]:
            raise LogError(
                f"a log needs two samples at least and a position of every joint in each: time has the shape "
                f"{self.time.shape}, position {shape}"
            )
        if len(self.time) > _MOST:
            raise LogError(f"it has {len(self.time):,} samples, more than {_MOST:,}: cut it")
        for name in ("position", "velocity", "acceleration"):
            value = getattr(self, name)
            if value is None:
                continue
            if np.shape(value) != shape:
                raise LogError(f"{name} has the shape {np.shape(value)}, position {shape}")
            object.__setattr__(self, name, _finite(name, value, self))
        check_times(self.time, self.rows or range(len(self.time)), LogError)
        far = np.argwhere(np.abs(self.position) > _TURNS)
        if len(far):
            k, j = (int(i) for i in far[0])
            raise LogError(
                f"{self.value(k, j)}: a joint at {self.position[k, j]:.4g} rad has turned twice; if these are degrees, "
                "say so in the header, as in 'q1 [deg]'"
            )

    def value(self, k: int, joint: int) -> str:
        """A joint's sample in words: where in the log it is."""
        name = self.joints[joint] if self.joints else f"joint {joint + 1}"
        return f"sample {k}, {name}" if self.rows is None else f"row {self.rows[k]}, column {name}"


def _finite(name: str, value: Any, log: RobotLog) -> Array:
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError) as error:
        raise LogError(f"{name} has to be numbers: {error}") from error
    if not np.all(np.isfinite(array)):
        k = int(np.argwhere(~np.isfinite(array))[0][0])
        where = f"sample {k}" if log.rows is None else f"row {log.rows[k]}"
        raise LogError(f"{where}, {name}: numbers have to be finite")
    return array


def read_log(path: str | Path, n: int) -> RobotLog:
    """Read the log of a robot of n joints.

    Raises:
        LogError: There is no such file, or it is no sound log; the message names file, row and column.
        MissingExtraError: It is ``.parquet`` and pyarrow is not installed.
    """
    path = Path(path)
    kind = path.suffix.casefold()
    if kind in _ELSEWHERE:
        raise LogError(
            f"{path.name}: {kind} is not read, what its messages mean is not in it: write the joint states as .csv or "
            ".npz (ros2 topic echo --csv /joint_states)"
        )
    if kind not in SUFFIXES:
        raise LogError(f"a robot's log is read from {', '.join(SUFFIXES)}, got {path.name!r}")
    if not path.is_file():
        raise LogError(f"no log at {path}")
    try:
        log = {".csv": _read_csv, ".npz": _read_npz, ".parquet": _read_parquet}[kind](path, n)
        if log.position.shape[1] != n:
            raise LogError(f"it has {log.position.shape[1]} joints, the robot {n}; give its file as --robot")
        return log
    except LogError as error:
        said = str(error)
        raise LogError(said if path.name in said else f"{path.name}: {said}") from error.__cause__


def _read_csv(path: Path, n: int) -> RobotLog:
    header, rows, comma = table_lines(read_text(path, LogError, _LARGEST), LogError)
    check_lengths(header, rows, LogError)
    columns = _columns(header, n)
    used = [k for k, *_ in columns]
    names = [header[k] for k in used]
    cells = [[row[k].strip() for k in used] for _, row in rows]
    numbers = tuple(number for number, _ in rows)
    return _assembled(as_numbers(cells, numbers, names, comma, LogError), columns, numbers)


def _read_parquet(path: Path, n: int) -> RobotLog:
    try:
        from pyarrow import parquet  # ty: ignore[import-not-found]
    except ImportError as error:
        raise MissingExtraError(f"{path.name}: .parquet needs pyarrow: pip install pyarrow") from error
    with refused(LogError, f"{path.name} is no table of numbers"):
        table = parquet.read_table(path)
        columns = _columns(table.column_names, n)
        values = [np.asarray(table.column(k).to_numpy(), np.float64) for k, *_ in columns]
        return _assembled(np.stack(values, axis=1), columns, None)


def _read_npz(path: Path, n: int) -> RobotLog:
    with (
        open_whole(path, LogError, _LARGEST) as file,
        refused(LogError, "is no complete .npz archive of arrays"),
        open_archive(file, _LARGEST) as archive,
    ):
        there = {name.removesuffix(".npy") for name in archive.namelist()}
        missing = [name for name in ("time", "position") if name not in there]
        if missing:
            raise LogError(f"misses {', '.join(missing)}; a log has time, position, and maybe velocity, acceleration")
        names = [name for name in ("time", "position", "velocity", "acceleration") if name in there]
        found: dict[str, Any] = {name: read_array(archive, name) for name in names}
    return RobotLog(**found)


_WHAT = {"pos": "position", "vel": "velocity", "acc": "acceleration"}


def _columns(header: Sequence[str], n: int) -> list[tuple[int, str, str, float]]:
    """Columns that count: place, what, joint, and what a unit is: time first, then position, velocity, acceleration."""
    time: list[tuple[int, str, str, float]] = []
    joints: dict[str, dict[str, tuple[int, str, str, float]]] = {"position": {}, "velocity": {}, "acceleration": {}}
    for k, column in enumerate(header):
        if column.casefold() in INDEX:
            continue
        match = _UNIT.match(column)
        name, unit = (match[1].strip(), match[2]) if match is not None else (column, None)
        if name.casefold() in ("time", "time_ms"):
            time.append((k, "time", name, _factor(column, "ms" if name.endswith("_ms") else unit or "s", _TIMES)))
            continue
        parts = _JOINT.match(name)
        if parts is None:
            continue
        what = (parts["what"] or "position").casefold()
        what, joint = _WHAT.get(what, what), parts["joint"]
        if parts["what"] is None and not _NUMBERED.fullmatch(joint):
            continue  # of something else
        if joint.casefold() in joints[what]:
            raise LogError(f"column {column} is there twice")
        factor = _factor(column, (unit or "rad").split("/")[0], _ANGLES)
        joints[what][joint.casefold()] = (k, what, joint, factor)
    if len(time) != 1 or len(joints["position"]) != n:
        said = ", ".join(name for _, _, name, _ in joints["position"].values()) or "none"
        raise LogError(
            f"columns have to be time and the positions of {n} joints, q1 ... q{n} or <joint>.position; found "
            f"{len(time) or 'no'} time and the joints: {said}"
        )
    order = _ordered(list(joints["position"]))
    found = [*time, *(joints["position"][joint] for joint in order)]
    for what in ("velocity", "acceleration"):
        if joints[what] and set(joints[what]) != set(order):
            missing = sorted(set(order) ^ set(joints[what]))
            raise LogError(f"column {missing[0]}.{what}: {what} has to be there for all joints or for none")
        found += [joints[what][joint] for joint in order if joints[what]]
    return found


def _ordered(joints: list[str]) -> list[str]:
    """Joints in order: by their numbers where all have one, else as they are written."""
    numbers = [match[1] if (match := _NUMBERED.fullmatch(joint)) else None for joint in joints]
    if any(number is None for number in numbers):
        return joints
    return [joint for _, joint in sorted(zip((int(number or 0) for number in numbers), joints, strict=True))]


def _factor(column: str, unit: str, units: dict[str, float]) -> float:
    if unit not in units:
        raise LogError(f"column {column}: unknown unit {unit!r}; valid: {', '.join(units)}")
    return units[unit]


def _assembled(table: Array, columns: Sequence[tuple[int, str, str, float]], rows: Sequence[int] | None) -> RobotLog:
    """The log of a table's columns."""
    table = table * np.array([factor for *_, factor in columns])
    what = np.array([kind for _, kind, _, _ in columns])
    joints = tuple(joint for _, kind, joint, _ in columns if kind == "position")
    values = {kind: table[:, what == kind] for kind in ("position", "velocity", "acceleration")}
    return RobotLog(
        table[:, 0],
        values["position"],
        *(values[kind] if values[kind].size else None for kind in ("velocity", "acceleration")),
        rows=rows,
        joints=joints,
    )
