"""Which wrappers may lie between an environment and its shield: those that pass every action on, once, as it is."""

from typing import Any, TypeVar

import gymnasium as gym

from jssa_gym.exceptions import InterfaceError

Layer = TypeVar("Layer", bound=gym.Wrapper)

REPEATERS = frozenset(
    {
        # Gymnasium
        "ArrayConversion",  # turns actions into another library's arrays, which may be of single precision
        "AtariPreprocessing",
        "Autoreset",  # throws away the action of the step in which it resets
        "MaxAndSkipObservation",
        "RepeatAction",
        # elsewhere
        "ActionRepeat",
        "AutoResetWrapper",
        "FrameSkip",
        "FrameSkipWrapper",
        "MaxAndSkipEnv",
        "RepeatActionWrapper",
        "StickyActionEnv",
    }
)
"""Wrappers, by the name of their class or of one that it derives from, whose own ``step`` changes, repeats or drops
actions; what derives from ``gymnasium.ActionWrapper`` needs no name."""


def layer_of(env: gym.Env, kind: type[Layer]) -> Layer | None:
    """The outermost wrapper of a kind around an environment; None without any."""
    while isinstance(env, gym.Wrapper):
        if isinstance(env, kind):
            return env
        env = env.env
    return None


def refuse_other_actions(env: gym.Env) -> None:
    """Refuse wrappers under which an action is no jerk of one control step: a shield would certify something else.

    A class says what it does by ``outside_shield``: True, and it is refused; False in its own body, and it is taken at
    its word. Without a word all :class:`gymnasium.ActionWrapper`, :data:`REPEATERS` and shields are refused.

    Raises:
        InterfaceError: There is such a wrapper; the message names it.
    """
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        kind = type(layer)
        if any(base.__name__ == "Shield" for base in kind.__mro__):
            raise InterfaceError(
                f"{env} has a shield already, {kind.__name__}, which would change what a second one has verified: put "
                "the shield around the environment without one"
            )
        if getattr(layer, "outside_shield", False) or (_changes(kind) and not _vouched_for(kind)):
            raise InterfaceError(
                f"{kind.__name__} belongs outside the shield, which filters the jerk of every control step: put the "
                f"shield around the environment, and {kind.__name__} around the shield. A wrapper that passes every "
                "action on, once and untouched, says so by outside_shield = False in the body of its own class"
            )
        layer = layer.env


def _changes(kind: type) -> bool:
    return issubclass(kind, gym.ActionWrapper) or any(base.__name__ in REPEATERS for base in kind.__mro__)


def _vouched_for(kind: type) -> bool:
    """Whether the class says itself that it changes nothing; what a parent says need not hold for it."""
    return vars(kind).get("outside_shield") is False
