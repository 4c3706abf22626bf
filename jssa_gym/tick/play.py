"""The ticks of position controllers in which nothing happens, for many arms, one after the other.

An arm plays its buffer, is slowed along its path, brakes while somebody else commands it, or rests. What happens beside
that, :class:`~jssa_gym.control.JPC` knows: :func:`play_all` leaves those ticks to it, untouched.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.jit import jit, jit_owning
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.pacing import go_on, offer, ticks_of
from jssa_gym.kernels.records import STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.kernels.vector import copy, copy_rows, fill

RESTS, READS, YIELDS = range(3)
"""What an arm without a path does: it rests, reads a buffer, or brakes as somebody else commands it."""

DISTURBED = (1e-5, 1e-5, 1e-3)
"""Deviation from the commanded state that means interference [rad, rad/s, rad/s²]; float32 actions make less."""

ARRIVED = (1e-7, 1e-6, 1e-5)
"""Distance from the end of a path [rad], and what is left of the motion there [rad/s, rad/s²], from which on the arm is
brought to rest."""

PLAYER = np.dtype(
    [
        ("paced", np.bool_),  # whether there is a path
        ("does", np.int64),  # what it does without one
        ("tick", np.int64),  # since the episode began
        ("wake", np.int64),  # tick in which something happens, whatever the arm does
        ("length", np.int64),  # ticks of what is played
        ("read", np.int64),  # of which are over
        ("mark", np.int64),  # after so many of them the next waypoint is met
        ("obeyed", np.int64),  # ticks for which commands have been obeyed
        ("quiet", np.int64),  # ... after so many the arm counts as its own again
        ("met", np.int64),  # waypoints that have been met
        ("visited", np.int64),  # ... and that count as met once somebody else has brought the arm there
    ],
    align=True,
)
"""What is remembered of one arm's controller, but for arrays."""


class Players(NamedTuple):
    """What controllers are doing, shapes without the leading axis of arms."""

    now: NDArray
    """Shape () of ``PLAYER``."""
    jerks: NDArray[np.float64]
    """What is played, shape (H, n) [rad/s³] ..."""
    states: NDArray[np.float64]
    """... and where it leads, shape (H + 1, 3, n); H is that of the longest."""
    expected: NDArray[np.float64]
    """Where the last command has led, shape (3, n); without a path."""
    stops: NDArray
    """Scratch, shape (n,) of ``STOP``, the same for all arms."""


def players(arms: int, n: int, ticks: int = 0) -> Players:
    """Controllers in whose first tick something happens; with room for plans of so many ticks."""
    return Players(
        records(arms, PLAYER),
        np.zeros((arms, ticks, n)),
        np.zeros((arms, ticks + 1, 3, n)),
        np.zeros((arms, 3, n)),
        records(n, STOP),
    )


@jit_owning
def _plan(players, tau, e):
    """What an arm plays, as :func:`~jssa_gym.kernels.override.along` reads it."""
    length = players.now[e]["length"]
    return players.jerks[e, :length], players.states[e, : length + 1], tau


@jit
def _near(state, other, off):
    """Whether two joint states (3, n) are no farther from each other than that, row by row; NaN is."""
    for row in range(3):
        for j in range(state.shape[1]):
            if not abs(state[row, j] - other[row, j]) <= off[row]:
                return False
    return True


@jit
def _arrived(state, end):
    """Whether an arm is where its path ends (3, n), nearly at rest."""
    for j in range(state.shape[1]):
        if not (abs(state[0, j] - end[0, j]) <= ARRIVED[0] and abs(state[1, j]) <= ARRIVED[1]):
            return False
        if not abs(state[2, j]) <= ARRIVED[2]:
            return False
    return True


@jit
def _brake(state, bounds, tau, stops, jerk):
    """The first jerk of the stop on the grid, see :func:`jssa_gym.control.moves.brake_jerk`."""
    fill(jerk, 0.0)
    if plan_stop(state, bounds, tau, stops):
        stop_jerk(stops, 0, jerk)


@jit_owning
def _follow(players, paced, state, bounds, tau, jerk, e):
    """A tick on a path; whether nothing happens in it."""
    now, plan = players.now[e], _plan(players, tau, e)
    ticks = ticks_of(plan, paced.pace[e, 0])
    if ticks >= now["mark"] or (ticks == now["length"] and _arrived(state, players.states[e, ticks])):
        return False
    # the first is the nominal; a shield asks for the others
    count = offer(plan, paced, state, paced.kept[e]["margin"], bounds, 1, e)
    if count < 0:
        return False
    now["read"] = ticks
    if count > 0:
        copy(paced.jerks[e, 0], jerk)
    else:
        _brake(state, bounds, tau, players.stops, jerk)
    return True


@jit
def _go_by_itself(players, state, bounds, tau, jerk, e):
    """A tick without a path; whether nothing happens in it."""
    now, expected = players.now[e], players.expected[e]
    obeyed, does, read = _near(state, expected, DISTURBED), now["does"], now["read"]
    if does == YIELDS:
        if obeyed and now["obeyed"] + 1 >= now["quiet"]:
            return False
    elif not obeyed or (does == READS and (read >= now["length"] or read + 1 >= now["mark"])):
        return False
    now["obeyed"] = now["obeyed"] + 1 if obeyed else 0
    if does == YIELDS:
        now["met"] = max(now["met"], now["visited"])
        _brake(state, bounds, tau, players.stops, jerk)
        integrate(state, jerk, tau, expected)
    elif does == READS:
        copy(players.jerks[e, read], jerk)
        copy_rows(players.states[e, read + 1], expected)
        now["read"] = read + 1
    else:
        fill(jerk, 0.0)
    return True


@jit_owning
def play_all(players, paced, state, bounds, tau, asked, jerk):
    """A tick of every arm in which nothing happens.

    Args:
        players, paced: What is remembered of the controllers and of the paces of their paths.
        state: Joint states, shape (E, 3, n).
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        tau: Tick [s].
        asked: Which arms, shape (E,) of bool; what is left is in whose tick something happens, and nothing of them has
            changed.
        jerk: The nominal jerks of the others, shape (E, n) [rad/s³].
    """
    for e in range(asked.shape[0]):
        now = players.now[e]
        if not asked[e] or now["tick"] >= now["wake"]:
            continue
        if now["paced"]:
            done = _follow(players, paced, state[e], bounds, tau, jerk[e], e)
        else:
            done = _go_by_itself(players, state[e], bounds, tau, jerk[e], e)
        if done:
            now["tick"] += 1
            asked[e] = False


@jit
def offer_all(players, paced, state, margin, bounds, tau, asked):
    """What paths offer to shields, for every arm that is ``asked`` and has one; see ``paced.jerks``.

    Args:
        players, paced, bounds, tau: As of :func:`play_all`.
        state: Where the shields take the arms to be, shape (E, 3, n).
        margin: Room that the last nominals' stops left to people, shape (E,) [m].
        asked: Shape (E,) of bool.
    """
    for e in range(asked.shape[0]):
        if asked[e] and players.now[e]["paced"]:
            offer(_plan(players, tau, e), paced, state[e], margin[e], bounds, paced.jerks.shape[1], e)


@jit
def go_on_all(players, paced, tau, choice, asked):
    """Let paths know which alternative was applied, shape (E,), -1 for none; for every arm that is ``asked``."""
    for e in range(asked.shape[0]):
        if asked[e] and players.now[e]["paced"]:
            go_on(_plan(players, tau, e), paced, choice[e], e)
