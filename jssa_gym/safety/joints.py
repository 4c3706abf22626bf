"""What a shield believes about its own arm: where the jerks that it applied must have led, not what is read."""

import math
from typing import Any

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.joints import AGREES, ASTRAY, FROZEN, LAGS, MISSING, deviates, judge_joints
from jssa_gym.types import Array

AGREEMENTS = 5
"""After a reading that was wrong, so many in a row have to be right before they are believed again: twice as many
each time that happens anew."""

_DOUBLINGS = 7
"""... up to five seconds."""

_FORGIVEN = 125
"""After so many readings in a row that were believed, what was wrong before does not count any more."""

_PERSISTENT = 10
"""Readings in a row that were wrong, from which on something is wrong for good."""

_RELAPSES = 5
"""Times that readings were believed again and were wrong again, likewise."""

_REMEMBERED = 32
"""Ticks by which a reading may lag and still be told so."""

_FLOAT64 = np.dtype(np.float64)

_AT_REST = 1e-6
"""Speed [rad/s] and acceleration [rad/s²] of joints below which they rest: what rounding leaves."""

WRONG = {
    FROZEN: "the joint state is frozen: the same again though the arm has moved",
    ASTRAY: "the joint state is not where the last jerk led",
}
NOT_FINITE = "joint state is not finite"
MOVING = "the arm moves in the first reading; with a state_tolerance it has to begin at rest"


def at_rest(state: Array) -> bool:
    """Whether a joint state (3, n) rests, up to rounding."""
    return bool(np.abs(state[1:]).max(initial=0.0) < _AT_REST)


class JointMonitor:
    """Believes a joint state only if the applied jerks must have led there.

    The expected state is dead-reckoned from the applied jerks since :meth:`reset` (the first reading that can be used
    is where it begins) and never corrected by a reading: deviations add up until they are seen. In every tick a
    reading is

    =========================================================  =================================================
    not an array of the right shape, masked, of single         not believed
    precision where the tolerance is 0, or not finite
    of a clock that stands still, went back or is not finite   not believed: it may be of another tick
    the one before, bit for bit, though the arm has moved      wrong
    that of some ticks ago                                     wrong; until the clock has caught up, if it lags too
    elsewhere than expected by more than the tolerance         wrong
    anything else                                              believed
    =========================================================  =================================================

    After a wrong one :data:`AGREEMENTS` in a row have to be right before they are believed again, and twice as many
    each time that happens anew; one that is missing meanwhile does not count. After a clock that stood still or went
    back none is believed until the clock has caught up. What disagrees for good, however little, is never believed
    until :meth:`reset` or :meth:`rebase`.

    Args:
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        dt: Control step [s].
        tolerance: How far a reading may be from the expected state, shape (3, n) [rad, rad/s, rad/s²]; inf for
            what is not measured. To each a billionth of its limit is added for rounding.
    """

    def __init__(self, bounds: Array, dt: float, tolerance: Array) -> None:
        n = bounds.shape[1]
        self.bounds, self.dt, self.tolerance, self._shape = bounds, dt, tolerance, (n,)
        self.expected = np.zeros((3, n))
        """Where the arm is, as far as the applied jerks tell, shape (3, n)."""
        self._exact = bool(np.any(tolerance == 0.0))
        self._reading, self._last, self._anchor = (np.zeros((3, n)) for _ in range(3))
        self._past = np.zeros((_REMEMBERED, 3, n))
        self.reset(None)

    def reset(self, robot: Any) -> None:
        """Forget the past; the arm is where ``robot`` says or, if that cannot be used, the first reading that can."""
        self.begun = False
        self.expected[:] = 0.0
        self._time, self._ticks, self._clock = math.nan, 0, ""
        self._forget()
        if not self._take(robot) and self._measured():
            self._begin()

    def _forget(self) -> None:
        """What was wrong with readings, and what they were."""
        self._last[:] = self._anchor[:] = self._past[:] = np.nan
        self._newest = 0
        # how many readings have to be right in a row before they are believed again; how many were wrong in a row, and
        # believed; how often they were wrong after they had been believed
        self._owed, self._wrong, self._believed, self._lapses, self._why = 0, 0, 0, 0, ""
        # ticks by which the clock is ahead of the control steps: now, when a reading was right for the last time, what
        # a lag asks it to reach; and lately
        self._offset, self._settled, self._due = 0.0, 0.0, -math.inf
        self._offsets = [-math.inf] * _REMEMBERED
        self.late = 0
        """Ticks without a decision that have passed, by the clock, since a reading was right for the last time."""

    def _begin(self) -> None:
        """Take the arm to be where the reading says: at rest, unless that is exact and says otherwise."""
        # noise in a velocity must not be reckoned with for good
        self.expected[0], self.expected[1:] = self._reading[0], 0.0
        self.begun = self.agrees(self._reading, self.expected)
        if not self.begun and not self.tolerance.any():
            self.expected[:] = self._reading
            self.begun = True

    @property
    def seen(self) -> Array:
        """What was read last, shape (3, n)."""
        return self._reading

    def read(self, robot: Any, time: Any) -> str:
        """Take down what is delivered in this tick; why it cannot be used, or nothing. Never raises, whatever it is.

        Has to be asked once a tick, and :meth:`judge` with the answer after it.
        """
        self._ticks += 1
        self._clock = self._date(time)
        reason = self._take(robot)
        if not (self.begun or reason):
            if not self._measured():
                return NOT_FINITE
            self._begin()
            if not self.begun:
                return MOVING
        return reason

    def _take(self, robot: Any) -> str:
        """Into ``self._reading``; why that is impossible, or nothing."""
        reading, shape = self._reading, self._shape
        try:
            for row, values in enumerate((robot.position, robot.velocity, robot.acceleration)):
                if type(values) is not np.ndarray or values.dtype is not _FLOAT64:
                    self._check(values)
                if values.shape != shape:
                    raise ValueError(f"it has shape {values.shape}, expected {shape}")
                reading[row] = values
        except Exception as error:  # whatever a driver delivers, the arm must go on safely
            return f"the joint state cannot be read: {error}"
        return ""

    def _check(self, values: Any) -> None:
        """Raises if an array is not what is taken for one."""
        kind, size = values.dtype.kind, values.dtype.itemsize
        if isinstance(values, np.ma.MaskedArray):
            raise ValueError("it is masked")
        if kind not in "fiu":
            raise ValueError(f"it is {values.dtype}, expected real numbers")
        if self._exact and kind == "f" and size < 8:
            raise ValueError(f"it is {values.dtype}, which without a state_tolerance has to be float64")

    def _measured(self) -> bool:
        """Whether all is finite that has to be measured."""
        return bool((np.isfinite(self._reading) | (self.tolerance == np.inf)).all())

    def _date(self, time: Any) -> str:
        """Compare the clock with the ticks; what is wrong with it."""
        try:
            now = float(time)
        except Exception as error:  # whatever a clock delivers, the arm must go on safely
            return f"the clock cannot be read: {error}"
        last = self._time
        # the very first reading has none before it
        if not (last < now < math.inf or (math.isnan(last) and math.isfinite(now))):
            return self._undated(now)
        passed = min((now - last) / self.dt, 1e7) if last < now else 1.0  # no more than a day of ticks at once
        self._offset += passed - self._ticks
        self._time, self._ticks = now, 0
        ahead = self._offset - self._settled
        self.late = round(ahead) if ahead > 0.5 else 0
        return ""

    def _undated(self, now: float) -> str:
        if not math.isfinite(now):
            return f"the time is {now}"
        # what is of an earlier tick is so until the clock has caught up: an arm at rest looks the same all along
        self._due = max(self._due, max(self._offsets) - 0.5)
        if now < self._time:
            return f"the clock went back from {self._time:g} s to {now:g} s"
        return f"the clock stands still at {now:g} s: the joint state is not of this tick"

    def agrees(self, state: Array, expected: Array) -> bool:
        """Whether a reading (3, n) is within the tolerance of an expected state (3, n)."""
        return not deviates(state, expected, self.bounds, self.tolerance)

    def judge(self, form: str) -> str:
        """Compare what was read with the expected state; why it is not believed, or nothing.

        Args:
            form: What :meth:`read` answered.
        """
        code = judge_joints(
            self._reading,
            not form,
            self.expected,
            self._last,
            self._anchor,
            self._past,
            self._newest,
            self.bounds,
            self.tolerance,
        )
        self._newest = newest = (self._newest + 1) % _REMEMBERED
        self._offsets[newest] = self._offset
        if code == MISSING:  # nothing false was said, and nothing right
            return form or NOT_FINITE
        if code != AGREES:
            if not self._owed:
                self._lapses += 1
            self._wrong, self._believed = self._wrong + 1, 0
            self._owed = AGREEMENTS << min(self._lapses - 1, _DOUBLINGS)
            self._why = WRONG[code] if code in WRONG else self._lagging(code - LAGS + 1)
            return self._why
        self._wrong = 0
        if self._clock:
            return self._clock
        if self._offset < self._due:
            return self._lagging(math.ceil(self._due - self._offset))
        self._due, self._settled, self.late = -math.inf, self._offset, 0
        if self._owed:
            self._owed -= 1
            if self._owed:
                return f"{self._why}; right again, but not for long enough to be believed"
        self._believed += 1
        if self._believed >= _FORGIVEN:
            self._lapses = 0
        return ""

    @property
    def timely(self) -> bool:
        """Whether this tick's scene is of this tick, as far as its clock tells."""
        return not self._clock and self._offset >= self._due

    @property
    def persistent(self) -> bool:
        """Whether readings are wrong for so long, or so often, that it is no accident."""
        return self._wrong >= _PERSISTENT or self._lapses >= _RELAPSES

    def _lagging(self, ticks: int) -> str:
        # where the clock shows the same lag, it has to catch up too: an arm at rest looks the same at all times
        if self._offset <= max(self._offsets) - ticks + 0.5:
            self._due = max(self._due, self._offset + ticks - 0.5)
        return f"the joint state lags by {ticks} tick{'s' if ticks > 1 else ''}"

    def rebase(self, robot: Any, time: Any) -> None:
        """Take a resting arm to be where its reading says; what was wrong is forgotten.

        Where velocity or acceleration are not measured nothing shows that it rests.

        Raises:
            ParameterError: The arm is expected to move still, or the reading cannot be used, is no newer than the last
                one, moves, or is outside the position limits.
        """
        if not at_rest(self.expected):
            raise ParameterError("the arm is still braking: rebase it when it rests")
        if wrong := self._take(robot) or ("" if self._measured() else NOT_FINITE):
            raise ParameterError(wrong)
        try:
            old = not float(time) < math.inf or float(time) <= self._time
        except (TypeError, ValueError) as error:
            raise ParameterError(f"the clock cannot be read: {error}") from error
        if old:
            raise ParameterError(f"the reading is of {time} s, the last one of {self._time:g} s: it has to be newer")
        position = self._reading[0]
        still = np.array([position, np.zeros_like(position), np.zeros_like(position)])
        if not self.agrees(self._reading, still):
            raise ParameterError(f"the arm moves, at {self._reading[1]} rad/s: rebase it when it rests")
        if not np.all((self.bounds[0] <= position) & (position <= self.bounds[1])):
            raise ParameterError(f"the arm is outside its position limits, at {position} rad")
        self.expected[:] = still
        self.begun = True
        self._forget()
