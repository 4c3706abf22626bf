r"""How much room a step and the stop after it leave to the people around.

A preference, never a permission: planners slow down by it long before the verification has to say no. It is looked at
in a few moments only, and leaves out half-spaces, static capsules and the arm itself.
"""

import numpy as np

from jssa_gym.kernels.capsules import apart, ball_around, capsule_pair, put_balls
from jssa_gym.kernels.chain import place_axes, pose
from jssa_gym.kernels.jit import jit, jit_counting
from jssa_gym.kernels.region import room_inside
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.vector import copy, fill
from jssa_gym.kernels.verification import posture_at

_MOMENTS = 6

_ROUNDING = 1e-9
"""By how much a gap has to be wider than the smallest one to be more than rounding [m]."""


@jit_counting
def margin(robot, motion, ticks, around, work):
    r"""Smallest gap that is left between arm and people until the arm is at rest [m].

    With T the length of step and stop, and people k grown by :math:`r_k` so far and by :math:`\hat v_k` from now on,

    .. math:: h = \min_{i, c, k} D_{ck}(t_i) - r_k - \hat v_k (t_i + \tau + T/6), \quad t_i = i T / 6, \; i = 0 \dots 5,

    over the robot capsules c that still move faster than k may be touched.

    The last moment is looked at first: people have grown most by then, and going back from it a gap shrinks by no more
    than the capsule moves, and widens by what people had not grown yet. So the moments before hardly ever count.

    Args:
        robot, motion, ticks, around: See :func:`~jssa_gym.kernels.verification.keeps_clear`.
        work: Scratch, see there; besides ``later`` (n,) and ``room`` (m,).

    Returns:
        That; inf where nothing moves or nobody is there, below 0 where people could be met, -inf where a gap is NaN.
    """
    agents, growth, posture, later, room = around.agents, around.growth, work.posture, work.later, work.room
    length, least, slowest = motion.dt * (1 + ticks), np.inf, np.inf
    if around.pieces.shape[0] > 1:
        slowest = around.entry_speed
    elif agents.shape[0] == 0:
        return np.inf
    for k in range(agents.shape[0]):
        slowest = min(slowest, growth[k])
    put_balls(agents, work.balls)
    fill(room, -np.inf)
    for moment in range(_MOMENTS - 1, -1, -1):
        t = length * moment / _MOMENTS
        until = t + motion.dt + length / _MOMENTS
        posture_at(motion, t, posture, work.fastest)
        if not _spins(work.fastest):
            continue
        _go_back(robot, posture, later, slowest * length / _MOMENTS, room)
        placed = False
        for i in range(room.shape[0]):
            if room[i] > least + _ROUNDING:
                continue
            if not placed:
                pose(robot.links, posture, work.frames_now)
                place_axes(work.frames_now, robot.capsules, work.segments_now)
                placed = True
            least, room[i] = _least_of(robot, i, until, least, around, work)
            if least == -np.inf:
                return least
        copy(posture, later)
    return least


@jit
def _spins(fastest):
    """Whether any joint still moves."""
    spins = False
    for j in range(fastest.shape[0]):
        spins = spins or fastest[j] > 0.0
    return spins


@jit_counting
def _go_back(robot, posture, later, widening, room):
    """Least gaps of all capsules, ``room`` (m,), from a later posture to an earlier one: what they are at least [m]."""
    for i in range(room.shape[0]):
        moved = 0.0
        for j in range(robot.capsules[i]["link"] + 1):
            moved += robot.levers[i, j] * abs(posture[j] - later[j])
        room[i] += widening - moved


@jit_counting
def _least_of(robot, i, until, least, around, work):
    """The smallest gap of all so far, and one that capsule i is not below towards anybody [m]."""
    agents, levers, fastest, touch = around.agents, robot.levers, work.fastest, around.touch
    part, spin, room = work.segments_now[i], 0.0, np.inf
    ball = ball_around(part)
    for j in range(part["link"] + 1):
        spin += (levers[i, j] + part["radius"]) * fastest[j]
    for k in range(agents.shape[0]):
        agent = agents[k]
        radii = part["radius"] + agent["radius"]
        taken = around.reach[k] + around.growth[k] * until
        if apart(ball, work.balls[k], radii + taken + least + _ROUNDING):
            room = min(room, least)
            continue
        gap, _, _ = capsule_pair(part["start"], part["end"], agent["start"], agent["end"], radii)
        left = gap - taken if not np.isnan(gap - taken) else -np.inf
        room = min(room, left)
        if not spin <= max(touch[k], REST_SPEED):
            least = min(least, left)
    if around.pieces.shape[0] > 1:
        left = room_inside(part["start"], part["end"], part["radius"], around.faces, around.pieces)
        left -= around.entry_reach + around.entry_speed * until
        left = left if not np.isnan(left) else -np.inf
        room = min(room, left)
        if not spin <= REST_SPEED:
            least = min(least, left)
    return least, room
