"""How sure one can be of a mean and a difference; of a rate, see :mod:`jssa_gym.rates`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.rates import Rate, clopper_pearson, tail_of
from jssa_gym.types import Array

__all__ = ["PairedDifference", "Rate", "bootstrap_interval", "clopper_pearson", "paired_difference"]


def _samples(name: str, values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.ndim == 0 or len(array) == 0 or not np.all(np.isfinite(array)):
        raise ParameterError(f"{name} have to be finite numbers, at least one, got shape {array.shape}")
    return array


def bootstrap_interval(
    values: ArrayLike,
    statistic: Callable[[Array], Any],
    seed: int,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> tuple[float, float]:
    """Percentile bootstrap: quantiles of a statistic over resamples with replacement.

    It knows nothing of what was never seen: for rates of rare events take :func:`clopper_pearson`.

    Args:
        values: One an episode, shape (n,), or one row, shape (n, ...).
        statistic: Maps as many values to a number, ``numpy.mean`` for instance.
        seed: Of the resampling.
        confidence: Between 0 and 1.
        resamples: How many.

    Raises:
        ParameterError: No values, values that are not finite, or a confidence or count out of range.
    """
    array, tail = _samples("values", values), tail_of(confidence)
    if isinstance(resamples, bool) or not isinstance(resamples, int) or resamples < 1:
        raise ParameterError(f"resamples has to be a positive integer, got {resamples!r}")
    rng = np.random.default_rng(seed)
    drawn = [float(statistic(array[rng.integers(len(array), size=len(array))])) for _ in range(resamples)]
    low, high = np.quantile(drawn, [tail, 1.0 - tail])
    return float(low), float(high)


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Rate of the first minus rate of the second, both tried on the same seeds."""

    n: int
    first_only: int
    """Seeds on which it happened to the first alone."""
    second_only: int
    value: float
    low: float
    high: float
    p_value: float
    """Of McNemar's exact test: how likely so unequal counts are if both rates are equal."""


def paired_difference(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> PairedDifference:
    r"""Difference of two rates over paired seeds.

    Only seeds on which the two differ tell: with :math:`b` on which it happened to the first alone and :math:`c` to
    the second alone, the difference is :math:`(b-c)/n`. The interval is Bonett and Price's (2012): Wald's for
    :math:`\tilde p_b = (b+1)/(n+2)` and :math:`\tilde p_c = (c+1)/(n+2)`, so that it has a width even if the two
    never differed.

    Args:
        first: Whether it happened, seed by seed, shape (n,).
        second: The same for the other, shape (n,).
        confidence: Between 0 and 1.

    Raises:
        ParameterError: Different lengths, no seed, or something else than yes and no.
    """
    one, other = _samples("outcomes", first), _samples("outcomes", second)
    if one.ndim != 1 or one.shape != other.shape or not np.all(np.isin([one, other], [0.0, 1.0])):
        raise ParameterError(f"outcomes have to be yes or no, as many each, got shapes {one.shape}, {other.shape}")
    tail, n = tail_of(confidence), len(one)
    from scipy.special import ndtri
    from scipy.stats import binomtest

    b, c = int((one > other).sum()), int((one < other).sum())
    p, q = (b + 1) / (n + 2), (c + 1) / (n + 2)
    half = float(ndtri(1.0 - tail)) * np.sqrt((p + q - (p - q) ** 2) / (n + 2))
    return PairedDifference(
        n=n,
        first_only=b,
        second_only=c,
        value=(b - c) / n,
        low=float(max(p - q - half, -1.0)),
        high=float(min(p - q + half, 1.0)),
        p_value=float(binomtest(b, b + c).pvalue) if b + c else 1.0,
    )
