"""Tasks in joint space: hold a position, follow waypoints."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.envs.observation import Feature
from jssa_gym.envs.tasks.task import Moment, Progress, RewardTerm, Task
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.postures import clearances, nearest, room
from jssa_gym.types import Array, Planes
from jssa_gym.validation import check_fields, positive_integer, positive_number, real_array

_SHARE = 0.5
"""Share of the joint limits that the reference between two drawn waypoints may use."""

_LONGEST, _SHORTEST = 0.15, 0.2
"""Longest way of a joint between drawn waypoints as a share of its range; shortest of all, root mean square [rad]."""

_CLEAR = 0.05
"""Distance of the reference from table and self-collision [m]."""


@dataclass(frozen=True, slots=True)
class Home(Task):
    """Hold the home position: the paper's task. It never terminates on success."""

    name: ClassVar[str] = "home"
    human: ClassVar[str] = "approach_retreat"
    text: ClassVar[str] = (
        "Hold the home position (the paper's task). Success, within 0.05 rad (root mean square) for 0.1 s, "
        "never ends it."
    )
    space: ClassVar[Literal["joints", "tip"]] = "joints"
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("posture", -1.0, "root mean square distance of the joints from home [rad]"),
    )
    ends: ClassVar[bool] = False
    tolerance: float = 0.05
    """Root mean square distance from home that counts as there [rad]."""

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        return (Feature("goal", robot.n, _ranges(robot), -1.0, 1.0, "home minus joint position / range"),)

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        return np.array(robot.home)

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        position = real_array("goal", goal, (robot.n,), "a joint position [rad]")
        if not robot.limits.contain(position):
            raise ParameterError(f"the goal has to lie inside the position limits, got {goal!r}")
        return position

    def observe(self, goal: Array, moment: Moment) -> Array:
        return goal - moment.position

    def value(self, goal: Array, moment: Moment) -> float:
        return _root_mean_square(goal - moment.position)

    def reached(self, value: float, moment: Moment) -> bool:
        return value <= self.tolerance


@dataclass(frozen=True, slots=True)
class Track(Task):
    r"""Follow joint waypoints :math:`w_1 \dots w_K`, one every ``period`` seconds.

    The reference moves from one waypoint to the next, and to the first from where the episode begins, at rest at
    both ends, with the least jerk: :math:`r = w_k + (10 x^3 - 15 x^4 + 6 x^5)(w_{k+1} - w_k)` with the elapsed share
    :math:`x` of the period. Its clock stands still while the waypoint that is due was not visited, so that an arm
    that a shield held up loses time and nothing else: no error jumps, and success stays possible. That time is
    ``info["track/lateness"]``.

    Raises:
        ParameterError: A parameter is not positive.
    """

    name: ClassVar[str] = "track"
    human: ClassVar[str] = "constant_velocity"
    text: ClassVar[str] = (
        "Follow joint waypoints, one every period (1.5 s), in their order. The reference waits for an arm that is "
        "late. Success: all visited within 0.05 rad (root mean square) and, when the reference is at its end, there "
        "at rest (0.05 rad, 0.05 rad/s) for 0.1 s. info: track/visited, track/lateness [s], track/error [rad]."
    )
    space: ClassVar[Literal["joints", "tip"]] = "joints"
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("track", -1.0, "root mean square distance of the joints from the reference [rad]"),
        RewardTerm("success", 10.0, "1 on success, else 0"),
    )
    evolves: ClassVar[bool] = True
    period: float = 1.5
    """Time from one waypoint to the next [s]."""
    count: int = 4
    """Number of waypoints that are drawn; 4 leave 2 of an episode's 8 s for being late."""
    tolerance: float = 0.05
    """Root mean square distance that counts as there [rad]."""
    speed: float = 0.05
    """Root mean square joint speed that counts as rest [rad/s]."""

    def __post_init__(self) -> None:
        check_fields(self, ("period", "tolerance", "speed"), positive_number)
        check_fields(self, ("count",), positive_integer)

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        ranges = _ranges(robot)
        return (
            Feature("goal", robot.n, ranges, -1.0, 1.0, "next waypoint minus joint position / range"),
            Feature("reference", robot.n, ranges, -1.0, 1.0, "reference minus joint position / range"),
            Feature("due", 1, (self.period,), 0.0, 2.0, "time until the next waypoint is due / period"),
            Feature("visited", 1, (1.0,), 0.0, 1.0, "share of the waypoints visited"),
        )

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        """Waypoints shape (count, n) [rad], the first within a period of home, with ways in between that are clear of
        table and arm and use up to half of the joint limits.
        """
        waypoints = [np.array(robot.home)]
        for _ in range(self.count):
            waypoints.append(self._draw_next(rng, robot, planes, waypoints[-1]))
        return np.array(waypoints[1:])

    def _draw_next(self, rng: np.random.Generator, robot: RobotModel, planes: Planes, last: Array) -> Array:
        limits, T = robot.limits, self.period
        low, high = limits.position.T
        # peaks of the reference over a way d: velocity 1.875 d/T, acceleration 5.774 d/T², jerk 60 d/T³
        fastest = np.min(
            [limits.velocity * T / 1.875, limits.acceleration * T**2 / 5.774, limits.jerk * T**3 / 60.0], 0
        )
        longest = np.minimum(_SHARE * fastest, _LONGEST * (high - low))
        margin = 0.05 * (high - low)
        off_planes, off_itself = room(robot, planes, (_CLEAR, _CLEAR))
        for _ in range(1000):
            way = (
                rng.uniform(np.maximum(low + margin, last - longest), np.minimum(high - margin, last + longest)) - last
            )
            if _root_mean_square(way) < min(_SHORTEST, 0.5 * _root_mean_square(longest)):
                continue
            on_the_way = (clearances(robot, last + x * way, planes) for x in np.linspace(1.0, 0.0, 10, False))
            if all(from_planes > off_planes and from_itself > off_itself for from_planes, from_itself in on_the_way):
                return last + way
        raise ParameterError(
            f"found no waypoint for {robot.name} that is clear of table and arm; at {np.round(last, 3).tolist()} "
            f"{nearest(robot, last, planes)}"
        )

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        try:  # how many they are is up to the user
            count = len(np.asarray(goal, dtype=np.float64))
        except (ValueError, TypeError):
            count = 0
        shape = (max(count, 1), robot.n)
        waypoints = real_array("goal", goal, shape, f"waypoints (K, {robot.n}) [rad], K at least 1")
        if not robot.limits.contain(waypoints):
            raise ParameterError(f"the waypoints of goal have to lie inside the position limits, got {goal!r}")
        return waypoints

    def reference(self, goal: Array, progress: Progress) -> Array:
        """Where the arm is to be, shape (n,) [rad]."""
        leg = min(int(progress.clock / self.period), len(goal) - 1)
        x = min(progress.clock / self.period - leg, 1.0)
        begin = goal[leg - 1] if leg else goal[0] if progress.start is None else progress.start
        return begin + x**3 * (10.0 - 15.0 * x + 6.0 * x**2) * (goal[leg] - begin)

    def advance(self, goal: Array, moment: Moment, velocity: Array, dt: float) -> Progress:
        start, visited, clock, lateness, *_ = moment.progress
        if visited < len(goal) and _root_mean_square(goal[visited] - moment.position) <= self.tolerance:
            visited += 1
        now = min(clock + dt, self._due(visited, len(goal)))
        if visited < len(goal):
            lateness += max(clock + dt - now, 0.0)
        arrived = (
            visited == len(goal) and now >= self._due(visited, len(goal)) and _root_mean_square(velocity) <= self.speed
        )
        return Progress(start, visited, now, lateness, arrived)

    def _due(self, visited: int, count: int) -> float:
        """When the next waypoint is due, or the last was [s]."""
        return min(visited + 1, count) * self.period

    def desired(self, goal: Array, progress: Progress) -> Array:
        return goal[min(progress.visited, len(goal) - 1)]

    def observe(self, goal: Array, moment: Moment) -> Array:
        progress, count = moment.progress, len(goal)
        following = self.desired(goal, progress)
        due = self._due(progress.visited, count) - progress.clock
        reference = self.reference(goal, progress)
        return np.concatenate(
            [following - moment.position, reference - moment.position, (due, progress.visited / count)]
        )

    def value(self, goal: Array, moment: Moment) -> float:
        return _root_mean_square(self.reference(goal, moment.progress) - moment.position)

    def reached(self, value: float, moment: Moment) -> bool:
        return moment.progress.arrived and value <= self.tolerance

    def metrics(self, value: float, moment: Moment) -> dict[str, Any]:
        progress = moment.progress
        return {"track/visited": progress.visited, "track/lateness": progress.lateness, "track/error": value}


def _ranges(robot: RobotModel) -> tuple[float, ...]:
    return tuple((robot.limits.position[:, 1] - robot.limits.position[:, 0]).tolist())


def _root_mean_square(gap: Array) -> float:
    return math.sqrt(gap.dot(gap) / len(gap))
