"""What a verified stop sees: the arm on its way to rest, and where people can be by then."""

import numpy as np

from jssa_gym.envs.surroundings import capsules_of
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import FRAME, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.proximity import state_rows
from jssa_gym.types import CapsuleSet, JointState
from jssa_gym.viewer.snapshot import Overlay

PLACES = 6
"""As many places of the arm on its way to rest are drawn, the last one at rest."""


def swept_stop(robot: RobotModel, state: JointState, dt: float) -> tuple[Overlay, float]:
    """The arm's capsules on the hardest stop that begins now, and how long it takes [s].

    Args:
        robot: The arm, where it stands.
        state: Its joints.
        dt: Control step [s].
    """
    bounds, plan = robot.limits.bounds(), records(robot.n, STOP)
    now = state_rows(state)
    ticks = plan_stop(now, bounds, dt, plan)
    wanted = np.unique(np.linspace(0, ticks, PLACES).round().astype(int)).tolist()
    starts, ends = [], []
    jerk, after = np.zeros(robot.n), np.empty_like(now)
    for tick in range(ticks + 1):
        if tick in wanted:
            capsules = arm_capsules(robot, JointState(*now))
            starts.append(capsules.start)
            ends.append(capsules.end)
        stop_jerk(plan, tick, jerk)
        integrate(now, jerk, dt, after)
        now, after = after, now
    # a fixed number of places, whatever the stop's length
    starts += starts[-1:] * (PLACES - len(starts))
    ends += ends[-1:] * (PLACES - len(ends))
    radius = np.tile(robot.capsules["radius"], PLACES)
    return Overlay(np.concatenate(starts), np.concatenate(ends), radius), ticks * dt


def reachable(people: CapsuleSet, params: FailsafeParams, time: float) -> Overlay:
    """The people's capsules grown by what they can move in a time: inside there may be somebody by then.

    Args:
        people: As measured, of age 0.
        params: How fast they are assumed to be, at most, and how well they are measured.
        time: From now [s].
    """
    fastest = np.array([max(params.end_speeds_of(name)) for name in people.names])
    late = time + params.actuation_lag
    return Overlay(people.start, people.end, people.radius + fastest * late + params.position_error)


def arm_capsules(robot: RobotModel, state: JointState) -> CapsuleSet:
    """The arm's capsules in the world.

    Args:
        robot: The arm, where it stands.
        state: Its joints.
    """
    frames, segments = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
    forward(robot.links, state_rows(state), frames)
    place(frames, robot.capsules, segments)
    return capsules_of(segments, robot.capsule_names)
