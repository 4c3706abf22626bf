"""A motion beside people as an episode's trace, so that it is measured as every other episode is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.surroundings import Surroundings
from jssa_gym.kernels.motion import violates
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, CapsuleSet, Decision, Planes, Status, Trace

_ROUNDING = 1e-9
"""Share of a limit that rounding may cost, as in the environment."""

_CORRECTED = 1e-6
"""Change of a joint's jerk from which a step counts as an intervention, in jerk bounds, as in the shield."""

D_MIN = 0.05
"""Distance below which a cost is counted [m], the environment's default."""


class Bystanders(NamedTuple):
    """Who is there."""

    names: tuple[str, ...]
    """Of the capsules."""
    radius: Array
    """Shape (m,) [m]."""
    person: NDArray[np.int64]
    """Shape (m,)."""

    def at(self, ends: Array, after: Array, dt: float) -> CapsuleSet:
        """Capsules at a moment.

        Args:
            ends: Starts and ends, shape (2, m, 3) [m].
            after: The same a step later.
            dt: Step [s].
        """
        velocity = (after - ends) / dt
        return CapsuleSet(ends[0], ends[1], velocity[0], velocity[1], self.radius, self.names, self.person)


class Course(NamedTuple):
    """A motion of T steps."""

    states: Array
    """Shape (T + 1, 3, n)."""
    jerk: Array
    """Shape (T, n) [rad/s³]."""
    nominal: Array
    """What was asked for, shape (T, n) [rad/s³]."""
    decisions: list[Decision] | None = None
    """Of a shield."""


def traced(
    name: str, robot: RobotModel, dt: float, planes: Planes, people: Bystanders, ends: Array, of: Course
) -> Trace:
    """The trace of a course.

    Args:
        name: Of the trace.
        robot: Where it stands.
        dt: Control step [s].
        planes: What stands still.
        people: Who is there.
        ends: Of everybody's capsules, shape (T + 1, 2, m, 3) [m].
        of: The course.
    """
    count, around, bounds = len(of.jerk), Surroundings(robot, len(people.names)), robot.limits.bounds()
    seen = {
        "distance": np.empty(count),
        "speed": np.empty(count),
        "acceleration_of_distance": np.empty(count),
        "pair": np.empty((count, 2), np.int64),
        "contact_speed": np.empty(count),
        "limit_violation": np.zeros(count, np.bool_),
    }
    for k in range(count):
        # the last moment's velocities are those of the way to it
        later = ends[k + 2] if k + 2 < len(ends) else 2.0 * ends[k + 1] - ends[k]
        around.take(people.at(ends[k + 1], later, dt))
        around.look(np.ascontiguousarray(of.states[k + 1]))
        closest = around.closest
        seen["distance"][k], seen["speed"][k] = closest.distance, closest.rate
        seen["acceleration_of_distance"][k], seen["pair"][k] = closest.curvature, (closest.robot, closest.human)
        seen["contact_speed"][k] = closest.contact_speed
        seen["limit_violation"][k] = violates(of.states[k + 1], of.jerk[k], bounds, _ROUNDING)
    told = _told(of, robot)
    return Trace(
        name=name,
        dt=dt,
        robot=robot.name,
        dynamics="kinematic",
        task="",
        holds=False,
        d_min=D_MIN,
        ended="truncated",
        mount=np.array(robot.mount),
        initial_state=np.array(of.states[0]),
        initial_human=np.array(ends[0]),
        human_radius=people.radius,
        human_person=people.person,
        human_names=people.names,
        plane_normal=planes.normal,
        plane_offset=planes.offset,
        plane_names=planes.names,
        time=dt * np.arange(1, count + 1),
        position=of.states[1:, 0].copy(),
        velocity=of.states[1:, 1].copy(),
        acceleration=of.states[1:, 2].copy(),
        jerk=of.jerk,
        nominal=of.nominal,
        goal=np.zeros((count, 0)),
        reward=np.zeros(count),
        success=np.zeros(count, np.bool_),
        contact=seen["distance"] <= 0.0,
        human_start=ends[1:, 0].copy(),
        human_end=ends[1:, 1].copy(),
        shield_time=np.full(count, np.nan),
        **seen,
        **told,
    )


def _told(of: Course, robot: RobotModel) -> dict[str, Array | NDArray]:
    """What a shield said, or as where there is none."""
    count, unknown = len(of.jerk), np.full(len(of.jerk), np.nan)
    if of.decisions is None:
        return {
            "status": np.zeros(count, np.int64),
            "reason": np.full(count, ""),
            "intervened": np.zeros(count, np.bool_),
            "correction": unknown,
            "phi": unknown,
            "slack": unknown,
            "margin": unknown,
            "kind": np.full(count, ""),
            "choice": np.full(count, -1),
            "override": unknown,
        }
    with np.errstate(invalid="ignore"):
        correction = (np.abs(of.jerk - of.nominal) / robot.limits.jerk).max(axis=1)
    made = of.decisions
    return {
        "status": np.array([int(one.status) for one in made], np.int64),
        "reason": np.array([one.reason for one in made], np.str_),
        # slowed along its path is not as asked for, whatever the jerk
        "intervened": (~(correction <= _CORRECTED))
        | np.array([one.status != Status.NOMINAL for one in made], np.bool_),
        "correction": correction,
        "phi": np.array([one.phi for one in made], np.float64),
        "slack": np.array([one.slack for one in made], np.float64),
        "margin": np.array([one.margin for one in made], np.float64),
        "kind": np.array([one.kind for one in made], np.str_),
        "choice": np.array([one.choice for one in made], np.int64),
        "override": np.array([one.override for one in made], np.float64),
    }
