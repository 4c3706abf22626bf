"""How smoothly an arm is driven: where its jerk jumps, and who made it jump."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.types import Array

_ROUNDING = 1e-9
"""Share of a bound that rounding may cost, as in the environment."""


class JerkJumps(NamedTuple):
    """Steps, from an episode's second on, in which a jerk jumps, as shares of all of these; 0 where there are none."""

    applied: float
    """The applied jerk jumps; the sum of the next two."""
    nominal: float
    """So does the wanted jerk: it was the policy's."""
    shield: float
    """The wanted jerk does not: it was the shield's."""


def jerk_jumps(applied: Array, nominal: Array, bound: Array) -> JerkJumps:
    r"""Shares of the steps in which :math:`|u_{j,k} - u_{j,k-1}| > J_j` for some joint j.

    That is more than half of all that there is, from :math:`-J_j` to :math:`J_j`. What came before the first step
    nobody knows, so that it is compared with none.

    Args:
        applied: The jerk of every step, shape (T, n) [rad/s³].
        nominal: What was asked for, shape (T, n) [rad/s³]. It counts as far as it is within the bounds: a shield that
            clips makes no jump less and none more. What is no number makes no jump: whatever is applied in its place is
            the shield's.
        bound: The jerk bounds :math:`J`, shape (n,) [rad/s³].
    """
    jumps, wanted = _jumps(applied, bound), _jumps(np.clip(nominal, -bound, bound), bound)
    count = max(len(jumps), 1)
    return JerkJumps(*(int(those.sum()) / count for those in (jumps, jumps & wanted, jumps & ~wanted)))


def _jumps(jerk: Array, bound: Array) -> NDArray[np.bool_]:
    """Whether some joint's jerk jumps, from the second step on, shape (max(T - 1, 0),)."""
    return np.any(np.abs(np.diff(jerk, axis=0)) > bound * (1.0 + _ROUNDING), axis=1)
