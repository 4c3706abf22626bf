"""People who move as somebody was recorded to."""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.files import load
from jssa_gym.humans.motion import CLEARANCE, HumanMotion
from jssa_gym.humans.recording import Recording, nearest_root
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import known_name, low_high, number_within, positive_number

REACH_AND_RETREAT = Path(__file__).parent / "recordings" / "reach_and_retreat.npz"
"""The recording that comes with the package; ``examples/make_recording.py`` synthesises it."""

_CLOSED = 1e-6
"""Distance within which the last sample of a recording that is played in a loop is the first [m]."""


def _held(time: float, duration: float) -> float:
    return min(time, duration)


def _looped(time: float, duration: float) -> float:
    return time % duration


def _to_and_fro(time: float, duration: float) -> float:
    return duration - abs(duration - time % (2.0 * duration))


_AFTERWARDS: dict[str, Callable[[float, float], float]] = {
    "hold": _held,
    "loop": _looped,
    "back_and_forth": _to_and_fro,
}


class Recorded(HumanMotion):
    """Plays a recording, linear between its samples, from a place that is drawn.

    All of it is turned about the base axis and moved along the floor. A person told to begin somewhere is turned until
    the root is in that direction and moved away from the base axis or towards it; then nothing is drawn. In the first
    step everything stands still.

    Args:
        recording: What to play: a :class:`Recording`, or a file of one, or of motion capture (``.bvh``); None for the
            one that comes with the package.
        turn: Range of the angle about the base axis, counter-clockwise from above [rad].
        offset: Ranges ((low, high), (low, high)) of the way along x and y, after the turn [m].
        afterwards: ``"hold"`` the last sample, play it in a ``"loop"``, which needs a recording that ends as it begins,
            or ``"back_and_forth"``.
        clearance: No placement brings the root, the first capsule's start, nearer to the base axis [m].
        pace: How fast it is played; 0.5 takes twice the time, at half the speed.

    Raises:
        RecordingError: The file is not a sound recording.
        ParameterError: A parameter is out of range, or no placement keeps ``clearance``.
    """

    reacts = False

    def __init__(
        self,
        recording: Recording | str | Path | None = None,
        *,
        turn: Sequence[float] = (-0.5, 0.5),
        offset: Sequence[Sequence[float]] = ((0.0, 0.1), (-0.1, 0.1)),
        afterwards: str = "hold",
        clearance: float = CLEARANCE,
        pace: float = 1.0,
    ) -> None:
        if not isinstance(recording, Recording):
            person = load(REACH_AND_RETREAT if recording is None else recording)
            if person.conversion is not None and person.conversion.unusual:
                warnings.warn(person.conversion.said, stacklevel=2)
            recording = person.recording
        self.recording, self.afterwards = recording, known_name("afterwards", afterwards, _AFTERWARDS)
        self.turn = low_high("turn", turn, -np.inf)
        if not isinstance(offset, Sequence | np.ndarray) or len(offset) != 2:
            raise ParameterError(f"offset has to be ((low, high), (low, high)), got {offset!r}")
        self.offset = low_high("offset", offset[0], -np.inf), low_high("offset", offset[1], -np.inf)
        self.clearance = number_within("clearance", clearance, 0.0)
        if (pace := positive_number("pace", pace)) != 1.0:
            self.recording = recording = replace(recording, time=recording.time / pace)
        if afterwards == "loop":
            self.recording = _closed(recording)
        self.speed_bound = self.recording.speed

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        if part not in self.recording.names:
            return super().end_speeds_of(part)
        start, end = self.recording.end_speeds[self.recording.names.index(part)].tolist()
        return start, end

    def check_start(self, start: Array) -> None:
        self._from(start)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        placed = self._drawn(rng) if start is None else self._from(start)
        self._time, self._ends = placed.time - placed.time[0], np.stack([placed.start, placed.end], axis=1)
        self._person = np.full(len(placed.radius), person, np.int64)
        self._clock, self._now = 0.0, self._ends[0].copy()
        self._velocity = np.zeros_like(self._now)
        return self._capsules()

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        self._now = self._now + self._velocity * dt
        self._clock += dt
        # aims at the sample to come from where the step before really led: nothing adds up
        self._velocity = (self._at(self._clock) - self._now) / dt
        return self._capsules()

    def _capsules(self) -> CapsuleSet:
        (start, end), (start_velocity, end_velocity) = self._now.copy(), self._velocity.copy()
        return CapsuleSet(
            start, end, start_velocity, end_velocity, self.recording.radius, self.recording.names, self._person
        )

    def _at(self, time: float) -> Array:
        """Starts and ends after so much time, shape (2, m, 3) [m]."""
        time = _AFTERWARDS[self.afterwards](time, float(self._time[-1]))
        k = min(max(int(np.searchsorted(self._time, time, side="right")) - 1, 0), len(self._time) - 2)
        share = (time - self._time[k]) / (self._time[k + 1] - self._time[k])
        return self._ends[k] + share * (self._ends[k + 1] - self._ends[k])

    def _drawn(self, rng: np.random.Generator) -> Recording:
        for _ in range(100):
            placed = self.recording.turned(rng.uniform(*self.turn))
            placed = placed.moved(np.array([rng.uniform(*along) for along in self.offset]))
            if float(np.hypot(*nearest_root(placed.root))) >= self.clearance:
                return placed
        raise ParameterError(f"no placement of the recording keeps {self.clearance} m from the base axis")

    def _from(self, start: Array) -> Recording:
        if not np.all(np.isfinite(start)):
            raise ParameterError(f"a start has to be finite, got {start.tolist()}")
        root = self.recording.root[0]
        bearing = math.atan2(start[1], start[0])
        placed = self.recording.turned(bearing - math.atan2(root[1], root[0]))
        placed = placed.moved(start - placed.root[0])
        nearest = float(np.hypot(*nearest_root(placed.root)))
        if nearest < self.clearance:
            raise ParameterError(
                f"from start {start.tolist()} the recording leads to {nearest:.2f} m from the base axis; "
                f"{self.clearance} m are kept"
            )
        return placed


def _closed(recording: Recording) -> Recording:
    """The same with a last sample that is the first."""
    gap = max(float(np.abs(ends[-1] - ends[0]).max()) for ends in (recording.start, recording.end))
    if gap > _CLOSED:
        raise ParameterError(
            f"a loop needs a recording that ends as it begins, it is {gap:.3g} m off; try 'back_and_forth'"
        )
    start, end = (np.concatenate([ends[:-1], ends[:1]]) for ends in (recording.start, recording.end))
    return replace(recording, start=start, end=end)
