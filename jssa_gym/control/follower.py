"""From commands in units to jerk, in every tick of a controller: nothing is allocated, nothing is raised."""

from typing import Any

import numpy as np

from jssa_gym.control.commands import (
    TIP_SPEED,
    JointJerk,
    JointPosition,
    JointVelocity,
    TipVelocity,
    ToolPose,
    Twist,
)
from jssa_gym.kernels import cascade
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array
from jssa_gym.validation import positive_number, positive_share

STIFFNESS, STIFFEST = 30.0, 0.24
"""Poles of the loops that follow a command [1/s]; on coarse grids no more than this over the tick."""

TURN_SPEED = 1.5
"""Speed at which a tool turns towards a commanded pose [rad/s]."""

TIP_BRAKING, TURN_BRAKING = 1.0, 3.0
"""Deceleration that a tool counts on before a commanded pose [m/s², rad/s²]."""

DAMPING = 0.05
"""Damping of the resolved rates [m]."""

_FLOAT64 = np.dtype(np.float64)


class Follower:
    r"""The jerk that follows a command, by nested loops of velocity and acceleration (:mod:`jssa_gym.kernels.cascade`).

    All three poles are at -30/s, or at 0.24 over the tick where that is slower: :math:`k_a = 3\omega`,
    :math:`k_v = \omega`, :math:`k_p = \omega/3`. What it commands may break limits and meet people: it is a nominal.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        speed_share: Share of the velocity and acceleration limits that is used, in (0, 1].

    Raises:
        ParameterError: ``dt`` is not positive or the share out of range.
    """

    def __init__(self, robot: RobotModel, dt: float, speed_share: float = 1.0) -> None:
        self._dt, self._share = positive_number("dt", dt), positive_share("speed_share", speed_share)
        omega = min(STIFFNESS, STIFFEST / self._dt)
        self._gains = omega / 3.0, omega, 3.0 * omega
        n = robot.n
        # copies, as constants of a robot are read-only and so of another type to kernels
        self._bounds, self._links = robot.limits.bounds(), np.array(robot.links)
        self._tool_link, self._tool_offset = robot.tool_link, np.array(robot.tool_offset)
        self._step = self._bounds[2] * self._dt
        self._fastest = self._share * self._bounds[2]
        self._target, self._last, self._scratch = np.zeros((3, n)), np.zeros(n), np.zeros(n)
        self._streams = False
        self._frames, self._tool, self._J = records(n, FRAME), np.zeros((2, 3)), np.zeros((6, n))
        self._twist, self._way, self._place, self._pose = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros((3, 3))
        self._still, self._square, self._small = np.zeros(n), np.zeros((6, 6)), np.zeros((3, 3))
        self._most = np.array([TIP_SPEED, TIP_BRAKING, TURN_SPEED, TURN_BRAKING])

    def forget(self) -> None:
        """The next position is the first of its stream."""
        self._streams = False

    def jerk(self, command: Any, state: Array, out: Array) -> str:
        """The jerk that follows a command, into ``out`` (n,) [rad/s³]; NaN where there is none.

        Args:
            command: A :data:`~jssa_gym.control.commands.Command`; whatever else it is is told.
            state: Rows position, velocity, acceleration, shape (3, n), contiguous.
            out: Result.

        Returns:
            What is wrong with the command; empty if nothing is.
        """
        streamed, self._streams = self._streams, False
        try:
            wrong = self._follow(command, state, streamed, out)
        except Exception as error:  # whatever a controller delivers, the arm must go on safely
            wrong = _words(error)
        if wrong:
            self._streams = False
            out.fill(np.nan)
        return wrong

    def _follow(self, command: Any, state: Array, streamed: bool, out: Array) -> str:
        kind = type(command)
        if kind is JointJerk:
            _take("jerk", command.jerk, out)
            return "" if cascade.is_finite(out) else "the command is not finite"
        if kind is JointPosition:
            return self._to_position(command, state, streamed, out)
        if kind is JointVelocity:
            wanted = self._target[1]
            _take("velocity", command.velocity, wanted)
        elif kind in (TipVelocity, Twist, ToolPose):
            wanted = self._target[1]
            self._resolve(command, kind, state, wanted)
        elif command is None:
            return "there is no command"
        else:
            kinds = "JointJerk, JointVelocity, JointPosition, TipVelocity, Twist or ToolPose"
            return f"a command is a {kinds}, got {kind.__name__}"
        if not cascade.is_finite(wanted):
            return "the command is not finite"
        cascade.lead(state, wanted, self._still, self._bounds, self._share, self._gains, out)
        return ""

    def _to_position(self, command: JointPosition, state: Array, streamed: bool, out: Array) -> str:
        position, velocity, acceleration = self._target
        _take("position", command.position, position)
        if command.velocity is not None:
            _take("velocity", command.velocity, velocity)
        elif streamed:
            np.subtract(position, self._last, out=velocity)
            if cascade.exceeds(velocity, self._step):
                velocity.fill(0.0)
            velocity /= self._dt
        else:
            velocity.fill(0.0)
        if command.acceleration is None:
            acceleration.fill(0.0)
        else:
            _take("acceleration", command.acceleration, acceleration)
        if not (cascade.is_finite(position) and cascade.is_finite(velocity) and cascade.is_finite(acceleration)):
            return "the command is not finite"
        self._last[:] = position
        self._streams = True
        cascade.lead_to_position(
            state,
            position,
            velocity,
            acceleration,
            self._dt,
            self._bounds,
            self._share,
            self._gains,
            self._scratch,
            out,
        )
        return ""

    def _resolve(self, command: Any, kind: type, state: Array, out: Array) -> None:
        """Joint velocities for a motion of the tool."""
        twist, J, square = self._twist, self._J, self._square
        cascade.look(self._links, self._tool_link, self._tool_offset, state, self._frames, self._tool, J)
        if kind is TipVelocity:
            twist, J, square = twist[:3], J[:3], self._small
            _take("velocity", command.velocity, twist)
        elif kind is Twist:
            _take("linear", command.linear, twist[:3])
            _take("angular", command.angular, twist[3:])
        else:
            _take("position", command.position, self._place)
            _take("rotation", command.rotation, self._pose)
            if not cascade.turns(self._pose):
                raise ValueError("its rotation is no rotation matrix")
            frame, kp = self._frames[-1], self._gains[0]
            cascade.lead_to_pose(frame, self._tool, self._place, self._pose, kp, self._most, self._way, twist)
        cascade.resolve(J, twist, DAMPING, self._fastest, square, out)


def _take(name: str, values: Any, out: Array) -> None:
    """Take down an array, of ``out``'s shape; raises ValueError or TypeError where it is something else."""
    if type(values) is not np.ndarray or values.dtype is not _FLOAT64:
        if isinstance(values, np.ma.MaskedArray):
            raise ValueError(f"its {name} is masked")
        values = np.asarray(values)
        if values.dtype.kind not in "fiu":
            raise ValueError(f"its {name} is no array of real numbers")
    if values.shape != out.shape:
        raise ValueError(f"its {name} has shape {values.shape}, expected {out.shape}")
    out[:] = values


def _words(error: Exception) -> str:
    try:
        return f"the command cannot be read: {error}"
    except Exception:
        return "the command cannot be read"
