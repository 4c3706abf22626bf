"""Checks of what users pass to a vector, before anything changes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from jssa_gym.exceptions import ParameterError
from jssa_gym.vectors import Mask


def refuse_singular(dynamics: str, observation: str, render_mode: str | None) -> None:
    """Refuse what is done for one arm at a time, with a ParameterError."""
    if dynamics == "servo":
        raise ParameterError(
            "dynamics='servo' is MuJoCo's, one arm at a time: take dynamics='kinematic', or vectorization_mode='sync'"
        )
    if observation == "goal":
        raise ParameterError(
            "observation='goal' is a dictionary, which vectors do not make: take vectorization_mode='sync', or "
            "observation='closest' or 'full'"
        )
    if render_mode is not None:
        raise ParameterError(
            f"vectors draw nothing, got render_mode={render_mode!r}: play the same seed in gym.make(..., "
            "render_mode=...)"
        )


def checked_mode(mode: Any) -> AutoresetMode:
    """A mode, or its value; ParameterError for anything else."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        modes = ", ".join(repr(mode.value) for mode in AutoresetMode)
        raise ParameterError(f"autoreset_mode has to be one of {modes}, got {mode!r}") from None


def checked_mask(mask: Any, count: int) -> Mask:
    """Who is to be reset, shape (count,); everybody for None. ParameterError for what is no mask, or names nobody."""
    if mask is None:
        return np.ones(count, np.bool_)
    if not (isinstance(mask, np.ndarray) and mask.shape == (count,) and mask.dtype == np.bool_):
        raise ParameterError(f"reset_mask has to be an array of bool of shape ({count},), got {mask!r}")
    if not mask.any():
        raise ParameterError("reset_mask has to name somebody to be reset")
    return mask.copy()


def checked_seeds(seed: Any, count: int) -> Sequence[int | None]:
    """A seed for each: the first one's, the next has the next; or one for each. ParameterError for anything else."""
    if seed is None:
        return [None] * count
    seeds = [seed + e for e in range(count)] if isinstance(seed, int | np.integer) else list(seed)
    if len(seeds) != count:
        raise ParameterError(f"there are {count} environments, got {len(seeds)} seeds")
    for one in seeds:
        if one is not None and not (isinstance(one, int | np.integer) and one >= 0):
            raise ParameterError(f"a seed is a whole number that is not negative, got {one!r}")
    return [one if one is None else int(one) for one in seeds]
