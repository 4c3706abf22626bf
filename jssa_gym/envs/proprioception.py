"""What an arm says about itself, and when: faults of the joint state and of the clock."""

import copy
from collections import deque

import gymnasium as gym
import numpy as np

from jssa_gym.envs.bursts import Bursts
from jssa_gym.envs.faults import GLITCHES, SensorFaults
from jssa_gym.robots import JointLimits
from jssa_gym.types import Array, JointState, Scene


class Proprioception:
    """Delivers the scenes of an episode with another joint state, later, or again.

    Args:
        faults: What is wrong.
        limits: Of the joints: what glitches and drift are shares of.
    """

    def __init__(self, faults: SensorFaults, limits: JointLimits) -> None:
        self._faults, self._scale = faults, limits.state_scale
        self.rng: np.random.Generator | None = None

    def reset(self, first: Scene | None, rng: np.random.Generator) -> None:
        """Begin an episode with its first scene, which is delivered as it is; faults are drawn from ``rng``."""
        faults, self.rng = self._faults, rng
        self._freezes = Bursts(faults.joint_freeze, faults.joint_freeze_ticks)
        self._glitches = Bursts(faults.joint_glitch, faults.joint_glitch_ticks)
        self._lags = Bursts(faults.lag, faults.lag_ticks)
        self._stills = Bursts(faults.freeze_scene, faults.freeze_scene_ticks)
        self._kind, self._ticks = faults.joint_glitch_kind, 0
        self._state = None if first is None else np.array(first.robot)
        self._past = deque([copy.deepcopy(first)], maxlen=faults.lag_age + 1)
        self._shown = first

    def perceive(self, scene: Scene | None) -> Scene | None:
        """One tick's scene as it is delivered; None where there is none."""
        if self.rng is None:
            raise gym.error.ResetNeeded("reset() has to come before perceive()")
        self._ticks += 1
        for bursts in (self._freezes, self._lags, self._stills):
            bursts.step(self.rng)
        if self._glitches.step(self.rng)[0] and self._faults.joint_glitch_kind == "any":
            self._kind = GLITCHES[self.rng.integers(len(GLITCHES))]
        if scene is None:
            return None
        if self._state is None or not self._freezes.on[0]:
            self._state = self._read(np.array(scene.robot), self.rng)
        # copies: what somebody does to a scene must not come back
        scene = scene._replace(robot=JointState(*self._state.copy()))
        self._past.append(copy.deepcopy(scene))
        if self._lags.on[0]:
            scene = copy.deepcopy(self._past[0])
        if self._shown is None or not self._stills.on[0]:
            self._shown = scene
        return self._shown

    def _read(self, state: Array, rng: np.random.Generator) -> Array:
        """What is read of a joint state, shape (3, n)."""
        state += self._faults.joint_drift * self._ticks * self._scale
        size = self._faults.joint_glitch_size
        if not self._glitches.on[0]:
            return state
        match self._kind:
            case "rest":
                state[1:] = 0.0
            case "acceleration":
                state[2] = -size * self._scale[2]
            case "position":
                state[0] += size
            case "huge":
                state[1] = 1e308
            case "noise":
                state += size * self._scale * rng.uniform(-1.0, 1.0, state.shape)
        return state
