"""How somebody moves who was recorded: one step of it, linear between samples; :mod:`jssa_gym.humans` says who.

Of a recording each player has placed no more than the two samples that it is between; all read the same table.
"""

import numpy as np

from jssa_gym.kernels.jit import jit

HOLD, LOOP, BACK_AND_FORTH = range(3)
"""What follows the last sample: nothing, the first, the way back."""

PLAYER = np.dtype(
    [
        ("afterwards", np.int64),
        ("time", np.float64),  # since the beginning [s]
        ("sample", np.int64),  # the last one before the step to come ...
        ("placed", np.int64),  # ... and the one that is placed, with the next
    ],
    align=True,
)
"""Somebody who plays a recording, and where in it."""


@jit
def step_player(player, times, samples, dt, ends):
    """Move on for ``dt`` [s] and choose the velocities of the step to come.

    Args:
        player: Shape (1,) of ``PLAYER``.
        times: Of the recording's samples, the first is 0, shape (T,) [s].
        samples: Starts and ends of the capsules in sample ``placed`` and the next, shape (2, 2, m, 3) [m].
        dt: Duration [s].
        ends: Starts, ends and their velocities, shape (4, m, 3) [m, m/s]; the result too.

    Returns:
        Whether they are chosen; if not, :func:`aim_player` has to be asked with ``sample`` and the next placed.
    """
    for row in range(2):
        for i in range(ends.shape[1]):
            for c in range(3):
                ends[row, i, c] += ends[row + 2, i, c] * dt
    player[0]["time"] += dt
    return aim_player(player, times, samples, dt, ends)


@jit
def aim_player(player, times, samples, dt, ends):
    """The second half of :func:`step_player`: velocities to where the recording is now, from wherever a step led."""
    p, last = player[0], times.shape[0] - 1
    time, k = _time_played(p, times[last]), p["placed"]
    while k < last - 1 and times[k + 1] <= time:
        k += 1
    while k > 0 and times[k] > time:
        k -= 1
    p["sample"] = k
    if k != p["placed"]:
        return False
    share = (time - times[k]) / (times[k + 1] - times[k])
    for row in range(2):
        for i in range(ends.shape[1]):
            for c in range(3):
                before, after = samples[0, row, i, c], samples[1, row, i, c]
                ends[row + 2, i, c] = (before + share * (after - before) - ends[row, i, c]) / dt
    return True


@jit
def _time_played(p, duration):
    """Where in the recording it is [s]."""
    if p["afterwards"] == HOLD:
        return min(p["time"], duration)
    if p["afterwards"] == LOOP:
        return p["time"] % duration
    return duration - abs(duration - p["time"] % (2.0 * duration))
