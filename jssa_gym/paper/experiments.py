"""The paper's experiments, run again."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym

from jssa_gym.evaluation.rollout import rollout
from jssa_gym.humans import HumanMotion
from jssa_gym.paper.handover import Delivery, deliver
from jssa_gym.paper.person import stand_in
from jssa_gym.paper.reported import GRID, STEPS, Measures, measures
from jssa_gym.policies import HoldPolicy
from jssa_gym.robots import JointLimits
from jssa_gym.safety.index import PUBLISHED
from jssa_gym.shields import JSSAShield, Shield
from jssa_gym.types import Trace

Advance = Callable[[Trace], Any]
"""Called with each episode."""


def _nobody(trace: Trace) -> None:
    """Nobody is told."""


SHIELDS: Mapping[str, Callable[[gym.Env, float, float], gym.Env]] = {
    "as published": lambda env, lambda1, lambda2: JSSAShield.as_published(env, lambda1=lambda1, lambda2=lambda2),
    "exact row": lambda env, lambda1, lambda2: JSSAShield(
        env, lambda1=lambda1, lambda2=lambda2, rows="closest", recovery=0.0, viability=False, failsafe=False
    ),
    "JSSAShield": lambda env, lambda1, lambda2: JSSAShield(env, lambda1=lambda1, lambda2=lambda2),
}
"""The published algorithm; the same with nothing but its row corrected; all layers. Built for λ₁ and λ₂."""


def play(
    wrap: Callable[[gym.Env], gym.Env], name: str, steps: int = STEPS, human: HumanMotion | None = None
) -> tuple[Trace, JointLimits]:
    """One episode of the paper's simulation: the arm holds its home position, a person walks up to it.

    Args:
        wrap: Puts a shield around the environment.
        name: Of the trace.
        steps: Length.
        human: The person; None for :func:`~jssa_gym.paper.person.stand_in`.
    """
    human = stand_in() if human is None else human
    env = wrap(gym.make("jssa_gym/Home-v0", human=human, terminate_on=(), max_episode_steps=steps))
    base: Any = env.unwrapped
    trace = rollout(env, HoldPolicy(env), seed=0, steps=steps, name=name)
    env.close()
    return trace, base.robot.limits


def _published() -> dict[str, Callable[[gym.Env], gym.Env]]:
    """Every shield with the paper's λ = (3, 1)."""
    own = PUBLISHED
    return {name: lambda env, wrap=wrap: wrap(env, own.lambda1, own.lambda2) for name, wrap in SHIELDS.items()}


def avoidance(done: Advance = _nobody) -> tuple[dict[str, Trace], JointLimits]:
    """Fig. 6: every shield with the paper's λ = (3, 1), and ours with its own."""
    return _each(_published() | {"JSSAShield, own λ": JSSAShield}, done)


def comparison(done: Advance = _nobody) -> tuple[dict[str, Trace], JointLimits]:
    """Fig. 8: the SSA with λ₁ = 3, and the JSSA with λ = (3, 1), as published and with the exact row."""
    return _each({"SSA": ssa} | _published(), done)


def handovers(done: Advance = _nobody) -> dict[str, Delivery]:
    """Fig. 10: as published with λ = (3, 1), our shield, and none."""
    wraps: dict[str, Callable[[gym.Env], gym.Env]] = {
        "as published": JSSAShield.as_published,
        "JSSAShield, own λ": JSSAShield,
        "no shield": lambda env: env,
    }
    runs = {}
    for name, wrap in wraps.items():
        runs[name] = deliver(wrap, name)
        done(runs[name].trace)
    return runs


def ssa(env: gym.Env) -> gym.Env:
    """The paper's baseline: the SSA on accelerations with λ₁ = 3, its jerk saturated."""
    return Shield(env, "ssa")


def _each(wraps: Mapping[str, Callable[[gym.Env], gym.Env]], done: Advance) -> tuple[dict[str, Trace], JointLimits]:
    traces = {}
    for name, wrap in wraps.items():
        traces[name], limits = play(wrap, name)
        done(traces[name])
    return traces, limits


def sensitivity(
    shields: Sequence[str] = tuple(SHIELDS),
    values: Sequence[float] = GRID,
    steps: int = STEPS,
    done: Advance = _nobody,
) -> dict[str, dict[tuple[float, float], Measures]]:
    """Table 1 for several shields.

    Args:
        shields: Names in :data:`SHIELDS`.
        values: Of λ₁ and of λ₂.
        steps: Length of the episodes.
        done: Called with each.
    """
    tables: dict[str, dict[tuple[float, float], Measures]] = {name: {} for name in shields}
    for name, table in tables.items():
        for lambda2 in values:
            for lambda1 in values:
                trace, limits = play(lambda env, n=name, a=lambda1, b=lambda2: SHIELDS[n](env, a, b), name, steps)
                table[lambda1, lambda2] = measures(trace, limits)
                done(trace)
    return tables
