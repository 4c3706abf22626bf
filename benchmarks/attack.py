"""Cross-entropy search for people and policies that break a shield, whole and with one guard removed.

python benchmarks/attack.py --shields full no_speed no_verification --generations 25 --population 40
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import gymnasium as gym
import numpy as np

from jssa_gym.envs.arm import DT, MOVING, ArmEnv
from jssa_gym.evaluation.contenders import shielded
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.humans import Steered
from jssa_gym.policies import SteeredPolicy
from jssa_gym.storage import write_whole
from jssa_gym.types import Array
from jssa_gym.validation import known_name, positive_integer

_NEAR = 0.05
"""Distance at which the arm's speed counts 1/e of what it counts in contact [m]: leads the search there."""

_STARTS = (1.0, 2.2)
"""Distances from the base axis at which people begin [m]."""


@dataclass(frozen=True, slots=True)
class Attack:
    """Somebody and a policy, as numbers in [-1, 1]."""

    person: Array
    """Shares of the acceleration bounds and the hand's speed, shape (segments, 3); see :class:`Steered`."""
    policy: Array
    """Actions, shape (segments, n)."""
    start: Array
    """Direction and distance of the person at the beginning, shape (2,), from :data:`_STARTS`."""

    def root(self) -> Array:
        """Where the person begins, shape (2,) [m]."""
        low, high = _STARTS
        distance, angle = low + (high - low) * (self.start[1] + 1.0) / 2.0, np.pi * self.start[0]
        return distance * np.array([np.cos(angle), np.sin(angle)])


@dataclass(frozen=True, slots=True)
class Outcome:
    """What an attack came to."""

    attack: Attack
    score: float
    """Largest joint speed times exp(-distance / 5 cm), what the search maximises [rad/s]."""
    contact_speed: float
    """Largest speed of a touching point of the arm [m/s]."""
    contact: bool
    violation: bool
    """Whether a joint limit was exceeded."""

    @property
    def breaks(self) -> bool:
        """Whether the shield's promise was broken: a contact with the arm moving, or a joint limit exceeded."""
        return self.contact_speed > MOVING or self.violation


def play(attack: Attack, shield: str, *, fault: str = "none", steps: int = 500) -> Outcome:
    """One episode under an attack.

    Args:
        attack: The person and the policy.
        shield: A name in :data:`~jssa_gym.evaluation.contenders.CONTENDERS`.
        fault: A name in :data:`~jssa_gym.evaluation.contenders.FAULTS`.
        steps: Length [ticks].
    """
    seconds = steps * DT
    person = Steered(attack.person, period=seconds / len(attack.person), start=attack.root())
    env: gym.Env = shielded(ArmEnv(human=person, terminate_on=()), shield, fault)
    arm = env.unwrapped
    policy = SteeredPolicy(arm, attack.policy, period=seconds / len(attack.policy))
    observation, info = env.reset(seed=0, options={"human_start": attack.root()})
    score, speed, contact, violation = -np.inf, 0.0, False, False
    for _ in range(steps):
        observation, _, _, _, info = env.step(policy(observation))
        fastest = float(np.abs(arm.scene.robot.velocity).max())
        score = max(score, fastest * float(np.exp(-max(info["distance"], 0.0) / _NEAR)))
        speed = max(speed, info["contact_speed"])
        contact, violation = contact or info["contact"], violation or info["limit_violation"]
    return Outcome(attack, score, speed, contact, violation)


def search(
    shield: str,
    *,
    who: Literal["person", "policy", "both"] = "both",
    fault: str = "none",
    generations: int = 10,
    population: int = 40,
    segments: int = 10,
    steps: int = 500,
    seed: int = 0,
    progress: Callable[[int, Outcome], None] | None = None,
) -> list[Outcome]:
    """Cross-entropy search for the attack with the fastest arm near or at a contact.

    A Gaussian over the attack's numbers is fitted, generation after generation, to the best tenth of a population.
    What is not searched stays what the first draw of the seed made it.

    Args:
        shield: A name in :data:`~jssa_gym.evaluation.contenders.CONTENDERS`.
        who: What is searched: the person's accelerations and strokes, the policy's jerks, or both.
        fault: A name in :data:`~jssa_gym.evaluation.contenders.FAULTS`.
        generations, population: Their product is the number of episodes.
        segments: Pieces that an episode's accelerations and jerks are constant in.
        steps: Length of an episode [ticks].
        seed: Of all draws.
        progress: Called with the generation and its best outcome.

    Returns:
        All outcomes, the best first; the search ends early when the promise is broken.

    Raises:
        ParameterError: A name or a number is out of range.
    """
    known_name("who", who, ("person", "policy", "both"))
    for name, value in (("generations", generations), ("population", population), ("segments", segments)):
        positive_integer(name, value)
    rng, n = np.random.default_rng(seed), ArmEnv().robot.n
    shapes = {"person": (segments, 3), "policy": (segments, n), "start": (2,)}
    searched = {"person": ("person", "start"), "policy": ("policy",), "both": ("person", "policy", "start")}[who]
    mean = {name: rng.uniform(-0.5, 0.5, shape) for name, shape in shapes.items()}
    spread = {name: np.full(shape, 0.7 if name in searched else 0.0) for name, shape in shapes.items()}
    outcomes: list[Outcome] = []
    for generation in range(generations):
        drawn = []
        for _ in range(population):
            attack = {m: np.clip(rng.normal(mean[m], spread[m]), -1.0, 1.0) for m in shapes}
            drawn.append(
                play(Attack(attack["person"], attack["policy"], attack["start"]), shield, fault=fault, steps=steps)
            )
        outcomes += drawn
        best = sorted(drawn, key=_badness, reverse=True)
        if progress is not None:
            progress(generation, best[0])
        if best[0].breaks:
            break
        elite = best[: max(population // 10, 2)]
        for name in searched:
            values = np.array([getattr(outcome.attack, name) for outcome in elite])
            mean[name] = 0.3 * mean[name] + 0.7 * values.mean(axis=0)
            spread[name] = 0.3 * spread[name] + 0.7 * values.std(axis=0) + 0.05
    return sorted(outcomes, key=_badness, reverse=True)


def _badness(outcome: Outcome) -> tuple[bool, float, float]:
    return outcome.breaks, outcome.contact_speed, outcome.score


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shields", nargs="+", default=["full", "no_speed", "no_lag", "no_verification", "off_by_one"])
    parser.add_argument("--who", nargs="+", default=["person", "policy", "both"])
    parser.add_argument("--generations", type=int, default=8)
    parser.add_argument("--population", type=int, default=20)
    parser.add_argument("--restarts", type=int, default=1)
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    options = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    rows = []
    for shield in options.shields:
        for who in options.who:
            for seed in range(options.restarts):
                found = search(
                    shield, who=who, generations=options.generations, population=options.population, seed=seed
                )
                broken, worst = sum(outcome.breaks for outcome in found), found[0]
                rows.append(
                    {
                        "shield": shield,
                        "who": who,
                        "seed": seed,
                        "episodes": len(found),
                        "broken": broken,
                        "contact_speed": worst.contact_speed,
                        "violation": worst.violation,
                        "contacts": sum(outcome.contact for outcome in found),
                    }
                )
                print(
                    f"{shield:16} {who:7} seed {seed}: {Rate.of(broken, len(found))} broken, fastest contact "
                    f"{worst.contact_speed:.2g} m/s, contacts {rows[-1]['contacts']}",
                    flush=True,
                )
                if options.out:
                    write_whole(options.out, json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
