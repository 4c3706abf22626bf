"""The time by which people move: a scene's clock that never falls behind the control steps."""

import math
from typing import Any


class TickClock:
    """A scene's time, set forward where it does not keep up with the ticks: people move on though a clock stands still.

    Args:
        dt: Control step [s].
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._seen, self._ahead, self._due = math.nan, 0.0, 0

    def miss(self) -> None:
        """A tick passes without a reading of the clock."""
        self._due += 1

    def read(self, time: Any) -> Any:
        """The time [s] in a tick with a reading; what is no time, or went back, is given back as it is."""
        self._due += 1
        try:
            now = float(time)
        except Exception:  # whatever a perception system delivers, the arm must go on safely
            return time
        # a reading that is none, or went back, does not count: the ticks since the last that does are still due
        if now < self._seen or not math.isfinite(now):
            return time
        gap, due = now - self._seen, self.dt * self._due
        self._seen, self._due = now, 0
        if gap < due * (1.0 - 1e-6):
            self._ahead += due - gap
        return now + self._ahead
