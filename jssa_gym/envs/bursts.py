"""Faults that come and go."""

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
