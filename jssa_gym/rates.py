"""How sure one can be of a rate."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from jssa_gym.exceptions import ParameterError


def clopper_pearson(k: int, n: int, confidence: float = 0.95) -> tuple[float, float]:
    r"""Exact two-sided interval of a probability after k of n.

    With :math:`\alpha = 1 -` confidence, the :math:`\alpha/2` quantile of :math:`\mathrm{Beta}(k, n-k+1)` and the
    :math:`1-\alpha/2` quantile of :math:`\mathrm{Beta}(k+1, n-k)`; 0 for k = 0 and 1 for k = n. It covers the truth
    with at least the confidence, whatever the truth.

    Args:
        k: How often it happened.
        n: How often it was tried.
        confidence: Between 0 and 1.

    Raises:
        ParameterError: Not 0 <= k <= n with n >= 1 in whole numbers, or no confidence between 0 and 1.
    """
    for name, value in (("k", k), ("n", n)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise ParameterError(f"{name} has to be a whole number, got {value!r}")
    if not (n >= 1 and 0 <= k <= n):
        raise ParameterError(f"a rate needs 0 <= k <= n with n >= 1, got k = {k}, n = {n}")
    tail = tail_of(confidence)
    from scipy.special import betaincinv

    low = float(betaincinv(k, n - k + 1, tail)) if k > 0 else 0.0
    high = float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0
    return low, high


def tail_of(confidence: float) -> float:
    """What a two-sided interval leaves out on either side."""
    if not 0.0 < confidence < 1.0:
        raise ParameterError(f"confidence has to be between 0 and 1, got {confidence!r}")
    return (1.0 - confidence) / 2.0


@dataclass(frozen=True, slots=True)
class Rate:
    """k of n, with its interval; in words like ``0 / 1,000 (≤ 0.37 %)``."""

    k: int
    n: int
    low: float
    high: float

    @classmethod
    def of(cls, k: int, n: int, confidence: float = 0.95) -> Self:
        """The rate with its :func:`clopper_pearson` interval.

        Raises:
            ParameterError: As there.
        """
        return cls(int(k), int(n), *clopper_pearson(k, n, confidence))

    @property
    def value(self) -> float:
        """The rate, k by n."""
        return self.k / self.n

    def __str__(self) -> str:
        low, high = _percent(self.low), _percent(self.high)
        interval = f"≤ {high}" if self.k == 0 else f"≥ {low}" if self.k == self.n else f"{low} to {high}"
        return f"{self.k:,} / {self.n:,} ({interval})"


def _percent(share: float) -> str:
    """Two digits, and more where the share is almost 1: 99.63 % is not 100 %."""
    percent = 100.0 * share
    digits = 2 if percent < 99.0 else 4
    return f"{percent:.{digits}g} %"
