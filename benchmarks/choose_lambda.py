"""Which parameters of the safety index should the shield have by default?

Every candidate goes through the same seeds: people who walk up to the arm and past it (at most 1 m/s) while the arm
holds its place or wanders, and harmless motion, namely wandering and reaching with a person standing 2 m from the base.
Chosen is the one that intervenes least in harmless motion among those with contacts in at most 1 % of the episodes.

    python benchmarks/choose_lambda.py --episodes 100 --cells "pass wander,far wander,far reach,bare wander,bare reach"
    python benchmarks/choose_lambda.py --episodes 300 --only 2,0.25

Each episode is a line of the file beside the table (.jsonl), so that a run can be interrupted and gone on with.
"""

import argparse
import csv
import json
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.humans import ApproachRetreat, Nobody, Walk, WalkBy, nobody
from jssa_gym.kernels.chain import forward, tool_motion
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.policies import HoldPolicy, WanderPolicy
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.proximity import measure
from jssa_gym.shields import JSSAFilter
from jssa_gym.types import JointState

TOLERATED = 0.01
"""Share of episodes with a contact of any kind."""

REST = 1e-3
"""Joint speed below which the arm counts as at rest [rad/s]."""


class Candidate(NamedTuple):
    """Parameters of a shield."""

    lambda1: float
    lambda2: float
    recovery: float = 0.5
    min_authority: float = 5.0
    d_min: float = 0.05

    @property
    def name(self) -> str:
        return ",".join(f"{x:g}" for x in self)

    def build(self, env: gym.Env) -> gym.Env:
        """The whole shield."""
        arm: Any = env.unwrapped
        index = IndexParams(d_min=self.d_min, lambda1=self.lambda1, lambda2=self.lambda2)
        return jssa_gym.Shield(
            env,
            JSSAFilter(
                arm.robot,
                arm.dt,
                index,
                recovery=self.recovery,
                min_authority=self.min_authority,
                viability=True,
                failsafe=FailsafeParams(),
            ),
        )


CANDIDATES = tuple(
    Candidate(*pair) for pair in ((1, 0.25), (1.25, 0.39), (1.6, 0.2), (2, 0.25), (2, 0.5), (3, 1), (6, 8))
)


class Standing(Walk):
    """Stands 2 m from the base axis, somewhere around it."""

    speed_bound = 0.0

    def _begin(self, rng, start):
        bearing = rng.uniform(-np.pi, np.pi)
        return 2.0 * np.array([np.cos(bearing), np.sin(bearing)]), bearing + np.pi

    def _next_velocity(self, dt):
        return 0.0, 0.0


class Cell(NamedTuple):
    """What the arm does beside whom."""

    name: str
    human: Any
    policy: str
    shielded: bool = True


CELLS = {
    cell.name: cell
    for cell in (
        Cell("approach hold", ApproachRetreat(), "hold"),
        Cell("approach wander", ApproachRetreat(), "wander"),
        Cell("pass hold", WalkBy(), "hold"),
        Cell("pass wander", WalkBy(), "wander"),
        Cell("far wander", Standing(), "wander"),
        Cell("far reach", Standing(), "reach"),
        Cell("alone wander", Nobody(), "wander"),
        Cell("alone reach", Nobody(), "reach"),
        Cell("bare wander", Nobody(), "wander", shielded=False),
        Cell("bare reach", Nobody(), "reach", shielded=False),
    )
}
BESIDE = ("approach hold", "approach wander", "pass hold", "pass wander")


def reachable(env: gym.Env, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A posture, and its tip, that :class:`HoldPolicy` reaches without coming within 5 cm of table or arm."""
    robot = env.unwrapped.robot
    rng, zero = np.random.default_rng(seed), np.zeros(robot.n)
    low, high = robot.limits.position.T
    around = 0.35 * (high - low)
    frames, tip = records(robot.n, FRAME), np.zeros((2, 3))
    while True:
        posture = np.clip(robot.home + rng.uniform(-around, around), 0.95 * low, 0.95 * high)
        for share in np.linspace(0.0, 1.0, 9):
            # the way is nearly straight in joint space; the run itself says whether it was
            between = robot.home + share * (posture - robot.home)
            near = measure(robot, JointState(between, zero, zero), nobody(), env.unwrapped.planes)
            if min(near.own.min(initial=np.inf), near.planes.min(initial=np.inf)) < 0.08:
                break
        else:
            forward(robot.links, np.array([posture, zero, zero]), frames)
            tool_motion(frames, robot.tool_link, robot.tool_offset, tip)
            return posture, tip[0].copy()


def episode(env: gym.Env, cell: Cell, seed: int) -> dict[str, Any]:
    """One episode; those beside people end with the first contact."""
    options, arm = None, env.unwrapped
    if cell.policy == "reach":
        posture, tip = reachable(env, seed)
        options, policy = {"goal": tip}, HoldPolicy(env, posture)
    else:
        policy = HoldPolicy(env) if cell.policy == "hold" else WanderPolicy(env, seed)
    observation, _ = env.reset(seed=seed, options=options)
    status, distance, speed, path = [], [], [], 0.0
    out: dict[str, Any] = {"contact": False, "moving": False, "violation": False, "time": np.nan, "touched": 0}
    for _ in range(1000):
        observation, _, terminated, truncated, info = env.step(policy(observation))
        velocity = arm.scene.robot.velocity
        status.append(info.get("shield/status", 0))
        distance.append(info["distance"])
        speed.append(float(np.abs(velocity).max()))
        path += float(np.linalg.norm(velocity)) * arm.dt
        out["touched"] += bool(info.get("shield/intervened", False))
        out["violation"] = out["violation"] or bool(info["limit_violation"])
        if info["contact"]:
            out.update(contact=True, moving=info["contact_speed"] > MOVING, **look_back(arm, status, distance, speed))
            break
        if terminated or truncated:
            break
    steps = len(status)
    if info["success"] and cell.policy == "reach":
        out["time"] = steps * arm.dt
    out.update(steps=steps, path=path / (steps * arm.dt), closest=float(min(distance)))
    out.update({f"status {k}": status.count(k) / steps for k in range(5)})
    return out


def look_back(arm: Any, status: list[int], distance: list[float], speed: list[float]) -> dict[str, Any]:
    """How it came to the contact in the last step."""
    k = len(speed) - 1
    while k > 0 and speed[k] < REST:
        k -= 1
    held = len(status) - 1
    while held > 0 and status[held - 1] == 3:
        held -= 1
    closest, state, limits = arm.closest, arm.scene.robot, arm.robot.limits.position
    room = np.minimum(state.position - limits[:, 0], limits[:, 1] - state.position)
    return {
        "pair": f"{arm.robot.capsule_names[closest.robot]} / {arm.scene.human.names[closest.human]}",
        "at rest for": (len(speed) - 1 - k) * arm.dt,
        "distance at rest": distance[k],
        "distance at failsafe": distance[held],
        "last second": "".join(str(s) for s in status[-125:]),
        "joint room": room.round(3).tolist(),
        "end": len(status) * arm.dt,
    }


def run(candidate: Candidate, cells: tuple[str, ...], episodes: int, done: dict, log: Path) -> None:
    for name in cells:
        cell = CELLS[name]
        who = candidate.name if cell.shielded else "bare"
        task = "Reach" if cell.policy == "reach" else "Home"
        endings = ("success",) if cell.policy == "reach" else ()
        env = None
        for seed in range(episodes):
            if (who, name, seed) in done:
                continue
            if env is None:
                env = gym.make(f"jssa_gym/{task}-v0", human=cell.human, terminate_on=endings)
                env = candidate.build(env) if cell.shielded else env
            line = {"candidate": who, "cell": name, "seed": seed, **episode(env, cell, seed)}
            done[who, name, seed] = line
            with log.open("a") as file:
                file.write(json.dumps(line) + "\n")


def summary(who: str, episodes: int, done: dict) -> dict[str, Any]:
    """One row of the table."""

    def of(cell: str, name: str = who) -> list[dict]:
        return [done[name, cell, s] for s in range(episodes) if (name, cell, s) in done]

    def paired(cell: str, other: str, name: str, key: str) -> float:
        both = [(done[who, cell, s][key], done[name, other, s][key]) for s in range(episodes)
                if (who, cell, s) in done and (name, other, s) in done]  # fmt: skip
        both = [(x, y) for x, y in both if np.isfinite(x) and np.isfinite(y)]
        return float(np.sum([x for x, _ in both]) / np.sum([y for _, y in both])) if both else np.nan

    row: dict[str, Any] = {"candidate": who}
    hits = [e["contact"] for cell in BESIDE for e in of(cell)]
    if hits:
        rate = Rate.of(sum(hits), len(hits))
        row |= {"contact": rate.value, "low": rate.low, "high": rate.high, "n": rate.n}
    for cell in BESIDE:
        found = of(cell)
        if found:
            row[cell] = sum(e["contact"] for e in found) / len(found)
    row["moving"] = sum(e["moving"] for cell in BESIDE for e in of(cell))
    row["violations"] = sum(e["violation"] for cell in CELLS for e in of(cell))
    for cell in ("far wander", "far reach", "alone wander", "alone reach"):
        found = of(cell)
        if found:
            row[f"touched {cell}"] = sum(e["touched"] for e in found) / sum(e["steps"] for e in found)
    row["speed far"] = paired("far wander", "bare wander", "bare", "path")
    row["time far"] = paired("far reach", "bare reach", "bare", "time")
    row["speed beside"] = paired("approach wander", "bare wander", "bare", "path")
    return row


def show(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        print("  ".join(f"{k} {v:.4f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=60, help="per cell and candidate")
    parser.add_argument("--cells", default=",".join(CELLS), help="names, comma between")
    parser.add_argument(
        "--only", action="append", help="lambda1,lambda2[,recovery[,min_authority[,d_min]]] instead of all"
    )
    parser.add_argument("--out", type=Path, default=Path("choose_lambda.csv"))
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    candidates = [Candidate(*map(float, one.split(","))) for one in args.only] if args.only else list(CANDIDATES)
    log, done = args.out.with_suffix(".jsonl"), {}
    if log.exists():
        for text in log.read_text().splitlines():
            line = json.loads(text)
            done[line["candidate"], line["cell"], line["seed"]] = line
    rows = []
    for candidate in candidates:
        run(candidate, tuple(args.cells.split(",")), args.episodes, done, log)
        rows.append(summary(candidate.name, args.episodes, done))
        show(rows[-1:])
    fields = list(dict.fromkeys(key for row in rows for key in row))
    with args.out.open("w", newline="") as file:
        writer = csv.DictWriter(file, fields)
        writer.writeheader()
        writer.writerows(rows)
    args.out.with_suffix(".json").write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
