"""Keypoints in files, and the capsules of a person that follow from them.

``.csv``, by the rules of people's tables (:mod:`jssa_gym.storage.tables`): ``time`` and, for every keypoint of one of
:data:`~jssa_gym.perception.SKELETONS`, ``nose.x``, ``nose.y``, ``nose.z`` [m] and maybe ``nose.confidence``; an empty
or ``nan`` field is a keypoint that was not found. ``.npz``: ``time`` (T,) [s], ``keypoints`` (T, k, 3) [m], NaN where
not found, maybe ``confidence`` (T, k), and ``names`` (k,). One person a file.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans import Recording
from jssa_gym.perception.skeletons import SKELETONS, KeypointTable
from jssa_gym.perception.tracker import Frame, Tracker, TrackerParams
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.storage import open_archive, open_whole, read_array, read_text, refused
from jssa_gym.storage.tables import INDEX, as_numbers, check_lengths, check_times, table_lines
from jssa_gym.types import Array

_LARGEST = 2**30
_AXES = ("x", "y", "z", "confidence")
_NOT_FOUND = ("", "nan", "na", "none")


@dataclass(frozen=True, slots=True, eq=False)
class KeypointRecording:
    """One person's keypoints over time."""

    skeleton: KeypointTable
    time: Array
    """Shape (T,) [s]."""
    position: Array
    """In the skeleton's order, NaN where not found, shape (T, k, 3) [m]."""
    confidence: Array
    """Shape (T, k)."""


def holds_keypoints(path: Path) -> bool:
    """Whether a file is one of keypoints rather than of capsules.

    Raises:
        RecordingError: It cannot be read.
    """
    kind = path.suffix.casefold()
    if not path.is_file():
        return False
    if kind == ".npz":
        with (
            open_whole(path, RecordingError, _LARGEST) as file,
            refused(RecordingError, f"{path.name} is no complete .npz archive of arrays"),
            open_archive(file, _LARGEST) as archive,
        ):
            return "keypoints.npy" in archive.namelist()
    if kind != ".csv":
        return False
    header, _, _ = table_lines(read_text(path, RecordingError, _LARGEST), RecordingError)
    points = {point for skeleton in SKELETONS.values() for point in skeleton.keypoints}
    return any(column.casefold().removesuffix(".x") in points for column in header if column.endswith(".x"))


def read_keypoints(path: Path) -> KeypointRecording:
    """Read a file of keypoints.

    Raises:
        RecordingError: It is no sound one; the message names file, row and column.
    """
    try:
        return (_read_npz if path.suffix.casefold() == ".npz" else _read_csv)(path)
    except RecordingError as error:
        said = str(error)
        raise RecordingError(said if path.name in said else f"{path.name}: {said}") from error.__cause__


def _skeleton_of(names: Sequence[str]) -> KeypointTable:
    """The first skeleton that has all these keypoints."""
    for skeleton in SKELETONS.values():
        if set(names) <= set(skeleton.keypoints):
            return skeleton
    closest = max(SKELETONS.values(), key=lambda one: len(set(names) & set(one.keypoints)))
    unknown = sorted(set(names) - set(closest.keypoints))[:4]
    raise RecordingError(
        f"no skeleton has the keypoints {', '.join(unknown)}; {closest.name} has: {', '.join(closest.keypoints)}"
    )


def _read_csv(path: Path) -> KeypointRecording:
    header, rows, comma = table_lines(read_text(path, RecordingError, _LARGEST), RecordingError)
    check_lengths(header, rows, RecordingError)
    kept = [k for k, column in enumerate(header) if column.casefold() not in INDEX]
    columns = [header[k].casefold() for k in kept]
    unknown = [c for c in columns if c != "time" and c.rpartition(".")[2] not in _AXES]
    if columns.count("time") != 1 or unknown or len(set(columns)) < len(columns):
        raise RecordingError(
            "columns have to be time and <keypoint>.x, .y, .z and maybe .confidence, each once; unknown: "
            f"{', '.join(unknown[:4]) or 'none'}"
        )
    names = list(dict.fromkeys(column.rpartition(".")[0] for column in columns if column != "time"))
    skeleton = _skeleton_of(names)
    missing = [f"{name}.{axis}" for name in names for axis in "xyz" if f"{name}.{axis}" not in columns]
    if missing or not rows:
        raise RecordingError(f"column {missing[0]} is missing" if missing else "it has no rows")
    numbers = tuple(number for number, _ in rows)
    cells = [[row[k].strip() for k in kept] for _, row in rows]
    place = {column: j for j, column in enumerate(columns)}
    gone = np.array([[cell.casefold() in _NOT_FOUND for cell in row] for row in cells])
    gone[:, place["time"]] = False
    filled = [
        ["0" if hole else cell for cell, hole in zip(row, holes, strict=True)]
        for row, holes in zip(cells, gone, strict=True)
    ]
    table = as_numbers(filled, numbers, columns, comma, RecordingError)
    table[gone] = np.nan
    check_times(table[:, place["time"]], numbers, RecordingError)
    count = len(skeleton.keypoints)
    position, confidence = np.full((len(rows), count, 3), np.nan), np.zeros((len(rows), count))
    for name in names:
        k = skeleton.keypoints.index(name)
        position[:, k] = table[:, [place[f"{name}.{axis}"] for axis in "xyz"]]
        told = place.get(f"{name}.confidence")
        confidence[:, k] = 1.0 if told is None else np.nan_to_num(table[:, told])
    return _sound(KeypointRecording(skeleton, table[:, place["time"]], position, confidence))


def _read_npz(path: Path) -> KeypointRecording:
    with (
        open_whole(path, RecordingError, _LARGEST) as file,
        refused(RecordingError, "is no complete .npz archive of arrays"),
        open_archive(file, _LARGEST) as archive,
    ):
        there = archive.namelist()
        missing = [name for name in ("time", "keypoints", "names") if f"{name}.npy" not in there]
        if missing:
            raise RecordingError(f"misses {', '.join(missing)}; keypoints have time, keypoints, names")
        time, found = (read_array(archive, name).astype(np.float64) for name in ("time", "keypoints"))
        names = [str(name) for name in read_array(archive, "names").tolist()]
        told = read_array(archive, "confidence").astype(np.float64) if "confidence.npy" in there else None
    if time.ndim != 1 or found.shape != (len(time), len(names), 3) or not np.all(np.isfinite(time)):
        raise RecordingError(f"keypoints has the shape {found.shape} for {time.shape} stamps of {len(names)} names")
    check_times(time, range(len(time)), RecordingError)
    skeleton = _skeleton_of(names)
    where = [skeleton.keypoints.index(name) for name in names]
    if told is not None and told.shape != found.shape[:2]:
        raise RecordingError(f"confidence has the shape {told.shape}, keypoints {found.shape}")
    position = np.full((len(time), len(skeleton.keypoints), 3), np.nan)
    confidence = np.zeros(position.shape[:2])
    position[:, where], confidence[:, where] = found, 1.0 if told is None else told
    return _sound(KeypointRecording(skeleton, time, position, confidence))


def _sound(recording: KeypointRecording) -> KeypointRecording:
    if len(recording.time) < 2:
        raise RecordingError("a recording needs two samples at least")
    recording.confidence[~np.isfinite(recording.position).all(axis=2)] = 0.0
    return recording


def capsules_of(
    keypoints: KeypointRecording, assumed: FailsafeParams, *, body: str = "jointed", params: TrackerParams | None = None
) -> tuple[Recording, dict[str, Array]]:
    """Capsules over time, and when each part was measured.

    Between the moments at which a part was measured it is on a straight line; the recording begins and ends where all
    parts are known.

    Args:
        keypoints: Of one person.
        assumed: Of a shield, see :class:`~jssa_gym.perception.Tracker`.
        body: ``"jointed"`` or ``"six"``.
        params: Of the detector.

    Returns:
        The recording, and the stamps of every part's measurements, ascending [s].

    Raises:
        RecordingError: Some part was never measured twice, or no keypoint would be believed.
    """
    try:
        tracker = Tracker(keypoints.skeleton, assumed, body=body, params=params)
    except ParameterError as error:
        raise RecordingError(str(error)) from error
    seen: list[list[tuple[float, Array]]] = [[] for _ in tracker.parts]
    for stamp, position, confidence in zip(keypoints.time, keypoints.position, keypoints.confidence, strict=True):
        tracker.update(Frame(float(stamp), np.array([0]), position[None], confidence[None]))
        now = tracker.at(float(stamp))
        for k in np.flatnonzero(now.age == 0.0).tolist():
            seen[k].append((float(stamp), np.array([now.human.start[k], now.human.end[k]])))
    names = tuple(part.name for part in tracker.parts)
    for name, one in zip(names, seen, strict=True):
        if len(one) < 2:
            raise RecordingError(f"{name} is hardly ever seen: all its keypoints have to be, in two frames at least")
    first, last = max(one[0][0] for one in seen), min(one[-1][0] for one in seen)
    time = keypoints.time[(keypoints.time >= first) & (keypoints.time <= last)]
    if len(time) < 2:
        raise RecordingError("there is no time at which all parts are known")
    ends = np.empty((len(time), len(names), 2, 3))
    stamps = {}
    for k, (name, one) in enumerate(zip(names, seen, strict=True)):
        stamps[name] = at = np.array([stamp for stamp, _ in one])
        places = np.array([place for _, place in one]).reshape(len(one), 6)
        ends[:, k] = np.stack([np.interp(time, at, column) for column in places.T], axis=1).reshape(-1, 2, 3)
    radius = np.array([part.radius for part in tracker.parts])
    return Recording(time, ends[:, :, 0], ends[:, :, 1], radius, names), stamps
