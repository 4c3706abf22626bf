"""The environment's half of a control step for many arms, one after the other: each moves as it would alone."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.chain import forward, jacobian, tool_motion
from jssa_gym.kernels.jit import jit, jit_owning
from jssa_gym.kernels.motion import scale_action, scale_nominal, to_shares
from jssa_gym.kernels.norm import length
from jssa_gym.tick.move import People, fill_features, move

Floats = NDArray[np.float64]


class Measured(NamedTuple):
    """What is measured of E arms beside k human capsules each, of m capsules of their own."""

    distance: Floats
    """Smallest distance to somebody, shape (E,) [m]."""
    contact_speed: Floats
    """Largest speed of a touching point of the arm, shape (E,) [m/s]."""
    tip_speed: Floats
    """Shape (E,) [m/s]."""
    violation: NDArray[np.bool_]
    """Whether a limit is exceeded, shape (E,)."""
    tip: Floats
    """Position and velocity of the tool centre point, shape (E, 2, 3) [m, m/s]."""
    near: Floats
    """The closest pair, shape (E, 13); see :func:`~jssa_gym.kernels.contact.observe`."""
    pair: NDArray[np.int64]
    """Its capsules, the arm's and the human one, shape (E, 2); -1 without a human."""
    parts: Floats
    """Smallest distance to each of a person's capsules, shape (E, p) [m]."""
    segments: NDArray
    """The arms' capsules, shape (E, m) of ``SEGMENT``; (E, 0) where nobody looks at them."""


def measured(arms: int, parts: int, segments: NDArray) -> Measured:
    """An empty one; ``segments`` are the arms' capsules, shape (E, m) or (E, 0)."""
    return Measured(
        *np.zeros((3, arms)),
        np.zeros(arms, np.bool_),
        np.zeros((arms, 2, 3)),
        np.zeros((arms, 13)),
        np.full((arms, 2), -1),
        np.zeros((arms, parts)),
        segments,
    )


@jit
def take_actions(fraction, bound, live, jerk):
    """Clip actions to [-1, 1] in place and scale them by the jerk bounds, shapes (E, n), where ``live``, (E,).

    Returns:
        The first arm whose action is not finite, before anything is done with it; -1 for none.
    """
    for e in range(fraction.shape[0]):
        if live[e] and not scale_action(fraction[e], bound, jerk[e]):
            return e
    return -1


@jit
def take_nominals(fraction, bound, jerk):
    """:func:`~jssa_gym.kernels.motion.scale_nominal` of many arms, shapes (E, n)."""
    for e in range(fraction.shape[0]):
        scale_nominal(fraction[e], bound, jerk[e])


@jit_owning
def replace_actions(jerk, bound, which, fraction, correction):
    """Shares of the bounds that give the jerks, shape (E, n), in place of the actions, where ``which``, shape (E,).

    ``correction``, shape (E,), becomes the largest change of a joint's action; 0 where there is none, NaN where the
    action was.
    """
    share = np.empty(jerk.shape[1])
    for e in range(jerk.shape[0]):
        correction[e] = 0.0
        if which[e]:
            to_shares(jerk[e], bound, share)
            for j in range(share.shape[0]):
                change = abs(share[j] - fraction[e, j])
                if not change <= correction[e]:  # NaN stays
                    correction[e] = change if correction[e] == correction[e] else correction[e]
                fraction[e, j] = share[j]


@jit_owning
def move_all(body, people, live, before, jerk, dt, seen, out):
    """:func:`~jssa_gym.tick.move.move` for every arm that is ``live``, shape (E,).

    Args:
        body: The arm that all are alike.
        people: Two arrays: starts, ends and their velocities of human capsules, shape (E, 4, k, 3) [m, m/s], and their
            radii, shape (E, k) [m].
        live: Shape (E,).
        before: Joint states, shape (E, 3, n); the results too.
        jerk: Shape (E, n) [rad/s³].
        dt: For how long [s].
        seen: Scratch.
        out: A :class:`Measured`, the results.
    """
    after, (ends, radius) = np.empty(before.shape[1:]), people
    for e in range(before.shape[0]):
        if not live[e]:
            continue
        own = People(ends[e, 0], ends[e, 1], ends[e, 2], ends[e, 3], radius[e])
        row, column, distance, contact_speed, tip_speed, violation = move(
            body, own, before[e], jerk[e], dt, after, seen
        )
        before[e] = after
        out.pair[e, 0], out.pair[e, 1] = row, column
        out.distance[e], out.contact_speed[e] = distance, contact_speed
        out.tip_speed[e], out.violation[e] = tip_speed, violation
        out.tip[e], out.near[e], out.parts[e] = seen.tip, seen.near, seen.parts
        for i in range(out.segments.shape[1]):
            out.segments[e, i] = seen.segments[i]


@jit
def observe_all(state, measured, goal, scaling, out):
    """:func:`~jssa_gym.tick.move.fill_observation` for every arm: observations into ``out``, shape (E, size)."""
    for e in range(state.shape[0]):
        fill_features(state[e], measured.tip[e], measured.near[e], measured.parts[e], goal[e], scaling, out[e])


@jit
def distances(one, other, out):
    """Distances of points, shapes (E, 3), as ``math.dist`` has them, into ``out``, shape (E,) [m]."""
    for e in range(out.shape[0]):
        out[e] = length(one[e, 0] - other[e, 0], one[e, 1] - other[e, 1], one[e, 2] - other[e, 2])


@jit
def squash(values, scale, out):
    """Hyperbolic tangent of values over a scale, shapes (E,), as Python's ``math.tanh`` has it."""
    for e in range(out.shape[0]):
        out[e] = math.tanh(values[e] / scale)


@jit
def before_hands(hand, offset, out):
    """Points at ``offset`` [m] from hands, shape (E, 3), level with them on the side of the base axis, into ``out``."""
    for e in range(out.shape[0]):
        x, y, z = hand[e, 0], hand[e, 1], hand[e, 2]
        share = 1.0 - offset / max(length(x, y, 0.0), offset)
        out[e, 0], out[e, 1], out[e, 2] = share * x, share * y, z


@jit
def ease(elapsed, powers, out):
    """Shares of ways that least-jerk moves have come after shares of their time, shapes (E,).

    ``powers`` are 3 and 2: as variables they are the C library's, as Python's own powers are.
    """
    for e in range(out.shape[0]):
        x = elapsed[e]
        out[e] = x ** powers[0] * (10.0 - 15.0 * x + 6.0 * x ** powers[1])


@jit
def look_at_tools(links, tool_link, tool_offset, state, frames, motion, J):
    """How tool centre points move, into ``motion``, and their Jacobians, into ``J``, of joint states, shape (E, 3, n).

    Args:
        links: The arms', shape (n,) of ``LINK``.
        tool_link: What the tool centre point is fixed to ...
        tool_offset: ... and where in that link's frame, shape (3,) [m].
        state: Shape (E, 3, n).
        frames: Scratch, shape (n,) of ``FRAME``.
        motion: Result: positions and velocities, shape (E, 2, 3) [m, m/s].
        J: Result, shape (E, 3, n).
    """
    for e in range(state.shape[0]):
        forward(links, state[e], frames)
        tool_motion(frames, tool_link, tool_offset, motion[e])
        jacobian(frames, tool_link, motion[e, 0], J[e])
