"""What a recording shows at a look.

Whether its numbers can be those of a person who stands on a floor, in metres and seconds, z up, without gaps and jumps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from jssa_gym.text import counted
from jssa_gym.types import Array

if TYPE_CHECKING:
    from jssa_gym.humans.recording import Recording

_LARGEST_LENGTH, _LARGEST_HEIGHT, _LARGEST_RADIUS = 10.0, 10.0, 2.0
"""Length of a capsule, height of its ends, radius, that no person has [m]."""

_TALL = (1.0, 2.4)
"""Height of people, capsules included [m]."""

_FLOOR = (-0.1, 0.3)
"""Height of the axis of whatever is lowest, in somebody who stands or walks [m]."""

_SPARSE, _HARDLY = 1.0, 0.05
"""Time between samples [s] from which a motion that hardly moves [m/s] looks like one in milliseconds."""

_GAP, _GAP_SHARE, _GAP_WAY = 0.25, 5.0, 0.02
"""A gap is longer than this [s], than so many usual steps, and somebody moves that far in it [m]."""

_JUMPS = ((15.0, 0.3), (6.0, 1.5))
"""Speeds [m/s] and ways [m] of a step that nobody makes who works; hands of good throwers reach 20 m/s."""

_UPRIGHT = {
    "x": "y, z and x",
    "y": "x, -z and y",
    "-x": "z, y and -x",
    "-y": "x, z and -y",
    "-z": "x, -y and -z",
}
"""What to take for x, y and z if that axis points up; rotations all."""

_FEET = ("foot", "feet", "ankle", "toe", "leg")

Kind = Literal["lengths", "time", "upright", "height", "floor", "gap", "jump"]

REFUSED: tuple[Kind, ...] = ("lengths", "time", "upright", "jump")
"""Findings with which a table is no recording of a person."""


@dataclass(frozen=True, slots=True)
class Oddity:
    """Something that is not as in people."""

    kind: Kind
    what: str
    """What was found and where."""
    cure: str
    """What to change."""

    def __str__(self) -> str:
        return f"{self.what}; {self.cure}"


@dataclass(frozen=True, slots=True)
class Source:
    """Where the samples stand in their file."""

    rows: Sequence[int] | None = None
    """Line of every sample in a table."""
    noun: str = "sample"
    """What a sample is there."""
    first: int = 0
    """Number of the first sample."""

    def sample(self, k: int) -> str:
        """Where a sample is, in words."""
        return f"{self.noun} {self.first + k}" if self.rows is None else f"row {self.rows[k]}"

    def value(self, k: int, name: str) -> str:
        """Where a value is, in words."""
        column = "" if self.rows is None else "column "
        return f"{self.sample(k)}, {column}{name}"


def survey(recording: "Recording", source: Source | None = None) -> list[Oddity]:
    """All that is not as in people.

    Args:
        recording: Any.
        source: Where its samples stand in their file; for the messages.
    """
    source = Source() if source is None else source
    found = list(_lengths(recording, source))
    if not found:
        # of something in millimetres the rest need not be told
        found = [
            *_time(recording, source),
            *_upright(recording, source),
            *_height(recording),
            *_floor(recording),
            *_gaps(recording, source),
            *_jumps(recording, source),
        ]
    return found


def height_of(recording: "Recording") -> float:
    """Height from the lowest axis to the top of the highest capsule, the median of the samples [m]."""
    heights = np.stack([recording.start[:, :, 2], recording.end[:, :, 2]])
    top = (heights + recording.radius).max(axis=(0, 2))
    return float(np.median(top - heights.min(axis=(0, 2))))


def lowest_of(recording: "Recording") -> float:
    """Height above the floor of the lowest capsule's axis, in the median of the samples [m]."""
    return float(np.median(np.minimum(recording.start[:, :, 2], recording.end[:, :, 2]).min(axis=1)))


def steps_of(recording: "Recording") -> Array:
    """Ways of starts and ends from each sample to the next, shape (T - 1, m, 2) [m]."""
    ends = np.stack([recording.start, recording.end], axis=2)
    return np.linalg.norm(np.diff(ends, axis=0), axis=-1)


def _lengths(recording: "Recording", source: Source) -> Iterator[Oddity]:
    said = "metres are meant: convert millimetres or centimetres"
    if source.rows is not None:
        said += ", or say the unit in the header, as in 'head.start.x [mm]'"
    if (i := int(recording.radius.argmax())) >= 0 and recording.radius[i] > _LARGEST_RADIUS:
        where = source.value(0, f"{recording.names[i]}.radius")
        yield Oddity("lengths", f"{where}: a radius of {recording.radius[i]:.4g} m", said)
        return
    length = np.linalg.norm(recording.end - recording.start, axis=-1)
    k, i = np.unravel_index(int(length.argmax()), length.shape)
    if length[k, i] > _LARGEST_LENGTH:
        where = source.value(int(k), f"{recording.names[i]}.end.x")
        yield Oddity("lengths", f"{where}: {recording.names[i]} is {length[k, i]:.4g} m long", said)
        return
    heights = np.stack([recording.start[:, :, 2], recording.end[:, :, 2]], axis=2)
    if np.median(np.abs(heights), axis=0).max() > _LARGEST_HEIGHT:
        k, i, end = np.unravel_index(int(np.abs(heights).argmax()), heights.shape)
        where = source.value(int(k), f"{recording.names[i]}.{('start', 'end')[end]}.z")
        yield Oddity("lengths", f"{where}: a height of {heights[k, i, end]:.4g} m", said)


def _time(recording: "Recording", source: Source) -> Iterator[Oddity]:
    step = np.diff(recording.time)
    speed = float(np.percentile(steps_of(recording).max(axis=(1, 2)) / step, 90.0))
    if len(step) >= 4 and np.median(step) >= _SPARSE and 0.0 < speed < _HARDLY:
        cure = "seconds are meant: convert milliseconds or microseconds"
        if source.rows is not None:
            cure += ", or say the unit in the header, as in 'time [ms]'"
        yield Oddity(
            "time",
            f"{source.value(1, 'time')}: a sample comes every {np.median(step):.4g} s, and nobody moves faster than "
            f"{speed:.2g} m/s",
            cure,
        )


def _upright(recording: "Recording", source: Source) -> Iterator[Oddity]:
    names = [name.casefold() for name in recording.names]
    head = next((i for i, name in enumerate(names) if "head" in name), None)
    feet = [i for i, name in enumerate(names) if any(foot in name for foot in _FEET)]
    if head is None or not feet:
        return
    low = (recording.start[:, feet].mean(axis=1) + recording.end[:, feet].mean(axis=1)) / 2.0
    way = np.median(recording.start[:, head] - low, axis=0)
    axis = int(np.abs(way).argmax())
    if axis == 2 and way[2] > 0.0:
        return
    where = source.value(0, f"{recording.names[head]}.start.{'xyz'[axis]}")
    sign = "-" if way[axis] < 0.0 else ""
    yield Oddity(
        "upright",
        f"{where}: the head is above the legs along "
        f"{sign}{'xyz'[axis]}, in most samples by {abs(way[axis]):.2f} m, and along z by {way[2]:.2f} m",
        f"z has to point up: write {_UPRIGHT[sign + 'xyz'[axis]]} as x, y and z, if this is somebody who stands",
    )


def _height(recording: "Recording") -> Iterator[Oddity]:
    height = height_of(recording)
    if not _TALL[0] <= height <= _TALL[1] and len(recording.names) > 1:
        yield Oddity(
            "height",
            f"the person is {height:.2f} m tall in most samples, capsules included",
            f"people are {_TALL[0]:g} to {_TALL[1]:g} m: is the unit right, and do they stand?",
        )


def _floor(recording: "Recording") -> Iterator[Oddity]:
    lowest = lowest_of(recording)
    if len(recording.names) > 1 and not _FLOOR[0] <= lowest <= _FLOOR[1]:
        where = f"{-lowest:.2f} m below" if lowest < 0.0 else f"{lowest:.2f} m above"
        yield Oddity(
            "floor",
            f"what is lowest of the body is {where} the floor in most samples",
            f"the floor is at z = 0: add {0.08 - lowest:.2f} m to all heights, if they stand on it",
        )


def _gaps(recording: "Recording", source: Source) -> Iterator[Oddity]:
    step, way = np.diff(recording.time), steps_of(recording).max(axis=(1, 2))
    gaps = np.flatnonzero((step > max(_GAP, _GAP_SHARE * float(np.median(step)))) & (way > _GAP_WAY))
    if len(gaps):
        k = int(gaps[0])
        more = f", and {len(gaps) - 1} more" if len(gaps) > 1 else ""
        yield Oddity(
            "gap",
            f"{source.value(k + 1, 'time')}: a gap of {step[k]:.2f} s after {source.sample(k)}, at "
            f"{recording.time[k]:.3f} s{more}",
            f"it is played as a straight line of {way[k]:.2f} m; fill it, or cut there",
        )


def _jumps(recording: "Recording", source: Source) -> Iterator[Oddity]:
    step, way = np.diff(recording.time), steps_of(recording)
    speed = way / step[:, None, None]
    jumps = np.any([(speed > fast) & (way > far) for fast, far in _JUMPS], axis=0)
    if np.any(jumps):
        k, i, end = (int(one) for one in np.argwhere(jumps)[0])
        ends = (recording.start, recording.end)[end]
        axis = int(np.abs(ends[k + 1, i] - ends[k, i]).argmax())
        steps = int(jumps.any(axis=(1, 2)).sum())
        more = f"; so do parts in {counted(steps - 1, 'more step')}" if steps > 1 else ""
        where = source.value(k + 1, f"{recording.names[i]}.{('start', 'end')[end]}.{'xyz'[axis]}")
        yield Oddity(
            "jump",
            f"{where}: jumps by {way[k, i, end]:.2f} m within {step[k]:.3g} s, {speed[k, i, end]:.3g} m/s, at "
            f"{recording.time[k + 1]:.3f} s{more}",
            "nobody does that: leave lost markers out, or cut there",
        )
