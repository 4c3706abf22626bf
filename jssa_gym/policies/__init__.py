"""What drives an arm: callables from observation to action in [-1, 1]."""

from collections.abc import Callable

import gymnasium as gym

from jssa_gym.policies.adversarial import (
    BangBangPolicy,
    ChasePolicy,
    ConstantPolicy,
    LimitSeekingPolicy,
    SteeredPolicy,
)
from jssa_gym.policies.jpc import JPCPolicy
from jssa_gym.policies.scripted import HoldPolicy, Policy, RandomPolicy, WanderPolicy


def _hold(env: gym.Env, seed: int | None = None) -> HoldPolicy:
    return HoldPolicy(env)


POLICIES: dict[str, Callable[[gym.Env, int | None], Policy]] = {
    "hold": _hold,
    "random": RandomPolicy,
    "wander": WanderPolicy,
    "bang_bang": BangBangPolicy,
    "constant": ConstantPolicy,
    "limit_seeking": LimitSeekingPolicy,
    "chase": ChasePolicy,
    "jpc": JPCPolicy,
}
"""Policies by name: called with the environment and a seed."""

__all__ = [
    "POLICIES",
    "BangBangPolicy",
    "ChasePolicy",
    "ConstantPolicy",
    "HoldPolicy",
    "JPCPolicy",
    "LimitSeekingPolicy",
    "Policy",
    "RandomPolicy",
    "SteeredPolicy",
    "WanderPolicy",
]
