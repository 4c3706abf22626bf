"""Robot capsules against human capsules at the present: distances, and what the jerks do to them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.derivatives import derivatives
from jssa_gym.kernels.index import index_values
from jssa_gym.kernels.records import FRAME, PAIR, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array

Rows = Literal["closest", "all"]
"""Which pairs a filter answers."""
ROWS = ("closest", "all")

_NO_INDEX = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0])
"""Parameters of none: each filter has its own, and only the sliding term, left out here, would matter to the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All pairs, robot capsule by robot capsule: p = m k."""

    motion: Array
    r""":math:`D, \dot D, \ddot D` and :math:`\dddot D` at zero joint jerk, shape (p, 4) [m, m/s, m/s², m/s³]."""
    rows: Array
    r""":math:`n^\top J`: what a joint jerk adds to :math:`\dddot D`, shape (p, n) [m/rad]."""
    normals: Array
    """Unit, from the person to the robot, shape (p, 3)."""
    pair: tuple[int, int]
    """Robot and human capsule that are closest; (-1, -1) without people."""
    closest: int
    """Number of that pair; -1 without people."""
    distance: float
    """Distance of that pair [m]; inf without people."""

    def index(self, d_min: float, lambda1: float, lambda2: float) -> Array:
        r""":math:`\phi` of Eq. (6) of every pair, shape (p,) [m²]."""
        parameters = _NO_INDEX.copy()
        parameters[:3] = d_min, lambda1, lambda2
        out = np.empty(len(self.motion))
        index_values(self.motion, parameters, out)
        return out


def measure_pairs(robot: RobotModel, state: Array, people: NDArray) -> Pairs:
    """Measure all pairs.

    Args:
        robot: The arm, where it stands.
        state: Joint state, shape (3, n).
        people: Shape (k,) of ``AGENT``.
    """
    m, n = len(robot.capsules), robot.n
    p = m * len(people)
    motion, rows, normals = np.zeros((p, 4)), np.zeros((p, n)), np.zeros((p, 3))
    row, column, distance = derivatives(
        robot.links,
        robot.capsules,
        state,
        people,
        _NO_INDEX,
        records(n, FRAME),
        records(m, SEGMENT),
        records((m, len(people)), PAIR),
        motion,
        rows,
        normals,
    )
    number = row * len(people) + column if row >= 0 else -1
    return Pairs(motion, rows, normals, (row, column), number, distance)
