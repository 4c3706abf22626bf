"""How sure one can be of a mean and a difference; of a rate, see :mod:`jssa_gym.rates`."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.rates import Rate, clopper_pearson, tail_of
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer

__all__ = ["PairedDifference", "Rate", "bootstrap_interval", "clopper_pearson", "paired_difference"]

_LARGEST = 20_000_000
"""Numbers of copies that are held at once while resampling."""


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
    array, resamples = _samples("values", values), positive_integer("resamples", resamples)
    tail_of(confidence)  # is one
    if len(array) == 1:  # which scipy refuses
        return (value := float(statistic(array))), value
    from scipy.stats import DegenerateDataWarning, bootstrap

    with warnings.catch_warnings():
        # of a statistic that is NaN, and of a standard error that is not asked for
        warnings.simplefilter("ignore", DegenerateDataWarning)
        for text in ("Degrees of freedom", "invalid value encountered in scalar divide"):
            warnings.filterwarnings("ignore", text, RuntimeWarning)
        low, high = bootstrap(
            (np.arange(len(array)),),  # rows are drawn by their numbers
            lambda drawn: float(statistic(array[drawn])),
            n_resamples=resamples,
            batch=max(1, 1_000_000 // len(array)),
            vectorized=False,
            confidence_level=confidence,
            method="percentile",
            random_state=np.random.default_rng(seed),
        ).confidence_interval
    return float(low), float(high)


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Rate of the first minus rate of the second on the same seeds; in words like ``-0.075 (-0.17 to 0.018)``."""

    n: int
    first_only: int
    """Seeds on which it happened to the first alone."""
    second_only: int
    value: float
    low: float
    high: float
    p_value: float
    """P-value of McNemar's exact test: how likely so unequal counts are if both rates are equal."""

    def __str__(self) -> str:
        return f"{short(self.value)} ({short(self.low)} to {short(self.high)})"


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


@dataclass(frozen=True, slots=True)
class Mean:
    """A mean over episodes, with its bootstrap interval; in words like ``0.31 (0.28 to 0.34)``."""

    n: int
    """Episodes that have a value."""
    value: float
    low: float
    high: float
    least: float
    p05: float
    """5th percentile over the episodes."""
    most: float

    def __str__(self) -> str:
        return f"{short(self.value)} ({short(self.low)} to {short(self.high)})"


def short(value: float) -> str:
    """Three digits, or all of those before the point."""
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.3g}"


def means(values: ArrayLike, seed: int = 0, *, confidence: float = 0.95, resamples: int = 2000) -> list[Mean | None]:
    """Means of several numbers over the same episodes, with percentile bootstrap intervals.

    A resample draws whole episodes: what is resampled together stays comparable.

    Args:
        values: A row an episode, a column a number, shape (n, m); what is not finite is left out.
        seed: Of the resampling.
        confidence: Between 0 and 1.
        resamples: How many.

    Returns:
        A mean a column, None where no episode has a value.

    Raises:
        ParameterError: No episodes, another shape, or a confidence or count out of range.
    """
    array, tail, resamples = (
        np.array(values, dtype=np.float64),
        tail_of(confidence),
        positive_integer("resamples", resamples),
    )
    if array.ndim != 2 or len(array) == 0:
        raise ParameterError(f"values have to have shape (n, m) with n >= 1, got {array.shape}")
    there = np.isfinite(array)
    # resampling with replacement is a random number of copies of every episode
    rng, share, parts = np.random.default_rng(seed), np.full(len(array), 1.0 / len(array)), []
    values, at_once = np.where(there, array, 0.0), max(1, _LARGEST // len(array))
    with np.errstate(invalid="ignore", divide="ignore"):
        for k in range(0, resamples, at_once):
            copies = rng.multinomial(len(array), share, min(at_once, resamples - k))
            parts.append((copies @ values) / (copies @ there))
    drawn = np.concatenate(parts)
    found: list[Mean | None] = []
    for column, kept, resampled in zip(array.T, there.T, drawn.T, strict=True):
        known = column[kept]
        if len(known) == 0:
            found.append(None)
            continue
        low, high = np.nanquantile(resampled, [tail, 1.0 - tail])
        least, p05, most = np.min(known), np.quantile(known, 0.05), np.max(known)
        numbers = (known.mean(), low, high, least, p05, most)
        found.append(Mean(len(known), *(float(number) for number in numbers)))
    return found


def mean_difference(first: ArrayLike, second: ArrayLike, seed: int = 0, *, confidence: float = 0.95) -> Mean | None:
    """Mean of the first minus the second over paired seeds, with its bootstrap interval.

    Args:
        first: A number a seed, shape (n,).
        second: The same for the other; seeds on which either is not finite are left out.
        seed: Of the resampling.
        confidence: Between 0 and 1.

    Raises:
        ParameterError: Different lengths, or no seed.
    """
    one, other = np.array(first, dtype=np.float64), np.array(second, dtype=np.float64)
    if one.ndim != 1 or one.shape != other.shape:
        raise ParameterError(f"paired numbers have to be as many each, got shapes {one.shape}, {other.shape}")
    with np.errstate(invalid="ignore"):  # infinite on both sides: no difference to speak of
        difference = one - other
    return means(difference[:, None], seed, confidence=confidence)[0]
