r"""Verification of a jerk by the stop that would follow it.

A jerk may be applied if, held for one step and followed by a stop, it keeps every joint limit, and keeps the arm off
everything until it is at rest: off half-spaces, static capsules and itself, and off all that a person can reach whose
points move at most at :math:`\hat v` from where they were measured.

Distances are checked between samples too, by conservative advancement: a capsule's axis moves at most
:math:`\sum_j \rho_j |\dot\theta_j|`, so that a gap found at one moment lasts at least gap over closing speed, and the
next moment to look at is then.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels import lanes as together
from jssa_gym.kernels.capsules import apart, ball_around, pair_of, plane_pair, put_balls, stands
from jssa_gym.kernels.chain import place_axes, place_present, pose
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.lanes import LANES, lanes
from jssa_gym.kernels.occupancy import apart_for, is_confined
from jssa_gym.kernels.records import FACE, records
from jssa_gym.kernels.region import room_inside
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.stopping import peak_from, peak_speed, stop_at, stop_length
from jssa_gym.kernels.vector import fill, fill_rows

SHORTEST = 5e-4
"""Advancement under which a gap counts as closed [s]."""

_ROUNDING = 1e-9
"""By how much a pair has to be apart for longer than another for that to be more than rounding [s]."""

_CLOSED = 1e-6
"""By how much a gap has to be closed for that to be more than rounding [m]."""

_LOOKS = 250
"""Most moments that are looked at before a stop counts as not verifiable."""

_TOLERANCE = 1e-10
"""Share of a joint limit by which a stop may exceed it: rounding."""

UNSOUND, CHANGED_PLANES, CHANGED_STATICS = 1, 2, 3
"""What can be wrong with what stands still."""

SAFE, LIMITS, REACH, HALF_SPACE, STATIC, SELF, UNDECIDED, ENTRY = 0, 1, 2, 3, 4, 5, 6, 7
"""What a verification ends in."""

NO_FACES, NO_PIECES = records(0, FACE), np.zeros(1, np.int64)
"""Faces and pieces of no watched region."""


@jit
def load_fixtures(start, end, radius, normal, offset, statics, planes, first):
    """Static capsules and half-spaces into records or, unless they are the ``first``, compared with those there.

    Returns:
        0, ``UNSOUND`` if one is not finite, has no radius or a normal that is no unit vector, ``CHANGED_PLANES`` or
        ``CHANGED_STATICS``. Of those that are not the first nothing is taken down.
    """
    for j in range(offset.shape[0]):
        length2 = 0.0
        for k in range(3):
            length2 += normal[j, k] ** 2
        if not (abs(length2 - 1.0) < 1e-6 and np.isfinite(offset[j])):
            return UNSOUND
    for j in range(radius.shape[0]):
        for k in range(3):
            if not np.isfinite(start[j, k] + end[j, k]):
                return UNSOUND
        if not 0.0 < radius[j] < np.inf:
            return UNSOUND
    if not first:
        return _changed(start, end, radius, normal, offset, statics, planes)
    for j in range(offset.shape[0]):
        planes[j]["offset"] = offset[j]
        for k in range(3):
            planes[j]["normal"][k] = normal[j, k]
    for j in range(radius.shape[0]):
        statics[j]["radius"] = radius[j]
        for k in range(3):
            statics[j]["start"][k], statics[j]["end"][k] = start[j, k], end[j, k]
    return 0


@jit
def _changed(start, end, radius, normal, offset, statics, planes):
    for j in range(offset.shape[0]):
        same = planes[j]["offset"] == offset[j]
        for k in range(3):
            same = same and planes[j]["normal"][k] == normal[j, k]
        if not same:
            return CHANGED_PLANES
    for j in range(radius.shape[0]):
        same = statics[j]["radius"] == radius[j]
        for k in range(3):
            same = same and statics[j]["start"][k] == start[j, k] and statics[j]["end"][k] == end[j, k]
        if not same:
            return CHANGED_STATICS
    return 0


@part
def load_people(start, end, radius, speed, age, lag, error, agents, reach):
    """People into records, and how far they can have come since they were measured.

    Args:
        start, end, radius: As they were measured, shapes (k, 3), (k, 3), (k,) [m].
        speed: Their speed bounds, shape (k,) [m/s].
        age: Of the measurements, shape (k,) [s].
        lag: Of the arm behind its commands [s].
        error: Of a measurement and of the arm's place [m].
        agents: Result, shape (k,) of ``AGENT``; velocities are left alone.
        reach: Result, shape (k,) [m].
    """
    for k in range(radius.shape[0]):
        agent = agents[k]
        for i in range(3):
            agent["start"][i], agent["end"][i] = start[k, i], end[k, i]
        agent["radius"] = radius[k]
        reach[k] = speed[k] * (age[k] + lag) + error


@part
def keeps_limits(state, jerk, after, plan, bounds, dt):
    """Whether one step at ``jerk`` and the stop after it stay inside all joint limits, at every instant."""
    q, v, a, u, low, high, V = lanes(), lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    A, J, later_q, later_v, later_a = lanes(), lanes(), lanes(), lanes(), lanes()
    ramp, hold, release, jerk_in, jerk_out, kept = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    count, more = jerk.shape[0], 1.0 + _TOLERANCE
    for first in range(0, count, LANES):
        for i in range(LANES):
            joint = min(first + i, count - 1)
            stop, slack = plan[joint], _TOLERANCE * (bounds[1, joint] - bounds[0, joint])
            q[i], v[i], a[i], u[i] = state[0, joint], state[1, joint], state[2, joint], jerk[joint]
            low[i], high[i] = bounds[0, joint] - slack, bounds[1, joint] + slack
            V[i], A[i], J[i] = bounds[2, joint] * more, bounds[3, joint] * more, bounds[4, joint] * more
            later_q[i], later_v[i], later_a[i] = after[0, joint], after[1, joint], after[2, joint]
            ramp[i], hold[i], release[i] = stop["ramp"], stop["hold"], stop["release"]
            jerk_in[i], jerk_out[i] = stop["jerk_in"], stop["jerk_out"]
        for i in range(LANES):
            keeps = together.keeps(q[i], v[i], a[i], u[i], dt, low[i], high[i], V[i], A[i], J[i])
            keeps &= together.stop_keeps(
                later_q[i], later_v[i], later_a[i], ramp[i], hold[i], release[i], jerk_in[i], jerk_out[i],
                low[i], high[i], V[i], A[i], J[i], dt,
            )  # fmt: skip
            kept[i] = 1.0 if keeps else 0.0
        for i in range(LANES):
            if kept[i] == 0.0:
                return False
    return True


@jit
def posture_at(motion, t, posture, fastest):
    """Joint positions at time t of step and stop, and each joint's largest speed from then on."""
    state, jerk, after, plan, dt = motion
    for j in range(jerk.shape[0]):
        stop = plan[j]
        if t < dt:
            q, v, a, u = state[0, j], state[1, j], state[2, j], jerk[j]
            posture[j] = q + t * v + t**2 / 2.0 * a + t**3 / 6.0 * u
            # the speed's extremes within the step: now, at its end, and where the acceleration passes zero
            now, turn = v + t * a + t**2 / 2.0 * u, 0.0
            if u != 0.0 and t < -a / u < dt:
                turn = abs(v - a * a / (2.0 * u))
            later = peak_speed(after[1, j], after[2, j], stop, dt, 0.0)
            fastest[j] = max(max(abs(now), turn), later)
        else:
            posture[j], now, _ = stop_at(after[0, j], after[1, j], after[2, j], stop, dt, t - dt)
            fastest[j] = peak_from(now, after[1, j], after[2, j], stop, dt, t - dt)


class StepAndStop(NamedTuple):
    """One step and the stop after it."""

    state: NDArray[np.float64]
    """Present joint state, shape (3, n)."""
    jerk: NDArray[np.float64]
    """For one step, shape (n,) [rad/s³]."""
    after: NDArray[np.float64]
    """Joint state after it, shape (3, n)."""
    plan: NDArray
    """The stop from there, shape (n,) of ``STOP``."""
    dt: float
    """Step [s]."""


class Around(NamedTuple):
    """What an arm has to keep off."""

    agents: NDArray
    """People as they were last measured, shape (k,) of ``AGENT``."""
    reach: NDArray[np.float64]
    """How much each of them has grown until now, shape (k,) [m]."""
    growth: NDArray[np.float64]
    """How fast each of them grows, shape (k,) [m/s]."""
    touch: NDArray[np.float64]
    """Speed of a point of the arm with which each may be touched, shape (k,) [m/s]."""
    confined: NDArray
    """What each of them is confined by beyond that growth, shape (k,) of ``CONFINED``."""
    statics: NDArray
    """Shape (c,) of ``AGENT``."""
    planes: NDArray
    """Shape (p,) of ``PLANE``."""
    margin: float
    """Gap to keep from what stands still and from the arm itself [m]."""
    faces: NDArray = NO_FACES
    """Faces of the watched region, see :mod:`~jssa_gym.kernels.region`."""
    pieces: NDArray[np.int64] = NO_PIECES
    """Where those of each piece begin."""
    entry_reach: float = 0.0
    """How far into it whoever is unseen can have come until now [m]."""
    entry_speed: float = 0.0
    """How fast they come [m/s]."""


@part
def beside_people(around):
    """The same without anybody, who is or could come: what stands still, and the arm itself."""
    return Around(
        around.agents[:0], around.reach, around.growth, around.touch, around.confined, around.statics, around.planes,
        around.margin, around.faces, around.pieces[:1], around.entry_reach, around.entry_speed,
    )  # fmt: skip


@part
def surely_meets(robot, motion, around, i, k, work):
    """Whether :func:`keeps_clear` would find capsule i, or something before it, in the way of person k: for certain.

    For pairs that were in the way of a stop much like this one. What is looked at is one moment, half a tick before
    the capsule comes to rest: by then the person has grown most. Every look of a verification before it promises that
    the pair is apart for a while, and the capsule turns no slower then; so none can lead beyond a gap that is closed.

    Args:
        robot, motion, around, work: See :func:`keeps_clear`.
        i, k: The pair. False says nothing.
    """
    capsule, agent, spin = robot.capsules[i], around.agents[k], 0.0
    if is_confined(around.confined[k]):
        return False  # then the pair may be apart where the gap is closed
    joints = capsule["link"] + 1
    t = motion.dt * (0.5 + stop_length(motion.plan[:joints]))
    posture_at(motion, t, work.posture, work.fastest)
    for j in range(joints):
        spin += (robot.levers[i, j] + capsule["radius"]) * work.fastest[j]
    if not spin > 2.0 * max(around.touch[k], REST_SPEED):
        return False
    pose(robot.links[:joints], work.posture, work.frames_now)
    place_axes(work.frames_now, robot.capsules[i : i + 1], work.segments_now[i : i + 1])
    part = work.segments_now[i]
    gap, _, _ = pair_of(part, agent, part["radius"] + agent["radius"])
    return gap - around.reach[k] - around.growth[k] * t < -_CLOSED


@jit
def _off(until, t, lasting):
    """Whether a pair that is apart until some time cannot be what is met next, and need not be looked at [s]."""
    return until - t - _ROUNDING > max(lasting, SHORTEST)


@jit
def _rests(gap, rate, t):
    """Whether a pair that is closed already may stay so: from now on only what rounding leaves of rest moves it."""
    return t == 0.0 and gap <= 0.0 and rate <= REST_SPEED


@part
def keeps_clear(robot, motion, ticks, around, work):
    """Whether one step and the stop after it keep off everything until the arm is at rest.

    Args:
        robot: Its ``links``, ``capsules``, ``self_pairs`` and ``levers``, see :class:`~jssa_gym.tick.layout.ArmRecord`.
        motion: The step and the stop.
        ticks: The stop's length.
        around: What may not be met.
        work: Scratch: ``posture`` and ``fastest`` (n,), ``frames_now`` and ``segments_now``, ``balls`` (k, 4);
            ``people_off`` (m, k), ``planes_off`` (m, p), ``statics_off`` (m, c) and ``self_off`` (s,).

    Returns:
        ``SAFE``, or what is in the way: its code, the robot's capsule, the other's number, the time of contact [s]; of
        ``SAFE`` that of rest.
    """
    dt, levers, agents, margin = motion.dt, robot.levers, around.agents, around.margin
    reach, speed, touch, statics, planes = around.reach, around.growth, around.touch, around.statics, around.planes
    fastest, self_pairs = work.fastest, robot.self_pairs
    balls, pieces, entry_speed = work.balls, around.pieces, around.entry_speed
    # until when each pair is known to be apart: the arm only slows down, so that what a gap lasts is a promise
    people_off, planes_off, statics_off, self_off = work.people_off, work.planes_off, work.statics_off, work.self_off
    fill_rows(people_off, -np.inf)
    fill_rows(planes_off, -np.inf)
    fill_rows(statics_off, -np.inf)
    fill(self_off, -np.inf)
    put_balls(agents, balls)
    end, t = dt * (1 + ticks), 0.0
    for _ in range(_LOOKS):
        posture_at(motion, t, work.posture, fastest)
        if t == 0.0:
            segments = work.segments_present
            place_present(robot, work.posture, work)
        else:
            segments = work.segments_now
            pose(robot.links, work.posture, work.frames_now)
            place_axes(work.frames_now, robot.capsules, segments)
        lasting = end - t
        for i in range(segments.shape[0]):
            part = segments[i]
            ball = ball_around(part)
            rate, spin = 0.0, 0.0
            for j in range(part["link"] + 1):
                rate += levers[i, j] * fastest[j]
                spin += (levers[i, j] + part["radius"]) * fastest[j]
            for k in range(agents.shape[0]):
                if spin <= max(touch[k], REST_SPEED) or _off(people_off[i, k], t, lasting):
                    continue
                agent = agents[k]
                radii = part["radius"] + agent["radius"]
                # at a glance: even from the nearest that their ends could be, for longer than what comes first
                far = radii + reach[k] + speed[k] * t + (rate + speed[k]) * (max(lasting, SHORTEST) + _ROUNDING)
                if apart(ball, balls[k], far):
                    continue
                gap, _, _ = pair_of(part, agent, radii)
                lasts = (gap - reach[k] - speed[k] * t) / (rate + speed[k])
                if not (lasts > SHORTEST):
                    lasts = apart_for(part, radii, around.confined[k], reach[k], speed[k], rate, t)
                if not (lasts > SHORTEST):
                    return REACH, i, k, t
                lasting, people_off[i, k] = min(lasting, lasts), t + lasts
            if pieces.shape[0] > 1 and spin > REST_SPEED:
                room = room_inside(part["start"], part["end"], part["radius"], around.faces, pieces)
                lasts = (room - around.entry_reach - entry_speed * t) / (rate + entry_speed)
                if not (lasts > SHORTEST):
                    return ENTRY, i, -1, t
                lasting = min(lasting, lasts)
            if rate <= 0.0:
                continue
            for k in range(planes.shape[0]):
                if _off(planes_off[i, k], t, lasting) or stands(part, planes[k]):
                    continue
                gap, _ = plane_pair(part["start"], part["end"], part["radius"], planes[k])
                lasts = np.inf if _rests(gap - margin, rate, t) else (gap - margin) / rate
                if not (lasts > SHORTEST):
                    return HALF_SPACE, i, k, t
                lasting, planes_off[i, k] = min(lasting, lasts), t + lasts
            for k in range(statics.shape[0]):
                if _off(statics_off[i, k], t, lasting):
                    continue
                static = statics[k]
                radii = part["radius"] + static["radius"]
                gap, _, _ = pair_of(part, static, radii)
                lasts = np.inf if _rests(gap - margin, rate, t) else (gap - margin) / rate
                if not (lasts > SHORTEST):
                    return STATIC, i, k, t
                lasting, statics_off[i, k] = min(lasting, lasts), t + lasts
        for k in range(self_pairs.shape[0]):
            if _off(self_off[k], t, lasting):
                continue
            inner, outer = self_pairs[k, 0], self_pairs[k, 1]
            if segments[inner]["link"] > segments[outer]["link"]:
                inner, outer = outer, inner
            one, two = segments[inner], segments[outer]
            # seen from the inner link only the joints beyond it move the outer one
            rate = 0.0
            for j in range(one["link"] + 1, two["link"] + 1):
                rate += levers[outer, j] * fastest[j]
            if rate <= 0.0:
                continue
            gap, _, _ = pair_of(one, two, one["radius"] + two["radius"])
            lasts = np.inf if _rests(gap - 2.0 * margin, rate, t) else (gap - 2.0 * margin) / rate
            if not (lasts > SHORTEST):
                return SELF, outer, inner, t
            lasting, self_off[k] = min(lasting, lasts), t + lasts
        t += lasting
        if t >= end:
            return SAFE, -1, -1, end
    return UNDECIDED, -1, -1, t
