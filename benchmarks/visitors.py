"""Do people who come and go ever meet a moving arm, and what is each part of that worth?

Raiders come in at the edge of a box, run at the arm, and leave; the arm is thrown about. They are seen as they are, or
by a camera: at 31 Hz, 100 ms late, 2 cm off, with people hidden for some frames and ids exchanged. The whole shield is
played beside one that leaves out the edge. Each episode is a line of a file, so that a run can be interrupted and gone
on with; takes some 0.5 s of processor time for each.

    python benchmarks/visitors.py --episodes 60
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.humans import Body, HumanMotion, Visitors, nobody
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.types import CapsuleSet, Scene, Status

DT, TICKS = 0.008, 500
MOVING = 1e-3
"""Speed of the arm's touching point from which a contact counts as a moving one [m/s]."""

HALF = 1.0
"""Half of the box' sides [m]: so narrow that whoever comes in is at the arm before it rests."""
LOW, HIGH = (-HALF, -HALF, 0.0), (HALF, HALF, 3.0)
SPEED = 1.6

ERROR, PERIOD, LATE, HIDDEN = 0.02, 4, 12, 4
"""Of the camera: error of a place [m], ticks between frames and until they arrive, most frames that hide somebody."""


class Raider(HumanMotion):
    """Runs at the nearest link until a moment, then away from the base axis; turns at once."""

    reacts, clearance, speed_bound = True, 0.0, SPEED

    def reset(self, rng, start=None, person=0) -> CapsuleSet:
        self._root, self._left = np.array(start), rng.uniform(0.5, 2.5)
        self._body = Body.facing(float(np.arctan2(-start[1], -start[0])), person)
        self._speed = rng.uniform(0.5, 1.0) * SPEED
        self._velocity = -self._speed * self._root / np.linalg.norm(self._root)
        return self._now()

    def step(self, dt: float, robot: CapsuleSet) -> CapsuleSet:
        self._root, self._left = self._root + dt * self._velocity, self._left - dt
        way = self._root if self._left < 0.0 else (robot.start + robot.end)[2:, :2].mean(axis=0) / 2.0 - self._root
        self._velocity = self._speed * way / max(np.linalg.norm(way), 1e-9)
        return self._now()

    def _now(self) -> CapsuleSet:
        return self._body.at(tuple(self._root.tolist()), tuple(self._velocity.tolist()))


class Raiders(Visitors):
    """A stream of them."""

    reacts = True

    def __init__(self) -> None:
        super().__init__(rate=1.2, speed=(0.8, SPEED), offset=(0.85, 0.9), low=LOW, high=HIGH, acceleration=None)

    def visitor(self) -> HumanMotion:
        return Raider()


class Camera(gym.Wrapper):
    """Shows people as a camera does: seldom, late, imprecisely; some are hidden for a while, some are taken for others.

    Its frames are complete: who comes into the box is measured before anything can hide them.
    """

    def reset(self, *, seed=None, options=None):
        result = self.env.reset(seed=seed, options=options)
        self._rng, self._tick = np.random.default_rng((seed, 0xCA3E7A)), 0
        self._frames: list[tuple[int, CapsuleSet, np.ndarray]] = []
        self._known: set[int] = set()
        self._hidden: dict[int, int] = {}
        self._look()
        return result

    def step(self, action):
        result = self.env.step(action)
        self._tick += 1
        if self._tick % PERIOD == 0:
            self._look()
        return result

    @property
    def scene(self) -> Scene:
        truth = self.env.get_wrapper_attr("scene")
        arrived = [frame for frame in self._frames if frame[0] + LATE <= self._tick]
        if not arrived:
            none = np.zeros(0)
            return truth._replace(human=nobody(), age=none, valid=none.astype(np.bool_), frame_age=np.nan)
        self._frames = [frame for frame in self._frames if frame[0] >= arrived[-1][0]]
        tick, people, valid = arrived[-1]
        age = (self._tick - tick) * DT
        return truth._replace(human=people, age=np.full(len(valid), age), valid=valid, frame_age=age)

    def _look(self) -> None:
        people, rng = self.env.get_wrapper_attr("scene").human, self._rng
        ids = people.person.copy()
        measured = np.ones(len(ids), np.bool_)
        for who in np.unique(ids):
            part = ids == who
            if self._outside(people, part):
                self._known.discard(int(who))
                self._hidden.pop(int(who), None)
                continue
            if self._hidden.get(int(who), 0) > 0:
                self._hidden[int(who)] -= 1
                measured[part] = False
            elif who in self._known and rng.random() < 0.05:
                self._hidden[int(who)] = int(rng.integers(0, HIDDEN))
                measured[part] = False
            else:
                self._known.add(int(who))
        seen = np.unique(ids[measured])
        if len(seen) > 1 and rng.random() < 0.03:
            one, other = rng.choice(seen, 2, replace=False)
            ids = np.where(ids == one, other, np.where(ids == other, one, ids))
        # the order of people is anybody's
        order = np.argsort(rng.permutation(int(ids.max(initial=0)) + 1)[ids], kind="stable")
        noise = rng.standard_normal((2, len(ids), 3))
        noise *= ERROR * rng.random((2, len(ids), 1)) / np.linalg.norm(noise, axis=-1, keepdims=True)
        start, end = people.start + noise[0], people.end + noise[1]
        shown = CapsuleSet(
            start[order], end[order], people.start_velocity[order], people.end_velocity[order], people.radius[order],
            tuple(people.names[k] for k in order), ids[order],
        )  # fmt: skip
        self._frames.append((self._tick, shown, measured[order]))

    @staticmethod
    def _outside(people: CapsuleSet, part: np.ndarray) -> bool:
        ends = np.concatenate([people.start[part], people.end[part]])[:, :2]
        radius = np.tile(people.radius[part], 2)[:, None] + ERROR
        return bool(max((-HALF - (ends + radius).max(axis=0)).max(), ((ends - radius).min(axis=0) - HALF).max()) > 0.0)


REGION = WatchedRegion.box(LOW, HIGH, ("bottom", "top"), entry_speed=2.0)
BLIND = WatchedRegion.box(LOW, HIGH, ("left", "right", "back", "front", "bottom", "top"))
EXACT = FailsafeParams(watched=REGION)
SEEN = FailsafeParams(watched=REGION, position_error=ERROR, max_age=(LATE + PERIOD * (HIDDEN + 1)) * DT + 1e-6)

SHIELDS: dict[str, Callable[[gym.Env], gym.Env]] = {
    "whole": lambda env: jssa_gym.JSSAShield(env, failsafe=EXACT),
    "edge left out": lambda env: jssa_gym.JSSAShield(env, failsafe=replace(EXACT, watched=BLIND)),
    "whole, camera": lambda env: jssa_gym.JSSAShield(Camera(env), failsafe=SEEN),
    "edge left out, camera": lambda env: jssa_gym.JSSAShield(Camera(env), failsafe=replace(SEEN, watched=BLIND)),
    "stop, camera": lambda env: jssa_gym.Shield(Camera(env), "stop", stop=SEEN),
    "no shield": lambda env: env,
}


def play(shield: str, seed: int) -> dict[str, Any]:
    """One episode."""
    env = SHIELDS[shield](jssa_gym.ArmEnv(task="track", human=Raiders(), terminate_on=()))
    rng, action = np.random.default_rng((seed, 0xAC7)), np.zeros(6)
    env.reset(seed=seed)
    found = {"touched": False, "fastest": 0.0, "limits": 0, "stored": 0, "faults": 0, "moved": 0.0}
    met, most = set(), 0
    for k in range(TICKS):
        if k % 8 == 0:  # bang-bang, wander, or back to where there is room
            home = np.sign(env.unwrapped.robot.home - env.unwrapped.scene.robot.position)
            action = (rng.choice([-1.0, 1.0], 6), rng.uniform(-0.3, 0.3, 6), 0.3 * home)[rng.integers(3)]
        info = env.step(action)[4]
        people = env.unwrapped.scene.human.person
        met, most = met | set(people.tolist()), max(most, len(people) // 6)
        found["touched"] |= bool(info["contact"])
        found["fastest"] = max(found["fastest"], float(info["contact_speed"]))
        found["limits"] += bool(info["limit_violation"])
        found["moved"] = max(found["moved"], float(np.abs(env.unwrapped.scene.robot.velocity).max()))
        found["stored"] += info.get("shield/status") == Status.FAILSAFE
        found["faults"] += info.get("shield/status") == Status.FAULT
    return {"shield": shield, "seed": seed, **found, "met": len(met), "most": most}


def table(rows: list[dict[str, Any]]) -> None:
    print(
        "| shield | episodes | visitors | moving contacts | fastest | limits exceeded | touched | stored stop "
        "| faults |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for shield in SHIELDS:
        mine = [row for row in rows if row["shield"] == shield]
        if not mine:
            continue
        count, steps = len(mine), len(mine) * TICKS
        moving = Rate.of(sum(row["fastest"] > MOVING for row in mine), count)
        print(
            f"| {shield} | {count} | {sum(row['met'] for row in mine)} | {moving} "
            f"| {max(row['fastest'] for row in mine):.2g} m/s | {sum(row['limits'] > 0 for row in mine)} "
            f"| {sum(row['touched'] for row in mine)} | {sum(row['stored'] for row in mine) / steps:.1%} "
            f"| {sum(row['faults'] for row in mine) / steps:.1%} |"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=60, help="of each shield")
    parser.add_argument("--shields", nargs="+", choices=list(SHIELDS), default=list(SHIELDS))
    parser.add_argument("--out", type=Path, default=Path("visitors.jsonl"), help="a line for each episode")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    rows = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(row["shield"], row["seed"]) for row in rows}
    with args.out.open("a") as file:
        for seed in range(args.episodes):
            for shield in args.shields:
                if (shield, seed) not in done:
                    rows.append(play(shield, seed))
                    print(json.dumps(rows[-1]), file=file, flush=True)
    table(rows)
    kept = [row for row in rows if row["shield"].startswith(("whole", "stop"))]
    return int(any(row["fastest"] > MOVING or row["limits"] for row in kept))


if __name__ == "__main__":
    sys.exit(main())
