r"""The map of :math:`(\lambda_1, \lambda_2)`: how many boundary states each pair loses, and which loses the fewest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym import robots
from jssa_gym.certificate.boundary import Boundary, Domain
from jssa_gym.certificate.census import Census
from jssa_gym.certificate.certify import moved_capsules
from jssa_gym.certificate.chunks import StateChunk, run
from jssa_gym.engine.cluster import Cluster, whose
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.feasibility import probe
from jssa_gym.rates import Rate
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.safety.index import IndexParams
from jssa_gym.storage import as_json
from jssa_gym.types import Array
from jssa_gym.validation import known_name, low_high, positive_integer, positive_number, whole_number

_ROUNDS = 2
"""Finer grids around the best pair, of up to five values of either parameter; each halves the steps. The best pair is
drawn again, so that it need not owe its place to luck."""

_MORE = 4
"""How many times as many states each finer grid draws."""


@dataclass(frozen=True, slots=True)
class LambdaPair:
    """One pair of parameters; rates by capsule."""

    lambda1: float
    lambda2: float
    infeasible: dict[str, Rate]
    """Boundary states in which no jerk keeps the index."""
    lost: dict[str, Rate]
    """Those, and those outside the certificate set: an approach that the index alone does not end in time."""
    trigger: float
    """Distance at which a person at top speed, straight at an arm at rest, has an index of 0 [m]."""

    @property
    def cost(self) -> float:
        """What the best pair has least of: lost states of the worst capsule, upper end of the 95 % interval."""
        return max(rate.high for rate in self.lost.values())


@dataclass(frozen=True, slots=True)
class LambdaMap:
    """Pairs that were tried."""

    domain: Domain
    d_min: float
    """[m]."""
    grid: tuple[tuple[float, ...], tuple[float, ...]]
    """Values of both parameters in the first grid."""
    cells: tuple[LambdaPair, ...]
    r"""All pairs but those with :math:`\lambda_1^2 < 8\lambda_2 d_{min}` and those whose boundary hardly meets the
    domain."""

    trigger: float
    """Largest :attr:`LambdaPair.trigger` that the best pair may have [m]."""

    @property
    def allowed(self) -> tuple[LambdaPair, ...]:
        """Pairs with at most that."""
        return tuple(cell for cell in self.cells if cell.trigger <= self.trigger)

    @property
    def best(self) -> LambdaPair:
        """The allowed pair with the least :attr:`LambdaPair.cost`."""
        return min(self.allowed, key=lambda cell: cell.cost)

    def as_json(self) -> dict[str, Any]:
        """The map as JSON can hold it."""
        return {**as_json(self), "best": as_json(self.best)}


def sweep(
    robot: str | Path | RobotModel = robots.DEFAULT,
    *,
    lambda1: tuple[float, float] = (0.5, 8.0),
    lambda2: tuple[float, float] = (0.05, 8.0),
    d_min: float = 0.05,
    grid: int = 7,
    trigger: float | None = None,
    domain: Domain | None = None,
    capsules: Sequence[str] = (),
    states: int = 5_000,
    seed: int = 0,
    jobs: int | Cluster = 1,
    dt: float = 0.008,
    progress: Callable[[int], Any] | None = None,
) -> LambdaMap:
    """Try a grid of pairs, then finer grids around the best.

    The measure is that of the domain, on another boundary for every pair: a difference between two pairs is one of
    both the arm's ability and the states that are asked about.

    Args:
        robot: A model, the name of one, or an MJCF file.
        lambda1: Range [m·s].
        lambda2: Range [m·s²].
        d_min: Margin of the index [m].
        grid: Values of either parameter, at least 2, evenly spaced by their logarithm.
        trigger: How far away the best pair may begin to slow down a person at top speed [m]: without a bound, ever
            larger parameters would lose ever fewer states. The domain's largest distance unless given.
        domain: Where states are drawn from.
        capsules: As of :func:`~jssa_gym.certificate.certify.certify`.
        states: Of each capsule and pair; the finer grids draw 4 and 16 times as many. The best pair is chosen by
            these very states: its interval does not account for that.
        seed: Of the draws.
        jobs: How many threads, or a :class:`~jssa_gym.evaluation.Cluster` of Ray's.
        dt: Control step [s].
        progress: Called with the number of pairs that are to come in a grid, negative, then with 1 after each.

    Raises:
        ParameterError: A value is out of range, or no pair can be tried.
        RobotModelError: As of :func:`~jssa_gym.robots.make_robot`.
    """
    model, domain = make_robot(robot), domain or Domain()
    names = tuple(dict.fromkeys(capsules)) or moved_capsules(model)
    for name in names:
        known_name("capsule", name, model.capsule_names)
    grid, states, jobs = positive_integer("grid", grid), positive_integer("states", states), whose(jobs)
    if grid < 2:
        raise ParameterError(f"grid has to be at least 2, got {grid}")
    seed, dt, d_min = whole_number("seed", seed), positive_number("dt", dt), positive_number("d_min", d_min)
    trigger = domain.distance[1] if trigger is None else positive_number("trigger", trigger)
    announce_compilation(probe)
    first = _axis("lambda1", lambda1, grid), _axis("lambda2", lambda2, grid)
    ones, twos = first
    tried: dict[tuple[float, float], LambdaPair] = {}
    allowed: list[LambdaPair] = []
    for finer in range(_ROUNDS + 1):
        if finer:
            best, half = min(allowed, key=lambda cell: cell.cost), 0.5**finer
            ones, twos = around(first[0], best.lambda1, half), around(first[1], best.lambda2, half)
        pairs = [(float(x), float(y)) for x in ones for y in twos if x**2 >= 8.0 * y * d_min]
        if progress is not None:
            progress(-len(pairs))
        indices = [IndexParams(d_min=d_min, lambda1=one, lambda2=two) for one, two in pairs]
        # all at once, so that nobody waits for a pair's last capsule
        chunks = [
            StateChunk(Boundary(model, index, name, domain, dt), finer, states * _MORE**finer, seed)
            for index in indices
            for name in names
        ]
        found: dict[IndexParams, dict[str, Census | None]] = {index: {} for index in indices}
        for chunk, census in run(chunks, jobs, _census):
            counted = found[chunk.boundary.index]
            counted[chunk.boundary.capsule] = census
            if progress is not None and len(counted) == len(names):
                progress(1)
        for index, counted in found.items():
            met = {name: census for name in names if (census := counted[name]) is not None}
            if len(met) == len(names):
                tried[index.lambda1, index.lambda2] = _cell(index, domain, met)
        allowed = [cell for cell in tried.values() if cell.trigger <= trigger]
        if not allowed:
            raise ParameterError(
                "no pair to choose from: lambda1² has to be at least 8 lambda2 d_min, the boundary has to meet the "
                f"domain, and d_min² + lambda1 {domain.human_speed:g} m/s may be at most trigger²; got lambda1 in "
                f"{lambda1}, lambda2 in {lambda2}, trigger {trigger:g} m, {domain}"
            )
    axes = tuple(first[0].tolist()), tuple(first[1].tolist())
    return LambdaMap(domain, d_min, axes, tuple(tried.values()), trigger)


def _census(chunk: StateChunk) -> Census | None:
    """A chunk's census; None where the boundary hardly meets the domain."""
    try:
        return chunk.census()
    except ParameterError:
        return None


def _axis(name: str, limits: tuple[float, float], count: int) -> Array:
    low, high = low_high(name, limits)
    positive_number(name, low)
    if not low < high:
        raise ParameterError(f"{name} has to be (low, high) with low < high, got {limits!r}")
    return np.geomspace(low, high, count)


def around(axis: Array, best: float, share: float) -> Array:
    """The best value itself, and two at either side of it, a share of the axis' steps apart, within its range."""
    steps = (axis[1] / axis[0]) ** (share * np.arange(-2.0, 3.0))
    return np.unique(np.clip(best * steps, axis[0], axis[-1]))


def _cell(index: IndexParams, domain: Domain, found: dict[str, Census]) -> LambdaPair:
    return LambdaPair(
        index.lambda1,
        index.lambda2,
        infeasible={name: Rate.of(one.infeasible, one.states) for name, one in found.items()},
        lost={name: Rate.of(one.outside + one.infeasible_inside, one.states) for name, one in found.items()},
        trigger=float(np.sqrt(index.d_min**2 + index.lambda1 * domain.human_speed)),
    )
