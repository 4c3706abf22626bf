"""Policies that were trained more slowly, or on normalised observations, as such that are asked in every tick."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.normalisation import Normalisation
from jssa_gym.policies.scripted import Policy
from jssa_gym.validation import positive_integer


class HeldPolicy:
    """Asks a policy every few ticks and holds its answer, as :class:`~jssa_gym.ActionRepeat` does in training.

    Of a :class:`~jssa_gym.policies.LearnedPolicy` the command is held, which its loops follow in every tick; of
    anything else the action. It is for one episode, whose first tick is its first call.

    Args:
        policy: What is asked.
        ticks: For how many ticks an answer holds.

    Raises:
        ParameterError: ``ticks`` is not a positive integer.
    """

    def __init__(self, policy: Policy, ticks: int) -> None:
        self._policy, self._ticks = policy, positive_integer("ticks", ticks)
        self._learned = policy if isinstance(policy, LearnedPolicy) else None
        self._answer: Any = None
        self._left = 0

    def __call__(self, observation: Any) -> Any:
        """The action in this tick."""
        if self._left == 0:
            ask = self._policy if self._learned is None else self._learned.command
            self._answer, self._left = ask(observation), self._ticks
        self._left -= 1
        return self._answer if self._learned is None else self._learned.jerk(observation, self._answer)


class NormalisedPolicy:
    """Gives a policy its observations normalised.

    Args:
        policy: What is asked.
        normalisation: As in its training.
    """

    def __init__(self, policy: Callable[[Any], Any], normalisation: Normalisation) -> None:
        self._policy, self._normalisation = policy, normalisation

    def __call__(self, observation: Any) -> Any:
        """The policy's action."""
        return self._policy(self._normalisation(observation))


def normalised(policy: Policy, normalisation: Normalisation) -> Policy:
    """A policy that was trained on normalised observations.

    Raises:
        ParameterError: It normalises them itself, or takes others.
    """
    if not isinstance(policy, LearnedPolicy):
        return NormalisedPolicy(policy, normalisation)
    network = policy.network
    if np.any(network.mean != 0.0) or np.any(network.std != 1.0) or np.isfinite(network.clip):
        raise ParameterError("the policy's file has its normalisation in it: leave normalise out")
    if network.inputs != len(normalisation.mean):
        raise ParameterError(
            f"the statistics are of {len(normalisation.mean)} numbers, the policy takes {network.inputs}: another's"
        )
    return replace(policy, network=replace(network, **normalisation._asdict()))
