"""People who come and go, for tests: who runs in at a region's edge, and worlds in which everything goes wrong."""

from typing import NamedTuple

import numpy as np

from jssa_gym.humans import HumanMotion, nobody
from jssa_gym.types import CapsuleSet

RADIUS = 0.1


def ball(at, velocity=(0.0, 0.0, 0.0), person: int = 0, name: str = "hand", radius: float = RADIUS) -> CapsuleSet:
    """Somebody who is a ball."""
    at, velocity = np.array([at], float), np.array([velocity], float)
    return CapsuleSet(
        at, at.copy(), velocity, velocity.copy(), np.array([radius]), (name,), np.array([person], np.int64)
    )


class Runner(HumanMotion):
    """Nobody, until a ball comes in at the edge of a box about the base axis and runs at the nearest link."""

    people, clearance, reacts = 1, 0.0, True

    def __init__(self, half: float, speed: float = 2.0, heights=(1.0, 1.6)) -> None:
        self.half, self.speed_bound, self.heights = half, speed, heights

    def reset(self, rng, start=None, person=0):
        self._wait, side = rng.uniform(0.1, 1.0), rng.integers(4)
        beyond, along = self.half + RADIUS, rng.uniform(-0.7, 0.7) * self.half
        x, y = [(beyond, along), (along, beyond), (-beyond, along), (along, -beyond)][side]
        self._at, self._velocity = np.array([x, y, rng.uniform(*self.heights)]), np.zeros(3)
        self._person = int(rng.integers(100))
        return nobody()

    def step(self, dt, robot):
        self._wait -= dt
        if self._wait > 0.0:
            return nobody()
        self._at = self._at + self._velocity * dt
        start, way = robot.start, robot.end - robot.start
        share = np.clip(((self._at - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12), 0.0, 1.0)
        to = start + share[:, None] * way - self._at
        near = np.linalg.norm(to, axis=1) - robot.radius
        near[0] = np.inf  # the column does not move
        k = int(near.argmin())
        self._velocity = self.speed_bound * to[k] / max(np.linalg.norm(to[k]), 1e-9)
        if np.abs(self._at[:2]).max() >= self.half + RADIUS:
            return nobody()  # not in yet
        return ball(self._at, self._velocity, self._person)


class Frame(NamedTuple):
    """What a camera delivers."""

    people: CapsuleSet
    age: np.ndarray
    valid: np.ndarray
    frame_age: float


class World:
    """Balls that wander in and out of a box, seen by a camera that is late, imprecise, and mixes people up.

    Args:
        rng: Randomness.
        half: Half of the box' side [m].
        speed: Nobody is faster [m/s].
        error: Of a measured place [m].
        period: Ticks between two frames.
        late: Ticks by which they are late.
        occluded: Probability for somebody who is known to be hidden in a frame.
        swaps: Probability that two people who are both measured have each other's ids.
        listed: Whether who is hidden stays in the list.
    """

    dt = 0.008

    def __init__(self, rng, half=1.0, speed=2.0, error=0.0, period=1, late=0, occluded=0.0, swaps=0.0, listed=True):
        self.rng, self.half, self.speed, self.error = rng, half, speed, error
        self.period, self.late, self.occluded, self.swaps, self.listed = period, late, occluded, swaps, listed
        self.tick, self.next_id = 0, 1
        self.at, self.velocity, self.ids = np.zeros((0, 3)), np.zeros((0, 3)), []
        self.known: set[int] = set()
        self.frames: list[tuple[int, CapsuleSet, np.ndarray]] = []
        self.hidden: dict[int, int] = {}

    @property
    def time(self):
        return self.tick * self.dt

    def step(self):
        rng = self.rng
        self.tick += 1
        self.at = self.at + self.velocity * self.dt
        if len(self.ids) < 4 and rng.random() < 0.05:
            side, along = rng.integers(4), rng.uniform(-self.half, self.half)
            out = self.half + RADIUS + 0.3
            x, y = [(out, along), (along, out), (-out, along), (along, -out)][side]
            self.at = np.vstack([self.at, [x, y, 1.0]])
            self.velocity = np.vstack([self.velocity, np.zeros(3)])
            self.ids.append(self.next_id)
            self.next_id += 1
        for k in range(len(self.ids)):
            if rng.random() < 0.05 or not self.velocity[k].any():
                goal = rng.uniform(-1.2, 1.2, 3) * [self.half, self.half, 0.0] + [0.0, 0.0, 1.0]
                way = goal - self.at[k]
                self.velocity[k] = rng.choice([0.3, 1.0]) * self.speed * way / np.linalg.norm(way)
        gone = np.abs(self.at[:, :2]).max(axis=1, initial=0.0) > self.half + RADIUS + 0.6
        keep = np.flatnonzero(~gone)
        self.at, self.velocity = self.at[keep], self.velocity[keep]
        self.ids = [self.ids[k] for k in keep]
        if self.tick % self.period == 0:
            self._look()

    def _look(self):
        rng, shown, valid = self.rng, [], []
        for k, who in enumerate(self.ids):
            outside = np.abs(self.at[k, :2]).max() > self.half + RADIUS + self.error
            if outside:  # who comes in has to be seen
                self.known.discard(who)
                self.hidden.pop(who, None)
            if self.hidden.get(who, 0) > 0:
                self.hidden[who] -= 1
                if self.listed:
                    shown.append(k)
                    valid.append(False)
                continue
            if outside and rng.random() < 0.5:
                continue  # not of interest there
            if who in self.known and rng.random() < self.occluded:
                self.hidden[who] = int(rng.integers(1, 5))
            shown.append(k)
            valid.append(True)
            if not outside:
                self.known.add(who)
        ids = [self.ids[k] for k in shown]
        seen = [n for n in range(len(shown)) if valid[n]]
        if len(seen) > 1 and rng.random() < self.swaps:
            a, b = rng.choice(seen, 2, replace=False)
            ids[a], ids[b] = ids[b], ids[a]
        order = rng.permutation(len(shown))
        noise = rng.standard_normal((len(shown), 3))
        noise *= self.error / np.maximum(np.linalg.norm(noise, axis=1, keepdims=True), 1e-9)
        at = (self.at[shown] + noise)[order]
        velocity = self.velocity[shown][order]
        people = CapsuleSet(
            at, at.copy(), velocity, velocity.copy(), np.full(len(shown), RADIUS), ("hand",) * len(shown),
            np.array([ids[n] for n in order], np.int64),
        )  # fmt: skip
        self.frames.append((self.tick, people, np.array([valid[n] for n in order], np.bool_)))

    def frame(self) -> Frame:
        """The newest that has arrived."""
        arrived = [frame for frame in self.frames if frame[0] + self.late <= self.tick]
        if not arrived:
            return Frame(nobody(), np.zeros(0), np.zeros(0, np.bool_), np.nan)
        self.frames = [frame for frame in self.frames if frame[0] >= arrived[-1][0]]
        tick, people, valid = arrived[-1]
        age = (self.tick - tick) * self.dt
        return Frame(people, np.full(len(valid), age), valid, age)
