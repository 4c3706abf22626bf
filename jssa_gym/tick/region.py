"""People who come and go, where a region is watched: complete frames of it, and who belongs to which track.

A frame is complete if everything of people that was inside of the region at its moment is in it, measured, or was
measured before and is a track since. So whatever is no track was outside of the region at the last complete frame or
later, and can have come into it no farther than it is fast; the verified stop keeps off that
(:func:`~jssa_gym.kernels.verification.keeps_clear`).
"""

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.people import LENGTH_ROUNDING, STAMP_ROUNDING, within
from jssa_gym.kernels.region import deepest, outside
from jssa_gym.kernels.rest import at_rest


@jit
def watches(settings):
    """Whether a region is watched."""
    return settings.pieces.shape[0] > 1


@jit
def entered(settings, since, error):
    """How far into the region who was outside of it can have come [m]; never is long ago."""
    return settings.entry_speed * max(since, 0.0) + error


@jit
def came_in(settings, memory, ends, radius, stamp, j, e):
    """Whether sample j can be of somebody who was outside of the region at the last complete frame."""
    # the place is uncertain twice: by the sample's error, and by that of the edge as it is seen
    reach = entered(settings, stamp - memory.arm[e]["frame"], 2.0 * settings.position_error) + LENGTH_ROUNDING
    return deepest(ends[0, j], ends[1, j], radius[j], settings.faces, settings.pieces) <= reach


@jit
def fits(settings, memory, ends, radius, stamp, j, k, e):
    """Whether sample j can be of the body part of track k, and would be believed there: not if it is the older."""
    track = memory.tracks[e, k]
    if not (track["stamp"] > -np.inf and stamp >= track["stamp"] - STAMP_ROUNDING):
        return False
    elapsed = max(stamp - track["stamp"], 0.0)
    return within(ends, j, radius[j], track, elapsed, settings.position_error)


@jit
def left(settings, memory, time, k, e):
    """Whether the body part of track k is wholly outside of the region by now, wherever it may be."""
    track = memory.tracks[e, k]
    reach = max(track["speed"][0], track["speed"][1]) * (time - track["stamp"]) + settings.position_error
    start, end = track["trusted"][0], track["trusted"][1]
    return outside(start, end, track["radius"] + reach, settings.faces, settings.pieces)


@jit
def _doubted(memory, k, e):
    """Whether the last sample of a track was not believed: then somebody may be elsewhere who is no track."""
    track = memory.tracks[e, k]
    for row in range(4):
        for i in range(3):
            if track["seen"][row, i] != track["trusted"][row, i]:
                return True
    return False


@jit
def as_they_were(arms, time, ends, radius, age, valid):
    """Whether each sample is of the track in its place, and nobody has left: then nothing is to be sorted out."""
    settings, memory = arms.settings, arms.memory
    for k in range(radius.shape[0]):
        if not memory.tracks[0, k]["stamp"] > -np.inf:
            return False
        if valid[k]:
            if not fits(settings, memory, ends, radius, time - age[k], k, k, 0):
                return False
        elif left(settings, memory, time, k, 0) and not _doubted(memory, k, 0):
            return False
    return True


@jit
def sample_fits(arms, time, ends, radius, age, j, k):
    """:func:`fits` of a single arm."""
    return fits(arms.settings, arms.memory, ends, radius, time - age[j], j, k, 0)


@jit
def sample_came_in(arms, time, ends, radius, age, j):
    """:func:`came_in` of a single arm."""
    return came_in(arms.settings, arms.memory, ends, radius, time - age[j], j, 0)


@jit
def track_left(arms, time, k, listed):
    """:func:`left` of a single arm; of who is ``listed`` still, not if another place was shown and not believed."""
    return left(arms.settings, arms.memory, time, k, 0) and not (listed and _doubted(arms.memory, k, 0))


@jit
def meet_newcomers(settings, memory, scene, time, e):
    """Before samples become tracks: the stored stop is not verified against who has appeared where nobody could be.

    Nor against whoever may go on faster than somebody who is unseen.
    """
    for k in range(memory.tracks.shape[1]):
        if memory.tracks[e, k]["stamp"] > -np.inf or not scene.valid[e, k]:
            continue
        stamp = time - scene.age[e, k]
        covered = came_in(settings, memory, scene.ends[e], scene.radius[e], stamp, k, e)
        covered = covered and memory.growth[e, k] <= settings.entry_speed
        if not (covered or at_rest(memory.expected[e])):
            memory.arm[e]["verified"] = False


@jit
def _all_believed(memory, scene, time, e):
    """Whether the last sample of everybody, in this tick or before, has become their track's."""
    for k in range(memory.tracks.shape[1]):
        track = memory.tracks[e, k]
        if not track["stamp"] > -np.inf or _doubted(memory, k, e):
            return False
        # one that is frozen is as old as it was when it came first; one that cannot be read was not taken in at all
        if scene.valid[e, k] and not track["stamp"] >= time - scene.age[e, k] - STAMP_ROUNDING:
            return False
    return True


@jit
def take_frame(settings, memory, scene, time, e):
    """After samples became tracks: note when the frame was, if it is complete; whether the last one is not too old."""
    arm, age = memory.arm[e], scene.now[e]["frame"]
    if np.isfinite(age) and age >= -STAMP_ROUNDING and _all_believed(memory, scene, time, e):
        arm["frame"] = max(arm["frame"], time - max(age, 0.0))
    return time - arm["frame"] <= settings.max_age + STAMP_ROUNDING
