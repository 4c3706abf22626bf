"""People beside many arms, one after the other: each walks as beside a single one."""

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import translate
from jssa_gym.kernels.walkers import PURSUES, step_walker


@jit
def walk_all(walkers, start, end, radius, live, dt, segments, ends, stuck):
    """:func:`~jssa_gym.kernels.walkers.step_walker` for everybody beside an arm that is ``live``, shape (E,).

    Args:
        walkers: Shape (E,) of ``WALKER``.
        start, end: Their capsules relative to their roots, shape (E, m, 3) [m].
        radius: Shape (m,) [m].
        live: Shape (E,).
        dt: Duration of the step [s].
        segments: The arms' capsules, shape (E, k) of ``SEGMENT``.
        ends: Result, capsules in the world: starts, ends, their velocities, shape (E, 4, m, 3).
        stuck: Result, the numbers of those who need random numbers before they can go on, shape (E,).

    Returns:
        How many are stuck.
    """
    count, links = 0, segments.shape[1]
    link_start, link_end, link_radius = np.empty((links, 3)), np.empty((links, 3)), np.empty(links)
    for e in range(walkers.shape[0]):
        if not live[e]:
            continue
        if walkers[e]["kind"] == PURSUES:
            for i in range(links):
                for c in range(3):
                    link_start[i, c], link_end[i, c] = segments[e, i]["start"][c], segments[e, i]["end"][c]
                link_radius[i] = segments[e, i]["radius"]
        if step_walker(walkers[e : e + 1], start[e], end[e], dt, link_start, link_end, link_radius, radius):
            place_walker(walkers, start, end, e, ends)
        else:
            stuck[count] = e
            count += 1
    return count


@jit
def place_walker(walkers, start, end, e, ends):
    """Put one walker's capsules where the root is; arguments as of :func:`walk_all`."""
    w = walkers[e]
    translate(start[e], end[e], w["root"][0], w["root"][1], w["velocity"][0], w["velocity"][1], ends[e])
