"""The package's tasks, and the ids that Gymnasium makes their environments from. Nothing is loaded: there are names."""

import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium as gym

HORIZON = 1000
"""Steps of an episode: 8 s."""

_BUILT_BY = "jssa_gym.entry_points"
_POINTS = {
    False: ("jssa_gym.envs.arm:ArmEnv", f"{_BUILT_BY}:make_vector"),
    True: (f"{_BUILT_BY}:make_shielded", f"{_BUILT_BY}:make_shielded_vector"),
}
"""Entry points of an id and of its vectors, by whether it is a shielded one."""


class Entry(NamedTuple):
    """A task as it is registered."""

    kind: str
    """Module and class, ``"package.module:Class"``; the ids bear the class's name."""
    shield: Mapping[str, Any] = MappingProxyType({})
    """What the shielded id changes of :class:`~jssa_gym.shields.JSSAShield`'s defaults, as JSON can hold it."""

    def env_id(self, shielded: bool = False) -> str:
        """The id of its environment, such as ``jssa_gym/ReachShielded-v0``."""
        return f"jssa_gym/{self.kind.partition(':')[2]}{'Shielded' if shielded else ''}-v0"

    def load(self) -> Any:
        """The class."""
        module, _, name = self.kind.partition(":")
        return getattr(importlib.import_module(module), name)


ENTRIES: dict[str, Entry] = {
    "home": Entry("jssa_gym.envs.tasks.joints:Home"),
    "reach": Entry("jssa_gym.envs.tasks.tip:Reach"),
    "track": Entry("jssa_gym.envs.tasks.joints:Track"),
    # with the defaults it takes 10 s and more to come near a hand: the right arm may be touched at 0.1 m/s
    "handover": Entry(
        "jssa_gym.envs.tasks.tip:Handover",
        {"lambda1": 1.0, "lambda2": 0.1, "failsafe": {"contact_speed": {"right_arm": 0.1}}},
    ),
    "deliver": Entry("jssa_gym.envs.tasks.deliver:Deliver"),
}
"""Tasks by name: the only place that lists them."""


def register_ids() -> None:
    """Tell Gymnasium the two ids of every task, those that it does not know yet."""
    for task, entry in ENTRIES.items():
        for shielded, (single, vector) in _POINTS.items():
            if (name := entry.env_id(shielded)) not in gym.registry:
                gym.register(
                    name, single, max_episode_steps=HORIZON, kwargs={"task": task}, vector_entry_point=vector
                )  # fmt: skip
