r"""Verification of a jerk by the stop that would follow it.

A jerk may be applied if, held for one step and followed by a stop, it keeps every joint limit, and keeps the arm off
everything until it is at rest: off half-spaces, static capsules and itself, and off all that a person can reach whose
points move at most at :math:`\hat v` from where they were measured.

Distances are checked between samples too, by conservative advancement: a capsule's axis moves at most
:math:`\sum_j \rho_j |\dot\theta_j|`, so that a gap found at one moment lasts at least gap over closing speed, and the
next moment to look at is then.
"""

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair, plane_pair, stands
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.motion import integrate, representable
from jssa_gym.kernels.stopping import (
    make_plan_representable,
    peak_speed,
    plan_stop,
    step_keeps,
    stop_at,
    stop_jerk,
    stop_keeps,
)

REST = 1e-6
"""Speed of a point of the arm below which it is at rest [m/s]: what rounding leaves."""

_SHORTEST = 5e-4
"""Advancement under which a gap counts as closed [s]."""

_LOOKS = 250
"""Most moments that are looked at before a stop counts as not verifiable."""

_TOLERANCE = 1e-10
"""Share of a joint limit by which a stop may exceed it: rounding."""

UNSOUND, CHANGED_PLANES, CHANGED_STATICS = 1, 2, 3
"""What can be wrong with what stands still."""

SAFE, LIMITS, REACH, HALF_SPACE, STATIC, SELF, UNDECIDED = 0, 1, 2, 3, 4, 5, 6
"""What a verification ends in."""


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


@jit
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


@jit
def keeps_limits(state, jerk, after, plan, bounds, dt):
    """Whether one step at ``jerk`` and the stop after it stay inside all joint limits, at every instant."""
    for j in range(jerk.shape[0]):
        low, high, V, A, J = bounds[0, j], bounds[1, j], bounds[2, j], bounds[3, j], bounds[4, j]
        if not step_keeps(state[0, j], state[1, j], state[2, j], jerk[j], low, high, V, A, J, dt, _TOLERANCE):
            return False
        if not stop_keeps(after[0, j], after[1, j], after[2, j], plan[j], low, high, V, A, J, dt, _TOLERANCE):
            return False
    return True


@jit
def _posture(state, jerk, after, plan, dt, t, posture, fastest):
    """Joint positions at time t of step and stop, and each joint's largest speed from then on."""
    for j in range(jerk.shape[0]):
        stop = plan[j]
        if t < dt:
            q, v, a, u = state[0, j], state[1, j], state[2, j], jerk[j]
            posture[0, j] = q + t * v + t**2 / 2.0 * a + t**3 / 6.0 * u
            # the speed's extremes within the step: now, at its end, and where the acceleration passes zero
            now, turn = v + t * a + t**2 / 2.0 * u, 0.0
            if u != 0.0 and t < -a / u < dt:
                turn = abs(v - a * a / (2.0 * u))
            later = peak_speed(after[1, j], after[2, j], stop, dt, 0.0)
            fastest[j] = max(max(abs(now), turn), later)
        else:
            posture[0, j], _, _ = stop_at(after[0, j], after[1, j], after[2, j], stop, dt, t - dt)
            fastest[j] = peak_speed(after[1, j], after[2, j], stop, dt, t - dt)


@jit
def keeps_clear(
    links,
    capsules,
    levers,
    self_pairs,
    state,
    jerk,
    after,
    plan,
    ticks,
    dt,
    agents,
    reach,
    speed,
    touch,
    statics,
    planes,
    margin,
    posture,
    fastest,
    frames,
    segments,
):
    """Whether one step at ``jerk`` and the stop after it keep off everything until the arm is at rest.

    Args:
        links, capsules, self_pairs: The robot.
        levers: From :func:`jssa_gym.safety.failsafe.levers`, shape (m, n) [m].
        state: Present joint state, shape (3, n).
        jerk: For one step, shape (n,) [rad/s³].
        after: Joint state after it, shape (3, n).
        plan: Stop from there, shape (n,) of ``STOP``.
        ticks: Its length.
        dt: Step [s].
        agents: People as they were last measured, shape (k,) of ``AGENT``.
        reach: How much each of them has grown until now, shape (k,) [m].
        speed: How fast each of them grows, shape (k,) [m/s].
        touch: Speed of a point of the arm with which each may be touched, shape (k,) [m/s].
        statics, planes: Shape (c,) of ``AGENT`` and (p,) of ``PLANE``.
        margin: Gap to keep from them and from the arm itself [m].
        posture, fastest, frames, segments: Scratch; ``posture`` of shape (3, n), its lower rows zero.

    Returns:
        ``SAFE``, or what is in the way: its code, the robot's capsule, the other's number, the time of contact [s].
    """
    end, t = dt * (1 + ticks), 0.0
    for _ in range(_LOOKS):
        _posture(state, jerk, after, plan, dt, t, posture, fastest)
        forward(links, posture, frames)
        place(frames, capsules, segments)
        lasting = end - t
        for i in range(segments.shape[0]):
            robot = segments[i]
            rate, spin = 0.0, 0.0
            for j in range(robot["link"] + 1):
                rate += levers[i, j] * fastest[j]
                spin += (levers[i, j] + robot["radius"]) * fastest[j]
            for k in range(agents.shape[0]):
                if spin <= max(touch[k], REST):
                    continue
                agent = agents[k]
                radii = robot["radius"] + agent["radius"]
                gap, _, _ = capsule_pair(robot["start"], robot["end"], agent["start"], agent["end"], radii)
                lasts = (gap - reach[k] - speed[k] * t) / (rate + speed[k])
                if not (lasts > _SHORTEST):
                    return REACH, i, k, t
                lasting = min(lasting, lasts)
            if rate <= REST:
                continue
            for k in range(planes.shape[0]):
                if stands(robot, planes[k]):
                    continue
                gap, _ = plane_pair(robot["start"], robot["end"], robot["radius"], planes[k])
                lasts = (gap - margin) / rate
                if not (lasts > _SHORTEST):
                    return HALF_SPACE, i, k, t
                lasting = min(lasting, lasts)
            for k in range(statics.shape[0]):
                static = statics[k]
                radii = robot["radius"] + static["radius"]
                gap, _, _ = capsule_pair(robot["start"], robot["end"], static["start"], static["end"], radii)
                lasts = (gap - margin) / rate
                if not (lasts > _SHORTEST):
                    return STATIC, i, k, t
                lasting = min(lasting, lasts)
        for k in range(self_pairs.shape[0]):
            inner, outer = self_pairs[k, 0], self_pairs[k, 1]
            if capsules[inner]["link"] > capsules[outer]["link"]:
                inner, outer = outer, inner
            one, two = segments[inner], segments[outer]
            # seen from the inner link only the joints beyond it move the outer one
            rate = 0.0
            for j in range(one["link"] + 1, two["link"] + 1):
                rate += levers[outer, j] * fastest[j]
            if rate <= REST:
                continue
            gap, _, _ = capsule_pair(one["start"], one["end"], two["start"], two["end"], one["radius"] + two["radius"])
            lasts = (gap - 2.0 * margin) / rate
            if not (lasts > _SHORTEST):
                return SELF, outer, inner, t
            lasting = min(lasting, lasts)
        t += lasting
        if t >= end:
            return SAFE, -1, -1, t
    return UNDECIDED, -1, -1, t


@jit
def choose(
    links,
    capsules,
    levers,
    self_pairs,
    state,
    wanted,
    stored,
    tick,
    bounds,
    dt,
    agents,
    reach,
    speed,
    touch,
    statics,
    planes,
    margin,
    jerk,
    after,
    plan,
    posture,
    fastest,
    frames,
    segments,
):
    """The first verified one of: the wanted jerk, the jerk half way to the stored stop's, the stored stop's.

    Args:
        wanted: Shape (n,) [rad/s³], shares of the jerk limits times these, so that what is verified is what an
            environment integrates; so are the other two.
        stored: The stored stop, shape (n,) of ``STOP``.
        tick: Number of its ticks that are over.
        jerk, after, plan: Results: the jerk, the state after it, the stop from there. For the stored stop ``plan``
            holds nothing of use.
        bounds: Rows lower and upper position, velocity, acceleration, jerk limits, shape (5, n).
        links, capsules, levers, self_pairs, state, dt: As of :func:`keeps_clear`.
        agents, reach, speed, touch, statics, planes, margin: As of :func:`keeps_clear`.
        posture, fastest, frames, segments: Scratch.

    Returns:
        Which one (0, 1, 2); then code, robot capsule, other's number and time of what stood in the first one's way.
    """
    why, row, column, time = SAFE, -1, -1, 0.0
    for attempt in range(2):
        if attempt == 0:
            for j in range(jerk.shape[0]):
                jerk[j] = wanted[j]
        else:
            stop_jerk(stored, tick, jerk)
            for j in range(jerk.shape[0]):
                jerk[j] = representable((jerk[j] + wanted[j]) / 2.0, bounds[4, j])
        integrate(state, jerk, dt, after)
        ticks = plan_stop(after, bounds, dt, plan)
        make_plan_representable(plan, bounds)
        code, i, k, t = LIMITS, -1, -1, 0.0
        if keeps_limits(state, jerk, after, plan, bounds, dt):
            code, i, k, t = keeps_clear(
                links,
                capsules,
                levers,
                self_pairs,
                state,
                jerk,
                after,
                plan,
                ticks,
                dt,
                agents,
                reach,
                speed,
                touch,
                statics,
                planes,
                margin,
                posture,
                fastest,
                frames,
                segments,
            )
        if attempt == 0:
            why, row, column, time = code, i, k, t
        if code == SAFE:
            return attempt, why, row, column, time
    stop_jerk(stored, tick, jerk)
    integrate(state, jerk, dt, after)
    return 2, why, row, column, time
