"""Walkers whose steps are compiled, beside one arm and beside thousands."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from jssa_gym.humans.body import NO_LINKS, Body
from jssa_gym.humans.motion import Point, Walk
from jssa_gym.kernels.records import records
from jssa_gym.kernels.walkers import WALKER, choose, step_walker
from jssa_gym.types import Array, CapsuleSet


class Walker(Walk):
    """A walk of the package's own: :func:`~jssa_gym.kernels.walkers.step_walker` says where to and how fast.

    Subclasses write what they draw into the record, whose fields :data:`~jssa_gym.kernels.walkers.WALKER` names.
    """

    record: NDArray[Any]
    """Where it is and what it is up to, shape (1,) of ``WALKER``."""
    body: Body
    """Its capsules around its root."""
    kind: ClassVar[int]
    """How they walk, of :mod:`jssa_gym.kernels.walkers`."""
    draws: ClassVar[int] = 1
    """Random numbers that a step may ask for at once."""

    def reset(self, rng: np.random.Generator, start: Array | None = None, person: int = 0) -> CapsuleSet:
        if start is not None:
            self.check_start(start)
        self._rng, self.record = rng, records(1, WALKER)
        walker = self.record[0]
        walker["kind"], walker["speed"], walker["square"] = self.kind, self.speed_bound, 2.0
        root, heading = self._write(walker, rng, start)
        walker["root"], self.body = root, Body.facing(heading, person)
        return self._stands(self._next_velocity(0.0))

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        body = self.body
        links = (robot.start, robot.end, robot.radius) if self.reacts else NO_LINKS
        if not step_walker(self.record, body.start, body.end, dt, *links, body.radius):
            return self._stands(self._next_velocity(dt))
        x, y = self.record[0]["velocity"].tolist()
        return self._stands((x, y))

    @abstractmethod
    def _write(self, walker: Any, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        """Draw an episode into a record of ``WALKER``; the root's start (2,) [m] and the body's heading [rad]."""

    def _begin(self, rng: np.random.Generator, start: Array | None) -> tuple[Array, float]:
        return self._write(self.record[0], rng, start)

    def _next_velocity(self, dt: float) -> Point:
        while not choose(self.record, dt):
            walker = self.record[0]
            walker["ahead"][: self.draws] = self._rng.random(self.draws)
            walker["drawn"], walker["used"] = self.draws, 0
        x, y = self.record[0]["velocity"].tolist()
        return x, y

    def _stands(self, velocity: Point) -> CapsuleSet:
        x, y = self.record[0]["root"].tolist()
        return self.body.at((x, y), velocity)
