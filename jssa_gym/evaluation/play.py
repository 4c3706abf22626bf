"""Episodes of an evaluation: played and recorded, put into numbers."""

import shlex
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.blocked import fault_of
from jssa_gym.evaluation.contenders import PEOPLE
from jssa_gym.evaluation.episodes import POLICY_SEEDS, digest
from jssa_gym.evaluation.geometry import geometry
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.ledger import Chunk, trace_name
from jssa_gym.evaluation.metrics import Summary, summarise
from jssa_gym.evaluation.plans import Setting, Single, Study, make_policy
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.trace import save_trace
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.policies import POLICIES, shipped_policies
from jssa_gym.types import Trace
from jssa_gym.validation import known_name

AnyStudy = Study | Single


@dataclass(frozen=True, slots=True)
class Scored:
    """One episode of an evaluation in numbers."""

    task: str
    filter: str
    human: str
    policy: str
    seed: int
    summary: Summary
    fault: str
    """The most frequent reason of its FAULTs; empty without any."""
    digest: str
    """SHA-256 of states, jerks and statuses."""
    wall: float
    """Time that it took [s]."""

    @property
    def cell(self) -> Setting:
        """What kind of episode it is."""
        return Setting(self.task, self.filter, self.human, self.policy)

    @property
    def severity(self) -> tuple[float, float, float]:
        """For keeping the worst: by the speed of a moving contact, then by limits exceeded, then by distance."""
        summary = self.summary
        # the speed of an arm at rest is rounding
        return (
            summary.contact_speed if summary.moving_contact else 0.0,
            summary.limit_violation_rate,
            -summary.min_distance,
        )

    @property
    def trace_name(self) -> str:
        """Name of the file with its recording."""
        return trace_name(self.cell, self.seed)


class Player:
    """One setting's environment, in which its episodes are played one after the other.

    Args:
        plan: What is evaluated.
        setting: Which of its settings.
    """

    def __init__(self, plan: AnyStudy, setting: Setting) -> None:
        self.plan, self.setting = plan, setting
        self.env = plan.build(setting)
        base = self.env.unwrapped
        if not isinstance(base, ArmEnv):
            raise InterfaceError(
                f"only environments around ArmEnv can be evaluated, not {type(base).__name__}: an evaluation needs the "
                "truth about distances; RecordSafety takes what info has"
            )
        self.robot = base.robot

    def record(self, seed: int) -> Trace:
        """One episode."""
        # policies see the truth: what they are told must not depend on the shield's sensor
        policy = make_policy(
            self.plan.policy(self.setting),
            self.env.unwrapped,
            POLICY_SEEDS + seed,
            seen=self.env,
            trust_pickle=self.plan.trust_pickle,
        )
        self.plan.check_policy(self.setting)  # what was read, after it was read
        name = f"{', '.join(part for part in self.setting if part)}, seed {seed}"
        return rollout(self.env, policy, seed=seed, steps=self.plan.steps, name=name)

    def score(self, seed: int) -> Scored:
        """One episode in numbers."""
        begin, plan = time.perf_counter(), self.plan
        trace = self.record(seed)
        summary = summarise(
            trace, self.robot.limits, geometry(trace, self.robot), v_safe=plan.v_safe, separation=plan.separation
        )
        return Scored(*self.setting, seed, summary, fault_of(trace), digest_of(trace), time.perf_counter() - begin)


def digest_of(trace: Trace) -> str:
    """SHA-256 of an episode's states, jerks and statuses."""
    states = np.stack([trace.position, trace.velocity, trace.acceleration], axis=1)
    return digest(states, trace.jerk, trace.status)


def score(chunk: Chunk[AnyStudy, Setting]) -> Iterator[Scored]:
    """Play episodes of one setting."""
    player = Player(chunk.plan, chunk.cell)
    for seed in chunk.seeds:
        yield player.score(seed)


def record(chunk: Chunk[AnyStudy, Setting]) -> Iterator[tuple[Path, str]]:
    """Play episodes of one setting again and save their recordings; paths and digests."""
    player = Player(chunk.plan, chunk.cell)
    chunk.traces.mkdir(parents=True, exist_ok=True)
    for seed in chunk.seeds:
        trace = player.record(seed)
        path, told = chunk.traces / trace_name(chunk.cell, seed), digest_of(trace)
        save_trace(trace, path, meta_of(chunk.plan, chunk.cell, seed, told))
        yield path, told


def meta_of(plan: AnyStudy, setting: Setting, seed: int, told: str) -> dict[str, Any]:
    """Where a recording comes from, for :func:`played_again`, and which code made it."""
    named = isinstance(plan, Study)
    played = {**setting._asdict(), "seed": seed, "steps": plan.steps, "digest": told, "named": named}
    return played | code_version()


def recorded_setting(meta: Mapping[str, Any], policy: str | None = None) -> Setting:
    """What kind of episode a recording is of, where nothing has to be read or run that only the recording names.

    Args:
        meta: Of the recording.
        policy: See :func:`played_again`.

    Raises:
        ParameterError: It does not say, or names a policy or people that are not the package's.
    """
    if meta.get("named") is not True:
        raise ParameterError("only episodes of `jssa-gym evaluate` and `jssa-gym compare` can be played again")
    try:
        setting = Setting(*(str(meta[name]) for name in Setting._fields))
    except KeyError as error:
        raise ParameterError(f"the recording does not say how it came about: {error} is missing") from error
    known_name("human", setting.human, PEOPLE)  # no file
    if policy is not None:
        return setting._replace(policy=policy)
    if setting.policy not in (*POLICIES, *shipped_policies()):
        raise ParameterError(
            f"the recording asks for the policy {setting.policy!r}, a file or code that only it names; if you trust "
            f"that, repeat it: --policy {shlex.quote(setting.policy)}"
        )
    return setting


def played_again(meta: Mapping[str, Any], *, policy: str | None = None, trust_pickle: bool = False) -> Trace:
    """Play a recorded episode anew from what its recording says of itself.

    Nothing that only the recording names is read or run: a policy that is a file or ``"module:factory"`` has to be
    given by whoever plays it.

    Args:
        meta: Of the recording.
        policy: Instead of the one that it names, as :func:`~jssa_gym.evaluation.plans.make_policy` takes it.
        trust_pickle: If its policy is a file, see :func:`~jssa_gym.policies.load_policy`.

    Raises:
        ParameterError: It does not say enough: only episodes made of names can be made again. Or it names a policy
            that is not the package's, which has to be repeated.
    """
    setting = recorded_setting(meta, policy)
    try:
        seed, steps = int(meta["seed"]), int(meta["steps"])
    except (KeyError, TypeError, ValueError) as error:
        raise ParameterError(f"the recording does not say how it came about: {error} is missing or wrong") from error
    tasks, filters, humans, policies = ((name,) for name in setting)
    plan = Study(tasks, filters, humans, policies, steps=steps, trust_pickle=trust_pickle)
    return Player(plan, setting).record(seed)
