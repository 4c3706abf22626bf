"""Episodes of a campaign: played fast, judged again where it matters."""

import hashlib
import logging
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.evaluation.campaign import Campaign, Cell
from jssa_gym.evaluation.contenders import PEOPLE, contender, shielded, within_assumptions
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.ledger import Chunk, trace_name
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.trace import save_trace
from jssa_gym.policies import POLICIES, Policy
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array, Status, Trace

_SUSPICIOUS = 1e-4
"""Contact speed from which an episode of a shield that promises rest is judged again [m/s]."""

_ROUNDING = 1e-9
"""Share of a limit that rounding may cost, as in the environment."""

POLICY_SEEDS = 10**9
"""Added to an episode's seed: what policy and people draw must have nothing in common."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode of a campaign in numbers."""

    filter: str
    human: str
    policy: str
    fault: str
    seed: int
    steps: int
    contact: bool
    moving_contact: bool
    """A touching point of the arm was faster than 1e-3 m/s at some tick."""
    contact_speed: float
    """Largest speed of a touching point [m/s]."""
    min_distance: float
    """[m]; inf without people."""
    violations: int
    """Ticks at which a joint limit is exceeded by more than rounding."""
    excess: float
    """By what share of its limit a joint exceeds it at most; negative if none does."""
    nominal: int
    """Ticks with this status; so the next four."""
    projected: int
    relaxed: int
    failsafe: int
    faulty: int
    no_stop: int
    """Ticks at which the wanted jerk had no stop inside the joint limits."""
    interventions: int
    first_fault: str
    """Reason of the first FAULT; empty without any."""
    joint_speed: float
    """Mean over the ticks of the Euclidean norm of the joint velocities [rad/s]."""
    wall: float
    """Time that it took [s]."""
    digest: str
    """SHA-256 of states, jerks and statuses."""
    judged: bool = False
    """Whether MuJoCo has judged it; else the rest says nothing."""
    agrees: bool = True
    """Whether the episode played again has the same digest and MuJoCo finds the same distances and contacts."""
    judged_speed: float = 0.0
    """Largest speed of a touching point at 1 kHz [m/s]."""
    judged_excess: float = 0.0
    """As ``excess``, at 1 kHz."""
    overlaps: int = 0
    """Collisions with the table and with itself at 1 kHz."""

    @property
    def cell(self) -> Cell:
        """What kind of episode it is."""
        return Cell(self.filter, self.human, self.policy, self.fault)

    @property
    def touched_moving(self) -> bool:
        """Whether the arm moved at some touching point, at a tick or, if MuJoCo was asked, between."""
        return self.moving_contact or self.judged_speed > MOVING

    @property
    def exceeds(self) -> bool:
        """Whether a joint limit was exceeded, at a tick or, if MuJoCo was asked, between."""
        return self.violations > 0 or self.judged_excess > _ROUNDING

    @property
    def broken(self) -> bool:
        """Whether something happened that must not: a broken promise, or two judges who disagree."""
        if not self.agrees:
            return True
        if not (contender(self.filter).promises and within_assumptions(self.human, self.fault)):
            return False
        return self.touched_moving or self.exceeds or self.overlaps > 0

    @property
    def severity(self) -> float:
        """For keeping the worst: disagreements first, then by contact speed and excess."""
        return (0.0 if self.agrees else 1e6) + max(self.contact_speed, self.judged_speed) + max(self.excess, 0.0)

    @property
    def trace_name(self) -> str:
        """Name of the file with its recording."""
        return trace_name(self.cell, self.seed)


def digest(states: Array, jerks: Array, status: NDArray[np.int64]) -> str:
    """SHA-256 of an episode, from shapes (T, 3, n), (T, n) and (T,)."""
    text = hashlib.sha256()
    for array, kind in ((states, np.float64), (jerks, np.float64), (status, np.int64)):
        text.update(np.ascontiguousarray(array, kind).tobytes())
    return text.hexdigest()


class Arena:
    """One cell's environment, in which its episodes are played one after the other."""

    def __init__(self, campaign: Campaign, cell: Cell) -> None:
        self.campaign, self.cell = campaign, cell
        self.base = ArmEnv(campaign.task, human=PEOPLE[cell.human](), terminate_on=())
        self.env = shielded(self.base, cell.filter, cell.fault)

    def _policy(self, seed: int) -> Policy:
        # policies see the truth: what they are told must not depend on the shield's sensor
        return POLICIES[self.cell.policy](self.base, POLICY_SEEDS + seed)

    def play(self, seed: int) -> Episode:
        """One episode."""
        begin, steps, env, base = time.perf_counter(), self.campaign.steps, self.env, self.base
        policy, n = self._policy(seed), base.robot.n
        states, jerks = np.empty((steps, 3, n)), np.empty((steps, n))
        distance, speed, violation, intervened = (np.zeros(steps) for _ in range(4))
        status, no_stop, first_fault = np.zeros(steps, np.int64), 0, ""
        observation, _ = env.reset(seed=seed)
        for k in range(steps):
            observation, _, _, _, info = env.step(policy(observation))
            state = base.scene.robot
            states[k, 0], states[k, 1], states[k, 2] = state
            jerks[k], distance[k], speed[k] = info["jerk"], info["distance"], info["contact_speed"]
            violation[k], intervened[k] = info["limit_violation"], info.get("shield/intervened", False)
            status[k] = code = info.get("shield/status", 0)
            if code == Status.FAILSAFE:
                no_stop += info["shield/reason"].startswith("no stop")
            elif code == Status.FAULT and not first_fault:
                first_fault = " ".join(info["shield/reason"].split())[:200]
        counts = np.bincount(status, minlength=len(Status)).tolist()
        return Episode(
            *self.cell,
            seed,
            steps,
            contact=bool((distance <= 0.0).any()),
            moving_contact=bool((speed > MOVING).any()),
            contact_speed=float(speed.max()),
            min_distance=float(distance.min()),
            violations=int(violation.sum()),
            excess=excess(states, jerks, base.robot.limits),
            nominal=counts[Status.NOMINAL],
            projected=counts[Status.PROJECTED],
            relaxed=counts[Status.RELAXED],
            failsafe=counts[Status.FAILSAFE],
            faulty=counts[Status.FAULT],
            no_stop=no_stop,
            interventions=int(intervened.sum()),
            first_fault=first_fault,
            joint_speed=float(np.linalg.norm(states[:, 1], axis=1).mean()),
            wall=time.perf_counter() - begin,
            digest=digest(states, jerks, status),
        )

    def record(self, seed: int) -> Trace:
        """The same episode, recorded."""
        name = f"{', '.join(self.cell)}, seed {seed}"
        return rollout(self.env, self._policy(seed), seed=seed, steps=self.campaign.steps, name=name)

    def judged(self, episode: Episode) -> tuple[Episode, Trace]:
        """The episode with what MuJoCo says about it, and its recording."""
        trace = self.record(episode.seed)
        verdict = judge(trace, self.base.robot)
        states = np.stack([trace.position, trace.velocity, trace.acceleration], axis=1)
        same = digest(states, trace.jerk, trace.status) == episode.digest
        return replace(
            episode,
            judged=True,
            agrees=same and verdict.same_course,
            judged_speed=verdict.contact_speed,
            judged_excess=max(verdict.excess),
            overlaps=len(verdict.self_collisions) + len(verdict.plane_collisions),
        ), trace


def excess(states: Array, jerks: Array, limits: JointLimits) -> float:
    """By what share of its limit a joint exceeds it at most; from shapes (T, 3, n) and (T, n)."""
    low, high = limits.position.T
    return max(
        float((np.maximum(states[:, 0] - high, low - states[:, 0]) / (high - low)).max()),
        float((np.abs(states[:, 1]) / limits.velocity).max() - 1.0),
        float((np.abs(states[:, 2]) / limits.acceleration).max() - 1.0),
        float((np.abs(jerks) / limits.jerk).max() - 1.0),
    )


def drawn(cell: Cell, seed: int, share: float) -> bool:
    """Whether an episode is among the share that is judged anyway: the same ones in every run."""
    number = hashlib.sha256(repr((tuple(cell), seed)).encode()).digest()
    return int.from_bytes(number[:6], "big") < share * 2**48


@contextmanager
def _expecting(fault: str) -> Generator[None]:
    """What a shield says aloud of what is wrong for good is no news where it is made wrong."""

    def news(record: logging.LogRecord) -> bool:
        return record.levelno > logging.WARNING

    logger = logging.getLogger("jssa_gym")
    if fault != "none":
        logger.addFilter(news)
    try:
        yield
    finally:
        logger.removeFilter(news)


def play(chunk: Chunk[Campaign, Cell]) -> Iterator[Episode]:
    """Play episodes of one cell and judge those that have to be."""
    with _expecting(chunk.cell.fault):
        yield from _played(chunk)


def _played(chunk: Chunk[Campaign, Cell]) -> Iterator[Episode]:
    campaign = chunk.plan
    arena = Arena(campaign, chunk.cell)
    careful = contender(chunk.cell.filter).promises
    for seed in chunk.seeds:
        episode = arena.play(seed)
        suspicious = careful and (episode.contact_speed > _SUSPICIOUS or episode.violations > 0)
        if suspicious or drawn(chunk.cell, seed, campaign.judge):
            episode, trace = arena.judged(episode)
            if episode.broken:
                chunk.traces.mkdir(parents=True, exist_ok=True)
                meta = {"seed": seed, "task": campaign.task, **chunk.cell._asdict(), **code_version()}
                save_trace(trace, chunk.traces / episode.trace_name, meta)
        yield episode
