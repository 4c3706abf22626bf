"""Environments and policies of a user's own, importable by other processes."""

import os
import signal
import time

import numpy as np

from jssa_gym.envs import ArmEnv
from jssa_gym.envs.sensor import SensorModel


def environment() -> ArmEnv:
    return ArmEnv("reach", human="walk_by", terminate_on=())


def blind() -> SensorModel:
    """An environment whose people are not measured for long."""
    return SensorModel(environment(), "long dropouts")


def push(observation) -> np.ndarray:
    """A policy."""
    return np.full(6, 0.3)


def broken_every_third(env, seed):
    """A factory of policies whose third, sixth, ... action is no number."""
    calls = []

    def act(observation):
        calls.append(observation)
        return np.full(6, np.nan if len(calls) % 3 == 0 else 0.1)

    return act


def pushes(env, seed):
    """A factory of policies that depend on the seed."""
    action = np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    return lambda observation: action


class Model:
    """What a learned model looks like."""

    def predict(self, observation, deterministic=False):
        assert deterministic
        return np.full(6, 0.3), None


class Drifting:
    """A policy whose actions depend on what was before: its episodes cannot be played again."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, observation) -> np.ndarray:
        self.calls += 1
        return np.full(6, np.sin(self.calls))


def killed(number: int) -> int:
    """Work in which the second piece ends its process, as a system without memory does."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def lasting(number: int) -> int:
    """Work that says who does it and takes longer than any test."""
    print(os.getpid(), flush=True)
    time.sleep(600.0)
    return number
