"""Filters that push the arm without rows: PFM and SMA; equations in :mod:`jssa_gym.shields.closed_form`."""

from typing import NamedTuple

from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import fill
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.pairs import index_now, measure, push, watched

NEAREST = 0.01
"""Distance below which the repulsive field, which has a pole at contact, is held [m]."""

MOVABLE = 1e-9
"""Share of the jerk bounds below which no joint moves a pair."""


class Repulsion(NamedTuple):
    """A repulsive force: PFM; fields as of :class:`~jssa_gym.shields.PFMParams`."""

    index: Index
    influence: float
    strength: float
    damping: float
    lag: float
    closest: bool


class SlidingMode(NamedTuple):
    """A jerk of one size: SMA; fields as of :class:`~jssa_gym.shields.SMAParams`."""

    index: Index
    gain: float
    closest: bool


@jit
def repulsion(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    away = work.own[0]
    fill(away, 0.0)
    for number in range(work.motion.shape[0]):
        phi = index_now(work, number)
        told["phi"] = max(told["phi"], phi)
        if not (phi > 0.0 and watched(robot, proposal, work, told, number)):
            continue
        motion = work.motion[number]
        distance, rate, curvature = max(motion[0], NEAREST), motion[1], motion[2]
        force = proposal.strength * (1.0 / distance - 1.0 / proposal.influence) / distance**2 - proposal.damping * rate
        # people repel, they never attract; what is no number stays none
        strength = 0.0 if force - curvature < 0.0 else (force - curvature) / proposal.lag
        for j in range(away.shape[0]):
            away[j] += strength * work.pushes[number, j]
    return codes.REPELLED if push(work, away) else 0


@jit
def sliding_mode(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    away, count = work.own[0], 0
    fill(away, 0.0)
    for number in range(work.motion.shape[0]):
        if not watched(robot, proposal, work, told, number):
            continue
        phi = index_now(work, number)
        told["phi"] = max(told["phi"], phi)
        if phi > 0.0:
            count += 1
            for j in range(away.shape[0]):
                away[j] += work.pushes[number, j]
    if count == 0:
        return 0
    told["rows"], most = count, 0.0
    for j in range(away.shape[0]):
        share = abs(away[j]) / robot.limits[4, j]
        if not share <= most:
            most = share
    if not most > MOVABLE:
        told["slack"] = told["phi"]
        return codes.IMMOVABLE
    for j in range(away.shape[0]):
        away[j] *= proposal.gain / most
    push(work, away)
    return codes.SLIDING
