"""People beside many arms, one after the other: each moves as beside a single one.

Who lacks something before they can go on, random numbers or samples of a recording, waits: whoever asked supplies it
and asks once more, and all that wait go on.
"""

import numpy as np

from jssa_gym.kernels.jit import jit, jit_owning
from jssa_gym.kernels.limbs import FLICKS, go_on, put_all, step_gesture
from jssa_gym.kernels.motion import translate
from jssa_gym.kernels.playing import aim_player, step_player
from jssa_gym.kernels.walkers import PURSUES, choose, step_walker


@jit_owning
def walk_all(walkers, body, live, dt, segments, ends, waits, again):
    """:func:`~jssa_gym.kernels.walkers.step_walker` for everybody beside an arm that is ``live``.

    Args:
        walkers: Shape (E,) of ``WALKER``.
        body: Three arrays: starts and ends of their capsules relative to their roots, shape (E, m, 3) [m], and radii
            that all share, shape (m,) [m].
        live: Shape (E,); ``waits`` itself if ``again``.
        dt: Durations of the step, shape (E,) [s].
        segments: The arms' capsules, shape (E, k) of ``SEGMENT``.
        ends: Result: capsules in the world, starts, ends and their velocities, shape (E, 4, m, 3).
        waits: Result: who needs random numbers before they can go on, shape (E,).
        again: Whether these have them now, and go on.

    Returns:
        How many wait.
    """
    start, end, radius = body
    count, links = 0, segments.shape[1]
    link_start, link_end, link_radius = np.empty((links, 3)), np.empty((links, 3)), np.empty(links)
    for e in range(walkers.shape[0]):
        if not live[e]:
            continue
        if again:
            chosen = choose(walkers[e : e + 1], dt[e])
        else:
            if walkers[e]["kind"] == PURSUES:
                take_links(segments[e], link_start, link_end, link_radius)
            chosen = step_walker(
                walkers[e : e + 1], start[e], end[e], dt[e], link_start, link_end, link_radius, radius
            )  # fmt: skip
        waits[e] = not chosen
        if chosen:
            w = walkers[e]
            translate(start[e], end[e], w["root"][0], w["root"][1], w["velocity"][0], w["velocity"][1], ends[e])
        else:
            count += 1
    return count


@jit
def take_links(segments, start, end, radius):
    """An arm's capsules, shape (k,) of ``SEGMENT``, into arrays of shapes (k, 3) and (k,) [m]."""
    for i in range(segments.shape[0]):
        for c in range(3):
            start[i, c], end[i, c] = segments[i]["start"][c], segments[i]["end"][c]
        radius[i] = segments[i]["radius"]


@jit_owning
def gesture_all(gestures, body, live, dt, segments, ends, waits, again):
    """:func:`~jssa_gym.kernels.limbs.step_gesture` for everybody beside an arm that is ``live``.

    ``gestures`` are two arrays, shape (E,) of ``GESTURE`` and (E, 2) of ``LIMB``; the rest as of :func:`walk_all`.
    """
    (people, limbs), (start, end, _) = gestures, body
    count, links = 0, segments.shape[1]
    link_start, link_end, link_radius = np.empty((links, 3)), np.empty((links, 3)), np.empty(links)
    for e in range(people.shape[0]):
        if not live[e]:
            continue
        g = people[e]
        if g["kind"] == FLICKS:
            take_links(segments[e], link_start, link_end, link_radius)
        if again:
            chosen = go_on(people[e : e + 1], limbs[e], dt[e], link_start, link_end, link_radius)
        else:
            chosen = step_gesture(people[e : e + 1], limbs[e], dt[e], link_start, link_end, link_radius)
        waits[e] = not chosen
        if chosen:
            translate(start[e], end[e], g["root"][0], g["root"][1], 0.0, 0.0, ends[e])
            put_all(limbs[e], g["limbs"], ends[e, 1], ends[e, 3])
        else:
            count += 1
    return count


@jit
def play_all(players, times, samples, live, dt, ends, waits, again):
    """:func:`~jssa_gym.kernels.playing.step_player` for everybody beside an arm that is ``live``.

    Args:
        players: Shape (E,) of ``PLAYER``.
        times: Of the samples of the one recording that all play, shape (T,) [s].
        samples: What each has placed of it, shape (E, 2, 2, m, 3) [m].
        live, dt, ends, again: As of :func:`walk_all`; ``ends`` are where they were, too.
        waits: Result: who needs other samples placed, shape (E,).

    Returns:
        How many wait.
    """
    count = 0
    for e in range(players.shape[0]):
        if not live[e]:
            continue
        if again:
            chosen = aim_player(players[e : e + 1], times, samples[e], dt[e], ends[e])
        else:
            chosen = step_player(players[e : e + 1], times, samples[e], dt[e], ends[e])
        waits[e] = not chosen
        if not chosen:
            count += 1
    return count
