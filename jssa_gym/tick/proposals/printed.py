"""The paper's algorithm to the letter: Eq. (13) as printed, from the present, projected once."""

from typing import NamedTuple

import numpy as np

from jssa_gym.kernels.index import Index
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.printed import measure_present, printed_rows
from jssa_gym.kernels.projection import violation
from jssa_gym.tick import codes
from jssa_gym.tick.proposals.rows import PROJECT, of_rows


class PrintedRows(NamedTuple):
    """Rows as the paper prints them; fields as of :class:`~jssa_gym.tick.proposals.exact.ExactRows`."""

    index: Index
    closest: bool
    authority: float


@jit
def printed(robot, settings, proposal, memory, nominal, work, told, e):
    """Make the rows of Eq. (13) as printed; arguments as of :mod:`jssa_gym.tick.proposals`."""
    humans = memory.tracks.shape[1]
    agents = work.agents[:humans]
    told["phi"] = -np.inf
    row, column, told["distance"] = measure_present(
        robot.links, robot.capsules, memory.state[e], agents, work.frames, work.segments, work.pairs
    )
    told["row"], told["column"] = row, column
    if row < 0:
        return 0
    only = row * humans + column if proposal.closest else -1
    authority = 0.0 if proposal.closest else proposal.authority
    count = printed_rows(
        work.frames, work.segments, agents, work.pairs, work.lower, work.upper, settings.dt, proposal.index,
        only, authority, work.L, work.S, work.owner,
    )  # fmt: skip
    told["attempt"] = count
    left = violation(work.L, work.S, count, work.wanted)
    if left <= 0.0:
        told["slack"] = max(left, 0.0)
        return _index_of_printed(left, work, told)
    told["rows"] = count
    return PROJECT


@jit
def after_printed(robot, settings, proposal, memory, nominal, work, told, e):
    """Take down what is left of the rows, and their index; as :func:`printed`."""
    left = told["slack"]
    told["slack"] = max(left, 0.0)
    return _index_of_printed(left, work, told)


@jit
def _index_of_printed(left, work, told):
    """The index as printed is its own row's S - L u; what became of the rows, as a code."""
    for k in range(told["attempt"]):
        gap = work.S[k]
        for j in range(work.wanted.shape[0]):
            gap -= work.L[k, j] * work.wanted[j]
        if not gap <= told["phi"]:
            told["phi"] = gap
            if np.isnan(gap):
                break
    return of_rows(told) if left < np.inf and told["phi"] < np.inf else codes.PRINTED_ROW


@jit
def unforeseen(robot, settings, proposal, memory, jerk, work, told, e):
    """Index, distance and pair at the end of the step are not computed."""
    told["phi"], told["distance"] = np.nan, np.nan
    told["row"], told["column"] = -1, -1
