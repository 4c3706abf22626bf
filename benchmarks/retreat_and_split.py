"""Does an arm get out of people's way better by a planned retreat, or by an index that splits whose approach it is?

Two things that were tried and are not part of the package; see "Tried, and what it brought" in docs/filters.md.

Retreat: an arm that stands, because it holds or is blocked, and that people at constant velocity would touch within a
second, chooses the smallest of 5, 10 and 20 cm away from where they would, along the damped inverse of the Jacobian,
that leaves it untouched and is over by then: a move from rest to rest, clear of what stands still, which it offers the
shield. Thrown off it, it stops. It goes on with what it did once its place has been clear for 0.3 s, or after 4 s. It
only proposes: whatever is applied the shield has verified.

Split: of the approach, what is the arm's own counts by one lambda and what is the person's by another,

    phi = d_min² - D|D| - l_r D' - l_2 D'' + (l_h - l_r) g max(0, n . u_h),

with g from 0 to 1 as the person's predicted miss falls below the gate's width. The added term is not negative, so that
phi <= 0 lies inside the set of l_r; with l_h = l_r it is JSSA's, which is what "split, control" is for: a filter in
Python takes no slower paces of a path, which costs it something whatever its index.

    python benchmarks/retreat_and_split.py retreat
    python benchmarks/retreat_and_split.py split
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.control import PacedPath, plan_move
from jssa_gym.control.inverse import path_is_clear
from jssa_gym.control.moves import brake_jerk, plan_brake
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.metrics import Summary, summarise
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.exceptions import InfeasibleError
from jssa_gym.kernels.chain import forward, jacobian
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.policies import Policy
from jssa_gym.robots import JointLimits, RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.pairs import Pairs, measure_pairs
from jssa_gym.safety.projectors import ExactProjector
from jssa_gym.safety.proximity import Proximity, measure
from jssa_gym.shields.pairs import PairFilter
from jssa_gym.shields.tick import Tick
from jssa_gym.types import Array, CapsuleSet, Decision, HalfSpaces, JointState, Planes, Scene, Status

SEED = 860_000
"""First seed. An earlier retreat was seen on these; from 870_000 on nothing was chosen by."""

# ---- retreat -----------------------------------------------------------------------------------------

HORIZON, LOOK = 1.0, 0.05
"""How far ahead people are predicted, and in which steps [s]."""

GAP = 0.03
"""Predicted distance below which somebody touches [m]."""

WAYS = (0.05, 0.10, 0.20)
"""Lengths of a retreat, of the point that would be touched [m]."""

HELD, DWELL, CLEAR = 0.2, 0.5, 0.3
"""For how long the arm has stood, how long it stays away at least, for how long its place has to be clear [s]."""

PATIENCE = 4.0
"""Longest absence, and for how long there is no other after one that was so long [s]."""

EVERY = 5
"""Ticks between two predictions."""

STILL = np.array([[np.inf], [5e-3], [0.1]])
"""Below which the arm stands [rad, rad/s, rad/s²]."""

DAMPING, STRIDE = 0.1, 0.025
"""Of the inverse, and of its steps [m]."""

SPARING, SOFT = 0.7, 0.4
"""Shares of the acceleration and jerk limits that a retreat takes, as other plans that yield, and a stop."""

NO_PLANES = Planes(np.zeros((0, 3)), np.zeros(0), ())


class Touch(NamedTuple):
    """Where people at constant velocity would touch an arm at rest, and when."""

    near: Proximity
    after: float
    """[s]."""


def predicted_touch(robot: RobotModel, posture: Array, people: CapsuleSet) -> Touch | None:
    """The first touch within the horizon of an arm at rest in a posture, shape (n,) [rad]."""
    rest = JointState(posture, *np.zeros((2, robot.n)))
    fastest = max(np.abs(v).max(initial=0.0) for v in (people.start_velocity, people.end_velocity)) * np.sqrt(3.0)
    if measure(robot, rest, people, NO_PLANES).smallest > GAP + HORIZON * fastest:
        return None
    for t in np.arange(0.0, HORIZON + 1e-9, LOOK):
        moved = people._replace(
            start=people.start + t * people.start_velocity, end=people.end + t * people.end_velocity
        )
        near = measure(robot, rest, moved, NO_PLANES)
        if near.smallest < GAP:
            return Touch(near, float(t))
    return None


def away(robot: RobotModel, posture: Array, near: Proximity, way: float) -> Array:
    """The posture in which the point that would be touched is a way [m] farther from who touches it, shape (n,)."""
    arm, person = near.points
    n = (arm - person) / max(float(np.linalg.norm(arm - person)), 1e-9)
    link = int(robot.capsules["link"][near.pair[0]])
    frames, J, q = records(robot.n, FRAME), np.zeros((3, robot.n)), posture.copy()
    point = arm.copy()
    for _ in range(round(way / STRIDE)):
        forward(robot.links, np.array([q, *np.zeros((2, robot.n))]), frames)
        jacobian(frames, link, point, J)
        step = J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(3), STRIDE * n)
        q, point = q + step, point + J @ step
    return q


def plan_retreat(robot: RobotModel, scene: Scene, dt: float) -> PacedPath | None:
    """The smallest retreat that leaves the arm untouched, if somebody would touch it, and is over by then; or None."""
    posture = scene.robot.position
    touch = predicted_touch(robot, posture, scene.human)
    if touch is None:
        return None
    full = robot.limits
    spared = JointLimits(full.position, full.velocity, SPARING * full.acceleration, SPARING * full.jerk)
    for way in WAYS:
        goal = away(robot, posture, touch.near, way)
        if predicted_touch(robot, goal, scene.human) is not None:
            continue
        try:
            plan = plan_move(posture, goal, spared, dt)
        except InfeasibleError:
            continue
        if plan.duration <= touch.after and path_is_clear(robot, plan.states[:, 0], scene.planes, scene.static, 0.01):
            return PacedPath(plan, full)
    return None


class Retreating:
    """A policy that steps aside while it stands in somebody's way; else it is another one."""

    def __init__(self, env: gym.Env, policy: Policy) -> None:
        self._env, self._policy = env, policy
        self._robot, self._dt = env.get_wrapper_attr("robot"), float(env.get_wrapper_attr("dt"))
        self._time, self.begun = np.inf, 0
        """How many retreats were begun."""

    def __call__(self, observation: Any) -> Array:
        """The action, shape (n,)."""
        scene: Scene = self._env.get_wrapper_attr("scene")
        if scene.time <= self._time:
            self._place: Array | None = None
            self._path: PacedPath | None = None
            self._tick, self._stood, self._stayed, self._clear = 0, 0, 0, 0
            self._left, self._returned, self._pause = 0, -np.inf, 0.0
        self._time = scene.time
        self._tick += 1
        state = np.array(scene.robot)
        self._stood = self._stood + 1 if np.all(np.abs(state) < STILL) else 0
        if self._path is not None and self._path.astray(state):
            self._path = self._stop(scene.robot)  # and stays where that ends
        if self._place is not None and self._over(scene):
            self._place, self._path, self._returned = None, None, self._tick
        if self._place is None:
            action = self._policy(observation)
            if (self._tick - self._returned) * self._dt < self._pause or not self._begins(scene):
                return action
            self._place, self._left = scene.robot.position.copy(), self._tick
        elif self._path.ended or self._stood:
            self._begins(scene)  # again, from where it got to
        return self._away(scene, state)

    def _away(self, scene: Scene, state: Array) -> Array:
        """The action on a retreat: on along its path."""
        self._env.get_wrapper_attr("offer")(self._path)
        limits, jerks = self._robot.limits, self._path.alternatives(state, self._path.margin)
        jerk = jerks[0] if len(jerks) else brake_jerk(scene.robot, limits, self._dt)
        return np.clip(jerk / limits.jerk, -1.0, 1.0)

    def _stop(self, state: JointState) -> PacedPath:
        """A stop from any state, as soft as the shield's softest if it can be."""
        full = self._robot.limits
        soft = JointLimits(full.position, full.velocity, SOFT * full.acceleration, SOFT * full.jerk)
        plan = plan_brake(state, soft, self._dt)
        return PacedPath(plan if plan.keeps(soft) else plan_brake(state, full, self._dt), full)

    def _begins(self, scene: Scene) -> bool:
        """Begin a retreat if the arm has stood, there is a reason and a way."""
        if self._stood * self._dt < HELD or self._tick % EVERY:
            return False
        found = plan_retreat(self._robot, scene, self._dt)
        if found is None:
            return False
        self._path, self._stayed, self._clear = found, 0, 0
        self.begun += 1
        return True

    def _over(self, scene: Scene) -> bool:
        """Whether the arm has stayed away for long enough and may go on."""
        if not (self._path.ended or self._stood):
            return False
        self._stayed += 1
        if self._tick % EVERY == 0:
            free = predicted_touch(self._robot, self._place, scene.human) is None
            self._clear = self._clear + EVERY if free else 0
        if (self._tick - self._left) * self._dt >= PATIENCE:
            self._pause = PATIENCE  # who has followed for so long will go on to
            return True
        self._pause = 0.0
        return self._stayed * self._dt >= DWELL and self._clear * self._dt >= CLEAR


# ---- split -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SplitParams:
    """Parameters of :class:`SplitFilter`."""

    d_min: float = 0.05
    """[m]."""
    own: float = 0.4
    """Of the arm's own approach [m·s]."""
    theirs: float = 1.6
    """Of the person's [m·s]."""
    lambda2: float = 0.1
    """[m·s²]."""
    width: float = 0.1
    """Predicted miss below which the gate opens, and is open all the way at 0 [m]."""
    authority: float = 5.0
    """Pairs that the jerk bounds move by less make no rows [m/s³]."""
    recovery: float = 0.5
    """Share of its authority by which an index above 0 has to fall in a step."""


class SplitFilter(PairFilter):
    """JSSA's rows one step ahead, of the split index."""

    params_type = SplitParams
    params: SplitParams

    def coefficients(self) -> tuple[float, float, float]:
        """Of the index for the arm's own approach."""
        return self.params.d_min, self.params.own, self.params.lambda2

    def extra(self, people: np.ndarray, pairs: Pairs) -> Array:
        """What the split adds to every pair's index, shape (p,) [m²], not negative."""
        p, robot = self.params, self.robot
        m = len(robot.capsules)
        velocity = np.stack([people["start_velocity"], people["end_velocity"]], axis=1)
        velocity = np.tile(velocity, (m, 1, 1))  # (p, 2, 3): of the ends, as the faster one comes
        along = np.einsum("pi,pei->pe", pairs.normals, velocity)
        end = along.argmax(axis=1)
        coming = along[np.arange(len(end)), end]
        speed2 = np.sum(velocity[np.arange(len(end)), end] ** 2, axis=1)
        radii = (robot.capsules["radius"][:, None] + people["radius"]).ravel()
        far = pairs.motion[:, 0] + radii
        across2 = np.maximum(1.0 - coming**2 / np.maximum(speed2, 1e-12), 0.0)
        miss = far * np.sqrt(across2) - radii  # of the point where it passes a point that stands
        gate = np.clip(1.0 - miss / p.width, 0.0, 1.0)
        return (p.theirs - p.own) * gate * np.maximum(coming, 0.0)

    def answer(self, tick: Tick, pairs: Pairs, index: Array) -> Decision:
        """Keep the index one step ahead at 0 or below; above it, let it fall."""
        p, dt, bound = self.params, self.dt, self.robot.limits.jerk
        ahead, people = np.empty_like(tick.state), tick.people.copy()
        integrate(np.ascontiguousarray(tick.state), tick.clipped, dt, ahead)
        for end in ("start", "end"):
            people[end] += dt * people[f"{end}_velocity"]
        later = measure_pairs(self.robot, ahead, people)
        after = later.index(p.d_min, p.own, p.lambda2) + self.extra(people, later)
        worst = float(after.max())
        if not worst > 0.0:
            return self.untouched(tick, worst)
        effect = p.lambda2 * dt + p.own * dt**2 / 2.0 + np.abs(later.motion[:, 0]) * dt**3 / 3.0
        L = effect[:, None] * later.rows
        reach = np.abs(L) @ bound
        now = index + self.extra(tick.people, pairs)
        target = np.maximum(now - p.recovery * reach, 0.0)
        S = after - target + L @ tick.clipped
        asks = (reach >= p.authority * p.lambda2 * dt) & (-reach < S)
        rows = HalfSpaces(np.ascontiguousarray(L[asks]), np.ascontiguousarray(S[asks]))
        if not len(rows.S) or float((rows.S - rows.L @ tick.clipped).max()) <= 0.0:
            return self.untouched(tick, worst)
        found = ExactProjector(self.robot.n).project(tick.nominal, rows, tick.lower, tick.upper)
        status = Status.PROJECTED if found.feasible else Status.RELAXED
        return self.decided(tick, found.jerk, status, "the split index", worst, found.violation, len(rows.S))


# ---- both --------------------------------------------------------------------------------------------


class Cell(NamedTuple):
    """What is played."""

    task: str
    human: str
    policy: str
    shield: str


def policy_of(env: gym.Env, name: str, seed: int) -> Policy:
    """The policy by a name; with ``retreat`` in front of it, one that steps aside."""
    base = name.removeprefix("retreat ")
    policy = jssa_gym.JPCPolicy(env, seed) if base == "jpc" else jssa_gym.HoldPolicy(env)
    return Retreating(env, policy) if base != name else policy


SPLITS = {
    "split, control": SplitParams(theirs=0.4),
    "split 0.4, +1.2, gate 0.1": SplitParams(),
    "split 0.4, +1.2, gate 0.5": SplitParams(width=0.5),
    "split 0.2, +1.4, gate 0.1": SplitParams(own=0.2),
}
"""Filters in Python."""


def shielded(cell: Cell) -> gym.Env:
    """The environment inside its shield."""
    env = gym.make(f"jssa_gym/{cell.task.capitalize()}-v0", human=cell.human, terminate_on=())
    if cell.shield not in SPLITS:
        return jssa_gym.Shield(env, cell.shield)
    robot, dt = env.unwrapped.robot, env.unwrapped.dt
    filter = SplitFilter(robot, dt, SPLITS[cell.shield], viability=True, failsafe=FailsafeParams())
    return jssa_gym.Shield(env, filter)


def played(cell: Cell, seeds: range) -> tuple[list[Summary], int]:
    """The episodes in numbers, and how many retreats were begun in them."""
    env, begun, summaries = shielded(cell), 0, []
    for seed in seeds:
        policy = policy_of(env, cell.policy, seed)
        trace = rollout(env, policy, seed=seed)
        summaries.append(summarise(trace, env.unwrapped.robot.limits))
        begun += getattr(policy, "begun", 0)
    return summaries, begun


def row(cell: Cell, seeds: range) -> str:
    """The cell's line of the table."""
    started = time.process_time()
    ends, begun = played(cell, seeds)
    count = {
        "ok, untouched": sum(end.success_untouched for end in ends),
        "ok": sum(end.success for end in ends),
        "touched": sum(end.collision for end in ends),
        "moving": sum(end.moving_contact for end in ends),
    }
    jumps = 100.0 * float(np.mean([end.jerk_jumps_shield for end in ends]))
    total = 100.0 * float(np.mean([end.jerk_jumps for end in ends]))
    cells = [cell.task, cell.human, cell.policy, cell.shield, *count.values()]
    cells += [f"{jumps:.2f}", f"{total:.2f}", begun, f"{time.process_time() - started:.0f}"]
    return "| " + " | ".join(map(str, cells)) + " |"


def retreat_cells() -> list[Cell]:
    """Holding and moving arms, beside people who come to where they stand."""
    people = [("home", human) for human in ("approach_retreat", "hand", "walk_by")]
    return [
        Cell(task, human, way + policy, shield)
        for task, human in (*people, ("reach", "hand"))
        for policy in ("jpc", "hold")
        if (task, policy) != ("reach", "hold")  # nothing to hold there
        for shield in ("stop", "work", "yield")
        for way in ("", "retreat ")
    ]


def split_cells() -> list[Cell]:
    """Beside people who wander about, and people who walk up."""
    return [
        Cell(task, human, "jpc", shield)
        for task in ("home", "reach", "track")
        for human in ("random", "approach_retreat")
        for shield in ("jssa_near+stop", "work", *SPLITS)
    ]


COLUMNS = (
    *("task", "people", "policy", "shield", "success, untouched", "success", "touched", "moving contact"),
    *("jumps made by the shield, %", "all jumps, %", "retreats", "processor time, s"),
)

PARTS: dict[str, Callable[[], list[Cell]]] = {"retreat": retreat_cells, "split": split_cells}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--episodes", type=int, default=16, help="per cell, the same seeds in all of them")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--only", default="", help="cells whose names have this in them")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    print("| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|", sep="\n", flush=True)
    for cell in PARTS[args.part]():
        if args.only in " ".join(cell):
            print(row(cell, range(args.seed, args.seed + args.episodes)), flush=True)


if __name__ == "__main__":
    main()
