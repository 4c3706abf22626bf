"""Evaluations: combinations of names, or an environment and a policy of one's own."""

import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any, ClassVar

import gymnasium as gym

from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.blocked import fault_of
from jssa_gym.evaluation.contenders import FAULTS, NO_SENSOR, assumed_of, spoiled
from jssa_gym.evaluation.geometry import geometry
from jssa_gym.evaluation.identity import code_digest, identity, named, robot_identity, without_default, without_sensor
from jssa_gym.evaluation.metrics import SeparationParams, summarise
from jssa_gym.evaluation.people import known_person, make_person, people_digests
from jssa_gym.evaluation.plan import EpisodePlan, episodes_of_a_cell, paired_seeds
from jssa_gym.evaluation.policy import AS_IT_IS, AsTrained, check_unchanged, make_policy, policy_code, policy_factory
from jssa_gym.evaluation.rows import EvaluationRow, Row, Setting, digest_of
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES, Policy
from jssa_gym.robots import DEFAULT, RobotModel, make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import Shield, read_name
from jssa_gym.shields.wrappers import layer_of
from jssa_gym.types import Trace
from jssa_gym.validation import check_fields, known_name, number_within, positive_integer, whole_number


def put_filter(env: gym.Env, name: str, assumed: FailsafeParams | None = None) -> Shield:
    """A shield by the name of its filter around an environment.

    Args:
        env: The environment; see :class:`~jssa_gym.shields.Shield` for what it has to offer.
        name: As :func:`~jssa_gym.shields.read_name` reads it.
        assumed: What its verified stop assumes, if it has one; None for what it does anyway.

    Raises:
        ParameterError: Unknown name, the environment has a shield, or no task with a shielded id.
    """
    if layer_of(env, Shield) is not None:
        raise ParameterError(f"{env} has a shield already: give a filter or an environment with a shield, not both")
    guarded = read_name(name).guarded
    return Shield(env, name, stop=assumed if guarded and assumed is not None else False)


class Evaluation(EpisodePlan[EvaluationRow]):
    """What is put into numbers: a plan whose episodes are measured in full."""

    __slots__ = ()

    row: ClassVar[type[Row]] = EvaluationRow
    by_name: ClassVar[bool]
    """Whether names say all of an episode, so that it can be played again from its recording."""
    episodes: int
    """Episodes of every setting."""
    seed: int
    """First seed."""
    v_safe: float
    """Speed of the robot's touching point from which a contact is critical [m/s]."""
    separation: SeparationParams

    def __post_init__(self) -> None:
        object.__setattr__(self, "episodes", episodes_of_a_cell(self.episodes))
        check_fields(self, ("seed",), whole_number)
        check_fields(self, ("steps",), positive_integer)
        check_fields(self, ("v_safe",), number_within, 0.0)
        if not isinstance(self.separation, SeparationParams):
            raise ParameterError(f"separation has to be SeparationParams, got {self.separation!r}")

    def uncovered(self) -> tuple[str, ...]:
        """Joints of the robot's links that have no capsules."""
        raise NotImplementedError

    def measure(self, cell: Setting, seed: int, trace: Trace, robot: RobotModel, begin: float) -> EvaluationRow:
        seen = geometry(trace, robot)
        summary = summarise(trace, robot.limits, seen, v_safe=self.v_safe, separation=self.separation)
        return EvaluationRow(*cell, seed, summary, fault_of(trace), digest_of(trace), wall=time.perf_counter() - begin)

    def origin(self, cell: Setting, seed: int, digest: str) -> dict[str, Any]:
        return {**cell._asdict(), "seed": seed, "steps": self.steps, "digest": digest, "named": self.by_name}


@dataclass(frozen=True, slots=True)
class Study(Evaluation):
    """All combinations of some tasks, filters, people and policies, every one on the same seeds for all filters.

    Raises:
        ParameterError: An unknown name, none at all, or a number out of range.
    """

    by_name: ClassVar[bool] = True

    tasks: tuple[str, ...]
    filters: tuple[str, ...]
    humans: tuple[str, ...]
    policies: tuple[str, ...]
    episodes: int = 100
    """Episodes of every combination."""
    seed: int = 0
    """First seed."""
    steps: int = 1000
    """Control steps of an episode."""
    v_safe: float = MOVING
    """Speed of the robot's touching point from which a contact is critical [m/s]."""
    separation: SeparationParams = field(default_factory=SeparationParams)
    trust_pickle: bool = False
    """Whether to trust policies that are files; see :func:`~jssa_gym.policies.load_policy`."""
    robot: str = DEFAULT
    """Name of a robot, or its file or prepared folder."""
    pair_policies: bool = False
    """Whether policies have the same seeds too, so that they can be compared in pairs."""
    sensor: str = NO_SENSOR
    """What is between the people and the filter, by name in :data:`~jssa_gym.evaluation.contenders.FAULTS`."""
    trained: AsTrained = AS_IT_IS
    """How the trained ones of the policies were trained."""
    code: tuple[tuple[str, str], ...] = field(init=False, repr=False)
    """Names of policies, and digests of the files that hold or define them, when the study was made."""

    def __post_init__(self) -> None:
        Evaluation.__post_init__(self)
        for name in ("tasks", "filters", "humans", "policies"):
            if not getattr(self, name):
                raise ParameterError(f"no {name} to evaluate")
        for task in self.tasks:
            known_name("task", task, TASKS)
        for human in self.humans:
            known_person(human)
        for name in self.filters:
            read_name(name)
        for policy in self.policies:
            policy_factory(policy, self.trust_pickle)
        self.trained.check(self.policies)
        robot_identity(self.robot)
        known_name("sensor", self.sensor, FAULTS)
        object.__setattr__(self, "code", _codes(self.policies))

    def seeds(self) -> dict[Setting, list[int]]:
        """Seeds of every setting: the same for all filters, and policies if asked for, others for everything else."""
        names = product(self.tasks, self.humans, self.policies, self.filters)
        paired = ("filter", "policy") if self.pair_policies else ("filter",)
        return paired_seeds(((Setting(t, f, h, p), self.episodes) for t, h, p, f in names), self.seed, paired)

    def config(self) -> dict[str, Any]:
        files = people_digests(self.humans)
        people = {"people": files} if files else {}
        own = asdict(self)
        del own["trained"]
        if not self.pair_policies:
            del own["pair_policies"]  # what was begun before there was a choice is the same as ever
        code = {"code": dict(_codes(self.policies))}
        return {**without_default(without_sensor(own)), **self.trained.told(), **code, **people}

    def origin(self, cell: Setting, seed: int, digest: str) -> dict[str, Any]:
        told = {**Evaluation.origin(self, cell, seed, digest), "robot": self.robot, "sensor": self.sensor}
        told |= {} if cell.policy in POLICIES else self.trained.told()
        return without_default(without_sensor(told))

    def make_env(self, cell: Setting) -> gym.Env:
        env = ArmEnv(cell.task, human=make_person(cell.human), robot=self.robot, terminate_on=())
        if self.sensor == NO_SENSOR:
            return put_filter(env, cell.filter)
        return put_filter(spoiled(env, self.sensor), cell.filter, assumed_of(self.sensor))

    def uncovered(self) -> tuple[str, ...]:
        return make_robot(self.robot).uncovered

    def make_policy(self, cell: Setting, env: gym.Env, seed: int) -> Policy:
        policy = make_policy(
            cell.policy, env.unwrapped, seed, seen=env, trust_pickle=self.trust_pickle, trained=self.trained
        )
        check_unchanged(cell.policy, dict(self.code).get(cell.policy, ""))  # what was read, after it was read
        return policy


@dataclass(frozen=True, slots=True)
class Single(Evaluation):
    """An environment and a policy, whatever they are.

    Raises:
        ParameterError: A number is out of range, or environment or policy is nothing that can be evaluated.
    """

    by_name: ClassVar[bool] = False

    env: str | Callable[[], gym.Env] | gym.Env
    policy: Any
    """What :func:`~jssa_gym.evaluation.policy.make_policy` takes, without ``trust_pickle``: who trusts a file hands
    over what :func:`~jssa_gym.policies.load_policy` returns, for one job and no ``out`` folder."""
    env_kwargs: Mapping[str, Any] | None = None
    """Keywords of ``gymnasium.make``, where ``env`` is an id."""
    filter: str | None = None
    """Put around the environment; None leaves it as it is."""
    episodes: int = 100
    seed: int = 0
    steps: int = 1000
    v_safe: float = MOVING
    separation: SeparationParams = field(default_factory=SeparationParams)
    trained: AsTrained = AS_IT_IS
    """How the policy was trained."""
    code: str = field(init=False, repr=False)
    """Digest of the file that holds or defines the policy, when the plan was made."""

    def __post_init__(self) -> None:
        Evaluation.__post_init__(self)
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
        if isinstance(self.policy, str):
            policy_factory(self.policy)
        elif not (hasattr(self.policy, "predict") or callable(self.policy)):
            make_policy(self.policy, None, 0)  # ty: ignore[invalid-argument-type]  # raises
        self.trained.check((self.policy,))
        object.__setattr__(self, "code", policy_code(self.policy))

    @property
    def setting(self) -> Setting:
        """The only one: names, or classes where there are none."""
        human = (self.env_kwargs or {}).get("human", "")
        return Setting(named(self.env), self.filter or "", human if isinstance(human, str) else "", named(self.policy))

    def seeds(self) -> dict[Setting, list[int]]:
        """Seeds of the only setting."""
        return {self.setting: list(range(self.seed, self.seed + self.episodes))}

    def config(self) -> dict[str, Any]:
        """All that decides about the results, as JSON can hold it: objects by name and digest."""
        human = (self.env_kwargs or {}).get("human")
        files = people_digests(map(str, human if isinstance(human, list | tuple) else (human,)))
        return {
            "env": identity("env", self.env),
            "policy": identity("policy", self.policy),
            "code": [code_digest(self.env), policy_code(self.policy)],
            "env_kwargs": identity("env_kwargs", dict(self.env_kwargs or {})),
            "filter": self.filter,
            "episodes": self.episodes,
            "seed": self.seed,
            "steps": self.steps,
            "v_safe": self.v_safe,
            "separation": asdict(self.separation),
            **self.trained.told(),
            **({"people": files} if files else {}),
        }

    def make_env(self, cell: Setting) -> gym.Env:
        """The environment; ids of this package run to the horizon unless ``terminate_on`` says otherwise."""
        if isinstance(self.env, str):
            kwargs: dict[str, Any] = dict(self.env_kwargs or {})
            if self.env.startswith("jssa_gym/"):
                kwargs = {"terminate_on": (), "max_episode_steps": self.steps, **kwargs}
            env = gym.make(self.env, **kwargs)
        else:
            env = self.env if isinstance(self.env, gym.Env) else self.env()
        return env if self.filter is None else put_filter(env, self.filter)

    def uncovered(self) -> tuple[str, ...]:
        if isinstance(self.env, gym.Env):
            return _uncovered(self.env)
        with closing(self.make_env(self.setting)) as env:
            return _uncovered(env)

    def make_policy(self, cell: Setting, env: gym.Env, seed: int) -> Policy:
        policy = make_policy(self.policy, env.unwrapped, seed, seen=env, trained=self.trained)
        if isinstance(self.policy, str):
            check_unchanged(self.policy, self.code)
        return policy

    def named_policy(self, cell: Setting) -> Any:
        return self.policy


def _uncovered(env: gym.Env) -> tuple[str, ...]:
    base: Any = env.unwrapped
    return base.robot.uncovered


def _codes(policies: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((name, code) for name in dict.fromkeys(policies) if (code := policy_code(name)))
