"""People who reach for the arm with a hand."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from jssa_gym.humans.acceleration import HAND, acceleration_bound
from jssa_gym.humans.body import NAMES, NO_LINKS, Body
from jssa_gym.humans.motion import CLEARANCE, STILL, HumanMotion, Point, check_clearance
from jssa_gym.kernels.limbs import (
    FLICKS,
    GESTURE,
    LIMB,
    THERE,
    aim,
    go_on,
    head,
    move,
    point,
    put,
    put_all,
    step_gesture,
    withdraw,
)
from jssa_gym.kernels.records import records
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import low_high, positive_number, share

RIGHT, LEFT = NAMES.index("right_arm"), NAMES.index("left_arm")

ARM_LENGTH = 0.7
"""Shoulder to hand of a stretched arm [m]; 0.58 m at rest."""


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
        self.record = records(1, LIMB)
        write_limb(self.record[0], body, part, length, acceleration)

    @property
    def withdrawn(self) -> bool:
        """Whether the goal is the hand's place at rest."""
        return bool(self.record[0]["withdrawn"])

    def withdraw(self) -> None:
        """Make the place at rest the goal."""
        withdraw(self.record)

    def aim(self, robot: CapsuleSet, root: Point) -> None:
        """Make the link nearest to the shoulder the goal, or as far towards it as the arm is long."""
        aim(self.record, root[0], root[1], robot.start, robot.end, robot.radius)

    def point(self, place: Sequence[float]) -> None:
        """Make a place relative to the root, shape (3,) [m], the goal, or as far towards it as the arm is long."""
        point(self.record, *map(float, place))

    def move(self, dt: float) -> None:
        """Let the velocity act for ``dt`` [s]."""
        move(self.record, dt)

    def head(self, speed: float, dt: float, fastest: float = math.inf) -> None:
        """Choose the velocity of the step to come: at ``speed`` [m/s] in the body to the goal, and no farther.

        ``fastest`` [m/s] is a bound on what is left of a motion elsewhere.
        """
        head(self.record, speed, dt, fastest)

    def put(self, people: CapsuleSet) -> None:
        """Write the hand into the capsules of its body, which has the limb at rest."""
        put(self.record, people.end, people.end_velocity)


def write_limb(limb: Any, body: Body, part: int, length: float, acceleration: float) -> None:
    """A limb at rest, into a record of ``LIMB``; arguments as of :class:`Limb`."""
    limb["shoulder"], limb["rest"], limb["hand"], limb["goal"] = body.start[part], *(body.end[part],) * 3
    limb["length"], limb["acceleration"], limb["part"], limb["withdrawn"] = length, acceleration, part, True
    limb["reach"] = max(length, math.dist(limb["shoulder"], limb["rest"])) + THERE


class Gesturer(HumanMotion):
    """Stands and moves hands; :func:`~jssa_gym.kernels.limbs.step_gesture` says where to and how fast."""

    record: NDArray[Any]
    """Who it is, shape (1,) of ``GESTURE``."""
    limbs: NDArray[Any]
    """The arms that move, shape (2,) of ``LIMB``."""
    body: Body
    """The capsules around the root, with the arms at rest."""
    front: tuple[float, float]
    side: tuple[float, float]
    acceleration: float
    arms: ClassVar[tuple[str, ...]]
    """Names of the capsules that may move."""
    _rng: np.random.Generator | None = None

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        return 0.0, self.speed_bound if part in self.arms else 0.0

    def acceleration_of(self, part: str) -> float:
        return self.acceleration if part in self.arms else 0.0

    def check_start(self, start: Array) -> None:
        check_clearance(start)

    def _stand(self, kind: int, rng: np.random.Generator, start: Array | None, person: int) -> tuple[Any, Point]:
        """Begin to stand at ``start``, or where is drawn, facing the base axis: the record to write into, the root."""
        if start is None:
            start = np.array([rng.uniform(*self.front), rng.uniform(*self.side)])
        else:
            self.check_start(start)
        root = float(start[0]), float(start[1])
        self.record, self.limbs = records(1, GESTURE), records(2, LIMB)
        self.record[0]["kind"], self.record[0]["root"] = kind, root
        self.body = Body.facing(math.atan2(-root[1], -root[0]), person)
        return self.record[0], root

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        links = (robot.start, robot.end, robot.radius) if self.reacts else NO_LINKS
        chosen = step_gesture(self.record, self.limbs, dt, *links)
        gesture = self.record[0]
        while not chosen and self._rng is not None:
            asked = int(gesture["asks"])
            gesture["ahead"][:asked], gesture["drawn"], gesture["used"] = self._rng.random(asked), asked, 0
            chosen = go_on(self.record, self.limbs, dt, *links)
        x, y = gesture["root"].tolist()
        people = self.body.at((x, y), STILL)
        put_all(self.limbs, gesture["limbs"], people.end, people.end_velocity)
        return people


class Hand(Gesturer):
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

    arms = NAMES[RIGHT], NAMES[LEFT]

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

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        self._rng = rng
        gesture, root = self._stand(FLICKS, rng, start, person)
        parts = (RIGHT, LEFT) if rng.random() < self.both else (RIGHT,)
        gesture["limbs"] = len(parts)
        gesture["slowest"], gesture["fastest"] = self.speed
        gesture["shortest"], gesture["longest"] = self.pause
        for k, part in enumerate(parts):
            write_limb(self.limbs[k], self.body, part, self.length, self.acceleration)
            self.limbs[k]["moment"] = rng.uniform(*self.pause)
        return self.body.at(root, STILL)
