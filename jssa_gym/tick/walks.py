"""People beside many arms, one after the other: each walks as beside a single one."""

import numpy as np

from jssa_gym.kernels.jit import jit, jit_owning
from jssa_gym.kernels.limbs import FLICKS, put_all, step_gesture
from jssa_gym.kernels.motion import translate
from jssa_gym.kernels.walkers import PURSUES, step_walker


@jit_owning
def walk_all(walkers, start, end, radius, live, dt, segments, out):
    """:func:`~jssa_gym.kernels.walkers.step_walker` for everybody beside an arm that is ``live``, shape (E,).

    Args:
        walkers: Shape (E,) of ``WALKER``.
        start, end: Their capsules relative to their roots, shape (E, m, 3) [m].
        radius: Shape (m,) [m].
        live: Shape (E,).
        dt: Duration of the step [s].
        segments: The arms' capsules, shape (E, k) of ``SEGMENT``.
        out: Results, two arrays: capsules in the world (starts, ends and their velocities, shape (E, 4, m, 3)) and the
            numbers of those who need random numbers before they can go on, shape (E,).

    Returns:
        How many need them.
    """
    ends, stuck = out
    count, links = 0, segments.shape[1]
    link_start, link_end, link_radius = np.empty((links, 3)), np.empty((links, 3)), np.empty(links)
    for e in range(walkers.shape[0]):
        if not live[e]:
            continue
        if walkers[e]["kind"] == PURSUES:
            take_links(segments[e], link_start, link_end, link_radius)
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


@jit
def take_links(segments, start, end, radius):
    """An arm's capsules, shape (k,) of ``SEGMENT``, into arrays of shapes (k, 3) and (k,) [m]."""
    for i in range(segments.shape[0]):
        for c in range(3):
            start[i, c], end[i, c] = segments[i]["start"][c], segments[i]["end"][c]
        radius[i] = segments[i]["radius"]


@jit_owning
def gesture_all(gestures, limbs, start, end, live, dt, segments, out):
    """:func:`~jssa_gym.kernels.limbs.step_gesture` for everybody beside an arm that is ``live``.

    ``gestures`` are of shape (E,) of ``GESTURE``, ``limbs`` (E, 2) of ``LIMB``; the rest as of :func:`walk_all`.
    """
    ends, stuck = out
    count, links = 0, segments.shape[1]
    link_start, link_end, link_radius = np.empty((links, 3)), np.empty((links, 3)), np.empty(links)
    for e in range(gestures.shape[0]):
        if not live[e]:
            continue
        if gestures[e]["kind"] == FLICKS:
            take_links(segments[e], link_start, link_end, link_radius)
        if step_gesture(gestures[e : e + 1], limbs[e], dt, link_start, link_end, link_radius):
            place_gesture(gestures, limbs, start, end, e, ends)
        else:
            stuck[count] = e
            count += 1
    return count


@jit
def place_gesture(gestures, limbs, start, end, e, ends):
    """Put one body where it stands and its hands where they are; arguments as of :func:`gesture_all`."""
    g = gestures[e]
    translate(start[e], end[e], g["root"][0], g["root"][1], 0.0, 0.0, ends[e])
    put_all(limbs[e], g["limbs"], ends[e, 1], ends[e, 3])
