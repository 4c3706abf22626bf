"""Filters by name, put around an environment as shields."""

import gymnasium as gym

from jssa_gym.exceptions import ParameterError
from jssa_gym.shields import Shield


def put_filter(env: gym.Env, name: str) -> Shield:
    """A shield by the name of its filter around an environment.

    Args:
        env: The environment; see :class:`~jssa_gym.shields.Shield` for what it has to offer.
        name: As :func:`~jssa_gym.shields.read_name` reads it.

    Raises:
        ParameterError: Unknown name, the environment has a shield, or no task with a shielded id.
    """
    layer: gym.Env = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, Shield):
            raise ParameterError(f"{env} has a shield already: give a filter or an environment with a shield, not both")
        layer = layer.env
    return Shield(env, name)
