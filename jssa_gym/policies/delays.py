"""How long a planning host takes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.validation import low_high

Delay = float | tuple[float, float] | Callable[[np.random.Generator], float]
"""Delay of the host [s]: a number, a range to draw from, or what draws it; infinity for an answer that never comes."""


@dataclass(frozen=True, slots=True)
class _Between:
    """Draws the host's delay evenly; like a constant one a class, since what stands in a function is never pickled."""

    low: float
    high: float

    def __call__(self, rng: np.random.Generator) -> float:
        return float(rng.uniform(self.low, self.high))


@dataclass(frozen=True, slots=True)
class _Always:
    """A delay that draws nothing."""

    delay: float

    def __call__(self, rng: np.random.Generator) -> float:
        return self.delay


def drawn_delay(host_delay: Delay) -> Callable[[np.random.Generator], float]:
    """What draws a host's delay [s].

    Raises:
        ParameterError: It is no delay.
    """
    if isinstance(host_delay, tuple):
        return _Between(*low_high("host_delay", host_delay))
    if isinstance(host_delay, int | float | np.integer | np.floating) and not isinstance(host_delay, bool):
        delay = float(host_delay)
        if not delay >= 0.0:
            raise ParameterError(f"host_delay has to be at least 0, got {host_delay!r}")
        return _Always(delay)
    if not callable(host_delay):
        raise ParameterError(f"host_delay has to be a number, (low, high) or a function, got {host_delay!r}")
    return host_delay
