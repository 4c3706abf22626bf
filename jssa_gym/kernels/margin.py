r"""How much room a step and the stop after it leave to the people around.

A preference, never a permission: planners slow down by it long before the verification has to say no. It is looked at
in a few moments only, and leaves out half-spaces, static capsules and the arm itself.
"""

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair, common_pair, put_axes
from jssa_gym.kernels.chain import place_axes, pose
from jssa_gym.kernels.jit import part
from jssa_gym.kernels.lanes import LANES, lanes
from jssa_gym.kernels.region import room_inside
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.vector import copy, fill
from jssa_gym.kernels.verification import SHORTEST, posture_at

_MOMENTS = 6

_ROUNDING = 1e-9
"""By how much a gap has to be wider than the smallest one to be more than rounding [m]."""

_CLEARLY = 1e-6
"""What has to be left of a margin for more than rounding [m]."""


@part
def margin(robot, motion, ticks, around, work):
    r"""Smallest gap that is left between arm and people until the arm is at rest [m].

    With T the length of step and stop, and people k grown by :math:`r_k` so far and by :math:`\hat v_k` from now on,

    .. math:: h = \min_{i, c, k} D_{ck}(t_i) - r_k - \hat v_k (t_i + \tau + T/6), \quad t_i = i T / 6, \; i = 0 \dots 5,

    over the robot capsules c that still move faster than k may be touched.

    The last moment is looked at first: people have grown most by then, and going back from it a gap shrinks by no more
    than the capsule moves, and widens by what people had not grown yet. So the moments before hardly ever count: a
    bound on the arm's speed tells of most of them, where the arm is then of others.

    Args:
        robot, motion, ticks, around: See :func:`~jssa_gym.kernels.verification.keeps_clear`.
        work: Scratch, see there; besides ``later`` (n,) and ``room`` (m,). ``quickest`` (1,) is a result.

    Returns:
        That; inf where nothing moves or nobody is there, below 0 where people could be met, -inf where a gap is NaN.
    """
    agents, growth, posture, later, room = around.agents, around.growth, work.posture, work.later, work.room
    fastest, segments = work.fastest, work.segments_now
    length, least, slowest = motion.dt * (1 + ticks), np.inf, np.inf
    if around.pieces.shape[0] > 1:
        slowest = around.entry_speed
    elif agents.shape[0] == 0:
        return np.inf
    for k in range(agents.shape[0]):
        slowest = min(slowest, growth[k])
    put_axes(agents, work.axes)
    posture_at(motion, 0.0, posture, fastest)
    speed, lowest, then = _quickest(robot, fastest), -np.inf, length
    work.quickest[0] = speed
    fill(room, -np.inf)
    for moment in range(_MOMENTS - 1, -1, -1):
        t = length * moment / _MOMENTS
        if lowest + (slowest - speed) * (then - t) > least + _ROUNDING:
            continue
        until = t + motion.dt + length / _MOMENTS
        posture_at(motion, t, posture, fastest)
        if not _spins(fastest):
            continue
        _go_back(robot, posture, later, slowest * (then - t), room)
        placed, lowest, then = False, np.inf, t
        for i in range(room.shape[0]):
            if not room[i] > least + _ROUNDING:
                if not placed:
                    pose(robot.links, posture, work.frames_now)
                    place_axes(work.frames_now, robot.capsules, segments)
                    placed = True
                least, room[i] = _least_of(robot, i, segments[i], until, least, around, work)
                if least == -np.inf:
                    return least
            lowest = min(lowest, room[i])
        copy(posture, later)
    return least


@part
def clears_people(motion, ticks, room, quickest):
    """Whether a margin of ``room`` [m] says that people are kept off, between the moments that it looks at too.

    The fastest capsule's speed [m/s] is what the margin says, too.

    A gap shrinks from one moment to the next by no more than the fastest capsule moves; what people grow meanwhile, and
    in a control step besides, is in the margin. So they need not be looked at again by
    :func:`~jssa_gym.kernels.verification.keeps_clear`, whose other arguments these are; NaN says nothing.
    """
    if not room > 0.0 or motion.dt < SHORTEST:
        return False
    between = motion.dt * (1 + ticks) / _MOMENTS
    return room > (between + SHORTEST) * quickest + _CLEARLY


@part
def _spins(fastest):
    """Whether any joint still moves."""
    spins = False
    for j in range(fastest.shape[0]):
        spins = spins or fastest[j] > 0.0
    return spins


@part
def _quickest(robot, fastest):
    """Speed of the fastest capsule's axis, at most, for joint speeds (n,) [m/s]."""
    quickest = 0.0
    for i in range(robot.capsules.shape[0]):
        speed = 0.0
        for j in range(robot.capsules[i]["link"] + 1):
            speed += robot.levers[i, j] * fastest[j]
        if not speed <= quickest:
            quickest = speed
    return quickest


@part
def _go_back(robot, posture, later, widening, room):
    """Least gaps of all capsules, ``room`` (m,), from a later posture to an earlier one: what they are at least [m]."""
    for i in range(room.shape[0]):
        moved = 0.0
        for j in range(robot.capsules[i]["link"] + 1):
            moved += robot.levers[i, j] * abs(posture[j] - later[j])
        room[i] += widening - moved


@part
def _least_of(robot, i, part, until, least, around, work):
    """The smallest gap of all so far, and one that capsule i, ``part``, is not below towards anybody [m]."""
    sx, sy, sz, ex, ey, ez = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    radii, gap, holds = lanes(), lanes(), lanes()
    agents, touch, axes, count = around.agents, around.touch, work.axes, around.agents.shape[0]
    thick, spin, nearest = part["radius"], 0.0, np.inf
    for j in range(part["link"] + 1):
        spin += (robot.levers[i, j] + thick) * work.fastest[j]
    a = part["start"][0], part["start"][1], part["start"][2]
    b = part["end"][0], part["end"][1], part["end"][2]
    for first in range(0, count, LANES):
        for k in range(LANES):
            sx[k], sy[k], sz[k] = axes[0, first + k], axes[1, first + k], axes[2, first + k]
            ex[k], ey[k], ez[k] = axes[3, first + k], axes[4, first + k], axes[5, first + k]
            radii[k] = thick + axes[6, first + k]
        for k in range(LANES):
            gap[k], _, _, common = common_pair(a, b, (sx[k], sy[k], sz[k]), (ex[k], ey[k], ez[k]), radii[k])
            holds[k] = 1.0 if common else 0.0
        for k in range(min(LANES, count - first)):
            if holds[k] == 0.0:
                agent = agents[first + k]
                gap[k], _, _ = capsule_pair(part["start"], part["end"], agent["start"], agent["end"], radii[k])
            left = gap[k] - (around.reach[first + k] + around.growth[first + k] * until)
            left = left if not np.isnan(left) else -np.inf
            nearest = min(nearest, left)
            if not spin <= max(touch[first + k], REST_SPEED):
                least = min(least, left)
    if around.pieces.shape[0] > 1:
        left = room_inside(part["start"], part["end"], part["radius"], around.faces, around.pieces)
        left -= around.entry_reach + around.entry_speed * until
        left = left if not np.isnan(left) else -np.inf
        nearest = min(nearest, left)
        if not spin <= REST_SPEED:
            least = min(least, left)
    return least, nearest
