"""What a planner offers a shield beside its nominal: jerks in order of preference, taken so that nothing can fail."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from jssa_gym.shields.alarm import Alarm
from jssa_gym.tick.layout import ALTERNATIVES
from jssa_gym.types import Array


@runtime_checkable
class Path(Protocol):
    """A motion that can be slowed down along itself, such as :class:`jssa_gym.control.PacedPath`."""

    @property
    def override(self) -> float:
        """The pace that it asked for last, 1 for its own."""
        ...

    def alternatives(self, state: Array, margin: float) -> Array:
        """Jerks for this control step in order of preference, shape (a, n) with a up to 8 [rad/s³].

        Args:
            state: Where the shield takes the arm to be, rows position, velocity, acceleration, shape (3, n).
            margin: Room that the last nominal's stop left to people [m]; inf where there is none to keep.
        """
        ...

    def took(self, choice: int) -> None:
        """Hear which of them is applied, or -1 for none."""
        ...


Offered = Path | Array
"""A path; or the alternatives themselves."""


def alternatives_of(offered: Offered, state: Array, margin: float, out: NDArray, alarm: Alarm) -> int:
    """Take down what is offered into ``out`` (8, n); how many that are, 0 for what is no offer at all.

    What the numbers are worth is decided where they are admitted.
    """
    try:
        jerks = offered if isinstance(offered, np.ndarray) else offered.alternatives(state, margin)
        jerks = np.asarray(jerks)
        if jerks.ndim != 2 or jerks.shape[1] != out.shape[1] or jerks.dtype != np.float64:
            raise ValueError(f"alternatives have to be a float64 array of shape (a, {out.shape[1]})")
        count = min(len(jerks), ALTERNATIVES)
        out[:count] = jerks[:count]
        return count
    except Exception:  # whatever a planner runs into, the arm must go on safely
        alarm.failure("path", "a path was not to be had; the shield goes by the nominal")
        return 0


def tell(offered: Offered, choice: int, alarm: Alarm) -> float:
    """Tell the planner what was chosen; the pace that it had asked for, 1 where nobody knows."""
    if isinstance(offered, np.ndarray):
        return 1.0
    try:
        offered.took(choice)
        return float(offered.override)
    except Exception:  # as above
        alarm.failure("told", "a path failed when it was told what was chosen")
        return 1.0
