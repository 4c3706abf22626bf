"""Somebody whom a visitor drags, and the same person beside another arm."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from jssa_gym.humans import Body, HumanMotion, nobody
from jssa_gym.humans.acceleration import HAND, RUNNER, towards
from jssa_gym.humans.body import NAMES
from jssa_gym.humans.hand import LEFT, RIGHT, Limb
from jssa_gym.kernels.walkers import stopping_speed
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import positive_number, real_array

HANDS = {NAMES[RIGHT]: RIGHT, NAMES[LEFT]: LEFT}
"""Body parts whose end can be dragged by itself, and their capsules' numbers."""

START = (1.6, 0.0)
"""Where the person stands at first [m]."""

_ASIDE = 0.4
"""The root comes no nearer to the base axis [m]: nobody stands in the robot's foot."""

_CATCH = 0.05
"""In this time a person who is not clamped is where the mouse is [s]: about that of a message from the page."""

_ASSUMED = FailsafeParams()

_FARTHEST = 6.0
"""Largest distance of the root from the base axis [m]: nobody is lost."""


class Dragged(HumanMotion):
    """Goes where it is drawn to: the body over the floor, each hand anywhere within the arm's length.

    Clamped, no point of the body is faster than ``speed``, no hand than ``limb_speed``, whatever the mouse does, and
    the body gathers speed as somebody who runs does. Not clamped, it is where the mouse is within 50 ms.

    Args:
        speed: Largest speed of the body [m/s].
        limb_speed: Largest speed of a hand in the world, at least ``speed`` [m/s].
        start: Where the person stands at first, shape (2,) [m]; later episodes begin where the last one ended.
    """

    clearance = 0.0
    reacts = False

    def __init__(
        self,
        speed: float = _ASSUMED.human_speed,
        limb_speed: float = _ASSUMED.limb_speed,
        start: Sequence[float] = START,
    ) -> None:
        x, y = real_array("start", start, (2,), "a point on the floor [m]").tolist()
        self.root: tuple[float, float] = (x, y)
        self.clamped = True
        self.keep_to(speed, limb_speed)
        self._begin(0)

    def keep_to(self, speed: float, limb_speed: float) -> None:
        """Be no faster than this from now on [m/s], while clamped.

        Raises:
            ParameterError: A speed is not positive.
        """
        self.speed = positive_number("speed", speed)
        self.limb_speed = max(positive_number("limb_speed", limb_speed), self.speed)
        self.speed_bound = self.limb_speed

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        return self.speed, self.limb_speed if part in HANDS else self.speed

    # ---- the mouse -------------------------------------------------------------------------------------

    def go(self, place: Sequence[float]) -> None:
        """Walk to a place on the floor, shape (2,) [m]; one that is not finite is no place."""
        x, y = place
        if not (math.isfinite(x) and math.isfinite(y)):
            return
        away = math.hypot(x, y)
        part = min(1.0, _FARTHEST / max(away, 1e-9))
        self._goal = (part * x, part * y)

    def reach(self, part: str, place: Sequence[float]) -> None:
        """Bring a hand to a place in the world, shape (3,) [m], or as far towards it as the arm is long.

        Args:
            part: Of :data:`HANDS`.
            place: The hand keeps it relative to the body when the body is dragged; one that is not finite is no place.
        """
        if not all(map(math.isfinite, place)):
            return
        x, y = self.root
        self._limbs[part].point((place[0] - x, place[1] - y, place[2]))

    def lower(self) -> None:
        """Let both hands hang again."""
        for limb in self._limbs.values():
            limb.withdraw()

    def stay(self) -> None:
        """Stop where it is."""
        self._goal = self.root

    # ---- a motion --------------------------------------------------------------------------------------

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        if start is not None:
            self.root = (float(start[0]), float(start[1]))
        self._begin(person)
        return self._body.at(self.root, self._velocity)

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        (x, y), (vx, vy) = self.root, self._velocity
        self.root = (x + vx * dt, y + vy * dt)
        self._velocity = self._next(dt)
        people = self._body.at(self.root, self._velocity)
        fastest = self.limb_speed - math.hypot(*self._velocity) if self.clamped else 1.0 / _CATCH
        for limb in self._limbs.values():
            limb.move(dt)
            limb.head(fastest, dt, fastest)
            limb.put(people)
        return people

    def _begin(self, person: int) -> None:
        x, y = self.root
        self._goal: tuple[float, float] = (x, y)
        self._velocity: tuple[float, float] = (0.0, 0.0)
        self._body = Body.facing(math.atan2(-y, -x), person)
        self._limbs = {name: Limb(self._body, part, acceleration=HAND) for name, part in HANDS.items()}

    def _next(self, dt: float) -> tuple[float, float]:
        """Velocity of the step to come [m/s]."""
        (x, y), goal = self.root, self._goal
        way = math.dist(self.root, goal)
        if not self.clamped:
            rate = 1.0 / max(_CATCH, dt)
            vx, vy = rate * (goal[0] - x), rate * (goal[1] - y)
        else:
            rate = min(self.speed, stopping_speed(way, RUNNER, dt)) / way if way > 1e-9 else 0.0
            wanted = (rate * (goal[0] - x), rate * (goal[1] - y))
            vx, vy = towards(self._clamp(*self._velocity), wanted, RUNNER, dt, self.speed)
        away = math.hypot(x + vx * dt, y + vy * dt)
        if 0.0 < away < _ASIDE:  # along the edge of the circle instead
            part = _ASIDE / away
            vx, vy = (part * (x + vx * dt) - x) / dt, (part * (y + vy * dt) - y) / dt
        return self._clamp(vx, vy) if self.clamped else (vx, vy)

    def _clamp(self, vx: float, vy: float) -> tuple[float, float]:
        part = min(1.0, self.speed / max(math.hypot(vx, vy), 1e-12))
        return part * vx, part * vy


class SameAs(HumanMotion):
    """The people of another environment, as they are there: the same for two arms, whichever they react to.

    Args:
        motion: Of the other environment.
        people: Their capsules there; asked after the other environment was reset or stepped.
    """

    reacts = False

    def __init__(self, motion: HumanMotion, people: Callable[[], CapsuleSet]) -> None:
        self._motion, self._people = motion, people
        self.people, self.clearance = motion.people, motion.clearance
        self.speed_bound = motion.speed_bound

    def end_speeds_of(self, part: str) -> tuple[float, float]:
        return self._motion.end_speeds_of(part)

    def acceleration_of(self, part: str) -> float | None:
        return self._motion.acceleration_of(part)

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        return self._people() if self.people else nobody()

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        return self._people() if self.people else nobody()
