"""Filters that keep an energy function from growing: SSA, SSS and CBF; equations in :mod:`jssa_gym.shields.energy`."""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.projection import violation
from jssa_gym.kernels.vector import fill
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.pairs import index_now, index_rate, measure, watched
from jssa_gym.tick.proposals.rows import PROJECT, project

UNBOUNDED = 1e6
"""Acceleration bound of a method that knows none [rad/s²]."""

TOLERANCE = 1e-9
"""Violation of a row by rounding [m²]."""


class SafeAcceleration(NamedTuple):
    """Rows of the acceleration: SSA; fields as of :class:`~jssa_gym.shields.SSAParams`."""

    index: Index
    eta: float
    closest: bool


class SublevelRows(NamedTuple):
    """Rows of the index's rate where it is above 0: SSS; fields as of :class:`~jssa_gym.shields.SSSParams`."""

    index: Index
    c: float
    closest: bool


class BarrierRows(NamedTuple):
    """Rows of the distance's third derivative: CBF; fields as of :class:`~jssa_gym.shields.CBFParams`."""

    index: Index
    k1: float
    k2: float
    k3: float
    closest: bool


@jit
def safe_acceleration(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    tau, now, count = settings.dt, memory.state[e, 2], 0
    wanted, lower, upper = work.own[0], work.own[1], work.own[2]
    for number in range(work.motion.shape[0]):
        if not watched(robot, proposal, work, told, number):
            continue
        phi = index_now(work, number)
        told["phi"] = max(told["phi"], phi)
        if not phi >= 0.0:
            continue
        at_present = 0.0
        for j in range(now.shape[0]):
            work.L[count, j] = tau * proposal.index.lambda1 * work.pushes[number, j]
            at_present += work.L[count, j] * now[j]
        work.S[count] = tau * (proposal.eta + index_rate(work.motion[number], proposal.index)) + at_present
        count += 1
    for j in range(now.shape[0]):
        wanted[j] = now[j] + tau * work.clipped[j]
    if violation(work.L, work.S, count, wanted) <= 0.0:
        return 0
    fill(lower, -UNBOUNDED)
    fill(upper, UNBOUNDED)
    _, left = project(settings, wanted, count, lower, upper, work)
    if not left < np.inf:
        return codes.UNSOLVED
    for j in range(now.shape[0]):
        work.wanted[j] = min(max((work.wanted[j] - now[j]) / tau, work.lower[j]), work.upper[j])
        wanted[j] = now[j] + tau * work.wanted[j]
    told["rows"], told["slack"] = count, violation(work.L, work.S, count, wanted)
    if not told["slack"] < np.inf:
        return codes.UNSOLVED
    return codes.CUT_OFF if told["slack"] > TOLERANCE else codes.ROWS


@jit
def sublevel_rows(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    count = 0
    for number in range(work.motion.shape[0]):
        if not watched(robot, proposal, work, told, number):
            continue
        phi = index_now(work, number)
        told["phi"] = max(told["phi"], phi)
        if not phi >= 0.0:
            continue
        for j in range(nominal.shape[0]):
            work.L[count, j] = settings.dt * proposal.index.lambda2 * work.pushes[number, j]
        work.S[count] = settings.dt * (proposal.c * phi + index_rate(work.motion[number], proposal.index))
        count += 1
    return _project_if_broken(count, work, told)


@jit
def barrier_rows(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    k1, k2, k3, count = proposal.k1, proposal.k2, proposal.k3, 0
    for number in range(work.motion.shape[0]):
        told["phi"] = max(told["phi"], index_now(work, number))
        if not watched(robot, proposal, work, told, number):
            continue
        motion = work.motion[number]
        distance, rate, curvature, drift = motion[0], motion[1], motion[2], motion[3]
        for j in range(nominal.shape[0]):
            work.L[count, j] = work.pushes[number, j]
        work.S[count] = -(
            drift
            + (k1 + k2 + k3) * curvature
            + (k1 * k2 + k1 * k3 + k2 * k3) * rate
            + k1 * k2 * k3 * (distance - proposal.index.d_min)
        )
        count += 1
    return _project_if_broken(count, work, told)


@jit
def _project_if_broken(count, work, told):
    """``PROJECT`` if the clipped nominal breaks one of the rows; else 0."""
    if violation(work.L, work.S, count, work.clipped) <= 0.0:
        return 0
    told["rows"] = count
    return PROJECT
