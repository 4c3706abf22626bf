"""What a visitor can choose: task, arm, people, policy and shields; checked here, wherever it comes from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.people import known_person
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES
from jssa_gym.robots import DEFAULT
from jssa_gym.shields import SafetyFilter, Shield, make_filter, read_name
from jssa_gym.shields.registry import TASK_SHIELD, UNSHIELDED
from jssa_gym.validation import known_name, whole_number

DRAGGED = "dragged"
"""Name of the person whom the mouse moves."""

PARAMETERS = ("lambda1", "lambda2", "d_min", "horizon")
"""Parameters of filters that can be changed on the page; each filter has some of them."""

ASSUMPTIONS = ("human_speed", "limb_speed")
"""Assumptions of the verified stop that can be."""

MOST = 2
"""Shields side by side."""


@dataclass(frozen=True)
class ShieldChoice:
    """A shield by name, with what is changed of it.

    Args:
        name: As :func:`~jssa_gym.shields.read_name` reads it; or ``"unshielded"`` for no shield at all.
        changes: Numbers by name, of :data:`PARAMETERS` and :data:`ASSUMPTIONS`; those that the shield has not are of no
            effect, so that they outlast a change of the name.

    Raises:
        ParameterError: Unknown name.
    """

    name: str = TASK_SHIELD
    changes: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        if self.name != UNSHIELDED:
            read_name(self.name)
        for name in self.changes:
            known_name("parameter", name, (*PARAMETERS, *ASSUMPTIONS))
        object.__setattr__(self, "changes", MappingProxyType(dict(self.changes)))

    @property
    def whole(self) -> bool:
        """Whether viability box and verified stop are around it."""
        return self.name != UNSHIELDED and read_name(self.name).guarded

    def changed(self, name: str, value: float) -> "ShieldChoice":
        """The same shield with another number."""
        return replace(self, changes={**self.changes, name: value})

    def around(self, env: gym.Env) -> gym.Env:
        """The environment inside this shield, or as it is.

        Raises:
            ParameterError: A number is out of range.
        """
        if self.name == UNSHIELDED:
            return env
        shield = Shield(env, self.name)
        had = shield.filter
        params = _with(had.params, self.changes, PARAMETERS)
        failsafe = _with(had.failsafe, self.changes, ASSUMPTIONS)
        if params == had.params and failsafe == had.failsafe:
            return shield
        name = read_name(self.name).filter
        kind = "jssa" if name == TASK_SHIELD else name
        made = make_filter(kind, had.robot, had.dt, params=params, viability=had.viability, failsafe=failsafe)
        return Shield(env, made)


def numbers_of(filter: SafetyFilter) -> dict[str, float]:
    """The parameters and assumptions of a filter that can be changed on the page, as they are."""
    found = {}
    for values, names in ((filter.params, PARAMETERS), (filter.failsafe, ASSUMPTIONS)):
        found |= {name: float(getattr(values, name)) for name in names if hasattr(values, name)}
    return found


def _with(values: Any, changes: Mapping[str, float], names: tuple[str, ...]) -> Any:
    """A dataclass with the changes that it has fields for; None as it is."""
    if values is None:
        return None
    known = {one.name for one in fields(values)}
    return replace(values, **{name: changes[name] for name in names if name in changes and name in known})


@dataclass(frozen=True)
class Choices:
    """What is played.

    Args:
        task: Of :data:`~jssa_gym.envs.tasks.TASKS`.
        robot: As :func:`~jssa_gym.robots.make_robot` takes it.
        human: :data:`DRAGGED`, a name of :data:`~jssa_gym.evaluation.people.PEOPLE`, or a file.
        policy: As :func:`~jssa_gym.evaluation.policy.make_policy` takes it.
        shields: One or two.
        seed: Of goals, people and policy.

    Raises:
        ParameterError: A name is unknown, or a saved policy would be without a verified stop.
    """

    task: str = "reach"
    robot: str = DEFAULT
    human: str = DRAGGED
    policy: str = "jpc"
    shields: tuple[ShieldChoice, ...] = (ShieldChoice(),)
    seed: int = 0

    def __post_init__(self) -> None:
        known_name("task", self.task, TASKS)
        if self.human != DRAGGED:
            known_person(self.human)
        whole_number("seed", self.seed)
        if not 1 <= len(self.shields) <= MOST:
            raise ParameterError(f"there are 1 or {MOST} shields side by side, got {len(self.shields)}")
        if self.policy not in POLICIES and (open_ones := [one.name for one in self.shields if not one.whole]):
            raise ParameterError(
                f"the saved policy {self.policy!r} is shown inside a shield with a verified stop only, {open_ones[0]} "
                f"has none; give one such as {TASK_SHIELD}, yield or jssa+stop"
            )
