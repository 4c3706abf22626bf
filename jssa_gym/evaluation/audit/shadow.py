"""A shield in the place of whoever drove the robot: the motion that was logged, followed as far as it lets it."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from jssa_gym.control.cascade import Cascade
from jssa_gym.control.inverse import path_is_clear
from jssa_gym.control.moves import brake_jerk
from jssa_gym.control.path import PacedPath
from jssa_gym.control.plan import Plan
from jssa_gym.control.rejoin import Route, rejoin
from jssa_gym.evaluation.audit.course import Bystanders, Course
from jssa_gym.evaluation.audit.motion import spline_ends
from jssa_gym.humans import nobody
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.robots import RobotModel
from jssa_gym.shields import SafetyFilter
from jssa_gym.types import Array, Decision, JointState, Planes, Scene, Status

_CLEAR = 0.005
"""Distance from table and itself that ways back to the log's path keep [m]."""

_SMOOTHED = (2.0, 4.0, 8.0)
"""Deviations of the Gaussians that a log is smoothed with until it keeps the limits, in control steps."""


SLOWED = "slowed along its path: at its own pace no stop would be verified, or the filter would not leave it alone"
"""Why a slower alternative is applied."""


class _FullPace:
    """A path that asks for its own pace, however near people are: what a shield makes slower is the shield's doing."""

    def __init__(self, path: PacedPath) -> None:
        self.path = path

    @property
    def override(self) -> float:
        return self.path.override

    def alternatives(self, state: Array, margin: float) -> Array:
        return self.path.alternatives(state, np.inf)

    def took(self, choice: int) -> None:
        self.path.took(choice)


class Shadowed(NamedTuple):
    """What the shield would have made of a log."""

    course: Course
    lateness: Array
    """By how much the arm is behind the log, after every step, shape (T,) [s]."""
    off: float
    """How far the motion that it was asked for is from the log, which exceeds the limits, at most [rad]; 0 where the
    log keeps them."""


def plan_of(states: Array, dt: float, robot: RobotModel) -> tuple[Plan, float]:
    """The motion of a log within the robot's limits, and how far that is from the log at most [rad].

    One that exceeds them, by noise mostly, is smoothed a little; where that does not help, it is followed.

    Args:
        states: Of the log, shape (T + 1, 3, n).
        dt: Control step [s].
        robot: Whose.
    """
    plan = _planned(states, dt)
    if np.abs(plan.states[:, 0] - states[:, 0]).max() < 1e-6 and plan.keeps(robot.limits):
        return plan, 0.0
    grid = dt * np.arange(len(states))
    for width in _SMOOTHED:
        smooth = gaussian_filter1d(states[:, 0], width, axis=0, mode="nearest")
        curve = CubicSpline(grid, smooth, bc_type=spline_ends(smooth))
        plan = _planned(np.stack([curve(grid), curve(grid, 1), curve(grid, 2)], axis=1), dt)
        if plan.keeps(robot.limits):
            break
    else:
        plan = _followed(states, dt, robot)
    return plan, float(np.abs(plan.states[:, 0] - states[:, 0]).max())


def _planned(states: Array, dt: float) -> Plan:
    jerk = np.diff(states[:, 2], axis=0) / dt
    return Plan.follow(states[0], jerk, dt, (len(jerk),))


def _followed(states: Array, dt: float, robot: RobotModel) -> Plan:
    """The motion of an arm that is sent along a log, and is as fast as its limits let it be."""
    bounds, law = robot.limits.bounds(), Cascade(robot.limits, share=1.0)
    state = np.clip(states[0], [bounds[0], -bounds[2], -bounds[3]], [bounds[1], bounds[2], bounds[3]])
    first, lower, upper = state.copy(), np.empty(robot.n), np.empty(robot.n)
    jerk = np.empty((len(states) - 1, robot.n))
    for k, wanted in enumerate(states[1:]):
        pull = law.jerk_at_speed(JointState(*state), wanted[1] + law.kp * (wanted[0] - state[0]))
        jerk_box(state, bounds, dt, lower, upper)
        jerk[k] = np.clip(pull, lower, upper)
        integrate(state, jerk[k], dt, state)
    return Plan.follow(first, jerk, dt, (len(jerk),))


def shadow(
    filter: SafetyFilter, states: Array, ends: Array, people: Bystanders, planes: Planes, begin: float = 0.0
) -> Shadowed:
    """Let a shield drive.

    It sees people and its own arm in every step, as the environments' shields do. It is offered the log's path at its
    own pace and at slower ones, and braking along it; what it takes off the path rejoins it ahead.

    Args:
        filter: The shield's, of the robot where it stands.
        states: Of the log, shape (T + 1, 3, n).
        ends: Of everybody's capsules, shape (T + 1, 2, m, 3) [m].
        people: Who is there.
        planes: What stands still.
        begin: Time of the first state [s].
    """
    robot, dt, limits = filter.robot, filter.dt, filter.robot.limits
    plan, off = plan_of(states, dt, robot)
    route = Route(plan, plan)
    path: PacedPath | None = PacedPath(plan, limits)
    state, static = np.array(plan.states[0]), nobody()
    sure, fresh = np.ones(len(people.names), np.bool_), np.zeros(len(people.names))

    def clear(positions: Array) -> bool:
        return path_is_clear(robot, positions, planes, static, _CLEAR)

    def scene_at(k: int) -> Scene:
        after = ends[k + 1] if k + 1 < len(ends) else ends[k]
        human = people.at(ends[k], after, dt)
        return Scene(begin + k * dt, JointState(*state.copy()), human, static, planes, fresh, sure)

    filter.reset(scene_at(0))
    count, at = len(plan), 0
    passed, lateness, made = [state.copy()], np.zeros(count), list[Decision]()
    jerk, nominal = np.empty_like(plan.jerk), np.empty_like(plan.jerk)
    for k in range(count):
        if path is not None:
            at = max(at, route.at(path.ticks, state[0]))
        if path is None or path.astray(state):
            found = rejoin(route, at, state, limits, clear) if at < len(plan) else None
            route, path = (route, None) if found is None else (found, PacedPath(found.plan, limits))
        offered = np.zeros((0, robot.n)) if path is None else path.alternatives(state, np.inf)
        nominal[k] = offered[0] if len(offered) else brake_jerk(JointState(*state), limits, dt)
        if path is not None and len(offered):
            decision = filter.decide(scene_at(k), nominal[k], _FullPace(path))
            nominal[k] = offered[0]  # what is asked for, whichever of the alternatives is taken
        else:
            decision = filter.decide(scene_at(k), nominal[k])
        jerk[k] = decision.jerk
        integrate(state, jerk[k], dt, state)
        passed.append(state.copy())
        done = at if path is None else max(at, route.at(path.ticks, state[0]))
        lateness[k] = (k + 1 - done) * dt
        made.append(_as_seen(decision))
    return Shadowed(Course(np.array(passed), jerk, nominal, made), lateness, off)


def _as_seen(decision: Decision) -> Decision:
    """A slower alternative is admitted untouched, and still not what was asked for."""
    if decision.status == Status.NOMINAL and decision.choice > 0:
        return decision._replace(status=Status.PROJECTED, reason=SLOWED)
    return decision
