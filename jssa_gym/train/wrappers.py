"""What a learner may be told of the shield's interventions."""

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.control.commands import MODES, Commands
from jssa_gym.exceptions import InterfaceError
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, JointState
from jssa_gym.validation import known_name, number_within

EXECUTED = "executed_action"
"""Key of ``info`` with the action that was executed, shape (n,)."""

_CORRECTION = "shield/correction"

LEAST_SHARE = 1e-3
"""Least share of the limits; with less an arm stands still."""


def _change(info: dict[str, Any]) -> float:
    """Largest change of a joint's action by the shield, at most 1; what is not finite counts as 1."""
    if _CORRECTION not in info:
        raise InterfaceError(f"info has no key {_CORRECTION!r}: put the wrapper around a shield")
    change = float(info[_CORRECTION])
    return min(change, 1.0) if np.isfinite(change) else 1.0


class InterventionPenalty(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Makes every change by the shield cost reward: ``weight`` times the largest change of a joint's action.

    It goes directly around the shield, inside an :class:`~jssa_gym.ActionRepeat`, which sums it over the ticks. The
    term is ``info["reward/intervention"]``.

    Args:
        env: With a shield.
        weight: Of a change by the whole jerk bound; larger changes count as that.

    Raises:
        ParameterError: The weight is negative or not finite.
        InterfaceError: At the first step, without a shield.
    """

    def __init__(self, env: gym.Env, weight: float = 0.1) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, weight=weight)
        gym.Wrapper.__init__(self, env)
        self.weight = number_within("weight", weight, 0.0)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; nothing was changed yet."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | {"reward/intervention": 0.0}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and subtract the penalty."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info["reward/intervention"] = penalty = -self.weight * _change(info)
        return observation, float(reward) + penalty, terminated, truncated, info


class ObserveIntervention(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Adds one entry to the observation: the shield's largest change in the last tick, in [0, 1]; 0 after a reset.

    Args:
        env: With a shield and a vector of float32 as observation.

    Raises:
        InterfaceError: The observation is no vector; at the first step, without a shield.
    """

    def __init__(self, env: gym.Env) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        space = env.observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
            raise InterfaceError(f"the observation has to be a vector, got {space}")
        low, high = np.append(space.low, np.float32(0.0)), np.append(space.high, np.float32(1.0))
        self.observation_space = gym.spaces.Box(low, high, dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; nothing was changed yet."""
        observation, info = self.env.reset(seed=seed, options=options)
        return _with(observation, 0.0), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and look at the shield."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return _with(observation, _change(info)), reward, terminated, truncated, info


def _with(observation: NDArray[np.float32], last: float) -> NDArray[np.float32]:
    return np.append(observation, np.float32(last))


class ExecutedAction(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Tells which action was executed, as ``info["executed_action"]``: the agent's own, or what became of it.

    Where the shield changed nothing that is the action itself. Else it is the action that would have asked for what
    happened until the end of the step: for jerks their mean over the ticks, since that is the change of the
    acceleration; for other commands the one that the arm ended with. It goes outside everything that changes
    or repeats actions.

    Args:
        env: With a shield, ``robot`` and ``scene``.
        control: What an action means: ``"jerk"``, or as :class:`~jssa_gym.JPCAction` has it.
        share: Of the velocity limits, as of :class:`~jssa_gym.JPCAction`.

    Raises:
        ParameterError: ``control`` is unknown or ``share`` out of range.
    """

    def __init__(self, env: gym.Env, control: str = "jerk", share: float = 0.5) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, control=control, share=share)
        gym.Wrapper.__init__(self, env)
        self._robot: RobotModel = env.get_wrapper_attr("robot")
        known_name("control", control, ("jerk", *MODES))
        part = number_within("share", share, LEAST_SHARE, 1.0)
        self._commands = None if control == "jerk" else Commands(self._robot.limits, control, part, self._robot)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; nothing was executed yet."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | {EXECUTED: np.zeros(self.action_space.shape or ())}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and say what it made of the action."""
        before = self.env.get_wrapper_attr("scene")
        observation, reward, terminated, truncated, info = self.env.step(action)
        executed = np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        if _change(info) > 0.0:
            after = self.env.get_wrapper_attr("scene")
            executed = self._asks_for(before.robot, after.robot, after.time - before.time)
        info[EXECUTED] = executed
        return observation, reward, terminated, truncated, info

    def _asks_for(self, before: JointState, after: JointState, time: float) -> Array:
        if self._commands is not None:
            return self._commands.met_by(after)
        jerk = (after.acceleration - before.acceleration) / time
        return np.clip(jerk / self._robot.limits.jerk, -1.0, 1.0)
