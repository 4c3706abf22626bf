"""People for tests of perception and of shields: strollers, who wander with every capsule end, and balls."""

import functools
from typing import ClassVar

import gymnasium as gym
import numpy as np

from jssa_gym.humans import nobody
from jssa_gym.robots import RobotModel, lr_mate_200id_7l
from jssa_gym.types import CapsuleSet, JointState, Planes, Scene

DT = 0.008


@functools.cache
def _arm() -> RobotModel:
    return lr_mate_200id_7l()


class Stage(gym.Env):
    """An arm that rests and two people of three capsules; ``truth[k]`` are the ends and velocities (4, m, 3) of tick k.

    Every end wanders by itself, never faster than a bound and often at it.
    Ends are at full speed or, with ``rest``, at rest now and then.
    """

    metadata: ClassVar = {"render_modes": []}
    names = ("head", "right_arm", "left_leg") * 2
    dt = DT

    def __init__(self, speed: float = 1.6, rest: bool = True) -> None:
        self.shares = (0.0, 1.0, 1.0) if rest else (0.2, 1.0, 1.0)
        self.speed = np.full(6, speed)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (6,), np.float32)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.truth: list[np.ndarray] = []

    @property
    def robot(self) -> RobotModel:
        return _arm()

    def _velocities(self) -> np.ndarray:
        vectors = self.np_random.standard_normal((2, 6, 3))
        vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
        share = self.np_random.choice(self.shares, (2, 6, 1))
        return vectors * share * self.speed[:, None]

    def moved(self) -> np.ndarray:
        before = self.truth[-1]
        now = before.copy()
        now[:2] += before[2:] * DT
        if self.np_random.random() < 0.05:
            now[2:] = self._velocities()
        return now

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        ends = self.np_random.uniform(-2.0, 2.0, (2, 6, 3))
        self.truth = [np.concatenate([ends, self._velocities()])]
        return np.zeros(1, np.float32), {}

    def step(self, action=None):
        self.truth.append(self.moved())
        return np.zeros(1, np.float32), 0.0, False, False, {}

    @property
    def scene(self) -> Scene:
        m = len(self.names)
        rest = JointState(np.zeros(6), np.zeros(6), np.zeros(6))
        people = CapsuleSet(*self.truth[-1].copy(), np.full(m, 0.1), self.names, np.repeat([0, 1], 3)[:m])
        planes = Planes(np.zeros((0, 3)), np.zeros(0), ())
        time = (len(self.truth) - 1) * DT
        return Scene(time, rest, people, nobody(), planes, np.zeros(m), np.ones(m, np.bool_))


def ends_of(people: CapsuleSet) -> np.ndarray:
    """Starts, ends and their velocities, shape (4, m, 3)."""
    return np.array([people.start, people.end, people.start_velocity, people.end_velocity])


def ball(place, radius=0.1, name="core_body", velocity=(0.0, 0.0, 0.0), person=0) -> CapsuleSet:
    at, rate = np.array([place], float), np.array([velocity], float)
    return CapsuleSet(at, at.copy(), rate, rate.copy(), np.array([radius]), (name,), np.array([person]))
