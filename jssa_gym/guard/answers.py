"""What a guard answers, in arrays that are used again once nobody holds them."""

from sys import getrefcount
from typing import NamedTuple

import numpy as np

from jssa_gym.types import Array, Status


class GuardAnswer(NamedTuple):
    """Where the arm is to be at the end of this tick, and what became of the command. The arrays are read-only."""

    position: Array
    """What to send to the drives, shape (n,) [rad]."""
    velocity: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (n,) [rad/s²]."""
    jerk: Array
    """Held during the tick, shape (n,) [rad/s³]."""
    status: Status
    reason: str
    """Why the jerk is not the one that follows the command; empty for NOMINAL."""
    margin: float
    """Room that the stop behind the command leaves to people [m], inf where nothing would move, NaN on a fault."""
    override: float
    """Pace at which whoever commands should go on along its own motion, in [0, 1]: 1 for as planned, 0 for not at all.
    Proportional to ``margin`` below 0.1 m; nobody has to heed it."""


class _Block:
    """Arrays of one answer."""

    def __init__(self, n: int) -> None:
        self.values = np.empty((4, n))
        rows = []
        for row in self.values:
            row.flags.writeable = False
            rows.append(row)
        self.rows = tuple(rows)

    def count(self) -> int:
        """How many references there are to its arrays."""
        a, b, c, d = self.rows
        return getrefcount(self.values) + getrefcount(a) + getrefcount(b) + getrefcount(c) + getrefcount(d)


class Answers:
    """Makes answers: into the arrays of an earlier one where it was let go, else into new ones.

    So an answer that is kept stays as it is, and a loop that keeps none allocates none.

    Args:
        n: Number of joints.
    """

    def __init__(self, n: int) -> None:
        self._n = n
        self._forget()

    def _forget(self) -> None:
        # two: in ``answer = guard.tick(...)`` the answer before is held until the call returns
        self._blocks = [_Block(self._n), _Block(self._n)]
        self._free, self._turn = self._blocks[0].count(), 0

    def __getstate__(self) -> dict[str, int]:
        """A copy has arrays of its own."""
        return {"n": self._n}

    def __setstate__(self, state: dict[str, int]) -> None:
        self._n = state["n"]
        self._forget()

    def make(
        self, state: Array, jerk: Array, status: Status, reason: str, margin: float, override: float
    ) -> GuardAnswer:
        """An answer; ``state`` (3, n) and ``jerk`` (n,) are copied."""
        self._turn = 1 - self._turn
        if self._blocks[self._turn].count() != self._free:
            self._blocks[self._turn] = _Block(self._n)
        block = self._blocks[self._turn]
        block.values[:3], block.values[3] = state, jerk
        return GuardAnswer(*block.rows, status, reason, margin, override)
