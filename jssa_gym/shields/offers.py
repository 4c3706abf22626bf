"""What a planner offers a shield beside its nominal: jerks in order of preference, taken so that nothing can fail."""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from jssa_gym.shields.alarm import Alarm
from jssa_gym.tick.layout import ALTERNATIVES
from jssa_gym.types import Array
from jssa_gym.vectors import Mask


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


@runtime_checkable
class VectorPath(Protocol):
    """The paths of many arms, of which some may have none, such as :class:`jssa_gym.control.many.ManyJPC` has them."""

    @property
    def override(self) -> Array:
        """The paces that they asked for last, shape (E,); 1 where there is none."""
        ...

    def alternatives(self, state: Array, margin: Array, asked: Mask) -> tuple[Array, NDArray[np.int64]]:
        """Jerks in order of preference of those who are ``asked``, shape (E,).

        Args:
            state: Where the shield takes the arms to be, shape (E, 3, n).
            margin: Room that the last nominals' stops left to people, shape (E,) [m]; inf where there is none to keep.
            asked: Shape (E,).

        Returns:
            Jerks, shape (E, a, n) with a up to 8 [rad/s³], and how many of them count, shape (E,).
        """
        ...

    def took(self, choice: NDArray[np.int64], asked: Mask) -> None:
        """Hear which of them is applied, or -1 for none, shape (E,)."""
        ...


Offered = Path | Array
"""A path; or the alternatives themselves."""

VectorOffered = VectorPath | Array
"""Paths of many arms; or the alternatives themselves, shape (E, a, n) [rad/s³]."""


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


def alternatives_of_all(
    offered: VectorOffered, state: Array, margin: Array, asked: Mask, out: NDArray, alarm: Alarm
) -> NDArray[np.int64]:
    """:func:`alternatives_of` of many arms, into ``out`` (E, 8, n); how many they are, shape (E,)."""
    count, n = len(out), out.shape[2]
    try:
        if isinstance(offered, np.ndarray):
            jerks, counts = offered, np.full(count, offered.shape[1])
        else:
            jerks, counts = offered.alternatives(state, margin, asked)
        if jerks.ndim != 3 or (len(jerks), jerks.shape[2]) != (count, n) or jerks.dtype != np.float64:
            raise ValueError(f"alternatives have to be a float64 array of shape ({count}, a, {n})")
        if counts.shape != (count,) or counts.dtype.kind != "i":
            raise ValueError(f"how many they are has to be an integer array of shape ({count},)")
        most = min(jerks.shape[1], ALTERNATIVES)
        out[:, :most] = jerks[:, :most]
        return np.where(asked, np.minimum(counts, most), 0)
    except Exception:  # as above
        alarm.failure("path", "paths were not to be had; the shield goes by the nominals")
        return np.zeros(count, np.int64)


def tell_all(offered: VectorOffered, choice: NDArray[np.int64], asked: Mask, alarm: Alarm) -> Array:
    """:func:`tell` of many arms: the paces that were asked for, shape (E,)."""
    nobody = np.ones(len(choice))
    if isinstance(offered, np.ndarray):
        return nobody
    try:
        offered.took(choice, asked)
        return np.where(asked, offered.override, nobody)
    except Exception:  # as above
        alarm.failure("told", "paths failed when they were told what was chosen")
        return nobody
