"""How people walk: one step of a walker, whatever kind it is; :mod:`jssa_gym.humans` says what they are.

What is random about a walker is a sequence of numbers in [0, 1), drawn from a generator as it needs them.
"""

import math
from typing import Any

import numpy as np
from numba import typeof, types

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.norm import length
from jssa_gym.kernels.reach import nearest_to_walker
from jssa_gym.kernels.records import records

STRAIGHT, WANDERS, PASSES, APPROACHES, PURSUES = range(5)
"""Kinds of walkers: at constant velocity; from place to place; past the arm; up to it and back; after it."""

AHEAD = 3
"""Random numbers that are drawn at once, at most."""

LEGS = 5
"""Legs of the way of who approaches."""

_XY = (np.float64, 2)

WALKER = np.dtype(
    [
        ("kind", np.int64),
        ("root", *_XY),  # [m]
        ("velocity", *_XY),  # of the step to come [m/s]
        ("time", np.float64),  # [s]
        ("speed", np.float64),  # largest [m/s]
        ("acceleration", np.float64),  # largest, or infinity [m/s²]
        # what is random
        ("ahead", np.float64, AHEAD),
        ("drawn", np.int64),  # how many of these there are ...
        ("used", np.int64),  # ... and how many are used
        # who wanders
        ("low", *_XY),  # the region [m] ...
        ("high", *_XY),
        ("change", np.float64),  # largest change from one segment to the next [m/s], or share of the pace
        ("period", np.float64),  # of a segment [s]
        ("goal", *_XY),  # [m]
        ("pace", np.float64),  # [m/s]
        ("wanted", *_XY),  # velocity of this segment [m/s]
        ("until", np.float64),  # end of this segment, or of this pace [s]
        # who passes
        ("direction", *_XY),
        ("slowest", np.float64),  # [m/s]
        ("stop_begin", np.float64),  # [s]
        ("stop_end", np.float64),
        ("now", np.float64),  # pace at present [m/s]
        # who approaches
        ("origin", *_XY),  # where the way begins [m]
        ("nearest", np.float64),  # x where the way ends [m]
        ("ramp", np.float64),  # duration of a change of the velocity [s]
        ("moments", np.float64, LEGS),  # ends of the legs [s]
        ("legs", np.float64, (LEGS, 2)),  # their velocities [m/s]
        ("square", np.float64),  # 2: as a variable it is the C library's power, which Python's own is
        # who pursues
        ("way", *_XY),  # to what is nearest [m]
        ("touches", np.bool_),
        ("runs", np.bool_),
        ("feints", np.bool_),
    ],
    align=True,
)
"""A walker, where it is and what it is up to."""

ROUNDING = 1e-10
"""Share by which a change of velocity may exceed its bound for rounding."""

WITHIN = 1e-9
"""How far inside its region a person who has to brake comes to rest [m]."""

ARRIVED = 0.1
"""Distance from which a wandering person picks the next place to go to [m]."""


def walking_parts() -> list[tuple[Any, tuple[Any, ...]]]:
    """What steps of people who walk need compiled, with the types of its arguments."""
    number, row, rows = types.float64, types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    walker = typeof(records(1, WALKER))
    return [(choose, (walker, number)), (step_walker, (walker, rows, rows, number, rows, rows, row, row))]


@jit
def step_walker(walker, start, end, dt, link_start, link_end, link_radius, radius):
    """Walk for ``dt`` [s] and choose the velocity of the step to come.

    Args:
        walker: Shape (1,) of ``WALKER``.
        start, end, radius: Capsules relative to the root, shapes (m, 3) and (m,) [m].
        dt: Duration [s].
        link_start, link_end, link_radius: The arm's capsules, shapes (k, 3) and (k,) [m]; only who pursues looks.

    Returns:
        Whether the velocity is chosen; if not, :func:`choose` has to be asked again with more random numbers.
    """
    w = walker[0]
    vx, vy = w["velocity"][0], w["velocity"][1]
    if w["kind"] == PURSUES:
        # from where the body will stand when the velocity to be chosen begins
        x, y = w["root"][0] + vx * dt, w["root"][1] + vy * dt
        gap, way_x, way_y = nearest_to_walker(start, end, radius, x, y, link_start, link_end, link_radius)
        w["way"][0], w["way"][1], w["touches"] = way_x, way_y, gap <= 0.0
    w["root"][0], w["root"][1] = w["root"][0] + vx * dt, w["root"][1] + vy * dt
    w["time"] += dt
    return choose(walker, dt)


@jit
def choose(walker, dt):
    """Choose the velocity of the step to come, of ``dt`` [s]; 0 before the first.

    Returns:
        Whether it is chosen; if not, more random numbers are needed, at most 3.
    """
    w = walker[0]
    kind = w["kind"]
    if kind == WANDERS:
        return _wander(w, dt)
    if kind == PASSES:
        return _pass(w, dt)
    if kind == APPROACHES:
        if w["acceleration"] == np.inf:
            _approach_at_once(w, dt)
        else:
            _approach(w, dt)
    elif kind == PURSUES:
        return _pursue(w, dt)
    return True


@jit
def draw(w):
    """The next random number."""
    w["used"] += 1
    return w["ahead"][w["used"] - 1]


@jit
def lacks(w, count):
    """Whether there are fewer random numbers than that."""
    return w["drawn"] - w["used"] < count


@jit
def turn_towards(w, wanted_x, wanted_y, dt):
    """The wanted velocity, or as far towards it as the acceleration allows."""
    vx, vy, acceleration = w["velocity"][0], w["velocity"][1], w["acceleration"]
    if acceleration == np.inf:
        return wanted_x, wanted_y
    most = acceleration * dt
    change = length(vx - wanted_x, vy - wanted_y, 0.0)
    if change <= most * (1.0 + ROUNDING):
        return wanted_x, wanted_y
    part = max(most, 0.0) / change
    return vx + part * (wanted_x - vx), vy + part * (wanted_y - vy)


@jit
def _set(w, vx, vy):
    w["velocity"][0], w["velocity"][1] = vx, vy


# ---- who wanders -----------------------------------------------------------------------------------


@jit
def _wander(w, dt):
    if w["time"] + dt > w["until"] + 1e-9 or not w["until"] > 0.0:
        if not _begin_segment(w):
            return False
    if w["acceleration"] == np.inf:
        _set(w, w["wanted"][0], w["wanted"][1])
    elif dt == 0.0:
        _set(w, 0.0, 0.0)
    else:
        vx, vy = turn_towards(w, w["wanted"][0], w["wanted"][1], dt)
        if not _comes_to_rest_inside(w, vx, vy, dt):
            vx, vy = turn_towards(w, 0.0, 0.0, dt)
        _set(w, vx, vy)
    return True


@jit
def _comes_to_rest_inside(w, vx, vy, dt):
    """Whether who walks at that velocity can come to rest in the region, or at its border, but no nearer to it."""
    speed, most = length(vx, vy, 0.0), w["acceleration"] * dt
    steps = max(math.ceil(speed / most), 1)
    way = steps - most / speed * steps * (steps - 1) / 2.0 if steps > 1 else 1.0
    for i in range(2):
        now = w["root"][i]
        then = now + way * dt * (vx if i == 0 else vy)
        if not (min(w["low"][i] + WITHIN, now) <= then <= max(w["high"][i] - WITHIN, now)):
            return False
    return True


@jit
def _begin_segment(w):
    """Begin a segment: its velocity; False if random numbers are needed first."""
    root, goal = w["root"], w["goal"]
    way_x, way_y = goal[0] - root[0], goal[1] - root[1]
    while math.hypot(way_x, way_y) < ARRIVED:
        if lacks(w, 3):
            return False
        for i in range(2):
            goal[i] = w["low"][i] + (w["high"][i] - w["low"][i]) * draw(w)
        w["pace"] = (0.3 + (1.0 - 0.3) * draw(w)) * w["speed"]
        way_x, way_y = goal[0] - root[0], goal[1] - root[1]
    w["until"] = w["time"] + w["period"]
    share = min(w["pace"] / math.hypot(way_x, way_y), 0.5 / w["period"])
    # every bound a coordinate at a time, so that one never undoes another
    fastest, drop = w["speed"] / math.sqrt(2.0), w["change"] / math.sqrt(2.0)
    for i in range(2):
        before, wanted = w["velocity"][i], (way_x if i == 0 else way_y) * share
        velocity = before + min(max(min(max(wanted, -fastest), fastest) - before, -drop), drop)
        # slow down in time for the border
        least = -_speed_within(root[i] - w["low"][i], w["period"], drop)
        most = _speed_within(w["high"][i] - root[i], w["period"], drop)
        w["wanted"][i] = min(max(velocity, least), most)
    return True


@jit
def _speed_within(gap, period, drop):
    """Largest speed from which segments of falling speed end within a gap [m]."""
    # after v the speeds v - drop, v - 2 drop, ... follow: period (v²/(2 drop) + v/2 + drop/8) is enough
    room = max(gap / period - drop / 8.0, 0.0)
    return drop * (math.sqrt(0.25 + 2.0 * room / drop) - 0.5)


# ---- who passes ------------------------------------------------------------------------------------


@jit
def _pass(w, dt):
    wanted_x, wanted_y = 0.0, 0.0
    if not (w["stop_begin"] <= w["time"] < w["stop_end"]):
        if w["time"] >= w["until"]:
            if lacks(w, 1):
                return False
            w["until"] = w["time"] + 0.5
            pace = w["pace"] * (1.0 + w["change"] * (-1.0 + 2.0 * draw(w)))
            w["now"] = min(max(pace, w["slowest"]), w["speed"])
        wanted_x, wanted_y = w["now"] * w["direction"][0], w["now"] * w["direction"][1]
    if dt == 0.0:  # somebody who walks by has walked before
        _set(w, wanted_x, wanted_y)
    else:
        vx, vy = turn_towards(w, wanted_x, wanted_y, dt)
        _set(w, vx, vy)
    return True


# ---- who approaches --------------------------------------------------------------------------------


@jit
def _seconds_after_ramp(w, time):
    """How far a velocity that grows from 0 to 1 m/s leads in a time [s], from the begin of the ramp on [m]."""
    ramp = w["ramp"]
    if time <= 0.0:
        return 0.0
    return time ** w["square"] / (2.0 * ramp) if time < ramp else time - ramp / 2.0


@jit
def _approach(w, dt):
    """The velocity that leads to where the person is to be; in the first step everything stands still."""
    if dt == 0.0:
        _set(w, 0.0, 0.0)
        return
    x, y, vx, vy, begin = w["origin"][0], w["origin"][1], 0.0, 0.0, 0.0
    for k in range(LEGS + 1):
        wx, wy = (w["legs"][k, 0], w["legs"][k, 1]) if k < LEGS else (0.0, 0.0)
        seconds = _seconds_after_ramp(w, w["time"] - begin)
        x, y = x + (wx - vx) * seconds, y + (wy - vy) * seconds
        vx, vy = wx, wy
        if k < LEGS:
            begin = w["moments"][k]
    # from where the step before really led: nothing adds up
    _set(w, (x - w["root"][0]) / dt, (y - w["root"][1]) / dt)


@jit
def _approach_at_once(w, dt):
    for k in range(LEGS):
        if w["time"] + dt <= w["moments"][k] + 1e-9:
            # cut the step that would lead beyond the place to stop at: legs end between steps
            if dt > 0.0 and w["root"][0] + w["legs"][k, 0] * dt < w["nearest"]:
                _set(w, (w["nearest"] - w["root"][0]) / dt, 0.0)
            else:
                _set(w, w["legs"][k, 0], w["legs"][k, 1])
            return
    _set(w, 0.0, 0.0)


# ---- who pursues -----------------------------------------------------------------------------------


@jit
def stopping_speed(way, acceleration, dt):
    """Largest speed of the step to come from which one can come to rest right at the end of a way.

    Args:
        way: At least 0 [m].
        acceleration: Bound on it, or infinity [m/s²].
        dt: Duration of a step [s].

    Returns:
        Speed [m/s]. Whoever walks it finds it fallen by at most ``acceleration`` · ``dt`` in the next step.
    """
    total = way / dt  # of the speeds of all steps
    if acceleration == np.inf:
        return total
    most = acceleration * dt
    # v, v - most, v - 2 most, ... for as many steps as it takes
    steps = max(math.ceil(math.sqrt(0.25 + 2.0 * total / most) - 0.5), 1)
    return total / steps + most * (steps - 1) / 2.0


@jit
def _pursue(w, dt):
    if dt == 0.0:
        _set(w, 0.0, 0.0)
        return True
    if w["feints"] and w["time"] >= w["until"]:
        if lacks(w, 1):
            return False
        w["runs"] = not w["runs"]
        w["until"] = w["time"] + (0.3 + (1.5 - 0.3) * draw(w) if w["runs"] else 0.1 + (0.6 - 0.1) * draw(w))
    way_x, way_y = w["way"][0], w["way"][1]
    far = length(way_x, way_y, 0.0)
    # onto the arm, not beyond it, as far as the acceleration allows who has run into it
    most = stopping_speed(far, w["acceleration"] if w["touches"] else np.inf, dt)
    share = min(w["speed"], most) / far if w["runs"] and far > 0.0 else 0.0
    vx, vy = w["velocity"][0], w["velocity"][1]
    dx, dy = share * way_x - vx, share * way_y - vy
    vx, vy = turn_towards(w, vx + dx, vy + dy, dt)
    _set(w, vx, vy)
    return True
