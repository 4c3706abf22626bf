"""What the page shows of a moment; nothing in it changes any more."""

from collections.abc import Mapping
from typing import NamedTuple

from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, CapsuleSet, Status
from jssa_gym.viewer.choices import Choices

SERIES = ("distance", "phi", "margin", "override", "speed", "jerk", "status")
"""What is plotted, in the order of :attr:`History.values`."""


class History(NamedTuple):
    """The last seconds of one arm."""

    time: Array
    """Shape (k,) [s]."""
    values: Array
    """Rows as of :data:`SERIES`, shape (7, k): distance [m], φ [m²], margin [m], override, largest joint speed and jerk
    as a share of their bounds, status."""


class Overlay(NamedTuple):
    """What a verified stop sees: capsules that are drawn translucent."""

    start: Array
    """Shape (k, 3) [m]."""
    end: Array
    """Shape (k, 3) [m]."""
    radius: Array
    """Shape (k,) [m]."""


class ArmView(NamedTuple):
    """One arm and its shield."""

    name: str
    """Name of the shield."""
    position: Array
    """Shape (n,) [rad]."""
    capsules: CapsuleSet
    line: tuple[Array, Array] | None
    """The critical pair's points, shape (3,) [m]; None without people."""
    goal: Array | None
    """A point that the tool is to be at, shape (3,) [m]."""
    distance: float
    """[m]; inf without people."""
    closest: float
    """Smallest distance of the episode [m]."""
    phi: float
    """[m²]; NaN without a shield."""
    margin: float
    """[m]; NaN where not told."""
    override: float
    """Pace along the path; NaN where not told."""
    speed: float
    """Largest joint speed as a share of its limit."""
    jerk: float
    """Largest joint jerk as a share of its bound."""
    status: Status
    reason: str
    contact: bool
    contact_speed: float
    """[m/s]."""
    moving_contacts: int
    """Steps of the episode in which the arm touched somebody while its touching point moved."""
    success: bool
    numbers: Mapping[str, float]
    """The shield's parameters and assumptions that can be changed, as they are."""
    promise: str
    """What holds, or why nothing is promised."""
    promised: bool
    stop: Overlay | None
    """The arm on its way to rest, if it were to stop now; None unless asked for."""
    reach: Overlay | None
    """Where people can be by then; None unless asked for."""
    history: History


class Snapshot(NamedTuple):
    """All that the page shows of a moment."""

    answered: int
    """Commands that were done until then."""
    number: int
    """Control steps since the session began."""
    epoch: int
    """Grows with every change of robots, tasks or shields: what is drawn has to be made anew."""
    time: float
    """Time of the episode [s]."""
    choices: Choices
    robot: RobotModel
    """The arm, where it stands."""
    people: CapsuleSet
    arms: tuple[ArmView, ...]
    paused: bool
    factor: float = 1.0
    """Simulated time over the clock's."""
    clamped: bool = True
    """Whether the dragged person keeps to the assumed speeds."""
    recording: float | None = None
    """Seconds on the film that is being recorded; None if there is none."""
    scrubbed: bool = False
    """Whether this is a moment of a saved episode."""
    length: float = 0.0
    """Length of the saved episode [s]; 0 of a live one."""
    message: str = ""
    """What went wrong with the last command; empty if nothing did."""
