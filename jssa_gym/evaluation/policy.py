"""The policy of an episode: a name, a file, a model or a function, and what tells it from another."""

import hashlib
import importlib
import inspect
from collections.abc import Callable
from typing import Any

import gymnasium as gym

from jssa_gym.evaluation.identity import code_digest
from jssa_gym.exceptions import ParameterError, PolicyFileError
from jssa_gym.policies import POLICIES, JPCPolicy, LearnedPolicy, Policy, load_policy, policy_file, shipped_policies
from jssa_gym.policies.model import ModelPolicy


def make_policy(
    policy: Any, env: gym.Env, seed: int, *, seen: gym.Env | None = None, trust_pickle: bool = False
) -> Policy:
    """A policy for one episode.

    Args:
        policy: A name of :data:`~jssa_gym.policies.POLICIES` or of
            :func:`~jssa_gym.policies.shipped_policies`; a file of :func:`~jssa_gym.policies.load_policy`;
            ``"package.module:factory"``, called with environment and seed; anything with a method ``predict``, as the
            models of Stable-Baselines3, see :class:`~jssa_gym.policies.model.ModelPolicy`; or a callable from
            observation to action.
        env: The environment that it acts in, which named policies look into.
        seed: Of what it draws.
        seen: The same environment with the wrappers whose observations it gets; by default ``env``. A policy that
            yields offers its paths to the shield among them.
        trust_pickle: See :func:`~jssa_gym.policies.load_policy`.

    Raises:
        ParameterError: It is nothing of these, or was trained for another environment.
        PolicyFileError: Its file is damaged, or holds something else.
    """
    if isinstance(policy, str):
        policy = policy_factory(policy, trust_pickle)(env, seed)
    if hasattr(policy, "predict"):
        return ModelPolicy(policy, env if seen is None else seen)
    if not callable(policy):
        raise ParameterError(f"a policy is a name, a file, 'module:factory', a model or a callable, got {policy!r}")
    if isinstance(policy, JPCPolicy) and seen is not None:
        policy.offer_to(seen)
    if isinstance(policy, LearnedPolicy):
        policy.check(env if seen is None else seen)
    return policy


def policy_factory(name: str, trust_pickle: bool = False) -> Callable[[gym.Env, int], Policy]:
    """What makes a policy of its name, file or ``"package.module:factory"`` for an environment and a seed.

    Raises:
        ParameterError: It is none of these, or cannot be loaded.
        PolicyFileError: Its file is damaged, or holds something else.
    """
    if name in POLICIES:
        return POLICIES[name]
    if policy_file(name) is not None:
        loaded = load_policy(name, trust_pickle=trust_pickle)
        return lambda env, seed: loaded
    if ":" not in name:
        known = ", ".join((*POLICIES, *shipped_policies()))
        raise ParameterError(f"unknown policy {name!r}; valid: {known}, a file .npz or .zip, or package.module:factory")
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ParameterError(
            f"cannot load the policy {name!r}: {error}; it is module:factory, of a module in the working directory or "
            "installed"
        ) from error
    if not callable(found):
        raise ParameterError(f"the policy {name!r} is no factory that can be called with an environment and a seed")
    try:
        inspect.signature(found).bind(None, 0)
    except TypeError as error:
        raise ParameterError(f"the factory {name!r} is called with an environment and a seed: {error}") from error
    except ValueError:
        pass  # something built in, which does not say what it takes
    return found


def check_unchanged(name: str, code: str) -> None:
    """Whether a policy's file is still what it was when the evaluation began.

    Args:
        name: Of the policy.
        code: :func:`policy_code` of it then.

    Raises:
        PolicyFileError: It is another one.
    """
    # a module was imported once and stays what it was; a file is read for every episode, and trainings replace theirs
    if name not in POLICIES and policy_file(name) is not None and policy_code(name) != code:
        raise PolicyFileError(f"{name} was changed while it was being evaluated; evaluate a copy")


def policy_code(policy: Any) -> str:
    """Digest of the file that holds or defines a policy; empty for this package's code."""
    if not isinstance(policy, str):
        return code_digest(policy)
    file = None if policy in POLICIES else policy_file(policy)
    if file is None:
        return code_digest(policy_factory(policy))
    return hashlib.sha256(file.read_bytes()).hexdigest()
