r"""How much room a step and the stop after it leave to the people around.

A preference, never a permission: planners slow down by it long before the verification has to say no. It is looked at
in a few moments only, and leaves out half-spaces, static capsules and the arm itself.
"""

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.chain import place_axes, pose
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.verification import apart, posture_at

_MOMENTS = 6


@jit
def margin(robot, motion, ticks, around, work):
    r"""Smallest gap that is left between arm and people until the arm is at rest [m].

    With T the length of step and stop, and people k grown by :math:`r_k` so far and by :math:`\hat v_k` from now on,

    .. math:: h = \min_{i, c, k} D_{ck}(t_i) - r_k - \hat v_k (t_i + \tau + T/6), \quad t_i = i T / 6, \; i = 0 \dots 5,

    over the robot capsules c that still move faster than k may be touched.

    Args:
        robot, motion, ticks, around, work: See :func:`~jssa_gym.kernels.verification.keeps_clear`.

    Returns:
        That; inf where nothing moves or nobody is there, below 0 where people could be met.
    """
    agents, reach, growth, touch = around.agents, around.reach, around.growth, around.touch
    levers, fastest, segments = robot.levers, work.fastest, work.segments_now
    length, least = motion.dt * (1 + ticks), np.inf
    for moment in range(_MOMENTS):
        t = length * moment / _MOMENTS
        until = t + motion.dt + length / _MOMENTS
        posture_at(motion, t, work.posture, fastest)
        spins = False
        for j in range(fastest.shape[0]):
            spins = spins or fastest[j] > 0.0
        if not spins:
            break
        pose(robot.links, work.posture, work.frames_now)
        place_axes(work.frames_now, robot.capsules, segments)
        for i in range(segments.shape[0]):
            part, spin = segments[i], 0.0
            for j in range(part["link"] + 1):
                spin += (levers[i, j] + part["radius"]) * fastest[j]
            for k in range(agents.shape[0]):
                if spin <= max(touch[k], REST_SPEED):
                    continue
                agent = agents[k]
                radii = part["radius"] + agent["radius"]
                taken = reach[k] + growth[k] * until
                if least < np.inf and apart(part, agent, radii + taken + least):
                    continue
                gap, _, _ = capsule_pair(part["start"], part["end"], agent["start"], agent["end"], radii)
                least = min(least, gap - taken)
    return least
