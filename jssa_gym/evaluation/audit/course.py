"""A motion beside people as an episode's trace, so that it is measured as every other episode is."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.surroundings import Surroundings
from jssa_gym.evaluation.trace import LATER, TASKLESS, TASKLESS_STEP, WITHOUT_SHIELD, beginning, trace_of
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
    """Names of the capsules."""
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
    """Decisions of a shield."""


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
    around, bounds = Surroundings(robot, len(people.names)), robot.limits.bounds()
    once = {
        **TASKLESS,
        **beginning(robot, of.states[0], people.at(ends[0], ends[0], dt), planes),
        "name": name,
        "dt": dt,
        "d_min": D_MIN,
        "ended": "truncated",
    }
    rows = []
    for k, (jerk, nominal) in enumerate(zip(of.jerk, of.nominal, strict=True)):
        state = np.ascontiguousarray(of.states[k + 1])
        # the last moment's velocities are those of the way to it
        later = ends[k + 2] if k + 2 < len(ends) else 2.0 * ends[k + 1] - ends[k]
        around.take(people.at(ends[k + 1], later, dt))
        around.look(state)
        closest = around.closest
        rows.append(
            {
                **TASKLESS_STEP,
                "time": dt * (k + 1),
                "position": state[0],
                "velocity": state[1],
                "acceleration": state[2],
                "jerk": jerk,
                "nominal": nominal,
                "limit_violation": violates(state, jerk, bounds, _ROUNDING),
                "distance": closest.distance,
                "speed": closest.rate,
                "acceleration_of_distance": closest.curvature,
                "pair": (closest.robot, closest.human),
                "contact": closest.distance <= 0.0,
                "contact_speed": closest.contact_speed,
                "human_start": ends[k + 1, 0],
                "human_end": ends[k + 1, 1],
                **(WITHOUT_SHIELD if of.decisions is None else _told(of.decisions[k], jerk, nominal, robot)),
            }
        )
    return trace_of(once, rows)


def _told(decision: Decision, jerk: Array, nominal: Array, robot: RobotModel) -> dict[str, Any]:
    """What a shield said."""
    with np.errstate(invalid="ignore"):
        correction = float((np.abs(jerk - nominal) / robot.limits.jerk).max())
    return {
        "status": int(decision.status),
        "reason": decision.reason,
        # slowed along its path is not as asked for, whatever the jerk
        "intervened": not correction <= _CORRECTED or decision.status != Status.NOMINAL,
        "correction": correction,
        **{name: getattr(decision, name) for name in ("phi", "slack", *LATER)},
    }
