"""Which goals do people block? An upper bound for the success of any arm beside people who do not look at it.

    python benchmarks/blocked_goals.py --episodes 1000 --task reach --human random

Every episode is played without the arm: its goal, and where its people are. An arm that meets the goal has its tool
centre point within the tolerance of it, and with that point the ball of the tool's capsule around it. As seen from the
goal, at distance D [m] from the people's surfaces, that ball of radius ρ is at most

    D + tolerance - ρ

away from them, wherever within the tolerance it is. Where that is less than the clearance asked for, nobody can meet
the goal with it: the goal is *blocked*. Success takes the task's hold time without a break, and not before the tool
can be there: from rest, a joint is no faster than min(V, A t, J t²/2), and moves the tool by no more than its angle
times the length of the links behind it. Where no such window is free, success with this clearance is impossible.

The bound is optimistic: it looks at the tool's ball alone, not at the arm behind it, and not at how the arm gets
there or away again. What it calls impossible is impossible; what it calls possible may not be. ``--not-before 0.9``
takes another time than the bound's for how long the arm needs, an estimate then and no bound.

Episode k has seed + k, as in ``jssa_gym.evaluate("jssa_gym/Reach-v0", ..., seed=seed, env_kwargs={"human": ...})``:
the seeds that are called impossible there are those that cannot succeed here.
"""

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.spans import longest
from jssa_gym.evaluation.statistics import Rate, bootstrap_interval
from jssa_gym.exceptions import JSSAGymError, ParameterError
from jssa_gym.humans import HUMANS, nobody
from jssa_gym.kernels.capsules import capsule_pair, measure_agents
from jssa_gym.kernels.records import PAIR, SEGMENT, records
from jssa_gym.safety.postures import tool_point
from jssa_gym.safety.proximity import agent_records
from jssa_gym.storage import write_whole
from jssa_gym.validation import number_within, positive_integer, whole_number


class Course(NamedTuple):
    """What happens to a goal in an episode, after every control step."""

    gap: np.ndarray
    """From the goal to the people's surfaces, negative inside, inf without people, shape (T,) [m]."""
    away: np.ndarray
    """From where the tool centre point begins to the goal, shape (T,) [m]."""


class Finding(NamedTuple):
    """What that means for an arm that keeps a clearance."""

    blocked: float
    """Share of the steps in which the goal is blocked."""
    possible: bool
    """Whether some window is long enough."""


def find(gap, reachable, clearance: float, slack: float, hold: int) -> Finding:
    """Whether a goal can be held.

    Args:
        gap: Of :class:`Course`, shape (T,) [m].
        reachable: Whether the tool can be there already, shape (T,).
        clearance: What the arm keeps from people [m].
        slack: Tolerance minus the radius of the tool's ball [m]: by how much more than ``gap`` the ball can be away.
        hold: Steps in a row that count as success.
    """
    free = np.asarray(gap) + slack >= clearance
    return Finding(float(np.mean(~free)), longest(free & reachable) >= hold)


def follow(env: ArmEnv, seed: int, steps: int) -> Course:
    """Play an episode's people, without the arm.

    Raises:
        ParameterError: The people react to the arm, or the goal is no point for the tool.
    """
    if env.human.reacts:
        raise ParameterError("these people look at the arm: where they go without it says nothing")
    if env.task.space != "tip":
        raise ParameterError(f"the goal of {env.task.name!r} is no point for the tool")
    env.reset(seed=seed)
    begin, goal = tool_point(env.robot, env.scene.robot.position), env.goal
    point, people, pairs, gap, away = records(1, SEGMENT), None, None, np.empty(steps), np.empty(steps)
    for t in range(steps):
        capsules = env.human.step(env.dt, nobody())
        goal = env.task.follow(goal, capsules)
        point["start"] = point["end"] = goal
        people = agent_records(capsules, people)
        if pairs is None:
            pairs = records((1, len(people)), PAIR)
        measure_agents(point, people, pairs)
        gap[t], away[t] = pairs["distance"].min(initial=np.inf), math.dist(begin, goal)
    return Course(gap, away)


def ball(robot) -> float:
    """Radius of the largest ball around the tool centre point inside one of the capsules of its link [m]."""
    tool, radius = tuple(robot.tool_offset), 0.0
    for capsule in robot.capsules[robot.capsules["link"] == robot.tool_link]:
        outside, _, _ = capsule_pair(tool, tool, capsule["start"], capsule["end"], capsule["radius"])
        radius = max(radius, -outside)
    return radius


def levers(robot) -> np.ndarray:
    """How far from each joint's origin the tool centre point can be, at most, shape (n,) [m]; 0 behind the tool."""
    links = np.linalg.norm(robot.links["offset"], axis=1)
    last, tool = robot.tool_link, np.linalg.norm(robot.tool_offset)
    return np.array([links[j + 1 : last + 1].sum() + tool if j <= last else 0.0 for j in range(robot.n)])


def farthest(robot, dt: float, steps: int) -> np.ndarray:
    """How far from its place at rest the tool centre point can be after every step, at most, shape (steps,) [m]."""
    limits, t = robot.limits, dt * np.arange(1, steps + 1)[:, None]
    # speeds only rise: those at a step's end are the largest in it
    speed = np.minimum(np.minimum(limits.velocity, limits.acceleration * t), limits.jerk * t**2 / 2.0)
    return np.cumsum(speed, axis=0) * dt @ levers(robot)


def survey(env: ArmEnv, seeds, clearances, steps: int, not_before: float | None = None) -> list[list[Finding]]:
    """Findings of every clearance [m], an episode each; ``not_before`` [s] replaces what the tool can reach."""
    hold = math.ceil(env.task.hold_time / env.dt - 1e-9)
    slack = env.task.tolerance - ball(env.robot)
    reach, time = farthest(env.robot, env.dt, steps), env.dt * np.arange(1, steps + 1)
    found: list[list[Finding]] = [[] for _ in clearances]
    for seed in seeds:
        gap, away = follow(env, seed, steps)
        reachable = away - env.task.tolerance <= reach if not_before is None else time >= not_before
        for findings, clearance in zip(found, clearances, strict=True):
            findings.append(find(gap, reachable, clearance, slack, hold))
    return found


def summary(findings: list[Finding], clearance: float, seed: int) -> dict:
    """Numbers about all episodes with one clearance, as JSON can hold them."""
    n, blocked = len(findings), np.array([one.blocked for one in findings])
    impossible = [seed + k for k, one in enumerate(findings) if not one.possible]
    counts = {
        "never blocked": int((blocked == 0.0).sum()),
        "no window: success is impossible": len(impossible),
        "success, at most": n - len(impossible),
    }
    low, high = bootstrap_interval(blocked, np.mean, 0)
    return {
        "clearance": clearance,
        **{name: asdict(Rate.of(count, n)) for name, count in counts.items()},
        "blocked share of the time": {"mean": float(blocked.mean()), "low": low, "high": high},
        "impossible seeds": impossible,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first episode")
    parser.add_argument("--task", default="reach", help=", ".join(n for n, t in TASKS.items() if t.space == "tip"))
    parser.add_argument("--human", default="random", help=", ".join(n for n, h in HUMANS.items() if not h().reacts))
    parser.add_argument("--seconds", type=float, default=8.0, help="length of an episode")
    parser.add_argument("--clearances", type=float, nargs="+", default=[0.0, 0.05], help="that the arm keeps [m]")
    parser.add_argument("--not-before", type=float, help="when the arm can be there [s], instead of the bound")
    parser.add_argument("--json", type=Path, help="also write the numbers, with the seeds, to this file")
    arguments = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    try:
        episodes, seed = positive_integer("episodes", arguments.episodes), whole_number("seed", arguments.seed)
        seconds, not_before = number_within("seconds", arguments.seconds, 0.1, 600.0), arguments.not_before
        if not_before is not None:
            number_within("not-before", not_before, 0.0)
        env = ArmEnv(arguments.task, human=arguments.human, terminate_on=())
        clearances = [number_within("clearances", one, 0.0) for one in arguments.clearances]
        found = survey(env, range(seed, seed + episodes), clearances, round(seconds / env.dt), not_before)
    except JSSAGymError as error:
        parser.error(str(error))
    tables = [summary(*one, seed) for one in zip(found, clearances, strict=True)]
    print(f"{arguments.task} beside {arguments.human}: {episodes:,} episodes of {seconds:g} s, 95 % intervals")
    for one in tables:
        print(f"{one['clearance']:g} m are kept:" if one["clearance"] else "no contact:")
        for row in ("never blocked", "no window: success is impossible", "success, at most"):
            print(f"  {row:<33} {Rate(**one[row])}")
        share = one["blocked share of the time"]
        print(
            f"  {'blocked, mean share of the time':<33} {share['mean']:.3f} ({share['low']:.3f} to {share['high']:.3f})"
        )
    if arguments.json:
        told = {"task": arguments.task, "human": arguments.human, "episodes": episodes, "seed": seed}
        told |= {"seconds": seconds, "not_before": not_before, "clearances": tables}
        write_whole(arguments.json, json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
