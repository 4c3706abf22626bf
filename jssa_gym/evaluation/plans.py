"""What is evaluated: named combinations, or an environment and a policy of one's own."""

import hashlib
import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym

from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.campaign import SPACING, paired_seeds
from jssa_gym.evaluation.contenders import PEOPLE
from jssa_gym.evaluation.filters import put_filter
from jssa_gym.evaluation.identity import code_digest, identity, named
from jssa_gym.evaluation.metrics import SeparationParams
from jssa_gym.exceptions import ParameterError, PolicyFileError
from jssa_gym.policies import POLICIES, LearnedPolicy, Policy, load_policy, policy_file, shipped_policies
from jssa_gym.policies.model import ModelPolicy
from jssa_gym.shields import read_name
from jssa_gym.validation import known_name, number_within, positive_integer, whole_number


class Setting(NamedTuple):
    """One kind of episode."""

    task: str
    filter: str
    human: str
    policy: str


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
        seen: The same environment with the wrappers whose observations it gets; by default ``env``.
        trust_pickle: See :func:`~jssa_gym.policies.load_policy`.

    Raises:
        ParameterError: It is nothing of these, or was trained for another environment.
        PolicyFileError: Its file is damaged, or holds something else.
    """
    if isinstance(policy, str):
        policy = _factory(policy, trust_pickle)(env, seed)
    if hasattr(policy, "predict"):
        return ModelPolicy(policy, env if seen is None else seen)
    if not callable(policy):
        raise ParameterError(f"a policy is a name, a file, 'module:factory', a model or a callable, got {policy!r}")
    if isinstance(policy, LearnedPolicy):
        policy.check(env if seen is None else seen)
    return policy


def _factory(name: str, trust_pickle: bool = False) -> Callable[[gym.Env, int], Policy]:
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


def _check(plan: "Study | Single") -> None:
    for name, value in (
        ("episodes", positive_integer("episodes", plan.episodes)),
        ("seed", whole_number("seed", plan.seed)),
        ("steps", positive_integer("steps", plan.steps)),
        ("v_safe", number_within("v_safe", plan.v_safe, 0.0)),
    ):
        object.__setattr__(plan, name, value)  # JSON holds no numbers of numpy
    if plan.episodes > SPACING:
        raise ParameterError(f"episodes has to be at most {SPACING} of a combination, got {plan.episodes}")
    if not isinstance(plan.separation, SeparationParams):
        raise ParameterError(f"separation has to be SeparationParams, got {plan.separation!r}")


@dataclass(frozen=True, slots=True)
class Study:
    """All combinations of some tasks, filters, people and policies, every one on the same seeds for all filters.

    Raises:
        ParameterError: An unknown name, none at all, or a number out of range.
    """

    tasks: tuple[str, ...]
    filters: tuple[str, ...]
    humans: tuple[str, ...]
    policies: tuple[str, ...]
    episodes: int = 100
    """Of every combination."""
    seed: int = 0
    """First seed."""
    steps: int = 1000
    """Control steps of an episode."""
    v_safe: float = MOVING
    """Speed of the robot's touching point from which a contact is critical [m/s]."""
    separation: SeparationParams = field(default_factory=SeparationParams)
    trust_pickle: bool = False
    """Of policies that are files; see :func:`~jssa_gym.policies.load_policy`."""
    code: tuple[tuple[str, str], ...] = field(init=False, repr=False)
    """Names of policies, and digests of the files that hold or define them, when the study was made."""

    def __post_init__(self) -> None:
        _check(self)
        for name in ("tasks", "filters", "humans", "policies"):
            if not getattr(self, name):
                raise ParameterError(f"no {name} to evaluate")
        for task in self.tasks:
            known_name("task", task, TASKS)
        for human in self.humans:
            known_name("human", human, PEOPLE)
        for name in self.filters:
            read_name(name)
        for policy in self.policies:
            _factory(policy, self.trust_pickle)
        object.__setattr__(self, "code", _codes(self.policies))

    def seeds(self) -> dict[Setting, list[int]]:
        """Seeds of every setting: the same for all filters, others for everything else."""
        settings = (Setting(t, f, h, p) for t, h, p, f in product(self.tasks, self.humans, self.policies, self.filters))
        return paired_seeds(((one, (one.task, one.human, one.policy), self.episodes) for one in settings), self.seed)

    def config(self) -> dict[str, Any]:
        """All that decides about the results, as JSON can hold it."""
        return {**asdict(self), "code": dict(_codes(self.policies))}

    def build(self, setting: Setting) -> gym.Env:
        """The environment of a setting."""
        return put_filter(ArmEnv(setting.task, human=PEOPLE[setting.human](), terminate_on=()), setting.filter)

    def policy(self, setting: Setting) -> Any:
        """What :func:`make_policy` takes."""
        return setting.policy

    def check_policy(self, setting: Setting) -> None:
        """Whether the file of a setting's policy is still what it was when the evaluation began.

        Raises:
            PolicyFileError: It is another one.
        """
        _check_unchanged(setting.policy, dict(self.code).get(setting.policy, ""))


@dataclass(frozen=True, slots=True)
class Single:
    """An environment and a policy, whatever they are.

    Raises:
        ParameterError: A number is out of range, or environment or policy is nothing that can be evaluated.
    """

    env: str | Callable[[], gym.Env] | gym.Env
    policy_of: Any
    """What :func:`make_policy` takes."""
    env_kwargs: Mapping[str, Any] | None = None
    """Of ``gymnasium.make``, where ``env`` is an id."""
    filter: str | None = None
    """Put around the environment; None leaves it as it is."""
    episodes: int = 100
    seed: int = 0
    steps: int = 1000
    v_safe: float = MOVING
    separation: SeparationParams = field(default_factory=SeparationParams)
    trust_pickle: ClassVar[bool] = False
    """Who trusts a file hands over what :func:`~jssa_gym.policies.load_policy` returns: one job, no ``out`` folder."""
    code: str = field(init=False, repr=False)
    """Digest of the file that holds or defines the policy, when the plan was made."""

    def __post_init__(self) -> None:
        _check(self)
        if self.filter is not None:
            read_name(self.filter)
        if not isinstance(self.env_kwargs, Mapping | None):
            raise ParameterError(f"env_kwargs has to be a mapping, got {self.env_kwargs!r}")
        if isinstance(self.env, str):
            if self.env not in gym.registry:
                ours = ", ".join(sorted(name for name in gym.registry if name.startswith("jssa_gym/")))
                raise ParameterError(f"unknown environment {self.env!r}; those of this package: {ours}")
        elif self.env_kwargs:
            raise ParameterError("env_kwargs belong to an environment's id, not to a factory or an environment")
        elif not (isinstance(self.env, gym.Env) or callable(self.env)):
            raise ParameterError(f"env has to be an id, a factory or an environment, got {self.env!r}")
        if isinstance(self.policy_of, str):
            _factory(self.policy_of)
        elif not (hasattr(self.policy_of, "predict") or callable(self.policy_of)):
            make_policy(self.policy_of, None, 0)  # ty: ignore[invalid-argument-type]  # raises
        object.__setattr__(self, "code", _policy_code(self.policy_of))

    @property
    def setting(self) -> Setting:
        """The only one: names, or classes where there are none."""
        human = (self.env_kwargs or {}).get("human", "")
        return Setting(
            named(self.env), self.filter or "", human if isinstance(human, str) else "", named(self.policy_of)
        )

    def seeds(self) -> dict[Setting, list[int]]:
        """Seeds of the only setting."""
        return {self.setting: list(range(self.seed, self.seed + self.episodes))}

    def config(self) -> dict[str, Any]:
        """All that decides about the results, as JSON can hold it: objects by name and digest."""
        return {
            "env": identity("env", self.env),
            "policy": identity("policy", self.policy_of),
            "code": [code_digest(self.env), _policy_code(self.policy_of)],
            "env_kwargs": identity("env_kwargs", dict(self.env_kwargs or {})),
            "filter": self.filter,
            "episodes": self.episodes,
            "seed": self.seed,
            "steps": self.steps,
            "v_safe": self.v_safe,
            "separation": asdict(self.separation),
        }

    def build(self, setting: Setting) -> gym.Env:
        """The environment; ids of this package run to the horizon unless ``terminate_on`` says otherwise."""
        if isinstance(self.env, str):
            kwargs: dict[str, Any] = dict(self.env_kwargs or {})
            if self.env.startswith("jssa_gym/"):
                kwargs = {"terminate_on": (), "max_episode_steps": self.steps, **kwargs}
            env = gym.make(self.env, **kwargs)
        else:
            env = self.env if isinstance(self.env, gym.Env) else self.env()
        return env if self.filter is None else put_filter(env, self.filter)

    def policy(self, setting: Setting) -> Any:
        """What :func:`make_policy` takes."""
        return self.policy_of

    def check_policy(self, setting: Setting) -> None:
        """See :meth:`Study.check_policy`."""
        if isinstance(self.policy_of, str):
            _check_unchanged(self.policy_of, self.code)


def _check_unchanged(name: str, code: str) -> None:
    # a module was imported once and stays what it was; a file is read for every episode, and trainings replace theirs
    if name not in POLICIES and policy_file(name) is not None and _policy_code(name) != code:
        raise PolicyFileError(f"{name} was changed while it was being evaluated; evaluate a copy")


def _codes(policies: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((name, code) for name in dict.fromkeys(policies) if (code := _policy_code(name)))


def _policy_code(policy: Any) -> str:
    """Digest of the file that holds or defines a policy; empty for this package's code."""
    if not isinstance(policy, str):
        return code_digest(policy)
    file = None if policy in POLICIES else policy_file(policy)
    if file is None:
        return code_digest(_factory(policy))
    return hashlib.sha256(file.read_bytes()).hexdigest()
