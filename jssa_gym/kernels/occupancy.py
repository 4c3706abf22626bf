r"""Where a person can be, more closely than a capsule that grows as fast as its fastest point.

Two sets that hold a body part, each for a reason of its own; a gap that is clear of either is clear. Both ends of a
capsule move within balls, and a point of its axis at share r is a convex combination of them, so that it moves within
the ball of the interpolated centre and radius.

* **Tapered**: ends with speed bounds :math:`v_0, v_1` let the point at share r move at :math:`(1 - r) v_0 + r v_1`. The
  set is the hull of two balls of different radius, and its gap is not at the closest point of the axis; the capsule is
  split into pieces, each of which grows as fast as its faster end.
* **Swerving**: a point measured at p with velocity v, known to :math:`\varepsilon_v`, that accelerates by at most
  :math:`\hat a`, is at time t in the ball around p + v t of radius
  :math:`\varepsilon_p + \varepsilon_v t + \hat a t^2/2`. These balls do not contain each other, so that a time known
  only to lie in an interval takes a ball around its middle.
"""

import numpy as np

from jssa_gym.kernels.capsules import capsule_pair
from jssa_gym.kernels.jit import jit, part
from jssa_gym.kernels.records import PIECES
from jssa_gym.kernels.vector import dot

UNCONFIRMED, STEADY, SWERVED = 0, 1, -1
"""Whether a body part has kept its acceleration bound: nobody has seen it, from sample to sample so far, not always."""


@part
def confine_people(people, age, lag, error, tracks, confined):
    """Take down what the closer sets are made of.

    Args:
        people: Trusted starts, ends and their velocities, shape (4, k, 3) [m, m/s].
        age: Of the measurements, shape (k,) [s].
        lag: Of the arm behind its commands [s].
        error: Of a measurement and of the arm's place [m].
        tracks: What is assumed and remembered of them, shape (k,) of ``TRACK``.
        confined: Result, shape (k,) of ``CONFINED``.
    """
    for k in range(age.shape[0]):
        one, track = confined[k], tracks[k]
        one["slower"][0], one["slower"][1] = track["slower"][0], track["slower"][1]
        one["acceleration"] = track["acceleration"] if track["steady"] == STEADY else 0.0
        if not is_confined(one):
            continue
        one["late"], one["error"] = age[k] + lag, error
        one["velocity_error"] = track["velocity_error"]
        for i in range(3):
            start, way = people[0, k, i], people[1, k, i] - people[0, k, i]
            for p in range(PIECES + 1):
                one["knots"][p, i] = start + p / PIECES * way
            one["start_velocity"][i], one["end_velocity"][i] = people[2, k, i], people[3, k, i]
        fastest = max(dot(people[2, k], people[2, k]), dot(people[3, k], people[3, k]))
        one["speed"] = np.sqrt(fastest)


@jit
def is_confined(one):
    """Whether anything confines a body part, a ``CONFINED``, more closely than its capsule does."""
    return one["slower"][0] > 0.0 or one["slower"][1] > 0.0 or one["acceleration"] > 0.0


@part
def apart_for(part, radii, one, reach, speed, rate, t):
    """How long a pair that the plain capsule may close is apart nevertheless [s]; 0 or less, or NaN, if it may not be.

    Args:
        part: The robot's capsule, a ``SEGMENT``.
        radii: Sum of both radii [m].
        one: The person's, a ``CONFINED``.
        reach: How much it has grown until now, at its faster end [m].
        speed: How fast that grows [m/s].
        rate: How fast the robot's axis moves from now on, at most [m/s].
        t: Time from now [s].
    """
    lasts = 0.0
    if one["slower"][0] > 0.0 or one["slower"][1] > 0.0:
        lasts = _apart_tapered(part, radii, one, reach, speed, rate, t)
    if one["acceleration"] > 0.0:
        other = _apart_swerving(part, radii, one, rate, t)
        lasts = other if other > lasts else lasts
    return lasts


@part
def _apart_tapered(part, radii, one, reach, speed, rate, t):
    """The shortest time of any of the pieces, each of which grows as fast as its faster end."""
    shortest, slower, knots = np.inf, one["slower"], one["knots"]
    for p in range(PIECES):
        near, far = p / PIECES, (p + 1) / PIECES
        less = min((1.0 - near) * slower[0] + near * slower[1], (1.0 - far) * slower[0] + far * slower[1])
        gap, _, _ = capsule_pair(part["start"], part["end"], knots[p], knots[p + 1], radii)
        growth = speed - less
        lasts = (gap - (reach - less * one["late"]) - growth * t) / (rate + growth)
        if not (lasts > 0.0):
            return lasts
        shortest = min(shortest, lasts)
    return shortest


@part
def _apart_swerving(part, radii, one, rate, t):
    """The time of a capsule that moves on as it was measured to, and grows by what its acceleration can add."""
    late, moved, a = one["late"], one["moved"], one["acceleration"]
    # by when it is t, between t and t + late have passed since the measurement: age and lag are upper bounds
    middle, longest = t + late / 2.0, t + late
    for i in range(3):
        moved[0, i] = one["knots"][0, i] + middle * one["start_velocity"][i]
        moved[1, i] = one["knots"][PIECES, i] + middle * one["end_velocity"][i]
    gap, _, _ = capsule_pair(part["start"], part["end"], moved[0], moved[1], radii)
    gap -= one["error"] + one["velocity_error"] * longest + a * longest * longest / 2.0 + one["speed"] * late / 2.0
    if not (gap > 0.0):
        return 0.0
    # gap = closing s + a s² / 2: both approach, ever faster
    closing = rate + one["speed"] + one["velocity_error"] + a * longest
    return 2.0 * gap / (closing + np.sqrt(closing * closing + 2.0 * a * gap))
