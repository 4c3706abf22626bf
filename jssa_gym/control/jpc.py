"""The online half of the jerk-bounded position controller: a buffer of nominal jerks and what to do when it is void.

It sees joint states only. When the state is not the one that its last command leads to, somebody else (a shield)
commands the arm: the plan is void, and a brake is offered. When its commands have been obeyed again for some ticks, it
brings the arm to rest by an internal plan and asks the host for a new one, which begins where the arm will rest. The
host may answer at any time, more than once, or never.
"""

from enum import Enum
from typing import NamedTuple

import numpy as np

from jssa_gym.control.moves import brake_jerk, plan_brake
from jssa_gym.control.plan import Plan
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.motion import integrate
from jssa_gym.robots import JointLimits
from jssa_gym.tick import play
from jssa_gym.types import Array, JointState
from jssa_gym.validation import positive_integer, positive_number

DISTURBED = np.array(play.DISTURBED)[:, None]
"""Deviation from the commanded state that means interference [rad, rad/s, rad/s²]; float32 actions make less."""


class Phase(Enum):
    """What the controller is doing."""

    IDLE = "idle"
    """At rest, nothing to do."""
    WAITING = "waiting"
    """At rest, the host has been asked."""
    TRACKING = "tracking"
    """Reads the host's plan."""
    YIELDING = "yielding"
    """Somebody else commands the arm; a brake is offered."""
    SETTLING = "settling"
    """Obeyed again: the internal stop is running, the host has been asked."""


class Event(Enum):
    """What changes the phase."""

    TASK = "task"
    """There is something to do."""
    PLAN = "plan"
    """A plan of the host's begins here and now."""
    DONE = "done"
    """The last waypoint has been met, or there is nothing to do any more."""
    RESTED = "rested"
    """The buffer has run out, the arm rests, and there is something left to do."""
    DISTURBED = "disturbed"
    """The joint state is not what was commanded."""
    QUIET = "quiet"
    """Commands have been obeyed for some ticks."""


TRANSITIONS: dict[tuple[Phase, Event], Phase] = {
    (Phase.IDLE, Event.TASK): Phase.WAITING,
    (Phase.IDLE, Event.DISTURBED): Phase.YIELDING,
    (Phase.WAITING, Event.PLAN): Phase.TRACKING,
    (Phase.WAITING, Event.DONE): Phase.IDLE,
    (Phase.WAITING, Event.DISTURBED): Phase.YIELDING,
    (Phase.TRACKING, Event.PLAN): Phase.TRACKING,
    (Phase.TRACKING, Event.DONE): Phase.IDLE,
    (Phase.TRACKING, Event.RESTED): Phase.WAITING,
    (Phase.TRACKING, Event.DISTURBED): Phase.YIELDING,
    (Phase.YIELDING, Event.QUIET): Phase.SETTLING,
    (Phase.SETTLING, Event.RESTED): Phase.WAITING,
    (Phase.SETTLING, Event.DISTURBED): Phase.YIELDING,
}
"""The whole state machine; any other event in a phase is a programming error."""


class Request(NamedTuple):
    """What the host is asked for: a plan from a state."""

    number: int
    """An answer has to carry it; answers to earlier requests are void."""
    state: Array
    """Where the plan has to begin, shape (3, n)."""
    begins: int
    """Tick at which the arm will be there."""
    met: int
    """Waypoints of the task that have been met."""


class JPC:
    """Buffer and state machine for one arm.

    In every tick: :meth:`step` with the joint state gives the jerk; :attr:`request` is what the host is asked for;
    :meth:`deliver` takes its answers.

    Args:
        limits: Of the joints.
        dt: Tick [s].
        quiet: For how many ticks commands have to be obeyed before the arm counts as its own again.
        patience: Time after which an unanswered request is made again [s]; doubled for every one that stays so.
        lead: How many ticks ahead a replan in motion begins at first; doubled whenever the host was slower.

    Raises:
        ParameterError: An argument is out of range.
    """

    def __init__(self, limits: JointLimits, dt: float, *, quiet: int = 6, patience: float = 2.5, lead: int = 5) -> None:
        self.limits, self.dt = limits, positive_number("dt", dt)
        self.quiet, self.lead = positive_integer("quiet", quiet), positive_integer("lead", lead)
        self.patience = max(1, round(positive_number("patience", patience) / dt))
        self._number = 0
        self.reset()

    def reset(self) -> None:
        """Forget plan, task and requests: a new episode."""
        self.phase = Phase.IDLE
        self.request: Request | None = None
        self.met = 0
        self.open = False
        """Whether there is something left to do."""
        self._task = False  # whether there is a task, done or not: what was reached has to be held
        self.tick = 0
        """Number of control steps of the episode so far."""
        self._plan: Plan | None = None
        self._read = 0  # ticks of the plan that have been read
        self._passed = 0  # waypoints of it that have been counted
        self._current = False  # whether it is for the present task
        self._answer: Plan | None = None
        self._asked, self._waits = 0, self.patience
        self._obeyed = 0
        self._ahead = self.lead
        self._expected: Array | None = None

    def assign(self) -> None:
        """There is a new task: nothing of it is met, and plans that were asked for so far are void."""
        self._task = self.open = True
        self.met, self._current = 0, False
        self.request, self._answer = None, None

    def withdraw(self) -> None:
        """There is no task any more; a plan that is being tracked goes on to its end."""
        self._task = self.open = False
        self._current = True
        self.request, self._answer = None, None

    def count(self, met: int) -> None:
        """So many waypoints count as met, whoever brought the arm there; a plan that is being read counts its own."""
        if self.phase is Phase.YIELDING:
            self.met = max(self.met, met)

    def deliver(self, number: int, plan: Plan | None) -> bool:
        """Take the host's answer.

        Args:
            number: Of the request.
            plan: Beginning at the request's state; None if the host has none: it will be asked again.

        Returns:
            Whether it is the present request's first answer; others are dropped.

        Raises:
            ParameterError: The plan begins elsewhere, or is for another tick or number of joints.
        """
        if self.request is None or number != self.request.number or self._answer is not None:
            return False
        if plan is None:
            return True
        if plan.dt != self.dt or plan.states.shape[1:] != self.request.state.shape:
            raise ParameterError("the plan is for another tick or another number of joints")
        if np.any(np.abs(plan.states[0] - self.request.state) > DISTURBED):
            raise ParameterError("the plan does not begin where it was asked to")
        self._answer = plan
        return True

    def step(self, state: Array) -> Array:
        """The jerk for the next tick.

        Args:
            state: Rows position, velocity, acceleration as they are now, shape (3, n).

        Returns:
            Shape (n,) [rad/s³].
        """
        self._notice(state)
        if self.phase is Phase.IDLE and self.open:
            self._on(Event.TASK)
        if self.phase in (Phase.TRACKING, Phase.SETTLING):
            self._end_of_buffer()
        if self.open and self.phase is not Phase.YIELDING:
            self._ask(state)
        if self.phase in (Phase.WAITING, Phase.TRACKING):
            self._begin(state)
        jerk = self._jerk(state)
        self.tick += 1
        return jerk

    def _on(self, event: Event) -> None:
        self.phase = TRANSITIONS[self.phase, event]

    def _notice(self, state: Array) -> None:
        """Compare the state with what was commanded."""
        if self._expected is None:
            self._expected = _at_rest(state)
        obeyed = bool(np.all(np.abs(state - self._expected) <= DISTURBED))
        self._obeyed = self._obeyed + 1 if obeyed else 0
        if self.phase is not Phase.YIELDING:
            if not obeyed:
                self._on(Event.DISTURBED)
                self.open = self._task
                self._plan, self.request, self._answer = None, None, None
        elif self._obeyed >= self.quiet:
            self._on(Event.QUIET)
            self._take(plan_brake(JointState(*state), self.limits, self.dt), current=False)

    def _take(self, plan: Plan, *, current: bool) -> None:
        self._plan, self._read, self._passed, self._current = plan, 0, 0, current

    def _end_of_buffer(self) -> None:
        if self._plan is None or self._read < len(self._plan):
            return
        if self.phase is Phase.SETTLING:
            self._on(Event.RESTED)
        elif self._current:
            self.open = False
            self._on(Event.DONE)
        else:
            self._on(Event.RESTED)

    def _future(self, state: Array) -> tuple[Array, int]:
        """Where a plan that is asked for now has to begin, and at which tick the arm will be there."""
        if self.phase is Phase.WAITING or self._plan is None:
            return _at_rest(state if self._expected is None else self._expected), self.tick
        last = len(self._plan)
        at = last if self.phase is Phase.SETTLING else min(self._read + self._ahead, last)
        begin = self._plan.states[at]
        if at == last:  # at rest but for rounding
            begin = _at_rest(begin)
        return begin, self.tick + at - self._read

    def _ask(self, state: Array) -> None:
        """Ask the host if there is need to, and ask again if it does not answer."""
        if self.phase is Phase.TRACKING and self._current:
            return
        if self.request is not None:
            if self._answer is not None or self.tick - self._asked < self._waits:
                return
            self._waits *= 2
        self._number += 1
        begin, begins = self._future(state)
        self.request, self._answer, self._asked = Request(self._number, begin, begins, self.met), None, self.tick

    def _begin(self, state: Array) -> None:
        """Begin with the answer if its time has come; drop it if it has passed."""
        if not self.open and self.phase is Phase.WAITING:
            self._on(Event.DONE)
        plan, request = self._answer, self.request
        if plan is None or request is None or self.tick < request.begins:
            return
        self.request, self._answer = None, None
        if np.all(np.abs(plan.states[0] - state) <= DISTURBED):
            self._on(Event.PLAN)
            self._waits = self.patience
            self._take(plan, current=True)
        else:
            self._ahead *= 2
            self._ask(state)

    def _jerk(self, state: Array) -> Array:
        jerk = np.zeros(state.shape[1])
        if self.phase is Phase.YIELDING:
            jerk = brake_jerk(JointState(*state), self.limits, self.dt)
            self._expected = np.empty_like(state)
            integrate(np.ascontiguousarray(state), jerk, self.dt, self._expected)
            return jerk
        if self.phase in (Phase.TRACKING, Phase.SETTLING) and self._plan is not None and len(self._plan):
            jerk = self._plan.jerk[self._read].copy()
            self._read += 1
            if self.phase is Phase.TRACKING and self._current:
                while self._passed < len(self._plan.marks) and self._plan.marks[self._passed] <= self._read:
                    self._passed += 1
                    self.met += 1
            self._expected = self._plan.states[self._read]
            return jerk
        # where it came to rest, not where it is: what creeps away is noticed
        self._expected = _at_rest(state if self._expected is None else self._expected)
        return jerk


def _at_rest(state: Array) -> Array:
    """A state's position without speed and acceleration, shape (3, n)."""
    rest = np.zeros_like(state)
    rest[0] = state[0]
    return rest
