r"""What several runs come to: interquartile means and stratified bootstrap intervals.

The definitions are those of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the
edge of the statistical precipice" (2021), and of their package rliable: with :math:`n` scores of all runs and tasks in
order, the interquartile mean is that of the scores without the :math:`\lfloor n/4\rfloor` smallest and largest; an
interval holds the middle of what it comes to over resamples that draw runs with replacement, within each task.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.rates import tail_of
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer


def interquartile_mean(scores: ArrayLike) -> Array:
    """The mean without the lowest and the highest quarter of the scores, along the first axis.

    With fewer than four scores that is the mean of all.

    Args:
        scores: Shape (n, ...).

    Returns:
        Shape (...).

    Raises:
        ParameterError: There are none, or some are not finite.
    """
    array = np.sort(_finite("scores", scores), axis=0)
    cut = len(array) // 4
    return array[cut : len(array) - cut].mean(axis=0)


def stratified_interval(
    strata: Sequence[ArrayLike], seed: int = 0, *, confidence: float = 0.95, resamples: int = 2000
) -> tuple[Array, Array]:
    """Percentile bootstrap of the interquartile mean over runs, which are drawn within their stratum.

    All points of a curve are drawn together: a run is drawn or not. With few runs it is too narrow: from three there
    are ten different resamples, and two quite bad runs in a row are not so rare.

    Args:
        strata: For every stratum, a task for instance, the scores of its runs, shape (runs, ...); the rest of the shape
            is that of a point, or of a curve, and the same for all.
        seed: Of the resampling.
        confidence: Between 0 and 1.
        resamples: How many.

    Returns:
        Lower and upper ends, shape (...).

    Raises:
        ParameterError: No stratum or an empty one, shapes that differ, values that are not finite, or a confidence or
            count out of range.
    """
    arrays, tail = [_finite("strata", scores) for scores in strata], tail_of(confidence)
    if not arrays or len({array.shape[1:] for array in arrays}) != 1:
        raise ParameterError(f"strata have to be alike but for their runs, got {[array.shape for array in arrays]}")
    rng, drawn = np.random.default_rng(seed), []
    for _ in range(positive_integer("resamples", resamples)):
        chosen: list[NDArray[np.float64]] = [array[rng.integers(len(array), size=len(array))] for array in arrays]
        drawn.append(interquartile_mean(np.concatenate(chosen)))
    low, high = np.quantile(np.array(drawn), [tail, 1.0 - tail], axis=0)
    return low, high


def _finite(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, np.float64)
    if array.ndim == 0 or len(array) == 0 or not np.all(np.isfinite(array)):
        raise ParameterError(f"{name} have to be finite numbers, at least one, got shape {array.shape}")
    return array
