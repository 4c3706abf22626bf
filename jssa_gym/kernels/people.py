"""Which measurements of people are believed."""

import numpy as np

from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.occupancy import STEADY, SWERVED, UNCONFIRMED
from jssa_gym.kernels.vector import add, dot, scale, subtract

GOOD, UNMEASURED, OLDER, FROZEN, JUMPED, PERSON, NEGATIVE, UNREADABLE, HOLLOW = range(9)
"""What became of a sample; from PERSON on whoever delivers it cannot be relied on at all."""

COVERED, LOST, NEVER, BROKEN = range(4)
"""Whether a capsule's trusted sample can stand for it, from best to worst."""

CLAIMS_MOTION = 0.05
"""Speed from which a measurement says that it will not be the same next time [m/s]."""

STAMP_ROUNDING = 1e-9
"""Stamps this close are one [s]: they are differences of times."""

ANCHORED = 0.25
"""How long samples are compared with one from before [s]: what errors of velocity hide of an acceleration between
neighbouring samples, they hide the less of the longer it lasts."""

LENGTH_ROUNDING = 1e-6
"""Added to what an end may have moved [m]."""

SPEED_ROUNDING = 1e-6
"""Added to what its velocity may have changed by [m/s]."""


@jit
def _readable(ends, j, radius):
    """Whether all numbers of a sample are finite and the radius is one."""
    for row in range(4):
        for k in range(3):
            if not np.isfinite(ends[row, j, k]):
                return False
    return np.isfinite(radius) and radius >= 0.0


@jit
def _repeated(ends, j, track):
    """Whether a sample is bit for bit the last one although that one claimed to move."""
    for row in range(4):
        for k in range(3):
            # what has never been seen is NaN and differs from everything
            if ends[row, j, k] != track["seen"][row, k]:
                return False
    fastest = max(dot(ends[2, j], ends[2, j]), dot(ends[3, j], ends[3, j]))
    return fastest > CLAIMS_MOTION * CLAIMS_MOTION


@jit
def within(ends, j, radius, track, elapsed, error):
    """Whether both ends are where they can have come from the trusted ones; a radius that changes moves the surface."""
    for row in range(2):
        allowed = track["speed"][row] * elapsed + 2.0 * error + LENGTH_ROUNDING
        left = allowed - abs(radius - track["radius"])
        if not left >= 0.0:
            return False
        way = subtract(ends[row, j], track["trusted"][row])
        if not dot(way, way) <= left * left:
            return False
    return True


@jit
def _strays(ends, j, thicker, before, elapsed, error, track):
    """Whether an end moved, or changed its velocity, since a sample before by more than its bound lets it."""
    bound, off = track["acceleration"], track["velocity_error"]
    drift = off * elapsed + bound * elapsed * elapsed / 2.0 + 2.0 * error + LENGTH_ROUNDING
    drift -= abs(thicker)
    change = bound * elapsed + 2.0 * off + SPEED_ROUNDING
    if not drift >= 0.0:
        return True
    for row in range(2):
        turn = subtract(ends[row + 2, j], before[row + 2])
        way = subtract(ends[row, j], add(before[row], scale(before[row + 2], elapsed)))
        if not (dot(turn, turn) <= change * change and dot(way, way) <= drift * drift):
            return True
    return False


@jit
def _swerves(ends, j, radius, track, stamp, error):
    """Whether an end breaks its acceleration bound, since it was last trusted or since its anchor.

    Or says that it is faster than its speed bound: then one of the two bounds does not hold.
    """
    for row in range(2):
        fastest = track["speed"][row] + track["velocity_error"] + SPEED_ROUNDING
        if not dot(ends[row + 2, j], ends[row + 2, j]) <= fastest * fastest:
            return True
    elapsed = max(stamp - track["stamp"], 0.0)
    if _strays(ends, j, radius - track["radius"], track["trusted"], elapsed, error, track):
        return True
    since = max(stamp - track["anchor_stamp"], 0.0)
    return _strays(ends, j, radius - track["anchor_radius"], track["anchor"], since, error, track)


@part
def _judge(time, ends, j, radius, age, valid, person, error, track):
    """Take in one capsule's sample, or not; what became of it."""
    if person != track["person"]:
        return PERSON
    if not valid:
        return UNMEASURED
    if not (_readable(ends, j, radius) and np.isfinite(age)):
        return UNREADABLE
    if radius == 0.0:
        return HOLLOW
    if age < -STAMP_ROUNDING:
        return NEGATIVE
    stamp = time - max(age, 0.0)
    verdict = GOOD
    if _repeated(ends, j, track):
        # the same sample again, whatever its stamp says: it is as old as when it came first
        if stamp > track["first"] + STAMP_ROUNDING:
            verdict = FROZEN
        stamp = min(stamp, track["first"])
    else:
        for row in range(4):
            for k in range(3):
                track["seen"][row, k] = ends[row, j, k]
        track["first"] = stamp
    if track["stamp"] > -np.inf:
        if stamp < track["stamp"] - STAMP_ROUNDING:
            return max(verdict, OLDER)
        elapsed = max(stamp - track["stamp"], 0.0)
        if track["acceleration"] > 0.0 and _swerves(ends, j, radius, track, stamp, error):
            # who has broken the bound once is not granted it again
            track["steady"] = SWERVED
        if not within(ends, j, radius, track, elapsed, error):
            return JUMPED
        # neither a sample that is not believed confirms anything nor one of the same moment
        if track["acceleration"] > 0.0 and track["steady"] == UNCONFIRMED and elapsed > STAMP_ROUNDING:
            track["steady"] = STEADY
    if track["acceleration"] > 0.0 and stamp - track["anchor_stamp"] >= ANCHORED:
        for row in range(4):
            for k in range(3):
                track["anchor"][row, k] = ends[row, j, k]
        track["anchor_radius"], track["anchor_stamp"] = radius, stamp
    for row in range(4):
        for k in range(3):
            track["trusted"][row, k] = ends[row, j, k]
    track["radius"] = radius
    track["stamp"] = stamp
    return verdict


@jit
def judge_people(time, ends, radius, age, valid, person, error, max_age, tracks, out, out_radius, out_age):
    """Take in a sample of every capsule and say what can be relied on.

    Args:
        time: Present, finite or inf, never earlier than in the call before [s].
        ends: Starts, ends and their velocities, shape (4, m, 3) [m, m/s].
        radius: Shape (m,) [m].
        age: Shape (m,) [s].
        valid: Shape (m,).
        person: Shape (m,).
        error: Bound on the measured ends' error [m].
        max_age: [s].
        tracks: The memory, shape (m,) of ``TRACK``.
        out: Result, the trusted ``ends``; NaN for what never was.
        out_radius: Result, shape (m,) [m].
        out_age: Result, shape (m,) [s]; inf for what never was.

    Returns:
        The capsule that is worst off (-1 if all are good), what became of its sample, how it is covered; and whether
        all trusted samples are of this very moment.
    """
    worst, worst_verdict, worst_cover, fresh = -1, GOOD, COVERED, True
    for j in range(tracks.shape[0]):
        track = tracks[j]
        verdict = _judge(time, ends, j, radius[j], age[j], valid[j], person[j], error, track)
        for row in range(4):
            for k in range(3):
                out[row, j, k] = track["trusted"][row, k]
        out_radius[j] = track["radius"]
        out_age[j] = time - track["stamp"]
        fresh = fresh and out_age[j] == 0.0
        cover = COVERED
        if verdict >= PERSON:
            cover = BROKEN
        elif not track["stamp"] > -np.inf:
            cover = NEVER
        elif not out_age[j] <= max_age + STAMP_ROUNDING:
            cover = LOST
        if cover > worst_cover or (cover == worst_cover and verdict > worst_verdict):
            worst, worst_verdict, worst_cover = j, verdict, cover
    return worst, worst_verdict, worst_cover, fresh
