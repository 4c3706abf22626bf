"""Campaigns: which shields, people, policies and faults are tried together, on which seeds."""

from collections.abc import Hashable, Iterable, Iterator
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, NamedTuple, TypeVar

from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.contenders import FAULTS, JOINTS, LATENCIES, MULTIPLES, PEOPLE, REPORTED, contender_names
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES
from jssa_gym.validation import known_name, number_within, positive_integer, whole_number

SPACING = 10_000
"""Most episodes of a cell: seeds of two cells differ by a multiple of it."""


AnyCell = TypeVar("AnyCell", bound=Hashable)


class Cell(NamedTuple):
    """One kind of episode."""

    filter: str
    human: str
    policy: str
    fault: str


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
    """Of every combination."""

    def __post_init__(self) -> None:
        known = {"filters": contender_names(), "humans": PEOPLE, "policies": POLICIES, "faults": FAULTS}
        for name, valid in known.items():
            chosen = getattr(self, name)
            if not chosen:
                raise ParameterError(f"no {name} to try; valid: {', '.join(valid)}")
            for one in chosen:
                known_name({"policies": "policy"}.get(name, name.removesuffix("s")), one, valid)
        object.__setattr__(self, "episodes", positive_integer("episodes", self.episodes))
        if self.episodes > SPACING:
            raise ParameterError(f"episodes has to be at most {SPACING} of a combination, got {self.episodes}")

    def cells(self) -> Iterator[Cell]:
        """The combinations."""
        for human, policy, fault, name in product(self.humans, self.policies, self.faults, self.filters):
            yield Cell(name, human, policy, fault)


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is tried. Every field takes part in the results; how many processes work at it does not.

    Seeds are those of ``env.reset``. Shields tried with the same people, policy and fault see the same seeds, so that
    what is drawn is the same too; other combinations see others.

    Raises:
        ParameterError: A value is out of range.
    """

    grids: tuple[Grid, ...]
    task: str = "home"
    steps: int = 1000
    """Control steps of an episode."""
    seed: int = 0
    """First seed."""
    judge: float = 0.02
    """Share of the episodes that MuJoCo judges anyway."""

    def __post_init__(self) -> None:
        known_name("task", self.task, TASKS)
        for name, value in (
            ("steps", positive_integer("steps", self.steps)),
            ("seed", whole_number("seed", self.seed)),
            ("judge", number_within("judge", self.judge, 0.0, 1.0)),
        ):
            object.__setattr__(self, name, value)  # JSON holds no numbers of numpy

    def seeds(self) -> dict[Cell, list[int]]:
        """Seeds of every cell, those of the same people, policy and fault side by side."""
        return paired_seeds(
            ((cell, cell[1:], grid.episodes) for grid in self.grids for cell in grid.cells()), self.seed
        )

    def config(self) -> dict[str, Any]:
        """All that decides about the results, as JSON can hold it."""
        return asdict(self)


def paired_seeds(wanted: Iterable[tuple[AnyCell, Hashable, int]], seed: int) -> dict[AnyCell, list[int]]:
    """Seeds of every cell: the same for cells with the same company, others for others.

    Args:
        wanted: Cells, each with what it shares its seeds with and its number of episodes, at most :data:`SPACING`.
        seed: The first one.
    """
    first: dict[Hashable, int] = {}
    seeds: dict[AnyCell, list[int]] = {}
    for cell, company, episodes in wanted:
        start = first.setdefault(company, seed + SPACING * len(first))
        if episodes > len(seeds.get(cell, ())):
            seeds[cell] = list(range(start, start + episodes))
    return seeds


_CALM = ("constant_velocity", "approach_retreat", "random", "walk_by")
_RESTLESS = ("random", "wander", "bang_bang", "limit_seeking", "chase")
_ATTACKERS = ("pursuit", "hand")
_GUARDS = (
    *("full", "lag", "no_lag", "no_speed", "low_speed", "no_verification", "off_by_one"),
    *("no_limits", "no_box", "no_limit_check"),
)

PRESETS: dict[str, tuple[Grid, ...]] = {
    "quick": (Grid(("full", "none"), _ATTACKERS, ("wander", "chase"), ("none", "all that is reported"), 1),),
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
            ("full", "jssa", "stop", "published", "none"),
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
