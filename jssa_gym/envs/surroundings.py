"""The simulated arm among the people: what one kernel call a step measures, and the buffers it writes to."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.humans import nobody
from jssa_gym.kernels.motion import violates
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import TRUTH, check_capsules
from jssa_gym.tick.move import MeasuredArm, People, Seen, move
from jssa_gym.tick.structs import pointer_to
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
        limits, zero = robot.limits, np.zeros(robot.n)
        self._robot, self._zero = robot, zero
        self._servo_bounds = over = limits.bounds()
        over[0] -= OVER_POSITION
        over[1] += OVER_POSITION
        over[2] *= 1.0 + OVER_VELOCITY
        over[3] = np.inf
        self._body = MeasuredArm(
            # copies: to kernels arrays for reading alone are of another type, and those of a copy are none
            np.array(robot.links),
            np.array(robot.capsules),
            int(robot.tool_link),
            np.array(robot.tool_offset),
            limits.bounds(),
            _LIMIT_TOLERANCE,
            TRUTH.kernel(),
        )
        self._pair, self._parts = (-1, -1), max(parts, 1)
        self._make_room(0)
        self.tip_speed = 0.0
        """Speed of the tool centre point [m/s]."""

    def _make_room(self, people: int) -> None:
        n, m = self._robot.n, len(self._robot.capsules)
        self.seen = Seen(
            np.zeros(13),
            np.zeros(self._parts),
            np.zeros((2, 3)),
            records(people, AGENT),
            records(n, FRAME),
            records(m, SEGMENT),
            records((m, people), PAIR),
        )
        """What was measured last."""
        self._pointers: tuple[Any, Any] | None = None

    @property
    def pointers(self) -> tuple[Any, Any]:
        """Pointers to the arm and to what is seen, for kernels; made anew where a copy needs them first."""
        if self._pointers is None:
            self._pointers = pointer_to(self._body), pointer_to(self.seen)
        return self._pointers

    def __getstate__(self) -> dict[str, Any]:
        """Without the pointers, which are none elsewhere."""
        return {**self.__dict__, "_pointers": None}

    @property
    def tip(self) -> Array:
        """Position [m] and velocity [m/s] of the tool centre point, shape (2, 3)."""
        return self.seen.tip

    def take(self, people: CapsuleSet) -> None:
        """Who is there from now on."""
        check_capsules(people)
        self._people = People(*people[:5])
        if len(people.radius) != len(self.seen.agents):
            self._make_room(len(people.radius))

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
        after, (body, seen) = np.empty_like(before), self.pointers
        row, column, distance, contact_speed, self.tip_speed, violation = move(
            body, self._people, before, jerk, dt, after, seen
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
        near, (row, column) = self.seen.near, self._pair
        return Closest(float(near[0]), float(near[1]), float(near[2]), row, column, float(near[3]))

    @property
    def line(self) -> tuple[Array, Array] | None:
        """Points of the closest pair, shape (3,) [m] each; None without a human."""
        near = self.seen.near
        return (near[7:10] - near[4:7], near[7:10]) if self._pair[0] >= 0 else None

    @property
    def touching(self) -> Array | None:
        """Where the closest pair touches, shape (3,) [m]; None where nothing does."""
        (row, column), line = self._pair, self.line
        if line is None or self.closest.distance > 0.0:
            return None
        own, theirs = self.seen.segments["radius"][row], self._people.radius[column]
        return line[0] + own / (own + theirs) * (line[1] - line[0])

    @property
    def robot_capsules(self) -> CapsuleSet:
        """The arm's capsules in the world, with velocities; copies."""
        return capsules_of(self.seen.segments, self._robot.capsule_names)


def capsules_of(segments: NDArray[Any], names: tuple[str, ...]) -> CapsuleSet:
    """An arm's capsules in the world, with velocities, from records of ``SEGMENT``; copies."""
    ends = (segments[field].copy() for field in CapsuleSet._fields[:5])
    return CapsuleSet(*ends, names, np.zeros(len(segments), np.int64))


def posed(robot: RobotModel, position: Array, people: CapsuleSet | None = None) -> Surroundings:
    """An arm at rest at a joint position, shape (n,) [rad], measured against people; for pictures."""
    people = nobody() if people is None else people
    made = Surroundings(robot, max(len(people.radius), 1))
    made.take(people)
    made.look(np.vstack([position, np.zeros((2, robot.n))]))
    return made
