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
from jssa_gym.policies.files import read_policy, save_policy
from jssa_gym.policies.foreign import convert_sb3
from jssa_gym.policies.jpc import JPCPolicy
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.loading import load_policy, policy_file, shipped_policies
from jssa_gym.policies.network import Network
from jssa_gym.policies.scripted import HoldPolicy, Policy, RandomPolicy, WanderPolicy
from jssa_gym.policies.straight import StraightPolicy
from jssa_gym.policies.vector_jpc import VectorJPCPolicy


def _hold(env: gym.Env, seed: int | None = None) -> HoldPolicy:
    return HoldPolicy(env)


def _jpc_paper(env: gym.Env, seed: int | None = None) -> JPCPolicy:
    return JPCPolicy(env, seed, yielding=False)


def _straight(env: gym.Env, seed: int | None = None) -> StraightPolicy:
    return StraightPolicy(env)


POLICIES: dict[str, Callable[[gym.Env, int | None], Policy]] = {
    "hold": _hold,
    "random": RandomPolicy,
    "wander": WanderPolicy,
    "bang_bang": BangBangPolicy,
    "constant": ConstantPolicy,
    "limit_seeking": LimitSeekingPolicy,
    "chase": ChasePolicy,
    "jpc": JPCPolicy,
    "jpc_paper": _jpc_paper,
    "straight": _straight,
}
"""Policies by name: called with the environment and a seed."""

__all__ = [
    "POLICIES",
    "BangBangPolicy",
    "ChasePolicy",
    "ConstantPolicy",
    "HoldPolicy",
    "JPCPolicy",
    "LearnedPolicy",
    "LimitSeekingPolicy",
    "Network",
    "Policy",
    "RandomPolicy",
    "SteeredPolicy",
    "StraightPolicy",
    "VectorJPCPolicy",
    "WanderPolicy",
    "convert_sb3",
    "load_policy",
    "policy_file",
    "read_policy",
    "save_policy",
    "shipped_policies",
]
