"""The person who stands in for the paper's, whose trajectory is not published."""

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import RecordingError
from jssa_gym.humans import Body, HumanMotion, Recorded, Recording
from jssa_gym.humans.body import NAMES

WALK = (
    (0.0, 1.522, 1.062),
    (1.84, 1.495, 0.02),
    (2.04, 1.458, 0.02),
    (2.24, 1.426, 0.02),
    (2.44, 1.399, 0.02),
    (2.64, 1.373, 0.02),
    (2.84, 1.35, 0.02),
    (3.04, 1.329, 0.02),
    (3.24, 1.308, 0.02),
    (3.44, 1.289, 0.02),
    (3.64, 1.272, 0.02),
    (3.84, 1.255, 0.02),
    (3.955, 1.246, 0.02),
    (4.04, 1.219, 0.02),
    (4.214, 1.165, 0.02),
    (5.714, 2.573, 0.02),
)
"""Time [s] and place on the floor [m] of the person who stands in for the paper's."""


def walk(table: ArrayLike) -> HumanMotion:
    """Somebody who faces the arm and walks straight and at constant velocity from each place of a table to the next.

    Args:
        table: Rows of time [s], x and y [m], shape (k, 3).

    Raises:
        RecordingError: The rows are no such table.
        ParameterError: A place is within the clearance of the base axis.
    """
    try:
        rows = np.array(table, np.float64)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"a walk is made of rows of time, x and y: {error}") from error
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise RecordingError(f"a walk is made of rows of time, x and y, shape (k, 3), got {rows.shape}")
    time, *root = rows.T
    body, place = Body.facing(), np.stack([*root, np.zeros_like(time)], axis=-1)[:, None]
    recording = Recording(time, body.start + place, body.end + place, body.radius, NAMES)
    return Recorded(recording, turn=(0.0, 0.0), offset=((0.0, 0.0), (0.0, 0.0)))


def stand_in() -> HumanMotion:
    """The person in place of the paper's, whose trajectory is not published.

    Found by ``benchmarks/stand_in.py``, which asks for the numbers of Fig. 6 with the filter as published. Fig. 8 and
    Table 1 play no part in it: what they say of this person was not chosen.
    """
    return walk(WALK)
