"""Joints as the controller counts them, and what it lets them do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.robots.lr_mate_200id_7l import STREAM_ACCELERATION_DEG, STREAM_JERK_DEG, VELOCITY_DEG
from jssa_gym.types import Array
from jssa_gym.validation import real_array

WIRE = 9
"""Axes of a packet."""


@dataclass(frozen=True)
class Axes:
    """How the controller's degrees belong to the model's radians: ``degrees = sign · model + offset``, joint by joint.

    What is right for a cell nobody but the arm can say: jog every joint alone and compare, before anything is streamed.

    Raises:
        ParameterError: A sign is not 1 or -1, or the numbers of signs and offsets differ.
    """

    sign: tuple[float, ...] = (1.0,) * 6
    offset: tuple[float, ...] = (0.0,) * 6
    """[deg]."""

    def __post_init__(self) -> None:
        sign = real_array("sign", self.sign, (len(self.sign),), "one sign a joint")
        real_array("offset", self.offset, sign.shape, "one angle a joint [deg]")
        if not 0 < len(sign) <= WIRE or np.any(np.abs(sign) != 1.0):
            raise ParameterError(f"sign has to be 1 or -1 for each of up to {WIRE} joints, got {self.sign!r}")

    def to_degrees(self, position: Array) -> list[float]:
        """A joint position, shape (n,) [rad], as a packet has it: nine numbers [deg]."""
        degrees = np.degrees(position) * self.sign + self.offset
        return [*degrees.tolist(), *(0.0,) * (WIRE - len(degrees))]

    def to_radians(self, degrees: list[float]) -> Array:
        """The joint position of a packet, shape (n,) [rad]."""
        n = len(self.sign)
        return np.radians((np.array(degrees[:n]) - self.offset) * self.sign)


@dataclass(frozen=True)
class Tables:
    """What a controller accepts of a stream, one number a joint; beyond that it stops the arm with an alarm."""

    velocity: tuple[float, ...]
    """[deg/s]."""
    acceleration: tuple[float, ...]
    """[deg/s²]."""
    jerk: tuple[float, ...]
    """[deg/s³]."""

    def excess(self, robot: RobotModel) -> str:
        """Which limits of an arm are above the tables, or nothing."""
        found = []
        for name in ("velocity", "acceleration", "jerk"):
            table, limit = np.array(getattr(self, name)), np.degrees(getattr(robot.limits, name))
            if table.shape != limit.shape:
                return f"they are for {len(table)} joints, {robot.name} has {len(limit)}"
            over: NDArray[np.intp] = np.flatnonzero(limit > table * (1.0 + 1e-9))
            found += [f"{robot.joint_names[j]}: {name} {limit[j]:.5g} over {table[j]:.5g}" for j in over]
        return ", ".join(found)


LR_MATE = Tables(VELOCITY_DEG, STREAM_ACCELERATION_DEG, STREAM_JERK_DEG)
"""Tables of the LR Mate 200iD/7L, as in ``lr_mate_200id_7l("stream")``: its second set of limits beside the paper's."""
