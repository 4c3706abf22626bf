"""Which parameters do the peers of the shield get by default?

Every candidate, inside the viability box and without the verified stop, goes through the same episodes on seeds that
no evaluation uses: people who walk up close to a holding arm (0.4 to 0.8 m/s, and 1.2 to 1.6 m/s), up to a wandering
one (1.2 to 1.6 m/s) and past it (0.3 to 1.0 m/s); and harmless motion, namely wandering with a person standing 2 m
from the base. Chosen is the candidate of a filter with the fewest episodes with a moving contact, and among those the
one that touches harmless motion least; among equals, the one with the larger median of the smallest distances.
Differences of two or three episodes are noise; the choice is a procedure, not a finding.

    python benchmarks/tune_filters.py --out tune_filters.csv
    python benchmarks/tune_filters.py --defaults --first-seed 0   # what was chosen, on seeds it was not chosen on
"""

import argparse
import csv
import io
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.evaluation import rollout
from jssa_gym.evaluation.identity import made_with
from jssa_gym.humans import ApproachRetreat, Walk, WalkBy
from jssa_gym.policies import HoldPolicy, WanderPolicy
from jssa_gym.shields import CBFParams, PFMParams, SMAParams, SSAParams, SSMParams, SSSParams
from jssa_gym.storage import write_whole

TUNING = 50_000
"""Seeds from here on are for tuning; tests and evaluations begin at 0."""

MOVING = 1e-3
"""Speed of a touching point from which a contact is a moving one [m/s]."""


class Standing(Walk):
    """Stands 2 m from the base axis, somewhere around it."""

    speed_bound = 0.0

    def _begin(self, rng, start):
        bearing = rng.uniform(-np.pi, np.pi)
        return 2.0 * np.array([np.cos(bearing), np.sin(bearing)]), bearing + np.pi

    def _next_velocity(self, dt):
        return 0.0, 0.0


class Cell(NamedTuple):
    """What the arm does beside whom, for how long."""

    human: Any
    policy: str
    episodes: int
    steps: int


_NEAR = (0.62, 0.7)
DANGER = (
    Cell(ApproachRetreat(start=2.2, nearest=_NEAR, speed=(0.4, 0.8), wait=(0.0, 0.5)), "hold", 6, 600),
    Cell(ApproachRetreat(start=2.2, nearest=_NEAR, speed=(1.2, 1.6), wait=(0.0, 0.5)), "hold", 6, 400),
    Cell(ApproachRetreat(start=2.2, speed=(1.2, 1.6), wait=(0.0, 0.5)), "wander", 6, 400),
    Cell(WalkBy(offset=(0.7, 0.9), passing=(1.0, 2.5)), "wander", 6, 500),
)
HARMLESS = Cell(Standing(), "wander", 4, 400)


def grid(kind: Any, **values: tuple[Any, ...]) -> Iterator[Any]:
    for chosen in itertools.product(*values.values()):
        yield kind(**dict(zip(values, chosen, strict=True)))


CANDIDATES: dict[str, list[Any]] = {
    "none": [None],
    "jssa": [None],
    "jssa_published": [None],
    "ssa": list(grid(SSAParams, eta=(0.3, 1.0, 3.0), rows=("closest", "all"))),
    "sss": list(grid(SSSParams, c=(1.0, 2.0, 5.0, 10.0, 20.0))),
    "cbf": list(grid(CBFParams, k1=(0.5, 1.0, 1.5, 2.0), k2=(4.0, 8.0), k3=(10.0, 20.0))),
    "pfm": list(grid(PFMParams, influence=(0.5, 0.8), strength=(0.1, 0.3, 1.0), damping=(5.0, 20.0))),
    "sma": list(grid(SMAParams, gain=(0.1, 0.3, 1.0), rows=("closest", "all"))),
    "ssm": list(grid(SSMParams, hysteresis=(0.05, 0.1))),
}


def episode(cell: Cell, name: str, params: Any, seed: int) -> Any:
    env = gym.make("jssa_gym/Home-v0", human=cell.human, terminate_on=(), max_episode_steps=cell.steps)
    arm: Any = env.unwrapped
    env = jssa_gym.Shield(env, jssa_gym.make_filter(name, arm.robot, arm.dt, params=params, viability=True))
    policy = HoldPolicy(env) if cell.policy == "hold" else WanderPolicy(env, seed=seed)
    trace = rollout(env, policy, seed=seed, steps=cell.steps, name=name)
    env.close()
    return trace


def measure(name: str, params: Any, first: int) -> dict[str, Any]:
    """One line of the table."""
    moving, contacts, distances = 0, 0, []
    for cell in DANGER:
        for k in range(cell.episodes):
            trace = episode(cell, name, params, first + k)
            moving += bool((trace.contact_speed > MOVING).any())
            contacts += bool(trace.contact.any())
            distances.append(trace.distance.min())
    touched, count = 0, 0
    for k in range(HARMLESS.episodes):
        trace = episode(HARMLESS, name, params, first + k)
        touched += int(trace.intervened.sum())
        count += len(trace.time)
    return {
        "filter": name,
        "params": "" if params is None else ", ".join(f"{f}={getattr(params, f)}" for f in params.__slots__),
        "episodes": len(distances),
        "moving": moving,
        "contacts": contacts,
        "touched": round(touched / count, 4),
        "distance p10": round(float(np.percentile(distances, 10)), 3),
        "distance p50": round(float(np.median(distances)), 3),
    }


def best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return min(rows, key=lambda row: (row["moving"], row["touched"], -row["distance p50"]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(CANDIDATES), help="names of filters, comma between")
    parser.add_argument("--defaults", action="store_true", help="only the default parameters of each filter")
    parser.add_argument("--first-seed", type=int, default=TUNING)
    parser.add_argument("--out", type=Path, default=Path("tune_filters.csv"))
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    rows: list[dict[str, Any]] = []
    for name in args.only.split(","):
        found = []
        for params in [None] if args.defaults else CANDIDATES[name]:
            found.append(measure(name, params, args.first_seed))
            print("  ".join(f"{k} {v}" for k, v in found[-1].items()), flush=True)
        chosen = best(found)
        for row in found:
            row["chosen"] = row is chosen
        print(f"-> {name}: {chosen['params']}", flush=True)
        rows += found
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    write_whole(args.out, text.getvalue())


if __name__ == "__main__":
    main()
