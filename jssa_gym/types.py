"""Data that the layers exchange. SI units and radians; nothing here computes.

What is made anew in every control step is a named tuple: immutable like a frozen dataclass and four times cheaper to
make. ``scene._replace(human=...)`` makes a changed copy.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Status(IntEnum):
    """What a decision did with the nominal jerk."""

    NOMINAL = 0
    """The policy's own values, forwarded untouched."""
    PROJECTED = 1
    """The nearest jerk that satisfies box and rows; of the kind ``graded``, that one slowed where room is little."""
    RELAXED = 2
    """Box and rows exclude each other: the least violation inside the box."""
    FAILSAFE = 3
    """A stored, verified stop goes on."""
    FAULT = 4
    """Something failed (action, measurement, solver): the arm brakes; the nominal is never applied."""


class JointState(NamedTuple):
    """State of the triple integrator, Eq. (1)."""

    position: Array
    """Shape (n,) [rad]."""
    velocity: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (n,) [rad/s²]."""


class CapsuleSet(NamedTuple):
    """Capsules with the velocities of their ends; a sphere has equal ends."""

    start: Array
    """Shape (m, 3) [m]."""
    end: Array
    """Shape (m, 3) [m]."""
    start_velocity: Array
    """Shape (m, 3) [m/s]."""
    end_velocity: Array
    """Shape (m, 3) [m/s]."""
    radius: Array
    """Shape (m,) [m]."""
    names: tuple[str, ...]
    """One name a capsule: a body part or a link."""
    person: NDArray[np.int64]
    """Shape (m,): whose body each capsule belongs to; 0 where nobody's."""


class Planes(NamedTuple):
    """Solid half-spaces ``normal · x <= offset``."""

    normal: Array
    """Unit, pointing out of the solid, shape (p, 3)."""
    offset: Array
    """Shape (p,) [m]."""
    names: tuple[str, ...]


class Scene(NamedTuple):
    """What a perception system could know; the only thing a filter sees."""

    time: float
    """[s]."""
    robot: JointState
    """Commanded joint state."""
    human: CapsuleSet
    """The dynamic agents D: everybody's capsules, several people allowed."""
    static: CapsuleSet
    """The static agents O, as capsules."""
    planes: Planes
    """The static agents O, as half-spaces: table or floor."""
    age: Array
    """Age of each human capsule's measurement, shape (m,) [s]."""
    valid: NDArray[np.bool_]
    """Whether each human capsule was measured, shape (m,)."""
    frame_age: float | None = None
    """Age of the newest complete frame [s]: all that was of people inside of a watched region at its moment is in
    ``human``, or was before and has not been measured since. NaN: there is none. None: as old as the oldest capsule
    that was measured, and of now without any. Nobody looks at it unless a region is watched."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPeople:
    """Everybody beside the arm as they were measured, for :meth:`jssa_gym.Guard.tick`.

    Who there is, by names, order and persons, is settled by the first tick, unless a region is watched. A capsule that
    was not measured this time stays in its place, not ``valid``.
    """

    capsules: CapsuleSet
    """m capsules, of all persons together; none for an empty room."""
    age: Array | float
    """How old the measurement is at the tick's stamp [s]: one number, or one a capsule, shape (m,)."""
    valid: NDArray[np.bool_] | None = None
    """Whether each capsule was measured, shape (m,); None for all."""
    frame_age: float | None = None
    """Age of a watched region's newest whole frame, see :class:`Scene` [s]; None: ``age`` if that is one number."""


class HalfSpaces(NamedTuple):
    """Rows :math:`L u \\ge S` of a safety index."""

    L: Array
    """Shape (rows, n) [m²/(rad/s³)]."""
    S: Array
    """Shape (rows,) [m²]."""


Kind = Literal["nominal", "alternative", "projected", "graded", "stop", "fault"]
"""Where an applied jerk comes from: the policy, one of its alternatives, the projection or another correction by the
filter, between what was proposed and braking, the verified stop, a failure."""


class Decision(NamedTuple):
    """A filter's answer to one nominal jerk."""

    jerk: Array
    """What is to be applied, shape (n,) [rad/s³]."""
    nominal: Array
    """What was asked for, shape (n,) [rad/s³]; may be non-finite."""
    status: Status
    reason: str
    """Why the jerk is not the nominal; empty for NOMINAL."""
    phi: float
    """Largest safety index predicted for the end of the step under ``jerk`` [m²]."""
    distance: float
    """Smallest robot-human surface distance predicted for the end of the step [m]; inf without a human."""
    pair: tuple[int, int]
    """Robot and human capsule of that distance; (-1, -1) without a human."""
    slack: float
    """Largest violation of the rows by ``jerk`` [m²]."""
    rows: int
    """Number of rows that reached the projector."""
    margin: float = math.inf
    """Room that the stop behind the nominal leaves to the people [m], below 0 where they could be met; inf where
    nothing would move and without a verified stop, NaN on a fault."""
    kind: Kind = "nominal"
    """What is applied."""
    choice: int = -1
    """Which alternative of the planner's is applied, which ``nominal`` then is; -1 for none."""
    override: float = 1.0
    """Pace along its path that the planner asked for; 1 for its own, and without a path."""


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One episode, a row a control step; row k holds the state after step k and the jerk that led to it.

    It holds all that another judge needs to play the episode again: see :func:`jssa_gym.evaluation.judge`. Its files
    hold the same fields. Annotations say the shape of an array, and how many names there are: T control steps, n
    joints, m human capsules, p planes, g numbers of a goal.
    """

    name: str
    dt: float
    """[s]."""
    robot: str
    """Name of the robot's model."""
    dynamics: str
    """``"kinematic"`` or ``"servo"``; with servos the distances are the simulated arm's, the states the commanded."""
    task: str
    """Name of the task; empty without one."""
    holds: bool
    """Whether the task is to hold a goal, which success never ends."""
    d_min: float
    """Distance below which the environment counts a cost [m]."""
    ended: str
    """``"terminated"``, ``"truncated"``, or ``"running"`` if the recording stopped before the episode did."""
    mount: Annotated[Array, "3"]
    """Where the robot stands [m]."""
    initial_state: Annotated[Array, "3 n"]
    """Position, velocity, acceleration before the first step [rad, rad/s, rad/s²]."""
    initial_human: Annotated[Array, "2 m 3"]
    """Starts and ends of the human capsules before the first step [m]."""
    human_radius: Annotated[Array, "m"]
    """[m]."""
    human_person: Annotated[NDArray[np.int64], "m"]
    """Whose body each human capsule belongs to."""
    human_names: Annotated[tuple[str, ...], "m"]
    """One name a human capsule: its body part."""
    plane_normal: Annotated[Array, "p 3"]
    """Normals of the solid half-spaces, see :class:`Planes`."""
    plane_offset: Annotated[Array, "p"]
    """[m]."""
    plane_names: Annotated[tuple[str, ...], "p"]
    time: Annotated[Array, "T"]
    """[s]."""
    position: Annotated[Array, "T n"]
    """[rad]."""
    velocity: Annotated[Array, "T n"]
    """[rad/s]."""
    acceleration: Annotated[Array, "T n"]
    """[rad/s²]."""
    jerk: Annotated[Array, "T n"]
    """Applied [rad/s³]."""
    nominal: Annotated[Array, "T n"]
    """Asked for by the policy [rad/s³]."""
    goal: Annotated[Array, "T g"]
    """The task's goal [rad or m]; waypoints one after the other."""
    reward: Annotated[Array, "T"]
    success: Annotated[NDArray[np.bool_], "T"]
    """Whether the goal is met."""
    limit_violation: Annotated[NDArray[np.bool_], "T"]
    """Whether a joint limit is exceeded by more than rounding."""
    distance: Annotated[Array, "T"]
    """Smallest robot-human surface distance [m]."""
    speed: Annotated[Array, "T"]
    """Rate of the distance [m/s]."""
    acceleration_of_distance: Annotated[Array, "T"]
    """Second derivative of the distance [m/s²]."""
    pair: Annotated[NDArray[np.int64], "T 2"]
    """Closest robot and human capsule."""
    contact: Annotated[NDArray[np.bool_], "T"]
    contact_speed: Annotated[Array, "T"]
    """Speed of the robot's touching point, 0 without contact [m/s]."""
    status: Annotated[NDArray[np.int64], "T"]
    """NOMINAL without a shield."""
    reason: Annotated[NDArray[np.str_], "T"]
    """Why the shield's jerk is not the nominal; empty strings without a shield."""
    intervened: Annotated[NDArray[np.bool_], "T"]
    correction: Annotated[Array, "T"]
    """Largest change of a joint's jerk by the shield, in jerk bounds; NaN without a shield."""
    phi: Annotated[Array, "T"]
    """[m²]; NaN without a shield."""
    slack: Annotated[Array, "T"]
    """Largest violation of the shield's rows by the jerk [m²]; NaN without a shield."""
    margin: Annotated[Array, "T"]
    """Room that the stop behind the nominal leaves to people [m]; inf where nothing would move, NaN where not told."""
    kind: Annotated[NDArray[np.str_], "T"]
    """Where the applied jerk comes from; empty strings where not told."""
    choice: Annotated[NDArray[np.int64], "T"]
    """Which of a planner's alternatives is applied; -1 for none."""
    override: Annotated[Array, "T"]
    """Pace along its path that the planner asked for; NaN where not told."""
    shield_time: Annotated[Array, "T"]
    """Wall-clock time of the shield's decision [s]; NaN without a shield."""
    human_start: Annotated[Array, "T m 3"]
    """[m]."""
    human_end: Annotated[Array, "T m 3"]
    """[m]."""
