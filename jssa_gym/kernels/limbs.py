"""How hands move beside a body that stands still: one step of somebody who gestures; :mod:`jssa_gym.humans` says who.

What is random is a sequence of numbers in [0, 1), as of :mod:`jssa_gym.kernels.walkers`.
"""

import math

import numpy as np

from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.norm import length
from jssa_gym.kernels.reach import nearest_to_point
from jssa_gym.kernels.vector import copy
from jssa_gym.kernels.walkers import AHEAD, ROUNDING, draw, lacks, stopping_speed

FLICKS, RECEIVES = range(2)
"""Kinds of gestures: at the nearest link and back; held out to take something."""

_V = (np.float64, 3)

LIMB = np.dtype(
    [
        ("shoulder", *_V),  # relative to the root [m]
        ("rest", *_V),  # where the hand rests
        ("hand", *_V),
        ("goal", *_V),
        ("velocity", *_V),  # in the body, of the step to come [m/s]
        ("withdrawn", np.bool_),  # whether the goal is the place at rest
        ("length", np.float64),  # largest distance from shoulder to hand that is aimed at [m] ...
        ("reach", np.float64),  # ... and that there is
        ("acceleration", np.float64),  # largest, or infinity [m/s²]
        ("speed", np.float64),  # at which it goes to its goal [m/s]
        ("moment", np.float64),  # of the next stroke [s]
        ("part", np.int64),  # its capsule
    ],
    align=True,
)
"""An arm of a body, whose hand moves on straight lines."""

GESTURE = np.dtype(
    [
        ("kind", np.int64),
        ("root", np.float64, 2),  # [m]
        ("time", np.float64),  # [s]
        ("limbs", np.int64),  # how many arms move
        ("next", np.int64),  # the limb whose turn it is in this step
        # what is random
        ("ahead", np.float64, AHEAD),
        ("drawn", np.int64),
        ("used", np.int64),
        ("asks", np.int64),  # how many numbers are needed to go on
        # who flicks: ranges
        ("slowest", np.float64),  # [m/s]
        ("fastest", np.float64),
        ("shortest", np.float64),  # pause [s]
        ("longest", np.float64),
        # who receives
        ("way", np.int64),  # the next of three
        ("pauses", *_V),  # before each [s]
        ("speeds", *_V),  # [m/s]
        ("places", np.float64, (2, 3)),  # where the first two lead; the last leads back
        ("under_way", np.float64),  # when the hand was under way last [s]
    ],
    align=True,
)
"""Somebody who stands and gestures."""

THERE = 1e-9
"""Distance at which a hand is at its goal [m]."""


@jit
def step_gesture(gesture, limbs, dt, link_start, link_end, link_radius):
    """Move hands for ``dt`` [s] and choose their velocities for the step to come.

    Args:
        gesture: Shape (1,) of ``GESTURE``.
        limbs: Shape (2,) of ``LIMB``.
        dt: Duration [s].
        link_start, link_end, link_radius: The arm's capsules, shapes (k, 3) and (k,) [m]; only who flicks looks.

    Returns:
        Whether they are chosen; if not, :func:`go_on` has to be asked with ``asks`` more random numbers.
    """
    g = gesture[0]
    g["time"] += dt
    g["next"] = 0
    for k in range(g["limbs"]):
        move_limb(limbs[k], dt)
    return go_on(gesture, limbs, dt, link_start, link_end, link_radius)


@jit
def go_on(gesture, limbs, dt, link_start, link_end, link_radius):
    """The second half of :func:`step_gesture`."""
    g = gesture[0]
    for k in range(g["next"], g["limbs"]):
        limb = limbs[k]
        if g["kind"] == RECEIVES:
            _receive(g, limb)
        elif arrived(limb) and g["time"] >= limb["moment"]:
            g["asks"] = 1 if limb["withdrawn"] else 2
            if lacks(g, g["asks"]):
                g["next"] = k
                return False
            _turn(g, limb, link_start, link_end, link_radius)
        head_limb(limb, limb["speed"], dt, np.inf)
    return True


@jit
def _turn(g, limb, link_start, link_end, link_radius):
    """Begin the next stroke of a limb: out, or back at once."""
    if not limb["withdrawn"]:
        withdraw_limb(limb)
        limb["moment"] = g["time"] + (g["shortest"] + (g["longest"] - g["shortest"]) * draw(g))
    elif link_radius.shape[0] > 0:
        aim_limb(limb, g["root"][0], g["root"][1], link_start, link_end, link_radius)
    limb["speed"] = g["slowest"] + (g["fastest"] - g["slowest"]) * draw(g)


@jit
def _receive(g, limb):
    """Begin the next way of a hand that is held out, if it is time."""
    if not arrived(limb):
        g["under_way"] = g["time"]
    elif g["way"] < 3 and g["time"] - g["under_way"] >= g["pauses"][g["way"]]:
        limb["speed"] = g["speeds"][g["way"]]
        if g["way"] < 2:
            place = g["places"][g["way"]]
            point_limb(limb, place[0], place[1], place[2])
        else:
            withdraw_limb(limb)
        g["way"] += 1


# ---- limbs -----------------------------------------------------------------------------------------


@jit
def _apart(a, b):
    return length(a[0] - b[0], a[1] - b[1], a[2] - b[2])


@jit
def arrived(limb):
    """Whether the hand is at its goal."""
    return _apart(limb["hand"], limb["goal"]) < THERE


@jit
def withdraw_limb(limb):
    """Make the place at rest the goal."""
    copy(limb["rest"], limb["goal"])
    limb["withdrawn"] = True


@jit
def point_limb(limb, x, y, z):
    """Make a place relative to the root [m] the goal, or as far towards it as the arm is long."""
    shoulder, goal = limb["shoulder"], limb["goal"]
    way_x, way_y, way_z = x - shoulder[0], y - shoulder[1], z - shoulder[2]
    part = min(1.0, limb["length"] / max(length(way_x, way_y, way_z), THERE))
    goal[0], goal[1], goal[2] = shoulder[0] + part * way_x, shoulder[1] + part * way_y, shoulder[2] + part * way_z
    limb["withdrawn"] = False


@jit
def aim_limb(limb, x, y, link_start, link_end, link_radius):
    """Make the link nearest to the shoulder the goal; the root is at x, y [m]."""
    shoulder = limb["shoulder"]
    at = (shoulder[0] + x, shoulder[1] + y, shoulder[2])
    _, nearest = nearest_to_point(at, link_start, link_end, link_radius)
    point_limb(limb, nearest[0] - x, nearest[1] - y, nearest[2])


@jit
def move_limb(limb, dt):
    """Let the velocity act for ``dt`` [s]."""
    for i in range(3):
        limb["hand"][i] += limb["velocity"][i] * dt


@jit
def head_limb(limb, speed, dt, fastest):
    """Choose the velocity of the step to come: at ``speed`` [m/s] in the body to the goal, and no farther.

    ``fastest`` [m/s] is a bound on what is left of a motion elsewhere.
    """
    hand, goal, most = limb["hand"], limb["goal"], limb["acceleration"]
    far = _apart(hand, goal)
    rate = min(speed, stopping_speed(far, most, dt)) / far if far >= THERE else 0.0
    wanted = (rate * (goal[0] - hand[0]), rate * (goal[1] - hand[1]), rate * (goal[2] - hand[2]))
    velocity = _towards(limb, wanted, dt, fastest)
    if most < np.inf and _stops_from_shoulder(limb, velocity, dt) > limb["reach"]:
        velocity = _towards(limb, (0.0, 0.0, 0.0), dt, fastest)  # the arm is no longer
    for i in range(3):
        limb["velocity"][i] = velocity[i]


@jit
def _towards(limb, wanted, dt, fastest):
    """The wanted velocity, or as far towards it as the acceleration allows; see ``humans.acceleration.towards``."""
    v, acceleration = limb["velocity"], limb["acceleration"]
    if acceleration == np.inf:
        return wanted
    before = (v[0], v[1], v[2])
    most, speed = acceleration * dt, length(v[0], v[1], v[2])
    if speed > fastest:
        share = fastest / speed
        before = (share * v[0], share * v[1], share * v[2])
        most -= speed - fastest
    change = length(before[0] - wanted[0], before[1] - wanted[1], before[2] - wanted[2])
    if change <= most * (1.0 + ROUNDING):
        return wanted
    part = max(most, 0.0) / change
    return (
        before[0] + part * (wanted[0] - before[0]),
        before[1] + part * (wanted[1] - before[1]),
        before[2] + part * (wanted[2] - before[2]),
    )


@jit
def _stops_from_shoulder(limb, velocity, dt):
    """How far from the shoulder a hand comes to rest that brakes straight after the step to come [m]."""
    speed, most = length(velocity[0], velocity[1], velocity[2]), limb["acceleration"] * dt
    steps = max(math.ceil(speed / most), 1)
    way = steps - most / speed * steps * (steps - 1) / 2.0 if steps > 1 else 1.0
    hand = limb["hand"]
    place = (
        hand[0] + way * dt * velocity[0],
        hand[1] + way * dt * velocity[1],
        hand[2] + way * dt * velocity[2],
    )
    return _apart(place, limb["shoulder"])


@jit
def put_limb(limb, end, end_velocity):
    """Write the hand into the capsule of a body that has it at rest, shapes (m, 3)."""
    part = limb["part"]
    for i in range(3):
        end[part, i] += limb["hand"][i] - limb["rest"][i]
        end_velocity[part, i] += limb["velocity"][i]


@jit
def put_all(limbs, count, end, end_velocity):
    """:func:`put_limb` of the first ``count`` limbs."""
    for k in range(count):
        put_limb(limbs[k], end, end_velocity)


# ---- a single limb, shape (1,) of ``LIMB``, from Python --------------------------------------------


@jit
def withdraw(limb):
    """:func:`withdraw_limb`."""
    withdraw_limb(limb[0])


@jit
def aim(limb, x, y, link_start, link_end, link_radius):
    """:func:`aim_limb`."""
    aim_limb(limb[0], x, y, link_start, link_end, link_radius)


@jit
def point(limb, x, y, z):
    """:func:`point_limb`."""
    point_limb(limb[0], x, y, z)


@jit
def move(limb, dt):
    """:func:`move_limb`."""
    move_limb(limb[0], dt)


@jit
def head(limb, speed, dt, fastest):
    """:func:`head_limb`."""
    head_limb(limb[0], speed, dt, fastest)


@jit
def put(limb, end, end_velocity):
    """:func:`put_limb`."""
    put_limb(limb[0], end, end_velocity)
