"""What filters share that decide from the distances of all pairs as they are now."""

import numpy as np

from jssa_gym.kernels.derivatives import pair_motion
from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.tick import codes

AUTHORITY = 5.0
"""Pairs that the jerk bounds move by less than this normal jerk make no rows [m/s³], as in JSSAFilter."""


def reported(d_min: float, lambda1: float, lambda2: float) -> Index:
    """The index that a filter reports, Eq. (6) without the sliding term; where a weight is 0 the term is not there."""
    return Index(float(d_min), float(lambda1), float(lambda2), False, 1.0, 0.0)


@jit
def measure(robot, proposal, memory, work, told, e):
    """Measure all pairs at present: ``work.motion``, ``pushes``, ``normals`` and, with the index, ``pairs_now``.

    ``told`` takes down the closest pair; its index is -inf to begin with.

    Returns:
        0, or the code of what is not finite.
    """
    agents, pairs = work.agents[: memory.tracks.shape[1]], work.pairs_now
    told["row"], told["column"], told["distance"] = pair_motion(
        robot.links, robot.capsules, memory.state[e], agents, proposal.index, work.frames_now, work.segments_now,
        pairs, work.motion, work.pushes, work.normals,
    )  # fmt: skip
    told["phi"] = -np.inf
    for number in range(work.motion.shape[0]):
        for order in range(4):
            if not np.isfinite(work.motion[number, order]):
                return codes.DERIVATIVE
        if np.isnan(index_now(work, number)):
            return codes.DERIVATIVE
    return 0


@jit
def index_now(work, number):
    """Index of a pair, by its row-major number, after :func:`measure` [m²]."""
    columns = work.pairs_now.shape[1]
    return work.pairs_now[number // columns, number % columns]["phi"]


@jit
def watched(robot, proposal, work, told, number):
    """Whether a pair counts: the closest alone, or all that the jerk bounds move noticeably."""
    if proposal.closest:
        return number == told["row"] * work.pairs_now.shape[1] + told["column"]
    most = 0.0
    for j in range(work.pushes.shape[1]):
        most += abs(work.pushes[number, j]) * robot.limits[4, j]
    return not most < AUTHORITY


@jit
def index_rate(motion, index):
    """Rate of the index of a pair at zero joint jerk [m²/s]; ``motion`` (4,) are its distance and derivatives."""
    return -2.0 * abs(motion[0]) * motion[1] - index.lambda1 * motion[2] - index.lambda2 * motion[3]


@jit
def push(work, away):
    """The clipped nominal and a jerk ``away`` (n,), in the box, into ``work.wanted``; whether that is another jerk."""
    moved = False
    for j in range(away.shape[0]):
        u = work.clipped[j] + away[j]
        # what is no number stays none: it is found where the answer is looked at
        work.wanted[j] = u if np.isnan(u) else min(max(u, work.lower[j]), work.upper[j])
        moved = moved or work.wanted[j] != work.clipped[j]
    return moved
