"""Episodes are played here: recorded, put into numbers and, where a plan asks for it, judged by MuJoCo."""

import logging
import shlex
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.batch import LEAST, at_once, vector_like
from jssa_gym.evaluation.contenders import NO_SENSOR
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.ledger import Chunk
from jssa_gym.evaluation.people import PEOPLE, known_person
from jssa_gym.evaluation.plan import AnyRow, EpisodePlan
from jssa_gym.evaluation.policy import AsTrained
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.rollout_vector import rollouts
from jssa_gym.evaluation.rows import Setting, digest_of, trace_name
from jssa_gym.evaluation.study import Study
from jssa_gym.evaluation.trace import save_trace
from jssa_gym.exceptions import InterfaceError, InvalidActionError, ParameterError
from jssa_gym.humans.files import is_file
from jssa_gym.policies import POLICIES, shipped_policies
from jssa_gym.policies.vector import make_vector_policy
from jssa_gym.robots import DEFAULT, ROBOTS
from jssa_gym.types import Trace
from jssa_gym.validation import known_name

POLICY_SEEDS = 10**9
"""Added to an episode's seed: what policy and people draw must have nothing in common."""


class Player(Generic[AnyRow]):
    """One cell's environment, in which its episodes are played one after the other.

    Args:
        plan: What is played.
        cell: Which of its cells.

    Raises:
        InterfaceError: The environment is none of this package.
    """

    def __init__(self, plan: EpisodePlan[AnyRow], cell: Any) -> None:
        self.plan, self.cell = plan, cell
        self.env = plan.make_env(cell)
        base = self.env.unwrapped
        if not isinstance(base, ArmEnv):
            raise InterfaceError(
                f"only environments around ArmEnv can be evaluated, not {type(base).__name__}: an evaluation needs the "
                "truth about distances; RecordSafety takes what info has"
            )
        self.robot = base.robot

    def record(self, seed: int) -> Trace:
        """One episode, recorded."""
        # policies see the truth: what they are told must not depend on the shield's sensor
        policy = self.plan.make_policy(self.cell, self.env, POLICY_SEEDS + seed)
        return rollout(self.env, policy, seed=seed, steps=self.plan.steps, name=self._name(seed))

    def measure(self, seed: int) -> AnyRow:
        """One episode in numbers."""
        begin = time.perf_counter()
        return self.plan.measure(self.cell, seed, self.record(seed), self.robot, begin)

    def measure_all(self, seeds: Sequence[int]) -> Iterator[AnyRow]:
        """Episodes in numbers, in order: played at once where that can be done, which changes nothing in them."""
        size = at_once(self.plan.steps)
        for some in (seeds[k : k + size] for k in range(0, len(seeds), size)):
            yield from self._measure_at_once(some) or map(self.measure, some)

    def _measure_at_once(self, seeds: Sequence[int]) -> Iterator[AnyRow] | None:
        """Episodes in numbers, once all of them have been played; None where each has to be played by itself."""
        plan, cell = self.plan, self.cell
        if len(seeds) < LEAST or (envs := vector_like(self.env, len(seeds))) is None:
            return None
        draws = [POLICY_SEEDS + seed for seed in seeds]
        # made as ever, so that its file is looked at as ever
        policy, named = plan.make_policy(cell, self.env, draws[0]), plan.named_policy(cell)
        together = make_vector_policy(named if isinstance(named, str) and named in POLICIES else policy, envs)
        if together is None:
            return None
        names = [self._name(seed) for seed in seeds]
        try:
            played = rollouts(envs, together, seeds, draws, names, steps=plan.steps)
        except InvalidActionError:  # whose that was, and what ended before, single episodes tell
            return None
        return (
            plan.measure(cell, seed, trace, self.robot, time.perf_counter() - took)
            for seed, (trace, took) in zip(seeds, played, strict=True)
        )

    def _name(self, seed: int) -> str:
        return f"{', '.join(part for part in self.cell if part)}, seed {seed}"

    def save(self, trace: Trace, seed: int, folder: Path) -> tuple[Path, str]:
        """Keep an episode's recording in a folder; its path and digest."""
        path, digest = folder / trace_name(self.cell, seed), digest_of(trace)
        folder.mkdir(parents=True, exist_ok=True)
        save_trace(trace, path, self.plan.origin(self.cell, seed, digest) | code_version())
        return path, digest


def play(chunk: Chunk[AnyRow]) -> Iterator[AnyRow]:
    """Play episodes of one cell: record, measure and, where the plan has doubts, play again, judge and keep."""
    plan, cell = chunk.plan, chunk.cell
    with _warnings_unsaid(plan.spoiled(cell)):
        player = Player(plan, cell)
        for seed, row in zip(chunk.seeds, player.measure_all(chunk.seeds), strict=True):
            if plan.doubts(row):
                trace = player.record(seed)
                row = plan.judged(row, trace, judge(trace, player.robot))
                if row.broken:
                    player.save(trace, seed, chunk.traces)
            yield row


def record(chunk: Chunk) -> Iterator[tuple[Path, str]]:
    """Play episodes of one cell again and keep their recordings; paths and digests."""
    player = Player(chunk.plan, chunk.cell)
    for seed in chunk.seeds:
        yield player.save(player.record(seed), seed, chunk.traces)


@contextmanager
def _warnings_unsaid(unsaid: bool) -> Generator[None]:
    """What a shield says aloud of what is wrong for good is no news where it is made wrong."""

    def news(record: logging.LogRecord) -> bool:
        return record.levelno > logging.WARNING

    logger = logging.getLogger("jssa_gym")
    if unsaid:
        logger.addFilter(news)
    try:
        yield
    finally:
        logger.removeFilter(news)


def recorded_setting(meta: Mapping[str, Any], policy: str | None = None, human: str | None = None) -> Setting:
    """What kind of episode a recording is of, where nothing has to be read or run that only the recording names.

    Args:
        meta: Of the recording.
        policy, human: See :func:`played_again`.

    Raises:
        ParameterError: It does not say, or names a policy or people that are not the package's.
    """
    if meta.get("named") is not True:
        raise ParameterError("only episodes of `jssa-gym evaluate` and `jssa-gym compare` can be played again")
    try:
        setting = Setting(*(str(meta[name]) for name in Setting._fields))
    except KeyError as error:
        raise ParameterError(f"the recording does not say how it came about: {error} is missing") from error
    if human is not None:
        setting = setting._replace(human=known_person(human))
    elif is_file(setting.human):
        raise ParameterError(
            f"the recording asks for the people {setting.human!r}, a file that only it names; if it is there, repeat "
            f"it: --human {shlex.quote(setting.human)}"
        )
    else:
        known_name("human", setting.human, PEOPLE)
    if policy is not None:
        return setting._replace(policy=policy)
    if setting.policy not in (*POLICIES, *shipped_policies()):
        raise ParameterError(
            f"the recording asks for the policy {setting.policy!r}, a file or code that only it names; if you trust "
            f"that, repeat it: --policy {shlex.quote(setting.policy)}"
        )
    return setting


def played_again(
    meta: Mapping[str, Any],
    *,
    policy: str | None = None,
    robot: str | None = None,
    human: str | None = None,
    trust_pickle: bool = False,
) -> Trace:
    """Play a recorded episode anew from what its recording says of itself.

    Nothing that only the recording names is read or run: a policy that is a file or ``"module:factory"``, and people
    that are a file, have to be given by whoever plays it.

    Args:
        meta: Of the recording.
        policy: Instead of the one that it names, as :func:`~jssa_gym.evaluation.policy.make_policy` takes it.
        robot: Its robot, if that is not the package's own.
        trust_pickle: If its policy is a file, see :func:`~jssa_gym.policies.load_policy`.
        human: Instead of the people that it names.

    Raises:
        ParameterError: It does not say enough: only episodes made of names can be made again. Or it names a policy
            that is not the package's, which has to be repeated.
    """
    setting = recorded_setting(meta, policy, human)
    try:
        seed, steps = int(meta["seed"]), int(meta["steps"])
    except (KeyError, TypeError, ValueError) as error:
        raise ParameterError(f"the recording does not say how it came about: {error} is missing or wrong") from error
    tasks, filters, humans, policies = ((name,) for name in setting)
    named = str(meta.get("robot", DEFAULT))
    if robot is None and named not in ROBOTS:  # nor is a file that a recording names
        raise ParameterError(f"the robot {named!r} is not the package's own; give its file as --robot")
    wanted = named if robot is None else robot
    sensor = str(meta.get("sensor", NO_SENSOR))
    plan = Study(
        tasks, filters, humans, policies, steps=steps, trust_pickle=trust_pickle, robot=wanted, sensor=sensor,
        trained=_trained(meta),
    )  # fmt: skip
    return Player(plan, setting).record(seed)


def _trained(meta: Mapping[str, Any]) -> AsTrained:
    """How the policy of a recording was trained; what only the recording names is not read."""
    if "normalise" in meta:
        raise ParameterError("the recording's policy had normalised observations: play it by evaluate(normalise=...)")
    return AsTrained(meta.get("ticks", 1))
