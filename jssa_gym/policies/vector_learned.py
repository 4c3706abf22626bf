"""A trained policy of many arms at once."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.control.vector import VectorCommands
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.types import Array


class VectorLearned:
    """:class:`~jssa_gym.policies.LearnedPolicy` of many arms: for each what it says to a single observation.

    Args:
        policy: The policy.
        envs: The vector that it acts in.
    """

    def __init__(self, policy: LearnedPolicy, envs: VectorEnv) -> None:
        self._policy, self._commands = policy, None
        if (commands := policy.commands) is not None:
            arms: Any = envs.unwrapped
            robot = commands.robot or arms.robot
            self._commands = VectorCommands(robot.with_limits(policy.limits), policy.control, policy.share)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """Nothing is remembered, and nothing drawn."""

    def __call__(self, observation: Array) -> Array:
        """Jerks as shares of their bounds, shape (E, n)."""
        x, policy = observation.astype(np.float64), self._policy
        action = policy.network(x)
        sound = np.isfinite(x).all(axis=1) & np.isfinite(action).all(axis=1)
        if self._commands is not None:
            action = self._commands.jerk(np.stack(policy.joint_state(x), axis=1), action)
        for e in np.flatnonzero(~sound).tolist():
            action[e] = policy(observation[e])
        return action
