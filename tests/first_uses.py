"""What most tests need compiled, in pieces that have little in common: several processes compile each piece once."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np

from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import evaluate
from jssa_gym.policies.vector_jpc import VectorJPCPolicy
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS, JSSAFilter, NoFilter, SafetyFilter, Shield

DT = 0.008


class _Asked(NoFilter):
    """A filter of a user's own."""

    def respond(self, tick):
        return super().respond(tick)


def _decide(build: Callable[..., SafetyFilter]) -> None:
    """A control step of a filter; no environment, which has kernels of its own."""
    env = ArmEnv("home")
    filter = build(env.robot, DT, viability=True, failsafe=FailsafeParams())
    filter.reset(env.scene)
    filter.decide(env.scene, np.zeros(env.robot.n))


def _ask() -> None:
    env = ArmEnv("home")
    shield = Shield(env, _Asked(env.robot, DT, viability=True, failsafe=FailsafeParams()))
    shield.reset(seed=0)
    shield.step(np.zeros(env.robot.n))


def _measure() -> None:
    evaluate("jssa_gym/Track-v0", "jpc", 1, steps=3)


def _vector() -> None:
    envs = gym.make_vec("jssa_gym/Reach-v0", 2)
    policy = VectorJPCPolicy(envs)
    seen, _ = envs.reset(seed=0)
    envs.step(policy(seen))


def first_uses() -> Iterator[partial[None]]:
    """What is to be called, the longest first: what many share is then there for whoever comes later."""
    first, *others = FILTERS.values()
    yield from (partial(_decide, first), partial(_measure), partial(_vector))
    yield from (partial(_decide, build) for build in others)
    yield partial(_decide, partial(JSSAFilter, projector="osqp"))
    yield partial(_ask)


def compile_together(claims: Path) -> None:
    """Call what no other process has begun to.

    Args:
        claims: A folder that all these processes share and nobody else knows.
    """
    claims.mkdir(exist_ok=True)
    for k, use in enumerate(first_uses()):
        try:
            (claims / str(k)).touch(exist_ok=False)
        except FileExistsError:
            continue
        with suppress(Exception):  # what is wrong shows where it is tested
            use()
