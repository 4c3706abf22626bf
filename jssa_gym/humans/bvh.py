"""From a BVH motion capture file to the six capsules.

``convert("walk.bvh", scale=0.01).save("walk.npz")`` makes what :class:`~jssa_gym.humans.Recorded` plays. A BVH file is
a tree of joints with offsets and Euler angles (``HIERARCHY``) and a row of numbers a frame (``MOTION``). The frame of a
joint in its parent's is the translation by offset and position channels, then the rotations in the order of its
channels, each about an axis that the ones before have turned.

An arm becomes one straight capsule from shoulder to hand, a leg one from hip to ankle: that is the paper's body, and an
elbow or a knee that is bent leaves it.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans.body import PARTS
from jssa_gym.humans.recording import Recording
from jssa_gym.storage import read_text
from jssa_gym.types import Array
from jssa_gym.validation import known_name, positive_number, real_array

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")

JOINTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "head": (("Head",), ("Head",)),
    "core_body": (("Hips", "Pelvis", "Root"), ("Neck", "Neck1", "Chest", "Spine2", "Spine1")),
    "right_arm": (("RightArm", "RightUpArm", "RightShoulder"), ("RightHand", "RightWrist")),
    "left_arm": (("LeftArm", "LeftUpArm", "LeftShoulder"), ("LeftHand", "LeftWrist")),
    "right_leg": (("RightUpLeg", "RightHip", "RightThigh"), ("RightFoot", "RightAnkle")),
    "left_leg": (("LeftUpLeg", "LeftHip", "LeftThigh"), ("LeftFoot", "LeftAnkle")),
}
"""The joints that a capsule starts and ends at, by the names that they have in common skeletons; the first that is
there counts. Case does not matter, nor what stands before a colon (``mixamorig:Head``)."""

_UP = {"y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), "z": np.eye(3)}
"""Turns the file's upward axis to z."""


@dataclass(frozen=True, slots=True, eq=False)
class Skeleton:
    """A BVH file as it is: its units, its axes."""

    names: tuple[str, ...]
    """Of the joints, each after its parent."""
    parents: tuple[int, ...]
    """-1 for the root."""
    offsets: Array
    """Of each joint in its parent's frame, shape (j, 3)."""
    channels: tuple[tuple[str, ...], ...]
    """Of each joint, in their order."""
    frames: Array
    """Values of all channels, shape (T, c); angles in degrees."""
    frame_time: float
    """[s]."""

    def positions(self) -> Array:
        """Where the joints are, by forward kinematics, shape (T, j, 3)."""
        count = len(self.frames)
        places, turns = np.empty((count, len(self.names), 3)), np.empty((len(self.names), count, 3, 3))
        column = 0
        for j, parent in enumerate(self.parents):
            shift, turn = np.tile(self.offsets[j], (count, 1)), np.tile(np.eye(3), (count, 1, 1))
            for channel in self.channels[j]:
                axis, values = "XYZ".index(channel[0]), self.frames[:, column]
                if channel.endswith("position"):
                    shift[:, axis] += values
                else:
                    turn = turn @ _about(axis, np.radians(values))
                column += 1
            if parent < 0:
                places[:, j], turns[j] = shift, turn
            else:
                places[:, j] = places[:, parent] + np.einsum("tij,tj->ti", turns[parent], shift)
                turns[j] = turns[parent] @ turn
        return places


def _about(axis: int, angle: Array) -> Array:
    """Rotations about a coordinate axis, shape (T, 3, 3)."""
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -out[:, j, i]
    return out


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
    if frame_time[0] != "Time:" or not seconds > 0.0 or frames < 1 or frames != int(frames):
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
        tuple(tree.names), tuple(tree.parents), np.array(tree.offsets), tuple(tree.channels), np.array(rows), seconds
    )


@dataclass(slots=True)
class _Tree:
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[tuple[str, ...]]


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
        """What follows a keyword in its line."""
        words = self.next(keyword)
        if words[0] != keyword or len(words) <= least:
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
    if len(offset) != 3 or str(len(channels)) != counted or not set(channels) <= set(_CHANNELS):
        raise RecordingError(f"line {reader.number}: a joint needs 3 offsets and channels out of {_CHANNELS}")
    tree.names.append(" ".join(name))
    tree.parents.append(parent)
    tree.offsets.append(offset)
    tree.channels.append(tuple(channels))
    own = len(tree.names) - 1
    while (words := reader.next("JOINT, End Site or }"))[0] != "}":
        if words[0] == "JOINT" and len(words) > 1:
            _read_joint(reader, words[1:], own, tree)
        elif words[:2] == ["End", "Site"]:
            reader.expect("{")
            _numbers(reader, reader.expect("OFFSET", 3))
            reader.expect("}")
        else:
            raise RecordingError(f"line {reader.number}: JOINT, End Site or }} was to follow, got {words[0]!r}")


def convert(
    skeleton: Skeleton | str | Path,
    *,
    scale: float = 0.01,
    up: str = "y",
    joints: Mapping[str, tuple[str, str]] | None = None,
    start: Array | tuple[float, float] = (1.5, 0.0),
) -> Recording:
    """The paper's six capsules from a skeleton's joints.

    The person begins at ``start`` and looks along -x there, towards the arm, as the shoulders tell.

    Args:
        skeleton: What was read, or a file.
        scale: Metres in a unit of the file; 0.01 for centimetres.
        up: The file's upward axis, ``"y"`` or ``"z"``.
        joints: Names of the joints that capsules start and end at, where :data:`JOINTS` does not know them.
        start: Where the root stands in the first frame, shape (2,) [m].

    Raises:
        RecordingError: The file is not BVH, or a joint is missing; the message lists those that are there.
        ParameterError: An argument is out of range or unknown.
    """
    if not isinstance(skeleton, Skeleton):
        skeleton = read(skeleton)
    chosen = {} if joints is None else joints
    if not isinstance(chosen, Mapping):
        raise ParameterError(f"joints has to be body parts and the names of their two joints, got {joints!r}")
    for part, pair in chosen.items():
        known_name("body part in joints", part, JOINTS)
        if isinstance(pair, str) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            raise ParameterError(f"joints[{part!r}] has to be the names of two joints, got {pair!r}")
    ends = [_ends_of(skeleton, part, chosen.get(part)) for part in JOINTS]
    turn = _UP[known_name("up", up, _UP)] * positive_number("scale", scale)
    where = real_array("start", start, (2,), "a point on the floor [m]")
    if len(skeleton.frames) < 2:
        raise RecordingError("a motion needs two frames at least, this skeleton has one")
    places = skeleton.positions() @ turn.T
    time = np.array([k * skeleton.frame_time for k in range(len(places))])
    names, radius = tuple(JOINTS), np.array([radius for _, _, _, radius in PARTS])
    first, last = ([end[k] for end in ends] for k in (0, 1))
    recording = Recording(time, places[:, first], places[:, last], radius, names)
    x, y = recording.start[0, names.index("right_arm"), :2] - recording.start[0, names.index("left_arm"), :2]
    if np.hypot(x, y) < 1e-9:
        raise ParameterError("the shoulders are above each other: is 'up' the right axis?")
    # the right shoulder comes to lie at +y of the left one
    recording = recording.turned(np.pi / 2.0 - np.arctan2(y, x))
    return recording.moved(where - recording.root[0])


def _ends_of(skeleton: Skeleton, part: str, chosen: tuple[str, str] | None) -> tuple[int, int]:
    """Indices of the joints that a capsule starts and ends at."""
    plain = [name.rsplit(":", 1)[-1].casefold() for name in skeleton.names]
    found = []
    for names in JOINTS[part] if chosen is None else ((chosen[0],), (chosen[1],)):
        known = [name.rsplit(":", 1)[-1].casefold() for name in names]
        index = next((plain.index(name) for name in known if name in plain), None)
        if index is None:
            raise RecordingError(
                f"no joint {' or '.join(names)} for {part}; name one in joints, out of: {', '.join(skeleton.names)}"
            )
        found.append(index)
    return found[0], found[1]
