"""Speed and separation monitoring: SSM; equations in :class:`jssa_gym.shields.SSMFilter`."""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.chain import forward, place, place_axes, pose
from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.rest import REST_PLANNED
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.kernels.vector import dot, fill, subtract
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.pairs import measure

LONGEST = 5.0
"""A stop that takes longer than this is not followed to its end: no distance is enough for it [s]."""


class ProtectiveDistance(NamedTuple):
    """A protective distance; fields as of :class:`~jssa_gym.shields.SSMParams`."""

    index: Index
    human_speed: float
    """NaN for the measured one."""
    latency: float
    intrusion: float
    human_error: float
    robot_error: float
    hysteresis: float


@jit
def separation(robot, settings, proposal, memory, nominal, work, told, e):
    """Arguments as of :mod:`jssa_gym.tick.proposals`."""
    arm = memory.arm[e]
    wrong = measure(robot, proposal, memory, work, told, e)
    if wrong:
        return wrong
    if work.motion.shape[0] == 0:
        arm["resume"] = np.nan
        return 0
    protective_distance(robot, settings, proposal, memory.state[e], work)
    missing, worst, apart = -np.inf, 0, told["distance"]
    for number in range(work.motion.shape[0]):
        distance, needed = work.motion[number, 0], work.needed[number]
        told["phi"] = max(told["phi"], needed**2 - distance * abs(distance))
        if not needed - distance <= missing:
            missing, worst = needed - distance, number
    distance, needed = work.motion[worst, 0], work.needed[worst]
    enough, stopped = distance >= needed, not np.isnan(arm["resume"])
    if enough and not (stopped and apart < arm["resume"]):
        arm["resume"] = np.nan
        return 0
    if not stopped:
        arm["resume"] = (needed if needed < np.inf else max(distance, 0.0)) + proposal.hysteresis
    stop_now(robot, settings, memory.state[e], work)
    told["rows"] = work.motion.shape[0]
    return codes.WAITING if enough else codes.TOO_CLOSE


@jit
def stop_now(robot, settings, state, work):
    """The first jerk of the arm's own stop, in the box, into ``work.wanted``; none at rest."""
    moving = False
    for j in range(state.shape[1]):
        moving = moving or not (abs(state[1, j]) < REST_PLANNED and abs(state[2, j]) < REST_PLANNED)
    fill(work.wanted, 0.0)
    if moving:
        plan_stop(state, robot.limits, settings.dt, work.next)
        stop_jerk(work.next, 0, work.wanted)
    for j in range(state.shape[1]):
        work.wanted[j] = min(max(work.wanted[j], work.lower[j]), work.upper[j])


@jit
def protective_distance(robot, settings, proposal, state, work):
    r""":math:`S_p` of every pair into ``work.needed`` [m], if the clipped nominal is applied and then the arm stops."""
    after, jerk = work.own[:3], work.own[3]
    integrate(state, work.clipped, settings.dt, after)
    ticks = plan_stop(after, robot.limits, settings.dt, work.next)
    time = ticks * settings.dt
    if not time < LONGEST:
        fill(work.needed, np.inf)
        return
    fill(work.needed, 0.0)
    forward(robot.links, after, work.frames)
    place(work.frames, robot.capsules, work.segments)
    come_towards(work)
    for tick in range(ticks):
        stop_jerk(work.next, tick, jerk)
        integrate(after, jerk, settings.dt, after)
        # velocities stay those of the stop's beginning
        pose(robot.links, after[0], work.frames)
        place_axes(work.frames, robot.capsules, work.segments)
        come_towards(work)
    columns = work.pairs_now.shape[1]
    for number in range(work.needed.shape[0]):
        agent, segment, n = work.agents[number % columns], work.segments[number // columns], work.normals[number]
        speed = proposal.human_speed
        if np.isnan(speed):
            speed = max(max(dot(agent["start_velocity"], n), dot(agent["end_velocity"], n)), 0.0)
        fastest = max(-dot(segment["start_velocity"], n), -dot(segment["end_velocity"], n))
        came = work.needed[number] + max(proposal.latency * fastest, 0.0)
        work.needed[number] = (
            speed * (settings.dt + proposal.latency + time) + came
            + proposal.intrusion + proposal.human_error + proposal.robot_error
        )  # fmt: skip


@jit
def come_towards(work):
    """How far an end of each pair's robot capsule has come towards the person, if it is more, into ``work.needed``."""
    columns = work.pairs_now.shape[1]
    for number in range(work.needed.shape[0]):
        now, then, n = work.segments_now[number // columns], work.segments[number // columns], work.normals[number]
        start, end = dot(subtract(now["start"], then["start"]), n), dot(subtract(now["end"], then["end"]), n)
        work.needed[number] = max(work.needed[number], start, end)
