"""Policies of many arms at once: each arm gets, bit for bit, what a policy of its own would do."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import InterfaceError
from jssa_gym.types import Array

_AHEAD = 32
"""For how many steps random actions are drawn at once."""


class VectorPolicy(Protocol):
    """Anything that maps observations of many arms to actions in [-1, 1].

    It is made for a vector of environments and reads what else it needs from there, as a policy of one arm does.
    """

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms begin an episode now, and draw from these seeds."""
        ...

    def __call__(self, observation: Array) -> Array:
        """The actions for observations of shape (E, ...), shape (E, n)."""
        ...


class _Drawing:
    """What draws from a generator of each arm's own."""

    def __init__(self, envs: VectorEnv) -> None:
        self._arms = arms_of(envs)
        self._n = self._arms.robot.n
        # of arms that never began: what they do is nobody's
        self._rngs = [np.random.default_rng(0) for _ in range(self._arms.num_envs)]

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms draw from these seeds from now on."""
        for e, seed in zip(arms.tolist(), seeds, strict=True):
            self._rngs[e] = np.random.default_rng(seed)


class VectorRandom(_Drawing):
    """:class:`~jssa_gym.policies.RandomPolicy` of many arms.

    Args:
        envs: The vector.
    """

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs)
        self._drawn = np.zeros((self._arms.num_envs, _AHEAD, self._n))
        self._used = np.full(self._arms.num_envs, _AHEAD)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms draw from these seeds from now on."""
        super().begin(arms, seeds)
        self._used[arms] = _AHEAD

    def __call__(self, observation: Array) -> Array:
        """Random actions, shape (E, n)."""
        for e in np.flatnonzero(self._used == _AHEAD).tolist():
            self._drawn[e] = self._rngs[e].uniform(-1.0, 1.0, (_AHEAD, self._n))
            self._used[e] = 0
        actions = self._drawn[np.arange(len(self._used)), self._used]
        self._used += 1
        return actions


def arms_of(envs: VectorEnv) -> VectorArmEnv:
    """The arms of a vector, within its wrappers.

    Raises:
        InterfaceError: It is another vector.
    """
    arms = envs.unwrapped
    if not isinstance(arms, VectorArmEnv):
        raise InterfaceError(f"{envs} is no VectorArmEnv: give each environment a policy of its own")
    return arms


VECTOR_POLICIES: dict[str, Callable[[VectorEnv], VectorPolicy]] = {
    "random": VectorRandom,
}
"""Those of :data:`~jssa_gym.policies.POLICIES` that there are for many arms: called with a vector."""


def make_vector_policy(policy: Any, envs: VectorEnv) -> VectorPolicy | None:
    """What many arms do of which each has a policy of its own, or None where that is asked one arm at a time.

    Args:
        policy: A name.
        envs: The vector that they act in, with its shield.
    """
    if isinstance(policy, str) and policy in VECTOR_POLICIES:
        return VECTOR_POLICIES[policy](envs)
    return None
