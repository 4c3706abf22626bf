"""The jerk-bounded position controller with plans that yield: slowed along its path, it is not interrupted."""

import numpy as np

from jssa_gym.control.jpc import JPC, Event
from jssa_gym.control.moves import brake_jerk, plan_brake
from jssa_gym.control.path import PacedPath
from jssa_gym.control.plan import Plan
from jssa_gym.control.rejoin import Clear, Route, rejoin
from jssa_gym.robots import JointLimits
from jssa_gym.tick import play
from jssa_gym.types import Array, JointState

_ARRIVED = np.array(play.ARRIVED)[:, None]
"""Distance from the end of a path, and what is left of the motion there, from which on the arm is brought to rest."""

_SLOW = 0.3
"""Pace below which a new plan begins where the arm is."""

_HERE = -1
"""In place of a tick of the plan: a plan was asked for that begins where the arm is held up."""


class YieldingJPC(JPC):
    """Plays the host's plans as a :class:`~jssa_gym.control.path.PacedPath`.

    In every tick: :meth:`step`; then :attr:`path`, if there is one, is offered to a shield, or told what was taken.
    What the shield slows along the path goes on. Thrown off it, the arm goes back to a point ahead of it, see
    :func:`~jssa_gym.control.rejoin.rejoin`; where there is no way back it brakes and asks for a new plan.

    Args:
        limits: Of the joints.
        dt: Tick [s].
        schedule: Whether plans are to make up for time that is lost.
        patience: See :class:`~jssa_gym.control.jpc.JPC`.
        clear: What ways back are checked by.

    Raises:
        ParameterError: An argument is out of range.
    """

    def __init__(
        self, limits: JointLimits, dt: float, clear: Clear, *, schedule: bool = False, patience: float = 2.5
    ) -> None:
        self._schedule, self._clear = schedule, clear
        super().__init__(limits, dt, patience=patience)

    def reset(self) -> None:
        """Forget plan, task and requests: a new episode."""
        super().reset()
        self.path: PacedPath | None = None
        """What is being played; None while there is nothing to be slowed."""
        self._route: Route | None = None
        self._override = 1.0  # the pace that the last path asked for
        self._from = 0  # tick of the plan that the plan that was asked for goes on from

    def _notice(self, state: Array) -> None:
        path = self.path
        if path is None:
            super()._notice(state)
            return
        self._count_marks(path)
        if not path.astray(state) or self._go_back(path, state):
            return
        self._leave()
        self._expected = np.full_like(state, np.nan)  # nothing is as it was commanded
        super()._notice(state)

    def _count_marks(self, path: PacedPath) -> None:
        self._read = path.ticks
        marks = path.plan.marks
        while self._passed < len(marks) and marks[self._passed] <= self._read:
            self._passed += 1
            if self._current:
                self.met += 1

    def _go_back(self, path: PacedPath, state: Array) -> bool:
        """Try to rejoin the path ahead; whether there is a way."""
        if self._route is None or not np.all(np.isfinite(state)):
            return False
        at = self._route.at(self._read, state[0])
        found = rejoin(self._route, at, state, self.limits, self._clear)
        if found is None:
            return False
        self._play(found, self._current)
        self.request, self._answer = None, None  # begins on what has just been left
        return True

    def _play(self, route: Route, current: bool) -> None:
        if self.path is not None:
            self._override = self.path.override
        self._route = route
        self.path = PacedPath(route.plan, self.limits, pace=self._override, schedule=self._schedule)
        super()._take(route.plan, current=current)

    def _leave(self) -> None:
        """There is no path any more."""
        if self.path is not None:
            self._override = self.path.override
        self.path, self._route = None, None
        self._expected = None

    def _take(self, plan: Plan, *, current: bool) -> None:
        if current:
            self._play(Route(plan, plan), current)
        else:
            self._leave()
            super()._take(plan, current=current)

    def _end_of_buffer(self) -> None:
        if self.path is None:
            super()._end_of_buffer()

    def _future(self, state: Array) -> tuple[Array, int]:
        """Ahead on the path by what the host takes; where the arm hardly gets on, from rest where it is.

        Going on at full speed, a plan would lead past where the arm is now and back, which at a slow pace takes long.
        """
        path = self.path
        if path is not None and path.pace < _SLOW:
            self._from = _HERE
            return np.concatenate([state[:1], np.zeros_like(state[1:])]), self.tick
        begin, begins = super()._future(state)
        self._from = self._read + begins - self.tick
        return begin, begins

    def _begin(self, state: Array) -> None:
        """Begin with the answer: at rest at once, in motion where the path gets to where it was asked for."""
        path, plan = self.path, self._answer
        if path is None or plan is None:
            super()._begin(state)
            return
        self.request, self._answer = None, None
        if self._from == _HERE:
            found = rejoin(Route(plan, plan), 0, state, self.limits, self._clear)
            if found is None:
                self._ask(state)
                return
            self._on(Event.PLAN)
            self._waits = self.patience
            self._play(found, current=True)
            return
        if path.ticks > self._from:
            self._ahead *= 2
            self._ask(state)
            return
        self._on(Event.PLAN)
        self._waits = self.patience
        played, old = path.ticks, path.plan
        jerk = np.concatenate([old.jerk[played : self._from], plan.jerk])
        marks = tuple(self._from - played + mark for mark in plan.marks)
        both = Plan.follow(old.states[played], jerk, self.dt, marks)
        self._route = Route(both, both)
        self.path = path.onto(both, played)
        super()._take(both, current=True)

    def _jerk(self, state: Array) -> Array:
        path = self.path
        if path is None or self._arrive(path, state):
            return super()._jerk(state)
        jerks = path.alternatives(state, path.margin)
        return jerks[0] if len(jerks) else brake_jerk(JointState(*state), self.limits, self.dt)

    def _arrive(self, path: PacedPath, state: Array) -> bool:
        """Bring what is left of the motion at the end of a path to rest on the grid; whether the arm is there."""
        end = np.zeros_like(state)
        end[0] = path.plan.states[-1, 0]
        if not (path.ended and np.all(np.abs(state - end) <= _ARRIVED)):
            return False
        current = self._current
        self._leave()
        super()._take(plan_brake(JointState(*state), self.limits, self.dt), current=current)
        self._passed = len(self._plan.marks) if self._plan is not None else 0  # no waypoint
        super()._end_of_buffer()
        return True
