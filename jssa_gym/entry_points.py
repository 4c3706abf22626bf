"""What Gymnasium builds from the package's ids: single and vector environments, with a shield or without."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium.vector import VectorEnv

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import ParameterError
from jssa_gym.registration import ENTRIES
from jssa_gym.shields.shield import JSSAShield
from jssa_gym.shields.vector import VectorShield


class MakeShielded:
    """Builds the environment of a shielded id; what it takes is what :class:`~jssa_gym.ArmEnv` takes."""

    metadata = ArmEnv.metadata

    def __call__(self, task: str, **arguments: Any) -> gym.Env:
        """The environment and its shield."""
        shield = JSSAShield(ArmEnv(task, **arguments), **ENTRIES[task].shield)
        shield.of_id = True
        return shield


make_shielded = MakeShielded()


def make_vector(
    num_envs: int, task: str, *, shield: str | Mapping[str, Any] | None = None, **arguments: Any
) -> VectorEnv:
    """Many environments of an id, as :func:`gymnasium.make_vec` builds them.

    Args:
        num_envs: How many.
        task: Name of the task.
        shield: None for none; ``{}`` for :class:`~jssa_gym.JSSAShield` with its defaults, or a mapping of its options;
            or a filter by name.
        arguments: Of :class:`~jssa_gym.envs.vector.VectorArmEnv`.

    Raises:
        ParameterError: An argument is unknown or out of range, or asks for what cannot be done for many at once.
    """
    env = VectorArmEnv(num_envs, task, **arguments)
    return env if shield is None else VectorShield(env, shield)


def make_shielded_vector(num_envs: int, task: str, *, shield: Any = None, **arguments: Any) -> VectorEnv:
    """Many environments of a shielded id, each with the shield that the id says.

    Raises:
        ParameterError: As of :func:`make_vector`, or ``shield`` asks for another one.
    """
    if shield is not None:
        raise ParameterError(
            f"{ENTRIES[task].env_id(True)} has its own shield: take {ENTRIES[task].env_id(False)} for shield={shield!r}"
        )
    return make_vector(num_envs, task, shield=ENTRIES[task].shield, **arguments)
