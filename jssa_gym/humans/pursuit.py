"""Somebody who runs at the arm."""

import math
from collections.abc import Sequence

import numpy as np

from jssa_gym.humans.acceleration import RUNNER, acceleration_bound, stopping_speed, towards
from jssa_gym.humans.motion import STILL, Point, Walk
from jssa_gym.kernels.reach import nearest_to_walker
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high, positive_number


class Pursuit(Walk):
    """Runs straight at the nearest link that walking can touch, wherever the arm moves it, into contact.

    The body does not turn: its closest capsule closes in on the closest of the arm's at that height, until their axes
    cross. It does not slow down before it touches. In the first step it stands, and for ever where there is no arm.

    Args:
        speed: Running speed [m/s].
        acceleration: Largest acceleration [m/s²]; None for none: it starts, turns and stops at once.
        feint: Whether it stops and starts again at random.
        distance: Range of the root's distance from the base axis at the beginning [m]; the default is out of reach.
    """

    clearance = 0.0
    reacts = True

    def __init__(
        self,
        speed: float = 1.6,
        acceleration: float | None = RUNNER,
        feint: bool = False,
        distance: Sequence[float] = (1.9, 3.0),
    ) -> None:
        self.speed_bound = positive_number("speed", speed)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.feint = feint
        self.distance = low_high("distance", distance, 0.6)

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        self._rng, self._velocity, self._way, self._touches = rng, STILL, STILL, False
        self._runs, self._change = True, rng.uniform(0.5, 1.5)
        if start is None:
            bearing, distance = rng.uniform(-np.pi, np.pi), rng.uniform(*self.distance)
            start = distance * np.array([np.cos(bearing), np.sin(bearing)])
        return start, np.arctan2(-start[1], -start[0])

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        (x, y), (vx, vy), body = self._root, self._velocity, self._body
        # from where the body will stand when the velocity to be chosen begins
        gap, *way = nearest_to_walker(
            body.start, body.end, body.radius, x + vx * dt, y + vy * dt, robot.start, robot.end, robot.radius
        )
        self._way, self._touches = (way[0], way[1]), gap <= 0.0
        return super().step(dt, robot)

    def _next_velocity(self, dt: float) -> Point:
        if dt == 0.0:
            return STILL
        if self.feint and self._time >= self._change:
            self._runs = not self._runs
            self._change = self._time + (self._rng.uniform(0.3, 1.5) if self._runs else self._rng.uniform(0.1, 0.6))
        length = math.hypot(*self._way)
        # onto the arm, not beyond it, as far as the acceleration allows who has run into it
        most = stopping_speed(length, self.acceleration if self._touches else math.inf, dt)
        share = min(self.speed_bound, most) / length if self._runs and length > 0.0 else 0.0
        vx, vy = self._velocity
        dx, dy = share * self._way[0] - vx, share * self._way[1] - vy
        vx, vy = towards(self._velocity, (vx + dx, vy + dy), self.acceleration, dt)
        return vx, vy
