"""Memory layout of what the kernels read and write: one structured-array record per link, capsule or pair.

Arrays of records cost one argument each, and their type does not depend on the number of joints, so that
one compiled kernel serves every robot. All lengths in metres, angles in radians, times in seconds.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_V = (np.float64, 3)

LINK = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),  # of the joint frame in the previous link frame, at q = 0
        ("offset", *_V),  # of the joint frame's origin in the previous link frame
        ("axis", *_V),  # unit, in the joint frame
    ],
    align=True,
)
"""Constant geometry of one joint and the link behind it."""

CAPSULE = np.dtype([("start", *_V), ("end", *_V), ("radius", np.float64), ("link", np.int64)], align=True)
"""A capsule fixed to a link, in that link's frame."""

AGENT = np.dtype(
    [
        ("start", *_V),
        ("end", *_V),
        ("start_velocity", *_V),
        ("end_velocity", *_V),
        ("radius", np.float64),
    ],
    align=True,
)
"""A moving capsule of the environment, in world coordinates."""

PLANE = np.dtype([("normal", *_V), ("offset", np.float64)], align=True)
"""A solid half-space ``normal · x <= offset``, unit normal pointing out of it."""

# not a plane with something behind it: numba would take one for the other, and say that it does
FACE = np.dtype([("closed", np.bool_), ("normal", *_V), ("offset", np.float64)], align=True)
"""A face of a watched region's piece: beyond it is ``normal · x <= offset``, unit normal pointing into the piece;
through a closed one nobody comes."""

FRAME = np.dtype(
    [
        ("rotation", np.float64, (3, 3)),
        ("origin", *_V),
        ("axis", *_V),  # the joint's axis, in world coordinates
        ("omega", *_V),
        ("alpha", *_V),
        ("psi", *_V),  # rate of alpha at zero joint jerk
        ("velocity", *_V),  # of the origin, and so on
        ("acceleration", *_V),
        ("drift", *_V),  # jerk of the origin at zero joint jerk
    ],
    align=True,
)
"""Motion of one link frame in world coordinates."""

SEGMENT = np.dtype(
    [
        ("start", *_V),
        ("end", *_V),
        ("start_velocity", *_V),
        ("end_velocity", *_V),
        ("start_acceleration", *_V),
        ("end_acceleration", *_V),
        ("swing", *_V),  # of the first link's capsules: the joint's axis times how far their ends are from it
        ("radius", np.float64),
        ("link", np.int64),
    ],
    align=True,
)
"""Motion of a robot capsule's axis in world coordinates."""

PAIR = np.dtype(
    [
        ("distance", np.float64),  # signed surface distance [m]
        ("s", np.float64),  # closest point on the robot's axis, 0 at start, 1 at end
        ("r", np.float64),  # closest point on the agent's axis
        ("phi", np.float64),  # safety index [m²]
    ],
    align=True,
)
"""A robot capsule against an agent."""

STOP = np.dtype(
    [
        ("ramp", np.int64),  # ticks at jerk_in
        ("hold", np.int64),  # ticks at zero jerk
        ("release", np.int64),  # ticks at jerk_out; at rest after them
        ("jerk_in", np.float64),
        ("jerk_out", np.float64),
    ],
    align=True,
)
"""One joint's stop on the time grid."""

TRACK = np.dtype(
    [
        ("trusted", np.float64, (4, 3)),  # start, end and their velocities, as last trusted
        ("radius", np.float64),
        ("stamp", np.float64),  # when that was measured, -inf for never
        ("seen", np.float64, (4, 3)),  # the last sample that could be read, trusted or not
        ("first", np.float64),  # stamp that it had when it came for the first time
        ("speed", np.float64, 2),  # start and end move no faster
        ("slower", np.float64, 2),  # by how much less than the faster of them each can come
        ("acceleration", np.float64),  # ... and change their velocity, 0 if nobody says how fast
        ("velocity_error", np.float64),  # of their measured velocities
        ("steady", np.int64),  # whether they have kept to that, see jssa_gym.kernels.occupancy
        ("anchor", np.float64, (4, 3)),  # a sample trusted a while ago, which those since have to agree with as well
        ("anchor_radius", np.float64),
        ("anchor_stamp", np.float64),  # -inf for never
        ("person", np.int64),
    ],
    align=True,
)
"""What is remembered of one human capsule from tick to tick."""

PIECES = 4
"""Into how many a capsule is split whose ends are not equally fast."""

CONFINED = np.dtype(
    [
        ("knots", np.float64, (PIECES + 1, 3)),  # of the axis as it was measured, from start to end
        ("slower", np.float64, 2),  # by how much less than the faster end start and end can come
        ("start_velocity", *_V),
        ("end_velocity", *_V),
        ("speed", np.float64),  # the larger of both
        ("acceleration", np.float64),  # bound on it, 0 if none can be relied on
        ("velocity_error", np.float64),
        ("late", np.float64),  # age of the measurement and lag of the arm
        ("error", np.float64),  # of the measurement and of the arm's place
        ("moved", np.float64, (2, 3)),  # scratch
    ],
    align=True,
)
"""What a body part is confined by, beyond the speed of its fastest point."""


def records(shape: int | tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Zeroed records of one of the types above."""
    return np.zeros(shape, dtype)
