"""Look-ahead: the nearest jerk that is out of everybody's way in time, as softly as the time that is left allows."""

from typing import NamedTuple

from jssa_gym.kernels.ahead import Foresight, predicted_rows
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.projection import violation
from jssa_gym.kernels.stopping import plan_stop
from jssa_gym.kernels.verification import StepAndStop
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.rows import PROJECT, of_rows


class PredictedRows(NamedTuple):
    """Rows from a predicted miss."""

    foresight: Foresight
    """How far ahead is looked, and what counts as too close."""


@jit
def ahead(robot, settings, proposal, memory, nominal, work, told, e):
    """Make rows for those who would come too close if the arm took its step and stopped.

    Arguments as of :mod:`jssa_gym.tick.proposals`. Without any, and where the clipped nominal keeps them all, it stays.
    """
    state, foresight = memory.state[e], proposal.foresight
    integrate(state, work.wanted, settings.dt, work.after)
    plan_stop(work.after, settings.stop_limits, settings.dt, work.next)
    motion = StepAndStop(state, work.wanted, work.after, work.next, settings.dt)
    people = work.agents[: memory.tracks.shape[1]]
    count, least, distance, row, column = predicted_rows(robot, motion, people, foresight, work)
    told["phi"] = foresight.d_min**2 - least * abs(least)
    told["distance"], told["row"], told["column"] = distance, row, column
    if not violation(work.L, work.S, count, work.wanted) > 0.0:
        return 0 if told["phi"] == told["phi"] else codes.INDEX
    told["rows"] = count
    return PROJECT


@jit
def after_ahead(robot, settings, proposal, memory, nominal, work, told, e):
    """What became of the rows; they are linear in the jerk, once is enough."""
    return of_rows(told)
