"""The simulated arm among the people: what one kernel call a step measures, and the buffers it writes to."""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.motion import violates
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, SEGMENT, records
from jssa_gym.kernels.tick import tick
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import TRUTH, records_for
from jssa_gym.types import Array, CapsuleSet

_LIMIT_TOLERANCE = 1e-9
"""Share of a limit by which it may be exceeded before ``limit_violation`` says so: rounding."""

OVER_POSITION = 2e-3
"""By how much a servoed joint may swing over its range before ``limit_violation`` says so [rad]."""

OVER_VELOCITY = 0.02
"""Share of its velocity limit by which it may be faster; its acceleration rings and has no bound."""


class Closest(NamedTuple):
    """Truth about the closest robot-human pair after a step."""

    distance: float
    """Signed surface distance [m]; inf without a human."""
    rate: float
    """[m/s]."""
    curvature: float
    """Second derivative [m/s²], the human at constant velocity, the points' sliding along the axes included."""
    robot: int
    """Robot capsule, -1 without a human."""
    human: int
    """Human capsule, -1 without a human."""
    contact_speed: float
    """Largest speed of a touching point of the robot [m/s]; 0 without contact."""


class Surroundings:
    """Truth about an arm and the people around it.

    Args:
        robot: The arm, where it stands.
        parts: Capsules of each person.
    """

    def __init__(self, robot: RobotModel, parts: int) -> None:
        limits, count = robot.limits, len(robot.capsules)
        self._robot = robot
        self._bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
        (low, high), zero = limits.position.T, np.zeros(robot.n)
        swung = (low - OVER_POSITION, high + OVER_POSITION, (1.0 + OVER_VELOCITY) * limits.velocity)
        self._servo_bounds, self._zero = np.array([*swung, np.full(robot.n, np.inf), limits.jerk]), zero
        self._parameters = TRUTH.array()
        self._frames, self._segments = records(robot.n, FRAME), records(count, SEGMENT)
        self._agents, self._pairs = records(0, AGENT), records((count, 0), PAIR)
        self._pair = (-1, -1)
        self.near = np.zeros(13)
        """Of the closest pair; see :func:`~jssa_gym.kernels.tick.tick`."""
        self.parts = np.zeros(max(parts, 1))
        """Smallest distance to each of a person's capsules [m]."""
        self.tip = np.zeros((2, 3))
        """Position [m] and velocity [m/s] of the tool centre point."""
        self.tip_speed = 0.0
        """[m/s]."""

    def take(self, people: CapsuleSet) -> None:
        """Who is there from now on."""
        self._people = people
        self._agents = records_for(people, self._agents)
        if self._pairs.shape[1] != len(self._agents):
            self._pairs = records((len(self._segments), len(self._agents)), PAIR)

    def move(self, before: Array, jerk: Array, dt: float) -> tuple[Array, float, float, bool]:
        """Move a joint state on and measure the arm against the people as they are now.

        Args:
            before: Rows position, velocity, acceleration, shape (3, n).
            jerk: Shape (n,) [rad/s³].
            dt: For how long [s].

        Returns:
            The joint state after ``dt``, shape (3, n), the smallest distance [m], the largest speed of a touching
            point [m/s], and whether state or jerk exceeds a limit.
        """
        robot, people, after = self._robot, self._people, np.empty_like(before)
        row, column, distance, contact_speed, self.tip_speed, violation = tick(
            robot.links,
            robot.capsules,
            robot.tool_link,
            robot.tool_offset,
            before,
            jerk,
            dt,
            self._bounds,
            _LIMIT_TOLERANCE,
            people.start,
            people.end,
            people.start_velocity,
            people.end_velocity,
            people.radius,
            self._parameters,
            after,
            self._agents,
            self._frames,
            self._segments,
            self._pairs,
            self.near,
            self.parts,
            self.tip,
        )
        self._pair = (row, column)
        return after, distance, contact_speed, violation

    def look(self, state: Array) -> tuple[float, float, bool]:
        """Measure an arm that servos have moved, shape (3, n), against the people as they are now.

        Returns:
            Smallest distance [m], largest speed of a touching point [m/s], and whether position or velocity exceeds its
            limit by more than :data:`OVER_POSITION` or :data:`OVER_VELOCITY`.
        """
        _, distance, contact_speed, _ = self.move(state, self._zero, 0.0)
        return distance, contact_speed, violates(state, self._zero, self._servo_bounds, 0.0)

    @property
    def closest(self) -> Closest:
        """The closest robot-human pair."""
        near, (row, column) = self.near, self._pair
        return Closest(float(near[0]), float(near[1]), float(near[2]), row, column, float(near[3]))

    @property
    def line(self) -> tuple[Array, Array] | None:
        """Points of the closest pair, shape (3,) [m] each; None without a human."""
        near = self.near
        return (near[7:10] - near[4:7], near[7:10]) if self._pair[0] >= 0 else None

    @property
    def robot_capsules(self) -> CapsuleSet:
        """The arm's capsules in the world, with velocities; copies."""
        segments = self._segments
        return CapsuleSet(
            segments["start"].copy(),
            segments["end"].copy(),
            segments["start_velocity"].copy(),
            segments["end_velocity"].copy(),
            segments["radius"].copy(),
            self._robot.capsule_names,
            np.zeros(len(segments), np.int64),
        )
