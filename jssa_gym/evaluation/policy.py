"""The policy of an episode: a name, a file, a model or a function, and what tells it from another."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from jssa_gym.evaluation.factories import load_factory
from jssa_gym.evaluation.identity import code_digest
from jssa_gym.exceptions import ParameterError, PolicyFileError
from jssa_gym.policies import POLICIES, JPCPolicy, LearnedPolicy, Policy, load_policy, policy_file, shipped_policies
from jssa_gym.policies.adapted import HeldPolicy, normalised
from jssa_gym.policies.model import ModelPolicy
from jssa_gym.policies.normalisation import read_normalisation
from jssa_gym.storage import sha256
from jssa_gym.validation import check_fields, positive_integer

_logger = logging.getLogger("jssa_gym")


@dataclass(frozen=True, slots=True)
class AsTrained:
    """What a policy met in its training and an environment that it is evaluated in has not.

    Raises:
        ParameterError: ``ticks`` is no positive integer.
        PolicyFileError: ``normalise`` is no file of ``VecNormalize.save``.
    """

    ticks: int = 1
    """For how many ticks a trained policy's action holds, as in the ActionRepeat of its training."""
    normalise: str | None = None
    """File of VecNormalize.save, whose statistics a trained policy's observations are normalised with."""

    def __post_init__(self) -> None:
        check_fields(self, ("ticks",), positive_integer)
        if self.normalise is not None:
            object.__setattr__(self, "normalise", str(self.normalise))
            read_normalisation(str(self.normalise))

    def adapted(self, policy: Policy) -> Policy:
        """A policy as it was trained."""
        if self.normalise is not None:
            policy = normalised(policy, read_normalisation(self.normalise))
        return policy if self.ticks == 1 else HeldPolicy(policy, self.ticks)

    def told(self) -> dict[str, Any]:
        """What tells it from others, as JSON can hold it; nothing where there is nothing to tell."""
        told: dict[str, Any] = {} if self.ticks == 1 else {"ticks": self.ticks}
        if self.normalise is not None:
            told["normalise"] = sha256(Path(self.normalise).read_bytes())
        return told

    def check(self, policies: Iterable[Any]) -> None:
        """Refuse it where nobody was trained, with a ParameterError; a log says what files do not say."""
        trained = [policy for policy in policies if not (isinstance(policy, str) and policy in POLICIES)]
        if self != AS_IT_IS and not trained:
            raise ParameterError("ticks and normalise are of trained policies: scripted ones are asked in every tick")
        for policy in trained:
            if isinstance(policy, str) and ((file := policy_file(policy)) is not None) and file.suffix == ".zip":
                unsaid = (
                    "" if self.normalise else ", nor whether its observations were normalised (then give normalise)"
                )
                _logger.warning("%s does not say which task it was trained for%s", policy, unsaid)


AS_IT_IS = AsTrained()
"""Asked in every tick with what is observed."""


def make_policy(
    policy: Any,
    env: gym.Env,
    seed: int,
    *,
    seen: gym.Env | None = None,
    trust_pickle: bool = False,
    trained: AsTrained = AS_IT_IS,
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
        trained: How it was trained; names of :data:`~jssa_gym.policies.POLICIES` were not.

    Raises:
        ParameterError: It is nothing of these, or was trained for another task or environment.
        PolicyFileError: Its file is damaged, or holds something else.
    """
    scripted = isinstance(policy, str) and policy in POLICIES
    if isinstance(policy, str):
        policy = policy_factory(policy, trust_pickle)(env, seed)
    if hasattr(policy, "predict"):
        if trained.normalise is not None and getattr(policy, "get_vec_normalize_env", lambda: None)() is not None:
            raise ParameterError("the model has its VecNormalize with it: leave normalise out")
        return trained.adapted(ModelPolicy(policy, env if seen is None else seen))
    if not callable(policy):
        raise ParameterError(f"a policy is a name, a file, 'module:factory', a model or a callable, got {policy!r}")
    if isinstance(policy, JPCPolicy) and seen is not None:
        policy.offer_to(seen)
    if isinstance(policy, LearnedPolicy):
        policy.check(env if seen is None else seen)
    return policy if scripted else trained.adapted(policy)


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
    return load_factory("policy", name, "an environment and a seed", None, 0)


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
    return sha256(file.read_bytes())
