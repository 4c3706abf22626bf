"""A motion along a path from tick to tick: what is remembered of its pace, what is offered, and how it goes on.

The first axis of all arrays are the arms, one or many; :func:`offer` and :func:`go_on` are told by ``e`` which of them
they are about. Plans are those of :func:`~jssa_gym.kernels.override.along`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.override import along, propose
from jssa_gym.kernels.records import records
from jssa_gym.kernels.vector import copy

FULL_PACE = 0.1
"""Margin from which on the full pace is asked for; nothing at margin 0, and proportional between [m]."""

SLOWER, FASTER = 6.0, 2.0
"""How fast the pace that is asked for may fall and rise [1/s]."""

GENTLE, HARD, HARDEST = (5.0, 25.0), (8.0, 60.0), (30.0, 600.0)
"""What acceleration and jerk of the pace may not exceed [1/s, 1/s²], where the joints' limits let them get so far."""

PACES = (0.6, 0.3, 0.0)
"""Paces that are offered beside the one that is asked for where it is faster."""

FAR, FAST, HARD_PULLED = 1e-3, 1e-2, 0.3
"""Deviation from the path that is left to feedback [rad, rad/s, rad/s²]; what is farther off was thrown off."""

_WISHES = np.array(
    [(0.0, *GENTLE), *((pace, *GENTLE) for pace in PACES), (0.0, *HARD), (0.0, *HARDEST), (1.0, *GENTLE)]
)

PACED = np.dtype(
    [
        ("override", np.float64),  # the pace that was asked for last
        ("asked", np.float64),  # the pace that is asked for now
        ("fastest", np.float64),  # the pace that all of the plan can be played at, while it is behind
        ("behind", np.float64),  # time that was lost [s]
        ("margin", np.float64),  # that the last alternatives were for [m]
        ("count", np.int64),  # of alternatives that are offered
    ],
    align=True,
)
"""What is remembered of one arm's pace, but for arrays."""


class Paces(NamedTuple):
    """What is remembered of paces, shapes without the leading axis of arms."""

    kept: NDArray
    """Shape () of ``PACED``."""
    pace: NDArray[np.float64]
    """Path time, its rate and its acceleration, shape (3,) [s, 1, 1/s]."""
    wishes: NDArray[np.float64]
    """Paces, and what their acceleration and jerk may not exceed, shape (7, 3); the last is one it is on the way to."""
    jerks: NDArray[np.float64]
    """What is offered, shape (7, n) [rad/s³] ..."""
    paces: NDArray[np.float64]
    """... the paces a tick later, shape (7, 3) ..."""
    numbers: NDArray[np.int64]
    """... and the numbers of the wishes that they are for, shape (7,)."""
    point: NDArray[np.float64]
    """Room to work in, shape (2, 4, n), the same for all arms."""


def paced(arms: int, n: int) -> Paces:
    """Paces that nothing is known of yet: plans at full pace that begin now."""
    m = len(_WISHES)
    kept, pace = records(arms, PACED), np.zeros((arms, 3))
    kept["override"] = kept["asked"] = kept["fastest"] = pace[:, 1] = 1.0
    kept["margin"] = np.inf
    wishes, paces = np.zeros((2, arms, m, 3))
    wishes[:] = _WISHES
    return Paces(
        kept, pace, wishes, np.zeros((arms, m, n)), paces, np.zeros((arms, m), np.int64), np.zeros((2, 4, n))
    )  # fmt: skip


@jit
def pace_of(margin):
    """The pace that a margin [m] asks for, in [0, 1]; 0 where it is no number."""
    return min(max(margin / FULL_PACE, 0.0), 1.0) if margin > 0.0 else 0.0  # NaN is not


@jit
def ticks_of(plan, s):
    """Ticks of a plan that are over at path time s [s], whole ones."""
    return min(int(s / plan[2] + 1e-6), plan[0].shape[0])


@jit
def astray(plan, paced, state, e):
    """Whether a joint state (3, n) is off the path by more than feedback is for; one that is not finite is."""
    pace, point = paced.pace[e], paced.point[0]
    s, rate, acceleration = pace[0], pace[1], pace[2]
    along(plan, s, point)
    for i in range(point.shape[1]):
        velocity, pull = point[1, i] * rate, point[2, i] * rate**2 + point[1, i] * acceleration
        if not (abs(state[0, i] - point[0, i]) <= FAR and abs(state[1, i] - velocity) <= FAST):
            return True
        if not abs(state[2, i] - pull) <= HARD_PULLED:
            return True
    return False


@jit
def slewed(kept, margin, tau):
    """The pace that a margin asks for, as fast as it may change."""
    most = kept["fastest"] if kept["behind"] > tau else 1.0
    return min(max(most * pace_of(margin), kept["override"] - SLOWER * tau), kept["override"] + FASTER * tau)


@jit
def offer(plan, paced, state, margin, bounds, most, e):
    """Jerks for this tick in order of preference, into ``paced.jerks[e]``; nothing moves on before :func:`go_on`.

    Args:
        plan: The path.
        paced: What is remembered.
        state: Rows position, velocity, acceleration of the joints, shape (3, n).
        margin: Room that is left to people [m]; what is no number counts as none.
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        most: How many are wanted at most.
        e: Which arm.

    Returns:
        How many there are, also kept; -1 where the arm is off the path, which is none.
    """
    kept, wishes = paced.kept[e], paced.wishes[e]
    kept["margin"], kept["count"] = margin, 0
    kept["asked"] = slewed(kept, margin, plan[2])
    wishes[0, 0] = kept["asked"]
    for k in range(len(PACES)):
        wishes[k + 1, 0] = min(PACES[k], kept["asked"])
    if astray(plan, paced, state, e):
        return -1
    out = paced.jerks[e, :most], paced.paces[e, :most], paced.numbers[e, :most]
    kept["count"] = propose(plan, paced.pace[e], wishes, state, bounds, paced.point, out)
    return kept["count"]


@jit
def go_on(plan, paced, choice, e):
    """The decision on what was offered last: the number of the one that was applied, -1 for none of them."""
    kept, pace, tau = paced.kept[e], paced.pace[e], plan[2]
    kept["override"] = kept["asked"]
    if not 0 <= choice < kept["count"]:
        kept["count"] = 0
        kept["behind"] += tau
        return
    before = pace[0]
    copy(paced.paces[e, choice], pace)
    kept["behind"] = max(kept["behind"] + tau - (pace[0] - before), 0.0)
    pace[0] = min(pace[0], plan[0].shape[0] * tau)
    # what it was on the way to was seen to be within the limits: offered again, it still is
    copy(paced.wishes[e, paced.numbers[e, choice]], paced.wishes[e, paced.wishes.shape[1] - 1])
    kept["count"] = 0
