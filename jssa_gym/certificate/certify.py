r"""The certificate of an index: whether some admissible jerk always keeps :math:`\phi \le 0`, Eq. (7).

Sampled on the boundary :math:`\phi = 0`, then searched for worse, one capsule of the robot after the other, against
one person at constant velocity. It says nothing about several rows at once, nor about a person who changes pace: that
is what the verified stop is for.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym import robots
from jssa_gym.certificate.boundary import KEPT, Boundary, BoundaryState, Domain
from jssa_gym.certificate.census import Census, Part, Shares, approach_bound, largest_part, mark, shares
from jssa_gym.certificate.chunks import ChunkFile, Key, StateChunk, generator, run
from jssa_gym.certificate.search import Kept, kept_part, worsen
from jssa_gym.engine.cluster import Cluster, whose
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.feasibility import probe
from jssa_gym.rates import Rate
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.safety.condition import fastest_approach, needed_jerk
from jssa_gym.safety.index import IndexParams
from jssa_gym.storage import as_json, sha256
from jssa_gym.validation import known_name, positive_integer, positive_number, whole_number

_CHUNK = 50_000
"""States drawn from one generator, and what an interrupted run loses at most for every worker."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkCertificate:
    """What was found for one capsule of the robot."""

    capsule: str
    infeasible: Rate
    """Sampled states for which no jerk keeps the index; the interval is Clopper and Pearson's of 95 %."""
    outside: Rate
    """Sampled states outside the certificate set: an approach that the index alone does not end in time."""
    infeasible_inside: int
    """Infeasible states inside it."""
    worst: BoundaryState
    """The worst state that was drawn or searched for."""
    worst_drawn: float
    """Index one step ahead of the worst that was drawn [m²]."""
    least_jerk: float
    """Smallest third derivative of the distance under the best jerk that was drawn [m/s³]."""
    jerk: dict[float, float]
    """What the best jerk's third derivative exceeds in all but this share of the states [m/s³]."""
    enough: Rate | None
    """Infeasible states among those in which the arm has the jerk of the sufficient condition: in continuous time and
    without the sliding of closest points there were none. None if no state has that jerk."""
    by: Shares
    """Infeasible states by tip speed, distance and authority."""
    sampled_part: Part | None
    """Largest part of the domain without an infeasible state that was drawn."""
    part: Part | None
    """The same after a search in it; None if the search ended every one."""
    searched: int
    """Counter-examples that the search for the part found."""

    @property
    def margin(self) -> float:
        r"""Smallest :math:`-\phi_{k+1}` under the best jerk [m²]; negative where Eq. (7) fails."""
        return -self.worst.ahead

    @property
    def holds(self) -> bool:
        """Whether neither a draw nor the search found an infeasible state in the whole domain."""
        return self.infeasible.k == 0 and self.worst.ahead <= KEPT


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """What was found for an index on a domain."""

    robot: str
    index: IndexParams
    domain: Domain
    dt: float
    """[s]."""
    seed: int
    needed_jerk: float
    """Third derivative of the distance that the sufficient condition asks for on the domain [m/s³]; inf if it cannot
    hold there."""
    fastest_approach: dict[float, float]
    """By distance [m]: the fastest approach that the index alone ends in time [m/s], the edge of the certificate
    set."""
    links: tuple[LinkCertificate, ...]

    @property
    def holds(self) -> bool:
        """Whether no infeasible state of any capsule was found in the domain. Not a proof: none was found."""
        return all(link.holds for link in self.links)

    @property
    def inside(self) -> Rate | None:
        """Infeasible states among those inside the certificate set, of all links together; None if none is inside."""
        inside = sum(link.outside.n - link.outside.k for link in self.links)
        return Rate.of(sum(link.infeasible_inside for link in self.links), inside) if inside else None

    @property
    def suffices(self) -> bool:
        """Whether the sufficient condition holds with the smallest jerk that was drawn."""
        return all(link.least_jerk >= self.needed_jerk for link in self.links)

    def as_json(self) -> dict[str, Any]:
        """The certificate as JSON can hold it."""
        links = [as_json({**as_json(link), "margin": link.margin, "holds": link.holds}) for link in self.links]
        return {**as_json(self), "links": links, "holds": self.holds, "suffices": self.suffices}


def _digest(robot: RobotModel) -> str:
    """Hash of all that the counts depend on: two models may have the same name."""
    limits = robot.limits
    arrays = (robot.links, robot.capsules, np.array(robot.tool_link), robot.tool_offset)
    bounds = (limits.position, limits.velocity, limits.acceleration, limits.jerk)
    return sha256(b"".join(array.tobytes() for array in (*arrays, *bounds)))[:16]


def moved_capsules(robot: RobotModel) -> tuple[str, ...]:
    """Names of the capsules that more than one joint moves: the first link's can hardly give way."""
    return tuple(name for name, capsule in zip(robot.capsule_names, robot.capsules, strict=True) if capsule["link"] > 0)


def certify(
    robot: str | Path | RobotModel = robots.DEFAULT,
    index: IndexParams | None = None,
    *,
    domain: Domain | None = None,
    capsules: Sequence[str] = (),
    states: int = 100_000,
    seed: int = 0,
    jobs: int | Cluster = 1,
    dt: float = 0.008,
    folder: str | Path | None = None,
    progress: Callable[[int], Any] | None = None,
    search: bool = True,
) -> Certificate:
    r"""Look for states with :math:`\phi = 0` in which no admissible jerk keeps :math:`\phi_{k+1} \le 0`, Eq. (7).

    Args:
        robot: A model, the name of one, or an MJCF file.
        index: Parameters of the index.
        domain: Where states are drawn from.
        capsules: Of the robot, by name; all that more than one joint moves if there is none.
        states: How many of each capsule.
        seed: Of the draws. The result depends on it, not on ``jobs``.
        jobs: How many threads, or a :class:`~jssa_gym.evaluation.Cluster` of Ray's.
        dt: Control step [s].
        folder: Where counts are kept as they come; a certificate that was interrupted is gone on with.
        progress: Called with the number of states that have been counted since the last call.
        search: Whether to search around the worst states, and in the part of the domain without any.

    Raises:
        ParameterError: A value is out of range, hardly any state of the domain has an index of 0, or the folder holds
            another certificate.
        RobotModelError: As of :func:`~jssa_gym.robots.make_robot`.
    """
    model, index, domain = make_robot(robot), index or IndexParams(), domain or Domain()
    names = tuple(capsules) or moved_capsules(model)
    for name in names:
        known_name("capsule", name, model.capsule_names)
    states, jobs = positive_integer("states", states), whose(jobs)
    seed, dt = whole_number("seed", seed), positive_number("dt", dt)
    announce_compilation(probe)
    links = [Boundary(model, index, name, domain, dt) for name in dict.fromkeys(names)]
    chunks = [
        StateChunk(link, k, min(_CHUNK, states - k * _CHUNK), seed)
        for k in range(-(-states // _CHUNK))
        for link in links
    ]
    kept = None
    if folder is not None:
        setting = {"robot": model.name, "index": asdict(index), "domain": asdict(domain), "dt": dt, "seed": seed}
        setting["model"] = _digest(model)
        kept = ChunkFile(Path(folder), setting)
    counted = _counted(chunks, jobs, kept, progress)
    return Certificate(
        robot=model.name,
        index=index,
        domain=domain,
        dt=dt,
        seed=seed,
        needed_jerk=needed_jerk(index, approach=approach_bound(domain), distance=domain.distance[1]),
        fastest_approach={D: float(fastest_approach(index, D)) for D in (0.1, 0.2, 0.3, 0.5, 1.0) if index.d_min < D},
        links=tuple(_link(link, Census.total(counted[link.row]), seed, search) for link in links),
    )


def _counted(
    chunks: Sequence[StateChunk], jobs: int | Cluster, kept: ChunkFile | None, progress: Callable[[int], Any] | None
) -> dict[int, list[Census]]:
    """Censuses of all chunks in order, by the number of the capsule."""
    known = {} if kept is None else kept.read()
    found: dict[Key, Census] = {}

    def done(chunk: StateChunk, census: Census) -> None:
        found[chunk.key] = census
        if progress is not None:
            progress(chunk.states)

    left = []
    for chunk in chunks:
        if chunk.key in known:
            done(chunk, known[chunk.key])
        else:
            left.append(chunk)
    for chunk, census in run(left, jobs):
        if kept is not None:
            kept.append(chunk.key, census)
        done(chunk, census)
    by_link: dict[int, list[Census]] = {}
    for chunk in chunks:
        by_link.setdefault(chunk.boundary.row, []).append(found[chunk.key])
    return by_link


def _link(boundary: Boundary, census: Census, seed: int, search: bool) -> LinkCertificate:
    rng = generator(seed, 1, boundary.row)
    genes = census.worst[:, 1:]
    drawn = boundary.look(genes)
    worst = worsen(boundary, genes, rng) if search else drawn
    sampled = largest_part(census.counts, boundary.domain)
    kept = Kept(None, 0, None)
    if search:
        # what the search in the whole domain found is in no part without a counter-example
        known = mark(census.counts, boundary.domain, worst.pick(worst.infeasible))
        kept = kept_part(boundary, known, rng)
        # and what the search in a part found is a counter-example in the domain
        if kept.worst is not None and kept.worst.ahead[0] > worst.ahead[0]:
            worst = kept.worst
    return LinkCertificate(
        capsule=boundary.capsule,
        infeasible=Rate.of(census.infeasible, census.states),
        outside=Rate.of(census.outside, census.states),
        infeasible_inside=census.infeasible_inside,
        worst=boundary.state(worst, 0),
        worst_drawn=float(census.worst[0, 0]),
        least_jerk=census.least_jerk,
        jerk={level: census.jerk_quantile(level) for level in (0.01, 0.05, 0.5)},
        enough=Rate.of(census.infeasible_enough, census.enough) if census.enough else None,
        by=shares(census.counts, boundary.domain),
        sampled_part=sampled,
        part=kept.part,
        searched=kept.searched,
    )
