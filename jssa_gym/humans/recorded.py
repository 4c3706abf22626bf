"""People who move as somebody was recorded to."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.body import turning
from jssa_gym.humans.files import load
from jssa_gym.humans.motion import CLEARANCE, HumanMotion
from jssa_gym.humans.recording import Recording, nearest_root
from jssa_gym.kernels.playing import BACK_AND_FORTH, HOLD, LOOP, PLAYER, aim_player, step_player
from jssa_gym.kernels.records import records
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import known_name, low_high, number_within, positive_number

REACH_AND_RETREAT = Path(__file__).parent / "recordings" / "reach_and_retreat.npz"
"""The recording that comes with the package; ``examples/make_recording.py`` synthesises it."""

Placement = tuple[Array, Array]
"""Where a recording is played: a turn about the base axis, shape (3, 3), then a way, shape (3,) [m]."""

_CLOSED = 1e-6
"""Distance within which the last sample of a recording that is played in a loop is the first [m]."""


_AFTERWARDS = {"hold": HOLD, "loop": LOOP, "back_and_forth": BACK_AND_FORTH}


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
    times: Array
    """Times of the samples, the first is 0, shape (T,) [s]."""
    record: NDArray[Any]
    """Where in the recording it is, shape (1,) of ``PLAYER``."""
    samples: Array
    """The two samples that it is between, placed: starts and ends, shape (2, 2, m, 3) [m]."""
    ends: Array
    """Starts, ends and their velocities, shape (4, m, 3) [m, m/s]."""
    placement: Placement

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
        self.times = self.recording.time - self.recording.time[0]

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        if part not in self.recording.names:
            return super().end_speeds_of(part)
        start, end = self.recording.end_speeds[self.recording.names.index(part)].tolist()
        return start, end

    def check_start(self, start: Array) -> None:
        self._from(start)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        self.placement = self._drawn(rng) if start is None else self._from(start)
        self.record, self.samples = records(1, PLAYER), self._placed(0)
        self.record[0]["afterwards"] = _AFTERWARDS[self.afterwards]
        self.ends = np.concatenate([self.samples[0], np.zeros_like(self.samples[0])])
        self._person = np.full(len(self.recording.radius), person, np.int64)
        return self._capsules()

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        chosen = step_player(self.record, self.times, self.samples, dt, self.ends)
        while not chosen:
            player = self.record[0]
            self.samples, player["placed"] = self._placed(int(player["sample"])), player["sample"]
            chosen = aim_player(self.record, self.times, self.samples, dt, self.ends)
        return self._capsules()

    def _capsules(self) -> CapsuleSet:
        return CapsuleSet(*self.ends.copy(), self.recording.radius, self.recording.names, self._person)

    def _placed(self, sample: int) -> Array:
        """A sample and the next as they are placed: starts and ends, shape (2, 2, m, 3) [m]."""
        return self.recording.ends_at(np.array([sample]), self.placement[0][None], self.placement[1][None])[0]

    def _drawn(self, rng: np.random.Generator) -> Placement:
        for _ in range(100):
            turn = turning(rng.uniform(*self.turn))
            way = np.array([*(rng.uniform(*along) for along in self.offset), 0.0])
            if self._nearest(turn, way) >= self.clearance:
                return turn, way
        raise ParameterError(f"no placement of the recording keeps {self.clearance} m from the base axis")

    def _nearest(self, turn: Array, way: Array) -> float:
        """How near to the base axis a placement leads the root [m]."""
        return float(np.hypot(*nearest_root((self.recording.start @ turn.T + way)[:, 0, :2])))

    def _from(self, start: Array) -> Placement:
        if not np.all(np.isfinite(start)):
            raise ParameterError(f"a start has to be finite, got {start.tolist()}")
        root = self.recording.root[0]
        turn = turning(math.atan2(start[1], start[0]) - math.atan2(root[1], root[0]))
        way = np.append(start - (self.recording.start[:1] @ turn.T)[0, 0, :2], 0.0)
        nearest = self._nearest(turn, way)
        if nearest < self.clearance:
            raise ParameterError(
                f"from start {start.tolist()} the recording leads to {nearest:.2f} m from the base axis; "
                f"{self.clearance} m are kept"
            )
        return turn, way


def _closed(recording: Recording) -> Recording:
    """The same with a last sample that is the first."""
    gap = max(float(np.abs(ends[-1] - ends[0]).max()) for ends in (recording.start, recording.end))
    if gap > _CLOSED:
        raise ParameterError(
            f"a loop needs a recording that ends as it begins, it is {gap:.3g} m off; try 'back_and_forth'"
        )
    start, end = (np.concatenate([ends[:-1], ends[:1]]) for ends in (recording.start, recording.end))
    return replace(recording, start=start, end=end)
