"""From a skeleton to capsules: the paper's six, or one a bone of the limbs."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans.bvh.bodies import BODIES, capsules_of
from jssa_gym.humans.bvh.guess import UNIT_NAMES, UNITS, bones_to_head, calibration_frames, unit_of, up_of
from jssa_gym.humans.bvh.names import JOINTS, ends_of
from jssa_gym.humans.bvh.reader import read
from jssa_gym.humans.bvh.skeleton import Skeleton
from jssa_gym.humans.motion import CLEARANCE
from jssa_gym.humans.recording import Recording, nearest_root
from jssa_gym.types import Array
from jssa_gym.validation import known_name, positive_number, real_array

_UP = {"y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), "z": np.eye(3)}
"""Turns the file's upward axis to z."""

START = (1.5, 0.0)
"""Where people begin, in front of the arm [m]."""

_AWAY = CLEARANCE + 0.15
"""How near they come to the base axis, unless told where to begin [m]; a placement that is drawn takes up to 0.14."""

_USUAL = ("cm", "y")
"""Unit and axis that need not be said."""


@dataclass(frozen=True, slots=True, eq=False)
class CaptureOptions:
    """How a skeleton is to be read; see :func:`convert`.

    Raises:
        ParameterError: A value is out of range or unknown.
    """

    scale: float | str = "auto"
    up: str = "auto"
    joints: Mapping[str, tuple[str, str]] | None = None
    start: Array | tuple[float, float] | None = None
    """None for :data:`START`, or a place beside it from where the person does not walk into the base."""
    frames: tuple[int | None, int | None] | None = None
    body: str = "six"

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", _checked_joints(self.joints))
        if isinstance(self.scale, str):
            known_name("scale", self.scale, ("auto", *UNITS))
        else:
            object.__setattr__(self, "scale", positive_number("scale", self.scale))
        known_name("up", self.up, ("auto", *_UP))
        known_name("body", self.body, BODIES)
        if self.start is not None:
            object.__setattr__(self, "start", real_array("start", self.start, (2,), "a point on the floor [m]"))


@dataclass(frozen=True, slots=True, eq=False)
class Conversion:
    """A recording, and what was made of the file for it."""

    recording: Recording
    unit: str
    """Metres in a unit of the file, in words."""
    up: str
    """The file's upward axis."""
    first: int
    """The file's frame that became the first sample, from 0."""
    dropped: int
    """Frames left out at the beginning, because they are a pose for calibration."""
    length: float
    """From ankle to head along the bones [m]."""
    unusual: bool
    """Whether anything but centimetres with y up was guessed, or frames were left out."""
    standing: Recording
    """The recording where the file has it: not turned to the arm, nor moved there."""
    points: Array
    """The skeleton's joints and end sites there, shape (T, j + k, 3) [m]."""
    point_names: tuple[str, ...]

    @property
    def said(self) -> str:
        """What was taken for what, in words."""
        told = f"taken as {self.unit} with {self.up} up: {self.length:.2f} m from ankle to head along the bones"
        if self.dropped:
            frames = "frame 0 is" if self.dropped == 1 else f"frames 0 to {self.dropped - 1} are"
            told += f"; {frames} a pose for calibration, which the motion jumps away from, and left out"
        x, y = self.recording.root[0]
        return f"{told}; begins at ({x:.2f}, {y:.2f}) m"

    def outside(self) -> dict[str, float]:
        """How far joints and end sites are outside of all capsules, at most, by name [m], of those that ever are."""
        nearest = np.full(self.points.shape[:2], np.inf)
        for i, radius in enumerate(self.standing.radius):
            start, way = self.standing.start[:, i, None], (self.standing.end - self.standing.start)[:, i, None]
            length = np.maximum((way * way).sum(axis=-1), 1e-300)
            share = np.clip(((self.points - start) * way).sum(axis=-1) / length, 0.0, 1.0)
            away = np.linalg.norm(self.points - start - share[..., None] * way, axis=-1) - radius
            nearest = np.minimum(nearest, away)
        worst = nearest.max(axis=0)
        return {name: float(far) for name, far in zip(self.point_names, worst, strict=True) if far > 0.0}


def convert(
    skeleton: Skeleton | str | Path,
    *,
    scale: float | str = "auto",
    up: str = "auto",
    joints: Mapping[str, tuple[str, str]] | None = None,
    start: Array | tuple[float, float] = START,
    frames: tuple[int | None, int | None] | None = None,
    body: str = "six",
) -> Recording:
    """Capsules from a skeleton's joints: the paper's six, or more.

    The person begins at ``start`` and looks along -x there, towards the arm, as the shoulders tell. What had to be
    guessed and is not the usual, centimetres with y up, is a warning.

    Args:
        skeleton: What was read, or a file.
        scale: Metres in a unit of the file, or a unit: ``"m"``, ``"cm"``, ``"mm"``, ``"in"`` or ``"cmu"``
            (:data:`~jssa_gym.humans.bvh.UNITS`); ``"auto"`` for the one in which the bones from ankle to head are a
            person's.
        up: The file's upward axis, ``"y"`` or ``"z"``; ``"auto"`` for the one along which the head is above the feet.
        joints: Names of the joints that body parts start and end at, where :data:`JOINTS` does not know them.
        start: Where the root stands in the first frame, shape (2,) [m].
        frames: First frame to take, from 0, and the first not to take; None for the file's own. Without it a pose for
            calibration at the beginning is left out, see
            :func:`~jssa_gym.humans.bvh.guess.calibration_frames`.
        body: ``"six"``: an arm is one capsule from shoulder to hand, a leg one from hip to ankle, and an elbow or a
            knee that is bent leaves it; ``"jointed"``: every bone of arms and legs has its own, hands and feet too.

    Raises:
        RecordingError: The file is not BVH, a joint is missing, or unit or axis cannot be told; the message says what
            would help.
        ParameterError: An argument is out of range or unknown.
    """
    made = convert_told(skeleton, CaptureOptions(scale, up, joints, start, frames, body))
    if made.unusual:
        warnings.warn(made.said, stacklevel=2)
    return made.recording


def convert_told(skeleton: Skeleton | str | Path, options: CaptureOptions) -> Conversion:
    """:func:`convert` that says what it did instead of warning of it."""
    if not isinstance(skeleton, Skeleton):
        skeleton = read(skeleton)
    chosen = options.joints or {}
    ends = {part: ends_of(skeleton, part, chosen.get(part)) for part in JOINTS}
    first, last = _checked_frames(options.frames, len(skeleton.frames))
    raw = skeleton.points()[first:last]
    if len(raw) < 2:
        raise RecordingError("a motion needs two frames at least, this skeleton has one")
    unit = options.scale if isinstance(options.scale, str) else ""
    unit = unit_of(skeleton, raw, ends) if unit == "auto" else unit
    metres = UNITS[unit] if unit else float(options.scale)
    up = up_of(raw, ends) if options.up == "auto" else options.up
    joints = len(skeleton.names)
    points = np.concatenate(
        [np.ascontiguousarray(some) @ (_UP[up] * metres).T for some in (raw[:, :joints], raw[:, joints:])], axis=1
    )
    dropped = 0
    if options.frames is None and (dropped := calibration_frames(skeleton, points, ends)):
        first, points = dropped, points[dropped:]
    standing = capsules_of(skeleton, points, ends, options.body)
    x, y = points[0, ends["right_arm"][0], :2] - points[0, ends["left_arm"][0], :2]
    if np.hypot(x, y) < 1e-9:
        raise ParameterError("the shoulders are above each other: is 'up' the right axis?")
    # the right shoulder comes to lie at +y of the left one
    recording = standing.turned(np.pi / 2.0 - np.arctan2(y, x))
    recording = recording.moved(np.asarray(START if options.start is None else options.start) - recording.root[0])
    if options.start is None:
        recording = _beside_base(recording)
    guessed = (options.scale == "auto" and unit != _USUAL[0]) or (options.up == "auto" and up != _USUAL[1])
    return Conversion(
        recording,
        UNIT_NAMES[unit] if unit else f"units of {metres:g} m",
        up,
        first,
        dropped,
        bones_to_head(skeleton, points, ends),
        guessed or bool(dropped),
        standing,
        points,
        skeleton.point_names,
    )


def _beside_base(recording: Recording) -> Recording:
    """The same, moved along the floor as far as it takes not to walk into the base."""
    moved = recording
    for _ in range(100):
        nearest = nearest_root(moved.root)
        distance = float(np.hypot(*nearest))
        if distance >= _AWAY:
            return moved
        outwards = nearest / distance if distance > 1e-6 else np.array([0.0, 1.0])
        moved = moved.moved((_AWAY + 1e-6 - distance) * outwards)
    return recording.moved(np.array([_AWAY - recording.root[:, 0].min(), 0.0]))  # it goes around the base


def _checked_joints(joints: Mapping[str, tuple[str, str]] | None) -> Mapping[str, tuple[str, str]]:
    chosen = {} if joints is None else joints
    if not isinstance(chosen, Mapping):
        raise ParameterError(f"joints has to be body parts and the names of their two joints, got {joints!r}")
    for part, pair in chosen.items():
        known_name("body part in joints", part, JOINTS)
        if isinstance(pair, str) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            raise ParameterError(f"joints[{part!r}] has to be the names of two joints, got {pair!r}")
    return chosen


def _checked_frames(frames: tuple[int | None, int | None] | None, count: int) -> tuple[int, int]:
    """First frame to take and the first not to take."""
    if frames is None:
        return 0, count
    if isinstance(frames, Sequence) and len(frames) == 2:
        first, last = (end if one is None else one for one, end in zip(frames, (0, count), strict=True))
        whole = all(isinstance(one, Integral) and not isinstance(one, bool) for one in (first, last))
        if whole and 0 <= first <= last - 2 <= count - 2:
            return int(first), int(last)
    raise ParameterError(
        "frames has to be the first frame to take, from 0, and the first not to take, two frames apart at least; the "
        f"file has {count}, got {frames!r}"
    )
