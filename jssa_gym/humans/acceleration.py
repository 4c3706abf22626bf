"""How fast people change their velocity: bounds on the acceleration of walkers and hands, and how they are kept.

Velocities are held for a step, so a bound of a [m/s²] means that from one step of dt to the next a velocity changes by
at most a · dt. A bound of infinity lets it change at once.
"""

import math
from collections.abc import Sequence

from jssa_gym.validation import positive_number

WALKER = 3.0
"""Largest acceleration of somebody who walks, unless told otherwise [m/s²]: from 1 m/s to rest in a third of a second,
half a step, which is a brisk stop."""

RUNNER = 5.0
"""Acceleration of somebody who runs at the arm [m/s²]: the first steps of a sprint."""

HAND = 30.0
"""Acceleration of a hand beside its body [m/s²]: 2 m/s after 7 cm, as in a fast reach."""

_ROUNDING = 1e-10
"""Share by which a change may exceed the bound for rounding."""


def acceleration_bound(name: str, value: float | None) -> float:
    """A positive, finite bound [m/s²]; infinity for None, which stands for none.

    Raises:
        ParameterError: It is something else.
    """
    return math.inf if value is None else positive_number(name, value)


def towards(
    velocity: Sequence[float], wanted: Sequence[float], acceleration: float, dt: float, fastest: float = math.inf
) -> Sequence[float]:
    """The velocity of the step to come: the wanted one, or as far towards it as the bound allows.

    Args:
        velocity: Of the step before, shape (k,) [m/s].
        wanted: Shape (k,), not faster than ``fastest`` [m/s].
        acceleration: Its bound, or infinity [m/s²].
        dt: Duration of the step [s].
        fastest: Bound on the speed [m/s], which falls by at most ``acceleration`` · ``dt`` a step. It is kept first;
            what it leaves of the change is turned to what is wanted.
    """
    if acceleration == math.inf:
        return wanted
    most, speed = acceleration * dt, math.hypot(*velocity)
    if speed > fastest:
        velocity, most = [fastest / speed * v for v in velocity], most - (speed - fastest)
    change = math.dist(velocity, wanted)
    if change <= most * (1.0 + _ROUNDING):
        return wanted
    part = max(most, 0.0) / change
    return [v + part * (w - v) for v, w in zip(velocity, wanted, strict=True)]
