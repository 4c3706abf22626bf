"""People who reach for the arm with a hand."""

import math
from collections.abc import Sequence

import numpy as np

from jssa_gym.humans.acceleration import HAND, acceleration_bound, stopping_place, stopping_speed, towards
from jssa_gym.humans.body import NAMES, Body
from jssa_gym.humans.motion import CLEARANCE, STILL, HumanMotion, Point, check_clearance
from jssa_gym.kernels.reach import nearest_to_point
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high, positive_number, share

RIGHT, LEFT = NAMES.index("right_arm"), NAMES.index("left_arm")
_ARMS = (NAMES[RIGHT], NAMES[LEFT])

ARM_LENGTH = 0.7
"""Shoulder to hand of a stretched arm [m]; 0.58 m at rest."""

_THERE = 1e-9
"""Distance at which a hand is at its goal [m]."""


class Limb:
    """An arm of a body whose hand moves on straight lines; the shoulder stays where it is in the body.

    A hand comes to rest at its goal. If the goal changes while it moves, it turns as fast as its acceleration allows.

    Args:
        body: Whose arm.
        part: Its capsule.
        length: Largest distance from shoulder to hand [m].
        acceleration: Largest acceleration of the hand in the body, or infinity [m/s²].
    """

    def __init__(self, body: Body, part: int, length: float = ARM_LENGTH, acceleration: float = math.inf) -> None:
        self._part, self._length, self._acceleration = part, length, acceleration
        self._shoulder, self._rest = body.start[part].tolist(), body.end[part].tolist()
        self._hand, self._goal = self._rest, self._rest
        self._velocity: Sequence[float] = (0.0, 0.0, 0.0)
        self._reach = max(length, math.dist(self._shoulder, self._rest)) + _THERE

    @property
    def arrived(self) -> bool:
        """Whether the hand is at its goal."""
        return math.dist(self._hand, self._goal) < _THERE

    @property
    def withdrawn(self) -> bool:
        """Whether the goal is the hand's place at rest."""
        return self._goal is self._rest

    def withdraw(self) -> None:
        """Make the place at rest the goal."""
        self._goal = self._rest

    def aim(self, robot: CapsuleSet, root: Point) -> None:
        """Make the link nearest to the shoulder the goal, or as far towards it as the arm is long."""
        sx, sy, sz = self._shoulder
        x, y = root
        _, (px, py, pz) = nearest_to_point((sx + x, sy + y, sz), robot.start, robot.end, robot.radius)
        self.point((px - x, py - y, pz))

    def point(self, place: Sequence[float]) -> None:
        """Make a place relative to the root, shape (3,) [m], the goal, or as far towards it as the arm is long."""
        sx, sy, sz = self._shoulder
        way = (place[0] - sx, place[1] - sy, place[2] - sz)
        part = min(1.0, self._length / max(math.hypot(*way), _THERE))
        self._goal = [sx + part * way[0], sy + part * way[1], sz + part * way[2]]

    def move(self, dt: float) -> None:
        """Let the velocity act for ``dt`` [s]."""
        self._hand = [h + v * dt for h, v in zip(self._hand, self._velocity, strict=True)]

    def head(self, speed: float, dt: float, fastest: float = math.inf) -> None:
        """Choose the velocity of the step to come: at ``speed`` [m/s] in the body to the goal, and no farther.

        ``fastest`` [m/s] is a bound on what is left of a motion elsewhere, see :func:`towards`.
        """
        length, most = math.dist(self._hand, self._goal), self._acceleration
        rate = min(speed, stopping_speed(length, most, dt)) / length if length >= _THERE else 0.0
        wanted = [rate * (g - h) for g, h in zip(self._goal, self._hand, strict=True)]
        velocity = towards(self._velocity, wanted, most, dt, fastest)
        if most < math.inf and math.dist(stopping_place(self._hand, velocity, most, dt), self._shoulder) > self._reach:
            velocity = towards(self._velocity, (0.0, 0.0, 0.0), most, dt, fastest)  # the arm is no longer
        self._velocity = velocity

    def put(self, people: CapsuleSet) -> None:
        """Write the hand into the capsules of its body, which has the limb at rest."""
        people.end[self._part] += [h - r for h, r in zip(self._hand, self._rest, strict=True)]
        people.end_velocity[self._part] += self._velocity


class Hand(HumanMotion):
    """Stands in front of the arm and flicks a hand, or either, at the nearest link and back, again and again.

    The stroke goes straight to where the link is as it begins. Body, legs and shoulders stand still; only the ends
    of the arms move. Without an arm there is nothing to reach for.

    Args:
        front: Range of the root's x [m]; the default is about where the hand just reaches the arm at home.
        side: Range of the root's y [m].
        speed: Range of the hand's speed, drawn for every stroke [m/s].
        pause: Range of the time between strokes [s].
        both: Probability of the left hand taking part as well.
        length: Largest distance from shoulder to hand [m].
        acceleration: Largest acceleration of the hand [m/s²]; None for none: it turns at once.
    """

    def __init__(
        self,
        front: Sequence[float] = (0.95, 1.3),
        side: Sequence[float] = (-0.3, 0.3),
        speed: Sequence[float] = (1.0, 2.0),
        pause: Sequence[float] = (0.1, 0.8),
        both: float = 0.5,
        length: float = ARM_LENGTH,
        acceleration: float | None = HAND,
    ) -> None:
        self.front, self.side = low_high("front", front, CLEARANCE), low_high("side", side, -np.inf)
        self.speed, self.pause = low_high("speed", speed, 1e-3), low_high("pause", pause)
        self.both, self.length = share("both", both), positive_number("length", length)
        self.acceleration = acceleration_bound("acceleration", acceleration)
        self.speed_bound = self.speed[1]

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        return 0.0, self.speed_bound if part in _ARMS else 0.0

    def acceleration_of(self, part: str) -> float:
        return self.acceleration if part in _ARMS else 0.0

    def check_start(self, start: Array) -> None:
        check_clearance(start)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        if start is None:
            start = np.array([rng.uniform(*self.front), rng.uniform(*self.side)])
        else:
            self.check_start(start)
        self._rng, self._time, self._root = rng, 0.0, (float(start[0]), float(start[1]))
        self._body = Body.facing(math.atan2(-self._root[1], -self._root[0]), person)
        parts = (RIGHT, LEFT) if rng.random() < self.both else (RIGHT,)
        self._limbs = [Limb(self._body, part, self.length, self.acceleration) for part in parts]
        self._speeds = [0.0 for _ in parts]
        self._moments = [rng.uniform(*self.pause) for _ in parts]
        return self._body.at(self._root, STILL)

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        self._time += dt
        people = self._body.at(self._root, STILL)
        for k, limb in enumerate(self._limbs):
            limb.move(dt)
            if limb.arrived and self._time >= self._moments[k]:
                self._turn(k, robot)
            limb.head(self._speeds[k], dt)
            limb.put(people)
        return people

    def _turn(self, k: int, robot: CapsuleSet) -> None:
        """Begin the next stroke of a limb: out, or back at once."""
        limb = self._limbs[k]
        if not limb.withdrawn:
            limb.withdraw()
            self._moments[k] = self._time + self._rng.uniform(*self.pause)
        elif len(robot.radius):
            limb.aim(robot, self._root)
        self._speeds[k] = self._rng.uniform(*self.speed)
