"""Campaigns: which shields, people, policies and faults are tried together, and whom MuJoCo judges."""

import hashlib
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.blocked import one_line
from jssa_gym.evaluation.contenders import (
    FAULTS,
    JOINTS,
    LATENCIES,
    REPORTED,
    contender,
    contender_names,
    shielded,
)
from jssa_gym.evaluation.identity import robot_identity, without_default
from jssa_gym.evaluation.judgement import Excess, Judgement
from jssa_gym.evaluation.people import MULTIPLES, PEOPLE, known_person, make_person, people_digests
from jssa_gym.evaluation.plan import EpisodePlan, episodes_of_a_cell, paired_seeds
from jssa_gym.evaluation.policy import make_policy
from jssa_gym.evaluation.rows import Cell, Row, StressRow, digest_of, states_of
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES, Policy
from jssa_gym.robots import DEFAULT, RobotModel
from jssa_gym.shields.reasons import REASONS
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.tick import codes
from jssa_gym.types import Status, Trace
from jssa_gym.validation import check_fields, known_name, number_within, positive_integer, whole_number

_SUSPICIOUS = 1e-4
"""Contact speed from which an episode of a shield that promises rest is judged [m/s]."""


@dataclass(frozen=True, slots=True)
class Grid:
    """All combinations of some names.

    Raises:
        ParameterError: An unknown name, none at all, or a number of episodes that is not in [1, 10000].
    """

    filters: tuple[str, ...]
    humans: tuple[str, ...]
    policies: tuple[str, ...]
    faults: tuple[str, ...] = ("none",)
    episodes: int = 10
    """Episodes of every combination."""

    def __post_init__(self) -> None:
        known = {"filters": contender_names(), "humans": PEOPLE, "policies": POLICIES, "faults": FAULTS}
        for name, valid in known.items():
            chosen = getattr(self, name)
            if not chosen:
                raise ParameterError(f"no {name} to try; valid: {', '.join(valid)}")
            for one in chosen:
                if name == "humans":
                    known_person(one)  # or a file
                else:
                    known_name({"policies": "policy"}.get(name, name.removesuffix("s")), one, valid)
        object.__setattr__(self, "episodes", episodes_of_a_cell(self.episodes))

    def cells(self) -> Iterator[Cell]:
        """The combinations."""
        for human, policy, fault, name in product(self.humans, self.policies, self.faults, self.filters):
            yield Cell(name, human, policy, fault)


@dataclass(frozen=True, slots=True)
class Campaign(EpisodePlan[StressRow]):
    """What is tried to break shields.

    Seeds are those of ``env.reset``. Shields tried with the same people, policy and fault see the same seeds, so that
    what is drawn is the same too; other combinations see others.

    Raises:
        ParameterError: A value is out of range.
    """

    row: ClassVar[type[Row]] = StressRow

    grids: tuple[Grid, ...]
    task: str = "home"
    steps: int = 1000
    """Control steps of an episode."""
    seed: int = 0
    """First seed."""
    judge: float = 0.02
    """Share of the episodes that MuJoCo judges anyway."""
    robot: str = DEFAULT
    """Name of a robot, or its file or prepared folder."""

    def __post_init__(self) -> None:
        known_name("task", self.task, TASKS)
        robot_identity(self.robot)
        check_fields(self, ("steps",), positive_integer)
        check_fields(self, ("seed",), whole_number)
        check_fields(self, ("judge",), number_within, 0.0, 1.0)

    def seeds(self) -> dict[Cell, list[int]]:
        return paired_seeds(((cell, grid.episodes) for grid in self.grids for cell in grid.cells()), self.seed)

    def config(self) -> dict[str, Any]:
        files = people_digests(human for grid in self.grids for human in grid.humans)
        return {**without_default(asdict(self)), **({"people": files} if files else {})}

    def make_env(self, cell: Cell) -> gym.Env:
        env = ArmEnv(self.task, human=make_person(cell.human), robot=self.robot, terminate_on=())
        return shielded(env, cell.filter, cell.fault)

    def make_policy(self, cell: Cell, env: gym.Env, seed: int) -> Policy:
        return make_policy(cell.policy, env.unwrapped, seed, seen=env)

    def measure(self, cell: Cell, seed: int, trace: Trace, robot: RobotModel, begin: float) -> StressRow:
        counts = np.bincount(trace.status, minlength=len(Status)).tolist()
        stops = trace.reason[trace.status == Status.FAILSAFE].tolist()
        faults = map(one_line, trace.reason[trace.status == Status.FAULT].tolist())
        return StressRow(
            *cell,
            seed,
            steps=len(trace.time),
            contact=bool((trace.distance <= 0.0).any()),
            moving_contact=bool((trace.contact_speed > MOVING).any()),
            contact_speed=float(trace.contact_speed.max()),
            min_distance=float(trace.distance.min()),
            violations=int(trace.limit_violation.sum()),
            excess=max(Excess.of(states_of(trace), trace.jerk, robot.limits)),
            nominal=counts[Status.NOMINAL],
            projected=counts[Status.PROJECTED],
            relaxed=counts[Status.RELAXED],
            failsafe=counts[Status.FAILSAFE],
            faulty=counts[Status.FAULT],
            no_stop=sum(reason.startswith(REASONS[codes.LIMITS]) for reason in stops),
            interventions=int(trace.intervened.sum()),
            first_fault=next(filter(None, faults), ""),
            joint_speed=float(np.linalg.norm(trace.velocity, axis=1).mean()),
            wall=time.perf_counter() - begin,
            digest=digest_of(trace),
        )

    def origin(self, cell: Cell, seed: int, digest: str) -> dict[str, Any]:
        return without_default({"seed": seed, "task": self.task, **cell._asdict(), "robot": self.robot})

    def spoiled(self, cell: Cell) -> bool:
        return cell.fault != "none"

    def doubts(self, row: StressRow) -> bool:
        suspicious = row.contact_speed > _SUSPICIOUS or row.violations > 0
        return (suspicious and contender(row.filter).promises) or drawn(row.cell, row.seed, self.judge)

    def judged(self, row: StressRow, again: Trace, verdict: Judgement) -> StressRow:
        return replace(
            row,
            judged=True,
            agrees=digest_of(again) == row.digest and verdict.same_course,
            judged_speed=verdict.contact_speed,
            judged_excess=max(verdict.excess),
            overlaps=len(verdict.self_collisions) + len(verdict.plane_collisions),
        )


def drawn(cell: Cell, seed: int, share: float) -> bool:
    """Whether an episode is among the share that is judged anyway: the same ones in every run."""
    number = hashlib.sha256(repr((tuple(cell), seed)).encode()).digest()
    return int.from_bytes(number[:6], "big") < share * 2**48


_CALM = ("constant_velocity", "approach_retreat", "random", "walk_by")
_RESTLESS = ("random", "wander", "bang_bang", "limit_seeking", "chase")
_ATTACKERS = ("pursuit", "hand")
_GUARDS = (
    *("full", "lag", "no_lag", "no_speed", "low_speed", "no_verification", "off_by_one"),
    *("no_limits", "no_box", "no_limit_check"),
)

PRESETS: dict[str, tuple[Grid, ...]] = {
    "quick": (Grid(("full", UNSHIELDED), _ATTACKERS, ("wander", "chase"), ("none", "all that is reported"), 1),),
    "claim": (Grid(("full",), (*_CALM, *_ATTACKERS, "feint", "two"), ("hold", "constant", *_RESTLESS), REPORTED, 12),),
    "power": (
        Grid(
            _GUARDS,
            _ATTACKERS,
            _RESTLESS,
            episodes=100,
        ),
        Grid(("full", "no_age"), _ATTACKERS, _RESTLESS, ("latency 100 ms",), 100),
        Grid(("full", "no_joint_check"), _ATTACKERS, _RESTLESS, ("stale joints",), 100),
        Grid(
            ("full", "stop", "closest_row", "one_step"),
            ("approach_retreat", "walk_by"),
            ("hold", "wander"),
            episodes=250,
        ),
    ),
    "joints": (
        Grid(
            ("full", "no_joint_check"),
            (*_ATTACKERS, "feint", "two", "walk_by"),
            ("constant", *_RESTLESS),
            JOINTS,
            4,
        ),
    ),
    "avoid": (
        Grid(
            ("full", "jssa", "stop", "published", UNSHIELDED),
            ("approach_retreat", "walk_by"),
            ("hold", "wander"),
            episodes=500,
        ),
    ),
    "degradation": (
        Grid(
            ("full",),
            tuple(f"{who} x{multiple:g}" for who in _ATTACKERS for multiple in MULTIPLES),
            ("wander", "chase"),
            episodes=25,
        ),
        Grid(("full",), _ATTACKERS, ("wander", "chase"), tuple(f"unmodelled {ms} ms" for ms in LATENCIES), 25),
    ),
}
"""Campaigns by name: a check in seconds, the promise of the whole shield, the power to see a missing guard, joint
states and clocks that are wrong, harmless people, and people faster or measurements later than assumed.
"""
