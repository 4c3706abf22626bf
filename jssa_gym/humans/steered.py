"""Somebody who walks as told: what a search for the worst case steers."""

import math

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans.acceleration import HAND, acceleration_bound
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.hand import ARM_LENGTH, RIGHT, Limb
from jssa_gym.humans.motion import STILL, Point, Walk
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import positive_number, real_array


class Steered(Walk):
    """A walk, from rest, under given piecewise-constant accelerations; nothing in it is random.

    Args:
        parameters: Shape (segments, 2) or (segments, 3), clipped to [-1, 1]: the acceleration along x and y as a share
            of its bound, together shortened to 1, and, if it is there, the right hand: its speed as a share of what
            ``limb_speed`` leaves beside the walk, positive towards the link nearest to the shoulder, negative back.
            After the last segment the person walks on and the hand goes back.
        speed: Largest speed of the body; the velocity saturates there [m/s].
        acceleration: Largest acceleration of the body [m/s²]; more than people's, since a search is after the worst.
        limb_speed: Largest speed of the hand in the world, not below ``speed`` [m/s].
        limb_acceleration: Largest acceleration of the hand in the body, not below ``acceleration`` [m/s²]; None for
            none: it turns at once.
        period: Duration of a segment [s].
        start: Root at the beginning, shape (2,) [m], unless ``reset`` is told another.
        heading: Where the body looks [rad]; it does not turn.
    """

    clearance = 0.0

    def __init__(
        self,
        parameters: ArrayLike,
        *,
        speed: float = 1.6,
        acceleration: float = 8.0,
        limb_speed: float = 2.0,
        period: float = 0.4,
        start: ArrayLike = (2.0, 0.0),
        heading: float = np.pi,
        limb_acceleration: float | None = HAND,
    ) -> None:
        shape = np.shape(parameters)
        if len(shape) != 2 or shape[0] < 1 or shape[1] not in (2, 3):
            raise ParameterError(f"parameters have to be of shape (segments, 2) or (segments, 3), got shape {shape}")
        values = np.clip(real_array("parameters", parameters, shape, "shares of the bounds"), -1.0, 1.0)
        values[:, :2] /= np.maximum(np.hypot(values[:, 0], values[:, 1]), 1.0)[:, None]
        self.reacts = shape[1] == 3
        self._shares = [(*row, 0.0)[:3] for row in values.tolist()]
        self.speed, self.acceleration = positive_number("speed", speed), positive_number("acceleration", acceleration)
        self.limb_speed, self.period = positive_number("limb_speed", limb_speed), positive_number("period", period)
        if self.limb_speed < self.speed:
            raise ParameterError(f"limb_speed has to be at least speed, got {limb_speed!r} and {speed!r}")
        self.limb_acceleration = acceleration_bound("limb_acceleration", limb_acceleration)
        if self.limb_acceleration < self.acceleration:
            raise ParameterError(
                f"limb_acceleration has to be at least acceleration, got {limb_acceleration!r} and {acceleration!r}"
            )
        self.speed_bound = self.limb_speed if self.reacts else self.speed
        self.start, self.heading = real_array("start", start, (2,), "a point on the floor [m]"), float(heading)
        self.check_start(self.start)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        people = super().reset(rng, start, person)
        self._limb = Limb(self._body, RIGHT, ARM_LENGTH, self.limb_acceleration)
        return people

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        return self.speed, self.speed_bound if part == NAMES[RIGHT] else self.speed

    def acceleration_of(self, part: str) -> float:
        moves = self.reacts and part == NAMES[RIGHT]
        return self.acceleration + (self.limb_acceleration if moves else 0.0)

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        self._velocity = STILL
        return self.start if start is None else start, self.heading

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        people = super().step(dt, robot)
        if self.reacts:
            limb, share = self._limb, self._share()[2]
            limb.move(dt)
            if share > 0.0 and len(robot.radius):
                limb.aim(robot, self._root)
            else:
                limb.withdraw()
            fastest = self.limb_speed - math.hypot(*self._velocity)
            limb.head(abs(share) * fastest, dt, fastest)
            limb.put(people)
        return people

    def _share(self) -> tuple[float, ...]:
        segment = int((self._time + 1e-9) / self.period)
        return self._shares[segment] if segment < len(self._shares) else (0.0, 0.0, -1.0)

    def _next_velocity(self, dt: float) -> Point:
        x, y, _ = self._share()
        most = self.acceleration * dt
        vx, vy = self._velocity[0] + x * most, self._velocity[1] + y * most
        share = min(1.0, self.speed / max(math.hypot(vx, vy), 1e-12))
        return share * vx, share * vy
