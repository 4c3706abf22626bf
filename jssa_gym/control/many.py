"""Position controllers of many arms: what nothing happens in is compiled, the rest is each controller's own."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jssa_gym.control.jpc import JPC, Phase
from jssa_gym.control.path import PacedPath
from jssa_gym.control.plan import Plan
from jssa_gym.control.yielding import YieldingJPC
from jssa_gym.kernels.pacing import Paces, paced
from jssa_gym.robots import JointLimits
from jssa_gym.tick.play import READS, RESTS, YIELDS, Players, go_on_all, offer_all, play_all, players
from jssa_gym.types import Array
from jssa_gym.vectors import Mask

NEVER = np.iinfo(np.int64).max
"""No tick is as late."""

_DOES = {
    Phase.IDLE: RESTS,
    Phase.WAITING: RESTS,
    Phase.TRACKING: READS,
    Phase.SETTLING: READS,
    Phase.YIELDING: YIELDS,
}


class ManyJPC:
    """Plays the ticks of controllers in which nothing happens, and knows which others there are.

    Between two calls the numbers of controllers that go on by themselves are here. Whoever wants to do something with
    one of them, even to let it :meth:`~jssa_gym.control.JPC.step`, fetches it before and returns it afterwards.

    Args:
        controllers: One for each arm.
        limits: Of the joints of all of them.
        dt: Tick [s].
    """

    def __init__(self, controllers: Sequence[JPC], limits: JointLimits, dt: float) -> None:
        count, n = len(controllers), len(limits.jerk)
        self._controllers, self._bounds, self._dt = controllers, limits.bounds(), dt
        self._players: Players = players(count, n)
        self._paced: Paces = paced(count, n)
        self._plans: list[Plan | None] = [None] * count

    # ---- ticks -----------------------------------------------------------------------------------------

    def play(self, state: Array, visited: NDArray[np.int64], asked: Mask, jerk: Array) -> Mask:
        """The next tick of those arms in which nothing happens.

        Args:
            state: Joint states, shape (E, 3, n).
            visited: As of :meth:`~jssa_gym.control.JPC.count`, shape (E,).
            asked: Which arms, shape (E,).
            jerk: Their jerks, shape (E, n) [rad/s³].

        Returns:
            In which of them something happens, shape (E,): they have not moved on.
        """
        left = asked.copy()
        self._players.now["visited"] = visited
        play_all(self._players, self._paced, state, self._bounds, self._dt, left, jerk)
        return left

    # ---- paths, as shields ask for them -------------------------------------------------------------------

    @property
    def override(self) -> Array:
        """The paces that paths asked for last, shape (E,); 1 where there is none."""
        return np.where(self._players.now["paced"], self._paced.kept["override"], 1.0)

    def alternatives(self, state: Array, margin: Array, asked: Mask) -> tuple[Array, NDArray[np.int64]]:
        """As of :class:`~jssa_gym.control.PacedPath`, of those who are ``asked`` and have a path.

        Args:
            state: Joint states, shape (E, 3, n).
            margin: Shape (E,) [m].
            asked: Shape (E,).

        Returns:
            Jerks, shape (E, 8, n) [rad/s³], and how many of them count, shape (E,).
        """
        self._paced.kept["count"] = 0
        offer_all(self._players, self._paced, state, margin, self._bounds, self._dt, asked)
        return self._paced.jerks, self._paced.kept["count"].copy()

    def took(self, choice: NDArray[np.int64], asked: Mask) -> None:
        """The decisions on the last alternatives, shape (E,): numbers of those that were applied, -1 for none."""
        go_on_all(self._players, self._paced, self._dt, choice, asked)

    # ---- controllers that something happens to ---------------------------------------------------------------

    def fetch(self, e: int) -> None:
        """Bring the controller of arm ``e`` to the present."""
        jpc, now = self._controllers[e], self._players.now[e]
        jpc.tick, jpc._read = int(now["tick"]), int(now["read"])
        jpc._obeyed, jpc.met = int(now["obeyed"]), int(now["met"])
        path = _path_of(jpc)
        if path is not None:
            for own, many in zip(path.paced[:3], self._paced[:3], strict=True):
                own[0] = many[e]
        else:
            jpc._expected = self._players.expected[e].copy()

    def take_back(self, e: int, wake: int) -> None:
        """Go on with the controller of arm ``e``, until tick ``wake`` at most."""
        jpc, now, path = self._controllers[e], self._players.now[e], _path_of(self._controllers[e])
        now["tick"], now["read"], now["obeyed"], now["met"] = jpc.tick, jpc._read, jpc._obeyed, jpc.met
        now["wake"], now["quiet"], now["paced"] = min(wake, _wakes(jpc)), jpc.quiet, path is not None
        now["does"] = _DOES[jpc.phase]
        plan = jpc._plan
        if path is not None:
            plan = path.plan
            for own, many in zip(path.paced[:-1], self._paced[:-1], strict=True):
                many[e] = own[0]
        elif jpc._expected is not None:
            self._players.expected[e] = jpc._expected
        if plan is not None and plan is not self._plans[e]:
            self._put(plan, e)
        now["length"] = len(plan) if plan is not None else 0
        counts = plan is not None and (path is not None or (jpc.phase is Phase.TRACKING and jpc._current))
        marks = plan.marks[jpc._passed :] if counts and plan is not None else ()
        now["mark"] = marks[0] if marks else NEVER

    def _put(self, plan: Plan, e: int) -> None:
        """Take down what arm ``e`` plays."""
        count, room = self._players.jerks.shape[:2]
        if len(plan) > room:
            more = players(count, plan.jerk.shape[1], max(len(plan), 2 * room))
            for whole, part in zip(more[1:3], self._players[1:3], strict=True):
                whole[:, : part.shape[1]] = part
            self._players = self._players._replace(jerks=more.jerks, states=more.states)
        self._players.jerks[e, : len(plan)], self._players.states[e, : len(plan) + 1] = plan.jerk, plan.states
        self._plans[e] = plan


def _path_of(jpc: JPC) -> PacedPath | None:
    return jpc.path if isinstance(jpc, YieldingJPC) else None


def _wakes(jpc: JPC) -> int:
    """The tick in which something happens to a controller, whatever its arm does; it may be the next one."""
    request, answer, tick = jpc.request, jpc._answer, jpc.tick
    if answer is not None and request is not None and jpc.phase in (Phase.WAITING, Phase.TRACKING):
        return tick if _path_of(jpc) is not None else request.begins
    if jpc.phase is Phase.WAITING and not jpc.open:
        return tick
    asks = jpc.open and jpc.phase is not Phase.YIELDING and not (jpc.phase is Phase.TRACKING and jpc._current)
    if asks and (request is None or jpc.phase is Phase.IDLE):
        return tick
    return jpc._asked + jpc._waits if asks and answer is None else NEVER
