"""Postures of an arm whose capsules are new: which pairs of them say something, and where home is."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.capsules import measure_planes, measure_self
from jssa_gym.kernels.chain import forward, place, tool_motion
from jssa_gym.kernels.records import FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.types import Array

_POSTURES = 2000
"""Postures that are looked at."""

_USELESS = 0.5
"""Share of all postures in which a pair that overlaps cannot tell a collision from its own thickness."""

_CLEAR = 0.05
"""Distance from table and itself that a home posture should have [m]."""


class Looked(NamedTuple):
    """Distances in postures."""

    own: Array
    """Distances of the pairs, shape (k, p) [m]."""
    table: Array
    """Height of the lowest capsule above the base, shape (k,) [m]; inf where none can come down."""
    tip: Array
    """Tool centre point, shape (k, 3) [m]."""


def look(links: NDArray, capsules: NDArray, pairs: NDArray[np.int64], tool: Array, postures: Array) -> Looked:
    """Measure an arm in postures, shape (k, n) [rad].

    Args:
        links: Shape (n,) of ``LINK``.
        capsules: Shape (m,) of ``CAPSULE``.
        pairs: Pairs of capsules, shape (p, 2).
        tool: In the last link's frame, shape (3,) [m].
        postures: Shape (k, n) [rad].
    """
    n, m = len(links), len(capsules)
    frames, segments, below = records(n, FRAME), records(m, SEGMENT), records((m, 1), PAIR)
    table, out = records(1, PLANE), np.zeros((2, 3))
    table["normal"] = (0.0, 0.0, 1.0)
    own, low, tip = np.zeros((len(postures), len(pairs))), np.zeros(len(postures)), np.zeros((len(postures), 3))
    for k, posture in enumerate(postures):
        forward(links, np.array([posture, np.zeros(n), np.zeros(n)]), frames)
        place(frames, capsules, segments)
        measure_self(segments, pairs, own[k])
        measure_planes(segments, table, below)
        tool_motion(frames, n - 1, tool, out)
        low[k], tip[k] = below["distance"].min(initial=np.inf), out[0]
    return Looked(own, low, tip)


def all_pairs(link: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs of capsules whose links are neither equal nor neighbours, shape (p, 2)."""
    pairs = [(i, j) for i in range(len(link)) for j in range(i + 1, len(link)) if abs(int(link[i]) - int(link[j])) > 1]
    return np.array(pairs, np.int64).reshape(-1, 2)


def some_postures(ranges: Array) -> Array:
    """Postures all over the ranges, one turn about the middle of wider ones, shape (k, n) [rad]; always the same."""
    middle, half = ranges.mean(axis=1), np.ptp(ranges, axis=1) / 2.0
    low = np.where(half > np.pi, middle - np.pi, ranges[:, 0])
    high = np.where(half > np.pi, middle + np.pi, ranges[:, 1])
    return np.random.default_rng(0).uniform(low, high, (_POSTURES, len(ranges)))


def useless(own: Array) -> NDArray[np.bool_]:
    """Pairs that overlap in most of the postures looked at, shape (p,)."""
    return (own < 0.0).mean(axis=0) > _USELESS


def find_home(postures: Array, looked: Looked, ranges: Array, reach: float, axis: Array) -> Array | None:
    """A posture that is clear of table and itself, with the tool at a distance to work at, shape (n,) [rad].

    Args:
        postures: To choose from, shape (k, n) [rad].
        looked: How they are.
        ranges: Shape (n, 2) [rad].
        reach: Of the arm [m].
        axis: A point of the first joint's axis, shape (3,) [m].
    """
    clearance = np.minimum(looked.table, looked.own.min(axis=1, initial=np.inf))
    enough = min(_CLEAR, 0.1 * reach)
    clear = clearance > enough
    if not np.any(clear):
        clear = clearance > 0.0
    if not np.any(clear):
        return None
    middle = np.clip(ranges.mean(axis=1), *ranges.T)
    off = np.sqrt((((postures - middle) / np.minimum(np.ptp(ranges, axis=1), 2.0 * np.pi)) ** 2).mean(axis=1))
    aside = np.hypot(*(looked.tip[:, :2] - axis[:2]).T) / reach
    height = (looked.tip[:, 2]) / reach
    away = np.maximum(0.35 - aside, 0.0) + np.maximum(aside - 0.6, 0.0) + np.maximum(0.2 - height, 0.0)
    # the person of the paper's scene comes along the x axis
    front = np.abs(np.arctan2(looked.tip[:, 1] - axis[1], looked.tip[:, 0] - axis[0])) / np.pi
    return postures[np.argmin(np.where(clear, off + 2.0 * away + front, np.inf))]


def rounded(postures: Sequence[float] | Array) -> Array:
    """As it is written into a file."""
    return np.round(np.asarray(postures, float), 4)
