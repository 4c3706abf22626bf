"""What a shield says aloud: failures with their tracebacks, and faults that go on for long."""

import logging
import sys

_logger = logging.getLogger("jssa_gym")

LONG = 1.0
"""For how long decisions are faults before that is said aloud [s]."""


class Alarm:
    """Says everything once: what is wrong in one control step is wrong in the next.

    Args:
        dt: Control step [s].
    """

    def __init__(self, dt: float) -> None:
        self._long = max(round(LONG / dt), 1)
        self._faults, self._failures = 0, dict[str, str]()
        self._said_long = self._said_astray = False

    def fault(self, reason: str, persistent: bool) -> None:
        """Count a fault; a second of them in a row is said, and an arm that is astray for good (``persistent``)."""
        self._faults += 1
        if persistent and not self._said_astray:
            self._said_astray = True
            _logger.warning(
                "The arm is not where the applied jerks lead, again and again (%s): something else moves it, or its "
                "readings are not those of the commanded state. The shield keeps braking. jssa_gym.check_env(env) "
                "names what is wrong with an environment; FailsafeParams(state_tolerance=...) is for measured states.",
                reason,
            )
        if self._faults == self._long and not self._said_long:
            self._said_long = True
            _logger.warning(
                "Every decision of the last %d control steps was a FAULT (%s): the arm does not move.",
                self._faults,
                reason,
            )

    def well(self) -> None:
        """A control step without a fault: they are counted anew."""
        self._faults = 0

    def failure(self, where: str, what: str) -> None:
        """Log the exception that is handled, with its traceback, unless the last one from ``where`` was alike."""
        this = f"{what} {sys.exc_info()[0]}"
        if self._failures.get(where) != this:
            self._failures[where] = this
            _logger.exception("%s", what)
