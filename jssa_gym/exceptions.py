"""Errors that the package raises; each message says what was wrong and what would be right."""


class JSSAGymError(Exception):
    """Root of every error of this package."""


class RobotModelError(JSSAGymError, ValueError):
    """A robot description cannot be modelled, or a limit is missing; names the joint or geom."""


class InvalidActionError(JSSAGymError, ValueError):
    """An action has the wrong shape or type. Raised before anything moves."""


class ParameterError(JSSAGymError, ValueError):
    """A parameter is out of range or unknown; the message lists what is valid."""


class TraceError(JSSAGymError, ValueError):
    """A file is not a complete, unchanged recording of an episode, or a trace's arrays do not fit together."""


class PolicyFileError(JSSAGymError, ValueError):
    """A file is not a complete, unchanged policy, or holds something that a policy has no use for."""


class StorageError(JSSAGymError, OSError):
    """A file cannot be written: the disk is full, or nobody may; what was there before is unchanged."""


class InterfaceError(JSSAGymError, TypeError):
    """An environment does not offer what a shield needs: ``robot``, ``dt`` and ``scene``."""


class NotStartedError(JSSAGymError, RuntimeError):
    """A guard was asked before it was told where the arm rests."""


class StreamError(JSSAGymError, RuntimeError):
    """A robot's own controller does not answer, or does not let its arm move."""


class InfeasibleError(JSSAGymError, ValueError):
    """No motion within the limits does what was asked for; :attr:`shortest` says in which time one would.

    Args:
        message: What was wrong and what would be right.
        shortest: Shortest time between waypoints for which there is one [s]; None if there is none.
    """

    def __init__(self, message: str, shortest: float | None = None) -> None:
        super().__init__(message)
        self.shortest = shortest


class UnreachableError(JSSAGymError, ValueError):
    """No posture within the joint limits, clear of table and arm, brings the tool to a point."""


class DisplayError(JSSAGymError, RuntimeError):
    """Nothing to draw on: no display for a window, or no OpenGL backend for pictures."""


class MissingExtraError(JSSAGymError, ImportError):
    """An optional dependency is not installed; the message says what to install."""


def how_to_install(extra: str) -> str:
    """The commands that install an extra of this package, of a release or of a clone."""
    return f"pip install 'jssa-gym[{extra}]', or pip install -e '.[{extra}]' in a clone"


class RecordingError(JSSAGymError, ValueError):
    """Recorded motion of a person is malformed, truncated or not finite; the message says what and where."""


class LogError(JSSAGymError, ValueError):
    """A robot's log cannot be audited: it is malformed, not finite, or of another robot; says what and where."""


class WorkerError(JSSAGymError, RuntimeError):
    """A worker process was killed before it ended its work."""


class BlockedError(JSSAGymError, RuntimeError):
    """Every decision of a training's shield was a FAULT; the message says why most were."""


class CheckpointError(JSSAGymError, ValueError):
    """A training's checkpoint is missing, truncated or changed, or belongs to another training."""
