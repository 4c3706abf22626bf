"""How a servoed arm follows its commands under the shield, and what is left when the shield knows of it.

The verified stop's promise is about the commanded arm. Here the simulated one (`dynamics="servo"`) is measured: how far
it is from its command, how far over its limits it swings, how fast it still is when somebody touches it; first under
the default assumptions, then under `FailsafeParams` with what `measure_tracking` finds in moves
that are stopped halfway.

    python benchmarks/servo_residual.py
"""

import argparse
from typing import NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.control import plan_brake, plan_move
from jssa_gym.evaluation.identity import made_with
from jssa_gym.policies import POLICIES
from jssa_gym.safety.tracking import Tracking, tracking_error_metres
from jssa_gym.types import JointState

PEOPLE = ("none", "pursuit", "hand")
DRIVERS = ("hold", "jpc_paper", "random", "bang_bang")
RESERVE = 1.5
"""By which what was measured is multiplied before it is assumed of other episodes."""

PAUSE = 25
"""Ticks at rest after every stop."""


class Residual(NamedTuple):
    """Of one episode; the largest of everything."""

    error: np.ndarray
    """Deviation of each joint, shape (n,) [rad]."""
    metres: float
    """What a point of the arm is off by at most [m]."""
    contact_speed: float
    """Of the simulated arm's touching point [m/s]."""
    moving: bool
    """Whether somebody was touched by it in motion."""
    violated: bool
    """Whether ``limit_violation`` was reported."""
    over: float
    """By which the range of a joint is exceeded [rad]; negative inside."""
    speed: float
    """Share of a velocity limit."""
    commanded: np.ndarray
    """Joint positions, shape (T, n) [rad]."""
    actual: np.ndarray
    """Where the joints are, shape (T, n) [rad]."""


def play(human: str, policy: str, seed: int, failsafe: jssa_gym.FailsafeParams, steps: int) -> Residual:
    """One episode of Home."""
    env = jssa_gym.JSSAShield(
        gym.make("jssa_gym/Home-v0", human=human, dynamics="servo", terminate_on=()), failsafe=failsafe
    )
    act = POLICIES[policy](env, seed)
    observation, info = env.reset(seed=seed)
    arm = env.unwrapped
    rows = []
    for _ in range(steps):
        observation, _, _, _, info = env.step(act(observation))
        rows.append((arm.scene.robot.position, info["tracking_error"], info["contact_speed"], info["limit_violation"]))
    env.close()
    commanded, error, contact, violated = (np.array(column) for column in zip(*rows, strict=True))
    low, high = arm.robot.limits.position.T
    actual = commanded + error
    speed = np.abs(np.diff(actual, axis=0)).max(axis=0) / arm.dt / arm.robot.limits.velocity
    return Residual(
        np.abs(error).max(axis=0),
        tracking_error_metres(arm.robot, error),
        float(contact.max()),
        bool((contact > 1e-3).any()),
        bool(violated.any()),
        float(np.maximum(low - actual, actual - high).max()),
        float(speed.max()),
        commanded,
        actual,
    )


def exercise(seed: int, stops: int) -> Tracking:
    """What moves between random postures say about the drives, each stopped by full jerk on its way."""
    env = gym.make("jssa_gym/Home-v0", human="none", dynamics="servo", terminate_on=(), max_episode_steps=-1)
    env.reset(seed=seed)
    arm, rng = env.unwrapped, np.random.default_rng(seed)
    limits, dt = arm.robot.limits, arm.dt
    commanded, actual = [], []
    for _ in range(stops):
        move = plan_move(arm.scene.robot.position, rng.uniform(*(0.9 * limits.position.T)), limits, dt)
        begun = move.jerk[: rng.integers(len(move) // 3, len(move))]
        state = JointState(*move.states[len(begun)])
        rest = np.zeros((PAUSE, arm.robot.n))
        for jerk in np.concatenate([begun, plan_brake(state, limits, dt).jerk, rest]):
            *_, info = env.step(jerk / limits.jerk)
            commanded.append(arm.scene.robot.position)
            actual.append(commanded[-1] + info["tracking_error"])
    return jssa_gym.measure_tracking(arm.robot, commanded, actual, dt)


def assumed(tracking: Tracking) -> jssa_gym.FailsafeParams:
    """What the shield is told, with a reserve."""
    return jssa_gym.FailsafeParams(
        actuation_lag=RESERVE * tracking.actuation_lag, tracking_error=RESERVE * tracking.tracking_error
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=10, help="per cell")
    parser.add_argument("--stops", type=int, default=40, help="from which the drives are measured")
    parser.add_argument("--steps", type=int, default=500, help="per episode")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    tracking = exercise(0, args.stops)
    print(f"measured: {tracking}")
    for name, failsafe in (("default", jssa_gym.FailsafeParams()), ("measured", assumed(tracking))):
        print(f"\n{name}: actuation_lag {failsafe.actuation_lag:.3f} s, tracking_error {failsafe.tracking_error:.4f} m")
        print(
            "| people | policy | off [mrad] | off [mm] | range exceeded [mrad] | speed / limit | contact [mm/s] "
            "| episodes with moving contact | with limit exceeded |"
        )
        print("|---|---|---|---|---|---|---|---|---|")
        for human in PEOPLE:
            for policy in DRIVERS:
                every = [play(human, policy, seed, failsafe, args.steps) for seed in range(args.episodes)]
                print(
                    f"| {human} | {policy} | {1e3 * max(e.error.max() for e in every):.1f} "
                    f"| {1e3 * max(e.metres for e in every):.1f} "
                    f"| {max(0.0, 1e3 * max(e.over for e in every)):.2f} | {max(e.speed for e in every):.3f} "
                    f"| {1e3 * max(e.contact_speed for e in every):.2f} "
                    f"| {sum(e.moving for e in every)} / {len(every)} "
                    f"| {sum(e.violated for e in every)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
