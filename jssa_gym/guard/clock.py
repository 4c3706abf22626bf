"""The rate at which ticks come, by their stamps."""

import math

TOLERANCE = 0.05
"""Share by which ticks may come faster or more slowly than they should, in the mean of about a second."""

MISSED = 0.25
"""Ticks by which one that comes after missed ones may be early: what is less is no missed tick but a late one."""

HASTY = 0.5
"""Ticks after the last one before which there can be no other: who calls earlier makes up for lost time."""


class TickRate:
    """Whether ticks keep to their rate; single ones may be late, missed or doubled, or somewhat early.

    A stop is verified for ticks of ``dt``: where all come late by a few per cent, it takes that much longer than it was
    verified for, and where they come early the arm is that much faster.

    Args:
        dt: Control step [s].
    """

    def __init__(self, dt: float) -> None:
        self._dt, self._weight = dt, min(dt, 1.0)
        self.forget()

    def forget(self) -> None:
        """The next tick is the first."""
        self._last, self._off = math.nan, 0.0

    def hasty(self, stamp: float) -> bool:
        """Whether a tick's stamp [s] comes so soon after the last one that was taken in that it is none."""
        return 0.0 < stamp - self._last < HASTY * self._dt

    def wrong(self, stamp: float) -> str:
        """Take in a tick's stamp [s]; what is wrong with the rate, or nothing."""
        gap = stamp - self._last
        if not 0.0 < gap < math.inf:  # the control step says what is wrong with it
            if math.isfinite(stamp) and math.isnan(self._last):
                self._last = stamp
            return ""
        self._last = stamp
        passed = gap / self._dt
        # rounded to the nearest, ticks that all come half a tick late would be on time in the mean
        off = passed - max(math.floor(passed + MISSED), 1)
        self._off += self._weight * (off - self._off)
        if abs(self._off) <= TOLERANCE:
            return ""
        rate, wanted = 1.0 / (self._dt * (1.0 + self._off)), 1.0 / self._dt
        return f"ticks come at {rate:.4g} a second, the guard is made for {wanted:.4g}"
