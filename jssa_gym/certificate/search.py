"""Local search for the states in which an index is hardest to keep."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jssa_gym.certificate.boundary import Boundary, Domain, Looks
from jssa_gym.certificate.census import Counts, Part, largest_part, mark
from jssa_gym.types import Array

_CHILDREN = 128
"""Draws tried around every state at a time."""

_GENERATIONS = 20

_WIDTH, _SHRINKS = 0.2, 0.8
"""Standard deviation of the first generation's changes, in units of the draw, and what each multiplies it by."""

_FRESH = 16_384
"""Draws that a search in a part of a domain begins with."""

_ROUNDS = 40
"""Counter-examples after which a part of a domain is given up."""


def worsen(boundary: Boundary, genes: Array, rng: np.random.Generator) -> Looks:
    """Change draws little by little so that the index one step ahead grows; the last of each, worst first.

    Args:
        boundary: Where they lie.
        genes: What to begin with, shape (k, 3n + 11).
        rng: Of the changes.
    """
    uniform = 3 * boundary.robot.n + 5
    low = np.r_[np.full(uniform - 5, -1.0), np.zeros(5), np.full(genes.shape[1] - uniform, -np.inf)]
    high = np.r_[np.ones(uniform), np.full(genes.shape[1] - uniform, np.inf)]
    best = []
    for start in genes:
        at, value, width = start, -np.inf, _WIDTH
        for _ in range(_GENERATIONS):
            # most changes are of few numbers: a step in all of them at once leaves the domain
            changes = width * rng.normal(size=(_CHILDREN, len(at))) * (rng.random((_CHILDREN, len(at))) < 0.3)
            looks = boundary.look(np.vstack([at, np.clip(at + changes, low, high)]))
            if len(looks.ahead):
                k = int(np.argmax(looks.ahead))
                if looks.ahead[k] > value:
                    at, value = looks.genes[k], looks.ahead[k]
            width *= _SHRINKS
        best.append(at)
    looks = boundary.look(np.array(best))
    return looks.pick(np.argsort(-looks.ahead, kind="stable"))


class Kept(NamedTuple):
    """What a search for a part of a domain without an infeasible state came to."""

    part: Part | None
    """None if none is left."""
    searched: int
    """How many parts a counter-example ended."""
    worst: Looks | None
    """The worst of those counter-examples, one state; None without any."""


def kept_part(boundary: Boundary, counts: Counts, rng: np.random.Generator) -> Kept:
    """The largest part of the domain without an infeasible state that was drawn or that a search in it finds.

    A search begins with the worst of some fresh states; what it finds counts as drawn, and the next largest part
    without it is searched.
    """
    worst: Looks | None = None
    for searched in range(_ROUNDS):
        part = largest_part(counts, boundary.domain)
        if part is None:
            return Kept(None, searched, worst)
        found = _worst_in(boundary, part, rng)
        if found is None or not found.infeasible[0]:
            return Kept(part, searched, worst)
        counts = mark(counts, boundary.domain, found.pick(found.infeasible), part)
        if worst is None or found.ahead[0] > worst.ahead[0]:
            worst = found.pick(np.arange(1))
    return Kept(None, _ROUNDS, worst)


def _worst_in(boundary: Boundary, part: Part, rng: np.random.Generator) -> Looks | None:
    inside: Domain = replace(
        boundary.domain, tip_speed=part.tip_speed, distance=part.distance, authority=part.authority
    )
    narrow = Boundary(boundary.robot, boundary.index, boundary.capsule, inside, boundary.dt)
    looks = narrow.look(narrow.draw(rng, _FRESH))
    if not len(looks.ahead):
        return None
    hardest = np.argsort(-looks.ahead, kind="stable")[:4]
    return worsen(narrow, looks.genes[hardest], rng)
