"""BVH files: a tree of joints with offsets and Euler angles (``HIERARCHY``), a row of numbers a frame (``MOTION``)."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans.bvh.skeleton import Skeleton
from jssa_gym.storage import read_text

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")


def read(path: str | Path) -> Skeleton:
    """Read a BVH file.

    Raises:
        RecordingError: There is no such file, or it is not BVH; the message says what was expected and where.
    """
    if not isinstance(path, str | os.PathLike):
        raise RecordingError(f"a skeleton is read from a BVH file, got {path!r}")
    path = Path(path)
    text = read_text(path, RecordingError)
    try:
        return parse(text)
    except RecordingError as error:
        raise RecordingError(f"{path.name}: {error}") from error.__cause__


def parse(text: str) -> Skeleton:
    """A skeleton from the text of a BVH file; errors as of :func:`read`."""
    lines = [(number, words) for number, line in enumerate(text.splitlines(), 1) if (words := line.split())]
    reader = _Reader(lines)
    reader.expect("HIERARCHY")
    tree = _Tree([], [], [], [])
    try:
        _read_joint(reader, reader.expect("ROOT", 1), -1, tree)
    except RecursionError:
        raise RecordingError(f"line {reader.number}: joints stand inside each other too deep") from None
    reader.expect("MOTION")
    count, frame_time = reader.expect("Frames:", 1), reader.expect("Frame", 2)
    frames = _numbers(reader, [count[0]])[0]
    seconds = _numbers(reader, frame_time[1:])[0]
    if frame_time[0].casefold() != "time:" or not seconds > 0.0 or frames < 1 or frames != int(frames):
        raise RecordingError(f"line {reader.number}: Frames and Frame Time have to be positive")
    width = sum(len(channels) for channels in tree.channels)
    rows = []
    for _ in range(int(frames)):
        words = reader.next(f"frame {len(rows) + 1} of {int(frames)}")
        if len(words) != width:
            raise RecordingError(f"line {reader.number}: {len(words)} values for {width} channels")
        rows.append(_numbers(reader, words))
    if reader.left:
        raise RecordingError(f"line {reader.number}: more rows follow than the {int(frames)} frames announced")
    return Skeleton(
        tuple(tree.names),
        tuple(tree.parents),
        np.array(tree.offsets),
        tuple(tree.channels),
        np.array(rows),
        seconds,
        tuple(tree.tip_parents),
        np.array(tree.tip_offsets).reshape(-1, 3),
    )


@dataclass(slots=True)
class _Tree:
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[tuple[str, ...]]
    tip_parents: list[int] = field(default_factory=list)
    tip_offsets: list[list[float]] = field(default_factory=list)


class _Reader:
    """Hands out the words of one line after the other."""

    def __init__(self, lines: list[tuple[int, list[str]]]) -> None:
        self._lines, self._at = lines, 0

    @property
    def left(self) -> int:
        return len(self._lines) - self._at

    @property
    def number(self) -> int:
        """Number of the line that was read last."""
        return self._lines[self._at - 1][0] if self._at else 1

    def next(self, wanted: str) -> list[str]:
        if not self.left:
            raise RecordingError(f"ends where {wanted} was to follow, after line {self.number}")
        self._at += 1
        return self._lines[self._at - 1][1]

    def expect(self, keyword: str, least: int = 0) -> list[str]:
        """What follows a keyword, in any case, in its line."""
        words = self.next(keyword)
        if words[0].casefold() != keyword.casefold() or len(words) <= least:
            raise RecordingError(f"line {self.number}: {keyword} was to follow, got {' '.join(words)[:60]!r}")
        return words[1:]


def _numbers(reader: _Reader, words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise RecordingError(f"line {reader.number}: {error}") from error
    if not np.all(np.isfinite(values)):
        raise RecordingError(f"line {reader.number}: a number is not finite")
    return values


def _read_joint(reader: _Reader, name: list[str], parent: int, tree: _Tree) -> None:
    """What stands in braces after ROOT or JOINT; stands below its parent, depth first."""
    reader.expect("{")
    offset = _numbers(reader, reader.expect("OFFSET", 3))
    counted, *channels = reader.expect("CHANNELS", 1)
    channels = [channel.capitalize() for channel in channels]
    if len(offset) != 3 or str(len(channels)) != counted or not set(channels) <= set(_CHANNELS):
        raise RecordingError(f"line {reader.number}: a joint needs 3 offsets and channels out of {_CHANNELS}")
    tree.names.append(" ".join(name))
    tree.parents.append(parent)
    tree.offsets.append(offset)
    tree.channels.append(tuple(channels))
    own = len(tree.names) - 1
    while (words := reader.next("JOINT, End Site or }"))[0] != "}":
        if words[0].casefold() == "joint" and len(words) > 1:
            _read_joint(reader, words[1:], own, tree)
        elif "".join(words[:2]).casefold() == "endsite":
            reader.expect("{")
            tip = _numbers(reader, reader.expect("OFFSET", 3))
            if len(tip) != 3:
                raise RecordingError(f"line {reader.number}: an end site needs 3 offsets")
            tree.tip_parents.append(own)
            tree.tip_offsets.append(tip)
            reader.expect("}")
        else:
            raise RecordingError(f"line {reader.number}: JOINT, End Site or }} was to follow, got {words[0]!r}")
