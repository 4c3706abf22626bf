"""What a detector finds in a picture, and how good it is."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from jssa_gym.perception.filtering import velocity_lag
from jssa_gym.validation import check_fields, number_within, positive_number


class Frame(NamedTuple):
    """What a detector found in one picture: p people of k keypoints."""

    stamp: float
    """When the picture was taken, by the scene's clock [s]."""
    person: Any
    """Ids, shape (p,)."""
    position: Any
    """Keypoints in the world, z up, the robot's base on the z axis, shape (p, k, 3) [m]; NaN where not found."""
    confidence: Any
    """In [0, 1], shape (p, k); 0 where not found."""


@dataclass(frozen=True, slots=True)
class TrackerParams:
    """How good a detector is, and what to do when it does not see.

    Raises:
        ParameterError: A number is out of range.
    """

    sure: float = 0.02
    """Largest error of a keypoint of confidence 1 [m]: a bound, no deviation. In between it is linear."""
    unsure: float = 0.10
    """The same at confidence 0 [m]."""
    hold: float = 1.0
    """How long a joint that is not seen is held by the limb that it ends [s]; then its parts are invalid."""
    acceleration: float = 10.0
    """No keypoint changes its velocity faster [m/s²]: what the filter expects, and ``velocity_error`` relies on."""
    deviation: float = 0.5
    """Standard deviation of a keypoint's error along an axis, as a share of its largest error."""

    def __post_init__(self) -> None:
        check_fields(self, ("sure",), positive_number)
        check_fields(self, ("unsure",), number_within, self.sure)
        check_fields(self, ("hold",), number_within, 0.0)
        check_fields(self, ("acceleration", "deviation"), positive_number)

    def lag(self, rate: float) -> float:
        """The time by which velocities lag behind a steady acceleration at so many frames a second [s].

        Raises:
            ParameterError: The rate is not positive.
        """
        return velocity_lag(positive_number("rate", rate), self.sure, self.acceleration, self.deviation)
