"""How clear an arm at rest is of what stands still, posture by posture."""

from typing import NamedTuple

from numpy.typing import NDArray

from jssa_gym.kernels.capsules import measure_agents, measure_planes, measure_self, nearest
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import copy


class StandingArm(NamedTuple):
    """An arm and what stands still around it, with room to measure."""

    links: NDArray
    """The arm, shape (n,) of ``LINK`` ..."""
    capsules: NDArray
    """... (m,) of ``CAPSULE`` ..."""
    self_pairs: NDArray
    """... and which of them could collide, shape (s, 2)."""
    agents: NDArray
    """Capsules that stand still, shape (c,) of ``AGENT``."""
    planes: NDArray
    """Half-spaces, shape (p,) of ``PLANE``."""
    state: NDArray
    """Scratch: rows position, velocity, acceleration, shape (3, n), of which the last two are 0."""
    frames: NDArray
    """Shape (n,) of ``FRAME``."""
    segments: NDArray
    """Shape (m,) of ``SEGMENT``."""
    pairs: NDArray
    """Shape (m, c) of ``PAIR``."""
    plane_pairs: NDArray
    """Shape (m, p) of ``PAIR``."""
    own: NDArray
    """Shape (s,) [m]."""


@jit
def smallest_gap(standing, posture):
    """Smallest distance of the arm at rest from what stands still and from itself [m]; inf where there is nothing.

    Args:
        standing: The arm, and what stands still.
        posture: Joint position, shape (n,) [rad].
    """
    segments, others = standing.segments, standing.agents.shape[0]
    copy(posture, standing.state[0])
    forward(standing.links, standing.state, standing.frames)
    place(standing.frames, standing.capsules, segments)
    measure_agents(segments, standing.agents, standing.pairs)
    measure_planes(segments, standing.planes, standing.plane_pairs)
    measure_self(segments, standing.self_pairs, standing.own)
    gap = min(nearest(standing.pairs, others)[2], nearest(standing.plane_pairs, standing.planes.shape[0])[2])
    for k in range(standing.own.shape[0]):
        gap = min(gap, standing.own[k])
    return gap


@jit
def stays_clear(standing, postures, least):
    """Whether the arm is at least that far from everything [m] in all postures, shape (k, n); the last is first."""
    last = postures.shape[0] - 1
    for k in range(last + 1):
        gap = smallest_gap(standing, postures[last - k])
        if not gap >= least:
            return False
    return True
