"""Filters by name, put around an environment as shields."""

from typing import Any

import gymnasium as gym

from jssa_gym.exceptions import ParameterError
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS, JSSAShield, Shield, make_filter

STOP = "+stop"
"""Ending of a filter's name: with the viability box and the verified stop around it."""


TASK_SHIELD = "shielded"
"""Name of the shield that a task's shielded id has, such as ``jssa_gym/HandoverShielded-v0``."""


def put_filter(env: gym.Env, name: str) -> Shield:
    """A shield by the name of its filter around an environment.

    Args:
        env: The environment; see :class:`~jssa_gym.shields.Shield` for what it has to offer.
        name: Of :data:`~jssa_gym.shields.FILTERS`, for the bare filter; with :data:`STOP` behind it, with viability
            box and verified stop; :data:`TASK_SHIELD` for the shield of the task's shielded id.

    Raises:
        ParameterError: Unknown name, the environment has a shield, or no task with a shielded id.
    """
    layer: gym.Env = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, Shield):
            raise ParameterError(f"{env} has a shield already: give a filter or an environment with a shield, not both")
        layer = layer.env
    if name == TASK_SHIELD:
        return JSSAShield(env, **_changes_of_task(env))
    bare = known_filter(name)
    robot, dt = env.get_wrapper_attr("robot"), env.get_wrapper_attr("dt")
    stop = bare != name
    return Shield(env, make_filter(bare, robot, dt, viability=stop, failsafe=FailsafeParams() if stop else None))


def _changes_of_task(env: gym.Env) -> dict[str, Any]:
    """What a task's shielded id changes of the shield's defaults."""
    task = getattr(getattr(env.unwrapped, "task", None), "name", "")
    spec = gym.registry.get(f"jssa_gym/{task.capitalize()}Shielded-v0")
    if spec is None:
        raise ParameterError(f"{env} is of no task with a shielded id; give another filter than {TASK_SHIELD!r}")
    return dict(spec.additional_wrappers[0].kwargs or {})


def known_filter(name: str) -> str:
    """The filter's name without :data:`STOP`.

    Raises:
        ParameterError: There is no such filter.
    """
    if name == TASK_SHIELD:
        return name
    bare = name.removesuffix(STOP) if isinstance(name, str) else name
    if bare not in FILTERS:
        valid = f"{', '.join(FILTERS)}, each also with '{STOP}' behind it, and {TASK_SHIELD}"
        raise ParameterError(f"unknown filter {name!r}; valid: {valid}")
    return bare
