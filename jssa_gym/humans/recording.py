"""Recorded motion of a person: what is in a file, and what a sound file is.

``.npz``, no pickles: ``time`` (T,) [s], ``start`` and ``end`` (T, m, 3) [m], ``radius`` (m,) [m] and ``names`` (m,),
strings. ``.csv``: a header, then a row a sample; the columns, in any order, are ``time`` and for every capsule
``<name>.start.x``, ``.y``, ``.z``, ``<name>.end.x``, ``.y``, ``.z`` and ``<name>.radius``, the same in every row; see
:mod:`jssa_gym.humans.table`. The z axis points up from the floor; it is the robot's base axis.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans.body import turning
from jssa_gym.humans.survey import REFUSED, Source, survey
from jssa_gym.humans.table import read_table
from jssa_gym.storage import open_archive, open_whole, read_array, refused, whole_file, write_archive
from jssa_gym.types import Array

_FIELDS = ("time", "start", "end", "radius", "names")
_LARGEST = 2**30
"""Size from which nothing is read, on disk and unpacked [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Capsules of one person over time.

    Raises:
        RecordingError: The arrays do not fit together, are not finite, time does not increase, a radius is not
            positive or a name is missing or double; the message says which and where.
    """

    time: Array
    """Times of the samples, increasing, shape (T,) [s], T at least 2."""
    start: Array
    """Shape (T, m, 3) [m]; the first capsule's, seen from above, is the person's root."""
    end: Array
    """Shape (T, m, 3) [m]."""
    radius: Array
    """Shape (m,) [m]."""
    names: tuple[str, ...]
    """One a capsule: the body part."""

    def __post_init__(self) -> None:
        for name in _FIELDS[:-1]:
            object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if isinstance(self.names, str) or not isinstance(self.names, Iterable):
            raise RecordingError(f"names has to be one string a capsule, got {self.names!r}")
        object.__setattr__(self, "names", tuple(str(name) for name in self.names))
        count, parts = self.time.size, len(self.names)
        shapes = {"time": (count,), "start": (count, parts, 3), "end": (count, parts, 3), "radius": (parts,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise RecordingError(
                    f"{name} has to be of shape {shape} for {count} samples of {parts} capsules, "
                    f"got {getattr(self, name).shape}"
                )
        if count < 2 or parts < 1:
            raise RecordingError(f"a recording needs two samples and a capsule at least, got {count} and {parts}")
        late = np.flatnonzero(~(np.diff(self.time) > 0.0))
        if len(late):
            raise RecordingError(f"time has to increase; sample {late[0] + 1} is not after the one before it")
        if not np.all(self.radius > 0.0):
            raise RecordingError(f"a radius has to be positive, got {self.radius.tolist()}")
        if len(set(self.names)) < parts or not all(self.names):
            raise RecordingError(f"every capsule needs a name of its own, got {self.names}")

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def speed(self) -> float:
        """Largest speed of a capsule's end between two samples [m/s]: no point of the body is faster."""
        return float(self.end_speeds.max())

    @property
    def end_speeds(self) -> Array:
        """The same of each capsule's start and end, shape (m, 2) [m/s]."""
        ends = np.stack([self.start, self.end], axis=2)
        return (np.linalg.norm(np.diff(ends, axis=0), axis=-1) / np.diff(self.time)[:, None, None]).max(axis=0)

    @property
    def root(self) -> Array:
        """Where the person stands, shape (T, 2) [m]."""
        return self.start[:, 0, :2]

    def turned(self, angle: float) -> "Recording":
        """All of it turned about the base axis, counter-clockwise from above [rad]."""
        turn = turning(angle)
        return Recording(self.time, self.start @ turn.T, self.end @ turn.T, self.radius, self.names)

    def moved(self, way: Array) -> "Recording":
        """All of it moved along the floor, shape (2,) [m]."""
        way = np.append(way, 0.0)
        return Recording(self.time, self.start + way, self.end + way, self.radius, self.names)

    def ends_at(self, samples: NDArray[np.int64], turn: Array, way: Array) -> Array:
        """Samples, each with the one after it, turned about the base axis and then moved.

        Args:
            samples: Their numbers, shape (E,), before the last.
            turn: Each one's turn, shape (E, 3, 3).
            way: Each one's way, shape (E, 3) [m].

        Returns:
            Starts and ends, shape (E, 2, 2, m, 3) [m]: of the sample and the next, all that is :attr:`start` before all
            that is :attr:`end`.
        """
        pairs = samples[:, None] + np.arange(2)
        ends = np.stack([self.start[pairs], self.end[pairs]], axis=2)
        return ends @ turn.transpose(0, 2, 1)[:, None, None] + way[:, None, None, None]

    @classmethod
    def load(cls, path: str | Path) -> "Recording":
        """Read an ``.npz`` or ``.csv`` file.

        Raises:
            RecordingError: There is no such file, or it is not a sound recording. A table is looked at more closely,
                since others wrote it: somebody who is too large, lies or jumps is refused too, by row and column.
        """
        return load_placed(path)[0]

    def save(self, path: str | Path) -> None:
        """Write an ``.npz`` file, to a temporary name first.

        Raises:
            RecordingError: The name does not end in ``.npz``, or its folder does not exist.
            StorageError: The file cannot be written.
        """
        path = _path(path)
        if path.suffix != ".npz":
            raise RecordingError(f"a recording is written to an .npz file, got {str(path)!r}")
        if not path.parent.is_dir():
            raise RecordingError(f"there is no folder {path.parent}")
        values = {name: getattr(self, name) for name in _FIELDS[:-1]}
        with whole_file(path) as file:
            write_archive(file, {"names": np.array(self.names), **values}, compressed=True)


def nearest_root(path: Array) -> Array:
    """The point of straight ways between points (T, 2) that is nearest to the base axis, shape (2,) [m]."""
    begin, way = path[:-1], np.diff(path, axis=0)
    length = np.maximum(np.einsum("ij,ij->i", way, way), 1e-300)
    share = np.clip(-np.einsum("ij,ij->i", begin, way) / length, 0.0, 1.0)
    points = begin + share[:, None] * way
    return points[int(np.hypot(*points.T).argmin())]


def load_placed(path: str | Path) -> tuple[Recording, Source]:
    """:meth:`Recording.load`, and where the samples stand in the file."""
    path = _path(path)
    kind = path.suffix.casefold()
    if kind not in (".npz", ".csv"):
        raise RecordingError(f"a recording is an .npz or .csv file, got {str(path)!r}")
    if not path.is_file():
        raise RecordingError(f"no recording at {path}")
    try:
        if kind == ".npz":
            return Recording(**_read_npz(path)), Source()
        table = read_table(path, _LARGEST)
        recording, source = Recording(**table.values), Source(table.rows)
        for finding in survey(recording, source):
            if finding.kind in REFUSED:
                raise RecordingError(str(finding))
        return recording, source
    except RecordingError as error:
        raise RecordingError(f"{path.name}: {error}") from error.__cause__


def _path(path: Any) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise RecordingError(f"a recording is an .npz or .csv file, got {path!r}")
    return Path(path)


def _numbers(name: str, value: Any) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{name} has to be numbers: {error}") from error
    if not np.all(np.isfinite(array)):
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise RecordingError(f"{name} has to be finite, it is not at index {where}")
    return array


def _read_npz(path: Path) -> dict[str, Any]:
    told = "is no complete .npz archive of arrays"
    with (
        open_whole(path, RecordingError, _LARGEST) as file,
        refused(RecordingError, told),
        open_archive(file, _LARGEST) as archive,
    ):
        missing = [name for name in _FIELDS if f"{name}.npy" not in archive.namelist()]
        if missing:
            raise RecordingError(f"misses {', '.join(missing)}; a recording has {', '.join(_FIELDS)}")
        values: dict[str, Any] = {name: read_array(archive, name) for name in _FIELDS}
    names = values["names"]
    if names.dtype.kind != "U" or names.ndim != 1:
        raise RecordingError(f"names has to be a list of strings, got {names.dtype} of shape {names.shape}")
    return {**values, "names": tuple(names.tolist())}
