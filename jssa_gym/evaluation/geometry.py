"""What follows from a recorded episode's joint states, people and half-spaces, for a robot: an array a quantity."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.capsules import measure_planes, measure_self
from jssa_gym.kernels.chain import forward, place, tool_motion
from jssa_gym.kernels.contact import observe
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import plan_stop
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import TRUTH, plane_records
from jssa_gym.types import Array, Planes, Trace


class Touches(NamedTuple):
    """Robot capsules against people's at the steps at which they touch; c touching pairs in all."""

    step: NDArray[np.int64]
    """Shape (c,)."""
    robot_approach: Array
    """Speed of the robot's touching point into the person, along the normal, shape (c,) [m/s]."""
    human_approach: Array
    """Speed of the person's touching point into the robot, shape (c,) [m/s]."""


class Geometry(NamedTuple):
    """An episode, a row a step; of the commanded arm, as the trace's joint states are."""

    tip: Array
    """Tool centre point, before the first step too, shape (T + 1, 3) [m]."""
    own: Array
    """Smallest distance of the arm to itself, shape (T,) [m]; inf for an arm that cannot touch itself."""
    planes: Array
    """Smallest distance of the arm to the half-spaces, shape (T,) [m]."""
    approach: Array
    """Speed of the robot's closest point towards the person's, shape (T,) [m/s]; 0 without people; so the next."""
    human_approach: Array
    """Speed of the person's closest point towards the robot's, shape (T,) [m/s]."""
    stop_time: Array
    """Time that the jerk-limited stop of all joints takes from the state, shape (T,) [s]."""
    stop_advance: Array
    """How far the robot's closest point comes towards the person during it, at least 0, shape (T,) [m]."""
    touches: Touches


def geometry(trace: Trace, robot: RobotModel) -> Geometry:
    """Look at an episode.

    People's velocities are those of the way from step to step.

    Args:
        trace: The episode.
        robot: The robot that it was recorded with, where it stood.

    Raises:
        ParameterError: The trace is of another robot, or of one that stood elsewhere.
    """
    if trace.robot != robot.name or trace.initial_state.shape != (3, robot.n):
        raise ParameterError(f"the episode is of the robot {trace.robot!r}, not of {robot.name!r}")
    if not np.array_equal(trace.mount, robot.mount):
        raise ParameterError(f"the episode's robot stands at {trace.mount}, this one at {robot.mount}; use mounted()")
    count, n, m, k = len(trace.time), robot.n, len(robot.capsules), len(trace.human_radius)
    agents = _agents(trace)
    # row 0 is the state before the first step: of it only the tool's place is asked for
    state = np.empty((count + 1, 3, n))
    state[0] = trace.initial_state
    state[1:, 0], state[1:, 1], state[1:, 2] = trace.position, trace.velocity, trace.acceleration
    bounds = np.array([*robot.limits.position.T, robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk])
    half_spaces = plane_records(Planes(trace.plane_normal, trace.plane_offset, trace.plane_names))
    frames, segments = records(n, FRAME), records((count, m), SEGMENT)
    pairs, plane_pairs = records((count, m, k), PAIR), records((count, m, len(half_spaces)), PAIR)
    own, plans = np.full((count, len(robot.self_pairs)), np.inf), records((count, n), STOP)
    out, parts, index, tool, tip = np.zeros(13), np.zeros(1), TRUTH.kernel(), np.zeros((2, 3)), np.empty((count + 1, 3))
    near, ticks = np.zeros((count, 2), np.int64), np.zeros(count)
    forward(robot.links, state[0], frames)
    tool_motion(frames, robot.tool_link, robot.tool_offset, tool)
    tip[0] = tool[0]
    for t in range(count):
        arm, now = segments[t], state[t + 1]
        near[t] = observe(
            robot.links, robot.capsules, now, agents[t], index, frames, arm, pairs[t], out, parts
        )  # fmt: skip
        measure_planes(arm, half_spaces, plane_pairs[t])
        measure_self(arm, robot.self_pairs, own[t])
        tool_motion(frames, robot.tool_link, robot.tool_offset, tool)
        tip[t + 1] = tool[0]
        ticks[t] = plan_stop(now, bounds, trace.dt, plans[t])
    approach, human_approach, advance = _closing(trace, robot, state[1:], segments, agents, pairs, near, plans)
    return Geometry(
        tip,
        own.min(axis=1, initial=np.inf),
        plane_pairs["distance"].min(axis=(1, 2), initial=np.inf),
        approach,
        human_approach,
        ticks * trace.dt,
        advance,
        _touches(segments, agents, pairs),
    )


def _agents(trace: Trace) -> NDArray:
    """People as the kernels read them, shape (T, k) of ``AGENT``."""
    start = np.concatenate([trace.initial_human[None, 0], trace.human_start])
    end = np.concatenate([trace.initial_human[None, 1], trace.human_end])
    agents = records(trace.human_start.shape[:2], AGENT)
    agents["start"], agents["end"], agents["radius"] = start[1:], end[1:], trace.human_radius
    agents["start_velocity"], agents["end_velocity"] = (
        np.diff(start, axis=0) / trace.dt,
        np.diff(end, axis=0) / trace.dt,
    )
    return agents


def _along(one: Array, other: Array, share: Array) -> Array:
    return one + share[:, None] * (other - one)


def _unit(vectors: Array) -> Array:
    """Directions of vectors (c, 3), zero where a vector is shorter than 1e-9."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), 0.0)


def _closing(
    trace: Trace,
    robot: RobotModel,
    state: Array,
    segments: NDArray,
    agents: NDArray,
    pairs: NDArray,
    near: NDArray[np.int64],
    plans: NDArray,
) -> tuple[Array, Array, Array]:
    """How fast robot and person approach each other at their closest points, and how far the robot yet comes."""
    count = len(trace.time)
    if not (count and agents.shape[1]):
        return np.zeros(count), np.zeros(count), np.zeros(count)
    row, column = near.T
    steps = np.arange(count)
    arm, person, pair = segments[steps, row], agents[steps, column], pairs[steps, row, column]
    point = _along(arm["start"], arm["end"], pair["s"])
    towards = _unit(_along(person["start"], person["end"], pair["r"]) - point)
    velocity = _along(arm["start_velocity"], arm["end_velocity"], pair["s"])
    human_velocity = _along(person["start_velocity"], person["end_velocity"], pair["r"])
    stopped = _stopped(state, plans, trace.dt)
    frames, rested = records(robot.n, FRAME), records(len(robot.capsules), SEGMENT)
    ends = np.empty((count, 2, 3))
    for t in range(count):
        forward(robot.links, stopped[t], frames)
        place(frames, robot.capsules, rested)
        ends[t, 0], ends[t, 1] = rested[row[t]]["start"], rested[row[t]]["end"]
    advance = ((_along(ends[:, 0], ends[:, 1], pair["s"]) - point) * towards).sum(axis=1)
    return (
        (velocity * towards).sum(axis=1),
        -(human_velocity * towards).sum(axis=1),
        np.maximum(advance, 0.0),
    )


def _stopped(state: Array, plans: NDArray, dt: float) -> Array:
    """States (T, 3, n) after the stops, shape (T, 3, n): Eq. (1) over ramp, hold and release."""
    q, v, a = state[:, 0], state[:, 1], state[:, 2]
    for part, jerk in (("ramp", plans["jerk_in"]), ("hold", 0.0), ("release", plans["jerk_out"])):
        t = plans[part] * dt
        q, v, a = q + t * v + t**2 / 2.0 * a + t**3 / 6.0 * jerk, v + t * a + t**2 / 2.0 * jerk, a + t * jerk
    return np.ascontiguousarray(np.stack([q, np.zeros_like(q), np.zeros_like(q)], axis=1))


def _touches(segments: NDArray, agents: NDArray, pairs: NDArray) -> Touches:
    step, i, j = np.nonzero(~(pairs["distance"] > 0.0))
    pair, arm, person = pairs[step, i, j], segments[step, i], agents[step, j]
    normal = _unit(_along(person["start"], person["end"], pair["r"]) - _along(arm["start"], arm["end"], pair["s"]))
    # along the normal a surface point moves as the axis point below it does, spinning or not
    velocity = _along(arm["start_velocity"], arm["end_velocity"], pair["s"])
    human_velocity = _along(person["start_velocity"], person["end_velocity"], pair["r"])
    # where the axes cross there is no normal: all of the speed counts
    crossing = ~normal.any(axis=1)
    speed, human_speed = np.linalg.norm(velocity, axis=1), np.linalg.norm(human_velocity, axis=1)
    return Touches(
        step,
        np.where(crossing, speed, (velocity * normal).sum(axis=1)),
        np.where(crossing, human_speed, -(human_velocity * normal).sum(axis=1)),
    )
