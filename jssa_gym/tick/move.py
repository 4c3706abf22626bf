"""The environment's half of a control step: the arm moves on among people who have moved already, and is measured."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.capsules import load_agents
from jssa_gym.kernels.chain import tool_motion
from jssa_gym.kernels.contact import observe
from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate, violates

Floats = NDArray[np.float64]


class MeasuredArm(NamedTuple):
    """An arm, where it stands, and how it is measured; never changes."""

    links: NDArray
    """Shape (n,) of ``LINK``."""
    capsules: NDArray
    """Shape (m,) of ``CAPSULE``."""
    tool_link: int
    """The link of the tool centre point ..."""
    tool_offset: Floats
    """... and where in its frame that is, shape (3,) [m]."""
    limits: Floats
    """Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n)."""
    tolerance: float
    """Share of a limit by which it may be exceeded."""
    index: Index
    """Decides about the sliding term in the distance's second derivative."""


class People(NamedTuple):
    """Human capsules as they are now; fields as of :class:`~jssa_gym.types.CapsuleSet`."""

    start: Floats
    """Shape (k, 3) [m]."""
    end: Floats
    start_velocity: Floats
    """Shape (k, 3) [m/s]."""
    end_velocity: Floats
    radius: Floats
    """Shape (k,) [m]."""


class Seen(NamedTuple):
    """What is measured, and the scratch for it."""

    near: Floats
    """The closest pair, shape (13,); see :func:`~jssa_gym.kernels.contact.observe`."""
    parts: Floats
    """Smallest distance to each of a person's capsules [m]."""
    tip: Floats
    """Position and velocity of the tool centre point, shape (2, 3) [m, m/s]."""
    agents: NDArray
    """Shape (k,) of ``AGENT``."""
    frames: NDArray
    """Shape (n,) of ``FRAME``."""
    segments: NDArray
    """Shape (m,) of ``SEGMENT``."""
    pairs: NDArray
    """Shape (m, k) of ``PAIR``."""


@jit
def move(body, people, before, jerk, dt, after, seen):
    """Move the arm by one step of Eq. (1) and look at it beside the people.

    Args:
        body, people: Who is there.
        before: Joint state, rows position, velocity, acceleration, shape (3, n).
        jerk: Shape (n,) [rad/s³].
        dt: For how long [s].
        after: Result, the joint state then.
        seen: Result.

    Returns:
        Row and column of the closest pair, its distance [m], the largest speed of a touching point and the speed of
        the tool centre point [m/s], whether a limit is exceeded.
    """
    integrate(before, jerk, dt, after)
    load_agents(people.start, people.end, people.start_velocity, people.end_velocity, people.radius, seen.agents)
    near = seen.near
    row, column = observe(
        body.links, body.capsules, after, seen.agents, body.index, seen.frames, seen.segments, seen.pairs, near,
        seen.parts,
    )  # fmt: skip
    speed = tool_motion(seen.frames, body.tool_link, body.tool_offset, seen.tip)
    return row, column, near[0], near[3], speed, violates(after, jerk, body.limits, body.tolerance)


@jit
def fill_features(state, tip, near, parts, goal, scaling, out):
    """:func:`fill_observation`, with what is :class:`Seen` one by one."""
    n = state.shape[1]
    for i in range(out.shape[0]):
        if i < 3 * n:
            raw = state[i // n, i % n]
        elif i < 3 * n + 3:
            raw = tip[0, i - 3 * n]
        elif i < 3 * n + 12:
            raw = near[4 + i - 3 * n - 3]
        elif i < 3 * n + 12 + parts.shape[0]:
            raw = parts[i - 3 * n - 12]
        else:
            raw = goal[i - 3 * n - 12 - parts.shape[0]]
        # min and max in float64, so that a bound is met exactly after rounding
        out[i] = min(max((raw - scaling[0, i]) * scaling[1, i], scaling[2, i]), scaling[3, i])


@jit
def fill_observation(state, seen, goal, scaling, out):
    """Observation in the order of the feature table: arm, tip, people, goal.

    Each raw value becomes (value - shift) gain, clipped to low and high: the rows of ``scaling``, shape (4, size).
    """
    fill_features(state, seen.tip, seen.near, seen.parts, goal, scaling, out)
