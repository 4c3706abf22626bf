"""Counts over boundary states that add up, and the largest part of a domain in which none fails."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from jssa_gym.certificate.boundary import Boundary, Domain, Looks
from jssa_gym.safety.condition import fastest_approach, needed_jerk
from jssa_gym.types import Array

_BINS = 8
"""Bins of tip speed and of distance, equally wide."""

_AUTHORITY = (0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0)
"""Lower ends of the bins of authority [m/s³]."""

_JERK = np.linspace(-50.0, 200.0, 501)
"""Edges of the bins of jerk [m/s³]; what lies outside counts for the bin at the end."""

_WORST = 4
"""States that a census keeps."""


class Counts(NamedTuple):
    """States by tip speed, distance and authority; fields of shape (8, 8, 7)."""

    states: NDArray[np.int64]
    infeasible: NDArray[np.int64]


class Part(NamedTuple):
    """Part of a domain: slower than, at distances of, with an authority of at least."""

    tip_speed: float
    """[m/s]."""
    distance: tuple[float, float]
    """[m]."""
    authority: float
    """[m/s³]."""
    states: int
    """States that were drawn in it; none was infeasible."""
    bound: float
    """With 95 % confidence no larger share of its states is, all parts that could have been chosen considered."""


class Share(NamedTuple):
    """Infeasible states with a quantity from ``low`` on, below the next share's."""

    low: float
    states: int
    infeasible: int


class Shares(NamedTuple):
    """What a census counted by one quantity at a time."""

    tip_speed: tuple[Share, ...]
    """[m/s]."""
    distance: tuple[Share, ...]
    """[m]."""
    authority: tuple[Share, ...]
    """[m/s³]."""


@dataclass(frozen=True, slots=True, eq=False)
class Census:
    """What was found in boundary states of one capsule; censuses of different states add up."""

    draws: int
    """Draws that it took."""
    states: int
    infeasible: int
    """States for which no jerk keeps the index."""
    outside: int
    """States outside the certificate set: an approach that the index alone does not end in time."""
    infeasible_inside: int
    """Infeasible states inside it."""
    enough: int
    """States in which the arm has the jerk that the sufficient condition asks for."""
    infeasible_enough: int
    """Infeasible ones among them."""
    least_jerk: float
    """Smallest third derivative of the distance under the best jerk [m/s³]."""
    jerk: NDArray[np.int64]
    """States by it, shape (500,)."""
    counts: Counts
    worst: Array
    """Index one step ahead [m²] and draw of the worst states, shape (at most 4, 1 + genes), worst first."""

    @classmethod
    def of(cls, boundary: Boundary, looks: Looks, draws: int) -> Self:
        """Count."""
        index, domain, bad = boundary.index, boundary.domain, looks.infeasible
        outside = ~(looks.rate >= fastest_approach(index, looks.distance))
        approach = approach_bound(domain)
        enough = (looks.jerk >= needed_jerk(index, approach=approach, distance=domain.distance[1])) & (
            np.abs(looks.rate) <= approach
        )
        order = np.argsort(-np.where(np.isnan(looks.ahead), np.inf, looks.ahead), kind="stable")[:_WORST]
        bins = _bins(domain, looks)
        return cls(
            draws=draws,
            states=len(bad),
            infeasible=int(bad.sum()),
            outside=int(outside.sum()),
            infeasible_inside=int((bad & ~outside).sum()),
            enough=int(enough.sum()),
            infeasible_enough=int((bad & enough).sum()),
            least_jerk=float(looks.jerk.min()),
            jerk=np.histogram(np.clip(looks.jerk, _JERK[0], _JERK[-1]), _JERK)[0].astype(np.int64),
            counts=Counts(_counted(bins), _counted(bins[:, bad])),
            worst=np.column_stack([looks.ahead, looks.genes])[order],
        )

    @classmethod
    def total(cls, parts: Iterable[Self]) -> Self:
        """All of them together; the same whoever ended first, if they come in the same order."""
        found = list(parts)
        worst = np.concatenate([one.worst for one in found])
        worst = worst[np.argsort(-np.where(np.isnan(worst[:, 0]), np.inf, worst[:, 0]), kind="stable")[:_WORST]]
        added = ("draws", "states", "infeasible", "outside", "infeasible_inside", "enough", "infeasible_enough")
        return cls(
            **{name: sum(getattr(one, name) for one in found) for name in added},
            least_jerk=min(one.least_jerk for one in found),
            jerk=np.sum([one.jerk for one in found], axis=0),
            counts=Counts(*(np.sum([one.counts[k] for one in found], axis=0) for k in range(2))),
            worst=worst,
        )

    def jerk_quantile(self, level: float) -> float:
        """Third derivative of the distance under the best jerk that a share of the states stays below [m/s³].

        Resolved to half a metre per second cubed, from below.
        """
        return float(_JERK[int(np.searchsorted(np.cumsum(self.jerk), level * self.states))])

    def as_json(self) -> dict[str, Any]:
        """The census as JSON can hold it, exactly."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return values | {
            "jerk": self.jerk.tolist(),
            "counts": [field.ravel().tolist() for field in self.counts],
            "worst": self.worst.tolist(),
        }

    @classmethod
    def read(cls, plain: dict[str, Any]) -> Self:
        """The census that :meth:`as_json` has written.

        Raises:
            KeyError, TypeError, ValueError: It is something else.
        """
        shape = (_BINS, _BINS, len(_AUTHORITY))
        arrays: dict[str, Any] = {
            "jerk": np.array(plain["jerk"], np.int64).reshape(len(_JERK) - 1),
            "counts": Counts(*(np.array(field, np.int64).reshape(shape) for field in plain["counts"])),
            "worst": np.array(plain["worst"], np.float64).reshape(-1, len(plain["worst"][0])),
        }
        return cls(**{**plain, **arrays})


def approach_bound(domain: Domain) -> float:
    r"""The :math:`\bar v` of the sufficient condition [m/s]: tip and person, straight at each other."""
    return domain.tip_speed + domain.human_speed


def _edges(domain: Domain) -> tuple[Array, Array, Array]:
    low, high = domain.distance
    speeds, distances = np.linspace(0.0, domain.tip_speed, _BINS + 1), np.linspace(low, high, _BINS + 1)
    return speeds, distances, np.array(_AUTHORITY)


def _bins(domain: Domain, looks: Looks) -> NDArray[np.int64]:
    """Numbers of the bins, shape (3, N)."""
    found = [
        np.searchsorted(edges, values, side="right") - 1
        for edges, values in zip(_edges(domain), (looks.tip_speed, looks.distance, looks.authority), strict=True)
    ]
    return np.clip(found, 0, np.array([[_BINS - 1], [_BINS - 1], [len(_AUTHORITY) - 1]]))


def _counted(bins: NDArray[np.int64]) -> NDArray[np.int64]:
    shape = (_BINS, _BINS, len(_AUTHORITY))
    numbers = np.ravel_multi_index(tuple(bins), shape)
    return np.bincount(numbers, minlength=math.prod(shape)).astype(np.int64).reshape(shape)


def mark(counts: Counts, domain: Domain, looks: Looks, part: Part | None = None) -> Counts:
    """Counts to which infeasible states have been added that were not drawn but searched for.

    A search ends on the edge of the part that it was done in, which is in the next bin already: such a state counts
    as inside of its part.
    """
    if part is not None:
        near, far = part.distance
        looks = looks._replace(
            tip_speed=np.minimum(looks.tip_speed, np.nextafter(part.tip_speed, 0.0)),
            distance=np.clip(looks.distance, near, np.nextafter(far, near)),
        )
    return counts._replace(infeasible=counts.infeasible + _counted(_bins(domain, looks)))


def shares(counts: Counts, domain: Domain) -> Shares:
    """States by one quantity at a time, whatever the others."""
    found = []
    for axis, edges in enumerate(_edges(domain)):
        others = tuple(other for other in range(3) if other != axis)
        columns = (field.sum(axis=others).tolist() for field in counts)
        found.append(tuple(Share(*row) for row in zip(edges.tolist(), *columns, strict=False)))
    return Shares(*found)


def largest_part(counts: Counts, domain: Domain) -> Part | None:
    """The part of the domain with the most states of which none was infeasible; None without any.

    Parts are of the form: tip speed below a bound, distance in a range, authority above a bound, in whole bins.
    """
    speeds, distances, authority = _edges(domain)
    first = [k for k, least in enumerate(_AUTHORITY) if k == 0 or least > domain.authority]
    parts = list(product(range(1, _BINS + 1), combinations(range(_BINS + 1), 2), first))
    best, chosen = 0, None
    for fast, (near, far), weak in parts:
        region = np.s_[:fast, near:far, weak:]
        states = int(counts.states[region].sum())
        if states > best and not counts.infeasible[region].any():
            best, chosen = states, (fast, near, far, weak)
    if chosen is None:
        return None
    fast, near, far, weak = chosen
    bound = -math.expm1(math.log(0.05 / len(parts)) / best)
    least = max(float(authority[weak]), domain.authority)
    return Part(float(speeds[fast]), (float(distances[near]), float(distances[far])), least, best, bound)
