"""Environments, filters and policies of a user's own, and what is seen of them, importable by other processes."""

import dataclasses
import logging
import os
import signal
import sys
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np
from places import LASTING

from jssa_gym.envs import ArmEnv
from jssa_gym.envs.sensor import SensorModel
from jssa_gym.evaluation import Study
from jssa_gym.evaluation.ledger import Chunk
from jssa_gym.evaluation.play import play
from jssa_gym.evaluation.rows import StressRow
from jssa_gym.exceptions import ParameterError
from jssa_gym.shields import SafetyFilter, Shield
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.types import Decision, Status

TINY = Study(("reach", "home"), ("jssa+stop", "none"), ("pursuit",), ("wander",), episodes=3, seed=5, steps=250)
"""Twelve short episodes."""


def environment() -> ArmEnv:
    return ArmEnv("reach", human="walk_by", terminate_on=())


def blind() -> SensorModel:
    """An environment whose people are not measured for long."""
    return SensorModel(environment(), "long dropouts")


def sightless() -> SensorModel:
    """An environment of which a part of the people is never measured."""
    return SensorModel(environment(), "partial body")


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


def killed(number: int) -> Iterator[int]:
    """Work in which the second piece ends its process, as a system without memory does."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    yield number


def dying_first(chunk: tuple[int, Path]) -> Iterator[int]:
    """Work whose process is killed in the midst of it, but the first time only."""
    number, folder = chunk
    yield number
    if number == 1 and not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    yield 10 * number


def dying_ever_earlier(chunk: tuple[int, Path]) -> Iterator[int]:
    """Work that kills its process behind its first result, and every one that begins it anew before that."""
    number, folder = chunk
    if (folder / "died").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    yield number
    (folder / "died").touch()
    os.kill(os.getpid(), signal.SIGKILL)


def playing_but_dying_first(chunk: Chunk[StressRow]) -> Iterator[StressRow]:
    """Episodes of a campaign, at the first of which its process is killed once."""
    for row in play(chunk):
        yield row
        if not (died := chunk.traces.parent / "died").exists():
            died.touch()
            os.kill(os.getpid(), signal.SIGKILL)


def lasting(number: int) -> Iterator[int]:
    """Work that says who does it and takes longer than any test."""
    print(os.getpid(), flush=True)
    time.sleep(LASTING)
    yield number


def one_then_lasting(number: int) -> Iterator[int]:
    """Work whose first piece is finished at once, and whose second takes longer than any test."""
    yield number
    print("begun", number, flush=True)
    time.sleep(LASTING)
    yield number


def failing_at_seven(numbers: Iterable[int]) -> Iterator[int]:
    """Work with a number that cannot be done."""
    for number in numbers:
        if number == 7:
            raise ParameterError("seven cannot be done")
        yield number


class DemandingError(Exception):
    """An error that cannot be made again from what it keeps."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} and {other}")


def failing_to_tell(number: int) -> Iterator[int]:
    """Work that fails with an error that no other process can have."""
    raise DemandingError("a", "b")
    yield number


def leaving(number: int) -> Iterator[int]:
    """Work that ends its process in its own way."""
    yield number
    sys.exit(3)


class Distant(PairFilter):
    """A filter of a user's own: slows down when somebody is near, and remembers for how long it has."""

    def coefficients(self):
        return 0.8, 0.0, 0.0

    def reset(self, scene):
        super().reset(scene)
        self.near = np.zeros(self.robot.n)

    def answer(self, tick, pairs, index):
        phi = index.max()
        if not phi > 0.0:
            return self.untouched(tick, phi)
        self.near += 1.0
        jerk = np.clip(tick.clipped / (1.0 + self.near), tick.lower, tick.upper)
        return self.decided(tick, jerk, Status.PROJECTED, "somebody is near", phi)


class Sluggish(SafetyFilter):
    """A filter of a user's own: follows the nominal late."""

    def reset(self, scene):
        super().reset(scene)
        self.followed = np.zeros(self.robot.n)

    def respond(self, tick):
        self.followed = 0.9 * self.followed + 0.1 * tick.clipped
        jerk = np.clip(self.followed, tick.lower, tick.upper)
        return Decision(jerk, tick.nominal, Status.PROJECTED, "late", tick.scene.time, np.nan, (-1, -1), 0.0, 0)


def saying(text: str) -> Iterator[str]:
    """Work that warns and logs."""
    warnings.warn(text, UserWarning, stacklevel=1)
    logging.getLogger("jssa_gym").warning("%s", text)
    yield text


def loud_environment() -> ArmEnv:
    """An environment that logs something hostile as it is made."""
    logging.getLogger("jssa_gym").warning("a name: %s", "\x1b[2J")
    return ArmEnv("reach", human="none")


def relay(chunk: tuple[str, Path]) -> Iterator[str | int]:
    """Two pieces of work: the first ends when the second has begun, which goes on when it is told to, for ever."""
    name, folder = chunk
    if name == "first":
        wait_for(folder / "begun")
        yield name
        return
    (folder / "begun").touch()
    wait_for(folder / "go")
    yield from range(3)
    (folder / "sent").touch()
    time.sleep(LASTING)


def wait_for(path: Path) -> None:
    """Until another process has made a file."""
    while not path.exists():
        time.sleep(0.01)


class Push:
    """Jerks that change slowly, which filters object to."""

    def __init__(self, env: gym.Env) -> None:
        self.n, self.calls = env.action_space.shape[0], 0

    def __call__(self, observation):
        self.calls += 1
        return np.sin(0.05 * self.calls + np.arange(self.n))


def bits(value):
    """What must not differ: every bit of every number, NaN too."""
    if isinstance(value, dict):
        return {key: bits(item) for key, item in value.items()}
    if dataclasses.is_dataclass(value):
        return bits({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    if isinstance(value, tuple | list):
        return [bits(item) for item in value]
    if isinstance(value, np.ndarray | np.generic | float):
        array = np.asarray(value)
        return array.dtype, array.shape, array.tobytes()
    return value


def go_on(env: gym.Env, policy, observation, steps: int) -> list:
    """All that can be seen of some steps."""
    seen = []
    for _ in range(steps):
        action = policy(observation)
        observation, *rest = env.step(action)
        seen.append(bits([action, observation, *rest, decisions(env)]))
    return seen


def decisions(env: gym.Env) -> list:
    """What the shields in a chain of wrappers decided last."""
    found = []
    while isinstance(env, gym.Wrapper):
        if isinstance(env, Shield) and env.last_decision is not None:
            found.append(env.last_decision)
        env = env.env
    return found
