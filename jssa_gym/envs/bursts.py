"""Faults that come and go."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Bursts:
    """Faults that begin by chance and last for some ticks, independent of each other."""

    def __init__(self, probability: float, longest: int, count: int = 1) -> None:
        self._probability, self._longest = probability, longest
        self._left = np.zeros(count, np.int64)

    def step(self, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Go on by a tick; which ones begin, shape (count,)."""
        if self._probability == 0.0:
            return self.on
        self._left = np.maximum(self._left - 1, 0)
        began = (self._left == 0) & (rng.random(len(self._left)) < self._probability)
        self._left[began] = rng.integers(1, self._longest + 1, np.count_nonzero(began))
        return began

    @property
    def on(self) -> NDArray[np.bool_]:
        """Which ones are on, shape (count,)."""
        return self._left > 0


class VectorBursts:
    """The same of many arms, each drawn from a generator of its own.

    Args:
        arms: How many.
        probability, longest, count: As of :class:`Bursts`.
    """

    def __init__(self, arms: int, probability: float, longest: int, count: int = 1) -> None:
        self._probability, self._longest = probability, longest
        self._left, self._drawn = np.zeros((arms, count), np.int64), np.zeros((arms, count))

    def begin(self, which: NDArray[np.bool_]) -> None:
        """Nothing is on in those arms."""
        self._left[which] = 0

    def step(self, who: NDArray[np.int64], rngs: Sequence[np.random.Generator]) -> None:
        """Go on by a tick in those arms, by their numbers."""
        if self._probability == 0.0:
            return
        for e in who.tolist():
            rngs[e].random(out=self._drawn[e])
        left = np.maximum(self._left[who] - 1, 0)
        began = (left == 0) & (self._drawn[who] < self._probability)
        for row in np.flatnonzero(began.any(axis=1)).tolist():
            count = np.count_nonzero(began[row])
            left[row, began[row]] = rngs[who[row]].integers(1, self._longest + 1, count)
        self._left[who] = left

    @property
    def on(self) -> NDArray[np.bool_]:
        """Which ones are on, shape (arms, count)."""
        return self._left > 0
