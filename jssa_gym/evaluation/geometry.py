"""What follows from a recorded episode's joint states, people and half-spaces, for a robot: an array a quantity."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.evaluation.counterfactual import false_interventions
from jssa_gym.evaluation.oracle import Inertia
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.apart import along_stops
from jssa_gym.kernels.capsules import measure_planes, measure_self
from jssa_gym.kernels.chain import forward, tool_motion
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import plan_stop
from jssa_gym.robots import RobotModel
from jssa_gym.safety.energy import energy_limit, mass_of
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.proximity import plane_records
from jssa_gym.tick.course import look_along, place_along
from jssa_gym.types import Array, Planes, Trace

MOVING_IN = 1e-6
"""Speed into a person up to which no energy is asked for [m/s]: what is slower is rounding."""


_ENDS = ("start", "end", "start_velocity", "end_velocity")
"""Ends of a capsule's axis, and how they move: fields of ``SEGMENT`` and ``AGENT``."""


class Touches(NamedTuple):
    """Robot capsules against people's at the steps at which they touch; c touching pairs in all."""

    step: NDArray[np.int64]
    """Shape (c,)."""
    robot_approach: Array
    """Speed of the robot's touching point into the person, along the normal, shape (c,) [m/s]."""
    human_approach: Array
    """Speed of the person's touching point into the robot, shape (c,) [m/s]."""
    energy_ratio: Array
    """Energy that the arm's own motion along the normal could give the body part, over its indicative limit (c,)."""


class Geometry(NamedTuple):
    """An episode, a row a step; of the commanded arm, as the trace's joint states are."""

    tip: Array
    """Tool centre point, before the first step too, shape (T + 1, 3) [m]."""
    own: Array
    """Smallest distance of the arm to itself, shape (T,) [m]; inf for an arm that cannot touch itself."""
    planes: Array
    """Smallest distance of the arm to the half-spaces, shape (T,) [m]."""
    distance: Array
    """Distance of every robot capsule to every one of people's, shape (T, m, k) [m]."""
    arm_distance: Array
    """Smallest distance to people of the arm but for its first link, shape (T,) [m]; inf without people."""
    approach: Array
    """Speed of such a pair's closest robot point towards the person's, shape (T, m, k) [m/s]."""
    human_approach: Array
    """Speed of the person's point towards the robot's, shape (T, m, k) [m/s]."""
    stop_time: Array
    """Time that the jerk-limited stop of all joints takes from the state, shape (T,) [s]."""
    stop_advance: Array
    """How far the robot's point has come towards the person's at its end, at least 0, shape (T, m, k) [m]."""
    phi: Array
    """Largest safety index of all pairs, by the defaults of ``IndexParams`` and the episode's d_min, the closest points
    fixed to their bodies, shape (T,) [m²]; -inf without people."""
    false_interventions: NDArray[np.bool_]
    """:func:`~jssa_gym.evaluation.counterfactual.false_interventions`, shape (onsets,)."""
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
    bounds = robot.limits.bounds()
    half_spaces = plane_records(Planes(trace.plane_normal, trace.plane_offset, trace.plane_names))
    frames, segments, pairs = records(n, FRAME), records((count, m), SEGMENT), records((count, m, k), PAIR)
    motion, rows, normals = np.zeros((count, m * k, 4)), np.zeros((m * k, n)), np.zeros((count, m * k, 3))
    index = np.array(IndexParams().kernel()._replace(d_min=trace.d_min), np.float64)
    tool, tip = np.zeros((2, 3)), np.empty((count + 1, 3))
    forward(robot.links, state[0], frames)
    tool_motion(frames, robot.tool_link, robot.tool_offset, tool)
    tip[0] = tool[0]
    arm = robot.links, robot.capsules, robot.tool_link, robot.tool_offset
    look_along(arm, state[1:], agents, index, (frames, rows, tool), (segments, pairs, motion, normals, tip[1:]))
    own, plane_pairs = np.full((count, len(robot.self_pairs)), np.inf), records((count, m, len(half_spaces)), PAIR)
    measure_planes(segments.reshape(-1), half_spaces, plane_pairs.reshape(count * m, len(half_spaces)))
    measure_self(segments.reshape(-1), _in_each(robot.self_pairs, count, m), own.reshape(-1))
    plans = _stops(state[1:], bounds, trace.dt)
    rested = np.empty((count, 1, n))
    along_stops(state[1:], plans, trace.dt, np.array([np.inf]), rested)
    shift = _shift(robot, rested[:, 0], segments)
    normals = normals.reshape(count, m, k, 3)
    human_approach = _component("tkx,tmkx->tmk", agents["start_velocity"], agents["end_velocity"], pairs["r"], normals)
    return Geometry(
        tip,
        own.min(axis=1, initial=np.inf),
        plane_pairs["distance"].min(axis=(1, 2), initial=np.inf),
        pairs["distance"],
        pairs["distance"][:, robot.capsules["link"] > 0].min(axis=(1, 2), initial=np.inf),
        -motion[:, :, 1].reshape(count, m, k) - human_approach,
        human_approach,
        (plans["ramp"] + plans["hold"] + plans["release"]).max(axis=1) * trace.dt,
        np.maximum(-_component("tmx,tmkx->tmk", shift[:, 0], shift[:, 1], pairs["s"], normals), 0.0),
        pairs["phi"].max(axis=(1, 2), initial=-np.inf),
        false_interventions(trace, robot, state, bounds, agents),
        _touches(trace, robot, segments, agents, pairs),
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


def _in_each(self_pairs: NDArray[np.int64], count: int, m: int) -> NDArray[np.int64]:
    """Pairs (p, 2) of m capsules as pairs of count times m capsules, shape (count p, 2)."""
    return (self_pairs + m * np.arange(count)[:, None, None]).reshape(-1, 2)


def _stops(state: Array, bounds: Array, dt: float) -> NDArray:
    """Stops from all states (T, 3, n), shape (T, n) of ``STOP``: each joint stops by itself, so all are one arm's."""
    count, _, n = state.shape
    plans = records((count, n), STOP)
    plan_stop(state.transpose(1, 0, 2).reshape(3, -1), np.tile(bounds, count), dt, plans.reshape(-1))
    return plans


def _shift(robot: RobotModel, position: Array, segments: NDArray) -> Array:
    """The ways of both ends from segments (T, m) to where they are at joint positions (T, n), (T, 2, m, 3) [m]."""
    frames, rested, state = records(robot.n, FRAME), records(segments.shape, SEGMENT), np.zeros((3, robot.n))
    place_along(robot.links, robot.capsules, np.ascontiguousarray(position), state, frames, rested)
    return np.stack([rested["start"] - segments["start"], rested["end"] - segments["end"]], axis=1)


def _component(axes: str, start: Array, end: Array, share: Array, normals: Array) -> Array:
    """Component along normals (T, m, k, 3) of a vector that is known at the ends of an axis, at the share between."""
    one, other = np.einsum(axes, start, normals), np.einsum(axes, end, normals)
    return one + share * (other - one)


def _touches(trace: Trace, robot: RobotModel, segments: NDArray, agents: NDArray, pairs: NDArray) -> Touches:
    step, i, j = np.nonzero(~(pairs["distance"] > 0.0))
    s, r = (pairs[name][step, i, j] for name in ("s", "r"))
    # field by field: of the rest of the records nothing is asked
    start, end, start_velocity, end_velocity = (segments[name][step, i] for name in _ENDS)
    point = _along(start, end, s)
    # along the normal a surface point moves as the axis point below it does, spinning or not
    velocity = _along(start_velocity, end_velocity, s)
    start, end, start_velocity, end_velocity = (agents[name][step, j] for name in _ENDS)
    normal = _unit(_along(start, end, r) - point)
    human_velocity = _along(start_velocity, end_velocity, r)
    # where the axes cross there is no normal: all of the speed counts
    crossing = ~normal.any(axis=1)
    speed, human_speed = np.linalg.norm(velocity, axis=1), np.linalg.norm(human_velocity, axis=1)
    approach = np.where(crossing, speed, (velocity * normal).sum(axis=1))
    return Touches(
        step,
        approach,
        np.where(crossing, human_speed, -(human_velocity * normal).sum(axis=1)),
        _energy_ratios(trace, robot, Touching(step, i, j, point, normal, approach)),
    )


class Touching(NamedTuple):
    """c touching pairs: steps, robot and human capsules (c,), points and normals (c, 3), approach (c,) [m, m/s]."""

    step: NDArray[np.int64]
    robot: NDArray[np.int64]
    human: NDArray[np.int64]
    point: Array
    normal: Array
    approach: Array


def _energy_ratios(trace: Trace, robot: RobotModel, touching: Touching) -> Array:
    """The energies of :class:`Touches`; without a normal the arm's mass is taken to be without bound."""
    ratios = np.zeros(len(touching.step))
    moving = np.flatnonzero(~(touching.approach <= MOVING_IN))
    if not len(moving):
        return ratios
    inertia, mass = Inertia(robot), np.full(len(moving), np.inf)
    for k, c in enumerate(moving.tolist()):
        step, i, _, point, normal, _ = (values[c] for values in touching)
        if normal.any():
            mass[k] = inertia.mass(trace.position[step], i, point, normal)
    part = touching.human[moving]
    human, limit = (np.array([of(name) for name in trace.human_names])[part] for of in (mass_of, energy_limit))
    reduced = human / (1.0 + human / mass)
    # one by one: the power of a number is the C library's, that of an array is not, and what was stored stays
    squared = np.array([speed**2 for speed in touching.approach[moving].tolist()])
    ratios[moving] = 0.5 * reduced * squared / limit
    return ratios
