"""People as a camera sees them: keypoints, now and then, late, of some of the body, made capsules by perception."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.bursts import Bursts
from jssa_gym.exceptions import ParameterError
from jssa_gym.perception import SKELETONS, Frame, Tracker, TrackerParams
from jssa_gym.perception.skeletons import BODIES
from jssa_gym.perception.synthetic import keypoints_of, people_in
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Array, Scene
from jssa_gym.validation import check_fields, known_name, number_within, positive_integer, positive_number

_ROUNDING = 1e-9
"""A picture counts as due, or arrived, this much early [s]: times are multiples of the control step up to rounding."""


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """A camera and the detector behind it; what it finds goes through :class:`jssa_gym.perception.Tracker`.

    Probabilities are per picture, of something's beginning while it is not on already; it then lasts a number of
    pictures drawn evenly from 1 to ``..._frames``.

    Raises:
        ParameterError: A value is out of range or unknown.
    """

    rate: float
    """Pictures a second [Hz]."""
    latency: float = 0.0
    """Time from a picture to the keypoints' arrival [s]."""
    jitter: float = 0.0
    """Further delay of each picture's, drawn evenly from [0, jitter] [s]; those overtaken are left out."""
    noise: float = 0.0
    """Each keypoint is displaced by a vector no longer than this, drawn evenly from the ball [m]: a bound."""
    occlusion: float = 0.0
    """Probability that a keypoint is no longer found."""
    occlusion_frames: int = 1
    swap: float = 0.0
    """Probability that two people are taken for each other; with one person nothing."""
    swap_frames: int = 1
    skeleton: str = "coco17"
    """Name in :data:`jssa_gym.perception.SKELETONS`."""
    body: str = "six"
    """Body that is reported (:meth:`jssa_gym.perception.KeypointTable.body`): ``"six"`` are the environments' own."""
    position_error: float = 0.03
    """What the reported capsules keep to [m], at least ``noise``."""
    max_age: float = 0.4
    """What a shield behind this camera may assume for the oldest measurement that it goes on with [s]."""

    def __post_init__(self) -> None:
        check_fields(self, ("rate", "max_age"), positive_number)
        check_fields(self, ("latency", "jitter", "noise"), number_within, 0.0)
        check_fields(self, ("occlusion", "swap"), number_within, 0.0, 1.0)
        check_fields(self, ("occlusion_frames", "swap_frames"), positive_integer)
        known_name("skeleton", self.skeleton, SKELETONS)
        known_name("body", self.body, BODIES)
        if not number_within("position_error", self.position_error, 0.0) >= max(self.noise, 1e-4):
            raise ParameterError(
                f"position_error has to be at least the noise, {self.noise} m, and 0.1 mm; got {self.position_error}"
            )

    @property
    def assumptions(self) -> FailsafeParams:
        """What a verified stop behind this camera has to assume."""
        return FailsafeParams(position_error=self.position_error, max_age=self.max_age)

    @property
    def reported(self) -> bool:
        """Whether age and validity, with the bound on the error, tell all: nothing delivered as good is wrong."""
        return self.swap == 0.0


CAMERAS: dict[str, CameraSettings] = {
    "camera 30 Hz": CameraSettings(30.0, latency=0.1, noise=0.02, occlusion=0.005, occlusion_frames=8),
    "camera 30 Hz, swapped ids": CameraSettings(
        30.0, latency=0.1, noise=0.02, occlusion=0.005, occlusion_frames=8, swap=0.02, swap_frames=15
    ),
}
"""Settings for campaigns by name."""


class KeypointCamera:
    """Looks at the truth and shows what perception makes of it.

    Args:
        settings: What is seen of people, and when.
        truth: The scene that an episode begins with.

    Raises:
        ParameterError: The people have other parts than the package's own.
    """

    def __init__(self, settings: CameraSettings, truth: Scene) -> None:
        self.settings = settings
        self._people = people_in(truth.human)
        params = TrackerParams(sure=max(settings.noise, 1e-4), unsure=1.0)
        self._tracker = (
            Tracker(settings.skeleton, settings.assumptions, self._people, body=settings.body, params=params)
            if self._people
            else None
        )
        count = 0 if self._tracker is None else len(self._tracker.skeleton.keypoints)
        self._hidden = Bursts(settings.occlusion, settings.occlusion_frames, len(self._people) * count)
        self._swaps = Bursts(settings.swap, settings.swap_frames)
        self._exchanged = (0, 0)
        self._pictures = 0
        self._under_way: list[tuple[float, Frame]] = []

    def perceive(self, truth: Scene, rng: np.random.Generator) -> Scene:
        """What is known of the people now."""
        tracker = self._tracker
        if tracker is None:
            return truth
        if self._pictures <= (due := (truth.time + _ROUNDING) * self.settings.rate):
            # taken at the first tick at or after its time, and stamped then; one a tick at most
            self._pictures = int(due) + 1
            self._take(tracker, truth, rng)
        arrived = [one for one in self._under_way if one[0] <= truth.time + _ROUNDING]
        self._under_way = [one for one in self._under_way if one[0] > truth.time + _ROUNDING]
        for _, frame in sorted(arrived, key=lambda one: one[1].stamp):
            tracker.update(frame)
        return tracker.at(truth.time).shown_in(truth)

    def _take(self, tracker: Tracker, truth: Scene, rng: np.random.Generator) -> None:
        settings = self.settings
        ids, points = keypoints_of(truth.human, tracker.skeleton)
        self._hidden.step(rng)
        seen = ~self._hidden.on.reshape(points.shape[:2])
        if settings.noise > 0.0:
            points = points + settings.noise * in_ball(rng, points.shape[:2])
        ids = self._called(ids, rng)
        points[~seen] = np.nan
        delay = settings.latency + (settings.jitter * rng.random() if settings.jitter > 0.0 else 0.0)
        confidence = np.isfinite(points).all(axis=2).astype(np.float64)
        self._under_way.append((truth.time + delay, Frame(truth.time, ids, points, confidence)))

    def _called(self, ids: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
        """What the detector calls people."""
        if len(ids) < 2:
            return ids
        if self._swaps.step(rng)[0]:
            one, other = rng.choice(len(ids), 2, replace=False).tolist()
            self._exchanged = one, other
        if self._swaps.on[0]:
            one, other = self._exchanged
            ids = ids.copy()
            ids[[one, other]] = ids[[other, one]]
        return ids


def directions(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Unit vectors drawn evenly, shape (*shape, 3)."""
    return _unit(rng.standard_normal((*shape, 3)))


def in_ball(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Points drawn evenly from the unit ball, shape (*shape, 3)."""
    return to_ball(rng.standard_normal((*shape, 3)), rng.random((*shape, 1)))


def to_ball(normal: Array, even: Array) -> Array:
    """Points of the unit ball, evenly, of standard normal vectors (..., 3) and even numbers (..., 1) in [0, 1)."""
    # rounding must not carry a point beyond the bound that is promised
    return _unit(normal) * (even ** (1.0 / 3.0) * (1.0 - 1e-12))


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
