"""Infos of many environments, as Gymnasium's vectors have them: arrays, and masks of who says something."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from jssa_gym.exceptions import InterfaceError

Infos = dict[str, Any]

Mask = NDArray[np.bool_]
"""Which of E environments, shape (E,)."""


def wrapper_with(envs: VectorEnv, attribute: str) -> Any:
    """The outermost of a vector's wrappers, or the vector, that has an attribute; None if none has.

    Gymnasium's vectors hand nothing through their wrappers.
    """
    while not hasattr(envs, attribute):
        if not isinstance(envs, VectorWrapper):
            return None
        envs = envs.env
    return envs


def refuse_vector(env: Any, twin: str) -> None:
    """Refuse many environments where one is wanted.

    Raises:
        InterfaceError: It is a vector; the message names what does the same for many.
    """
    if isinstance(env, VectorEnv):
        raise InterfaceError(f"{env} is a vector of environments: take {twin}, or wrap each environment by itself")


def as_infos(values: Mapping[str, NDArray[Any]], who: Mask) -> Infos:
    """Arrays of shape (E, ...) with a mask beside each of them.

    What those who do not take part have is 0, of words None, as in Gymnasium's own vectors.
    """
    infos: Infos = {}
    everybody = who.all()
    for key, value in values.items():
        if not everybody:
            nothing = np.full((), None if value.dtype == object else 0, value.dtype)
            value = np.where(who.reshape(-1, *(1,) * (value.ndim - 1)), value, nothing)
        infos[key], infos[f"_{key}"] = value, who.copy()
    return infos


def stacked(values: Mapping[str, Any], count: int) -> dict[str, NDArray[Any]]:
    """Empty arrays of shape (count, ...) for what a single environment says."""
    arrays: dict[str, NDArray[Any]] = {}
    for key, value in values.items():
        if isinstance(value, np.ndarray):
            arrays[key] = np.zeros((count, *value.shape), value.dtype)
        elif isinstance(value, bool | int | float):
            arrays[key] = np.zeros(count, type(value))
        else:
            arrays[key] = np.full(count, None, object)
    return arrays
