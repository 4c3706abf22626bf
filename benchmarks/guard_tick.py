"""What a tick of a guard costs, and a long run of it: jittered clock, noise, overruns, doubled ticks, faults.

    python benchmarks/guard_tick.py                             # times of a tick, 20,000 of each kind of command
    python benchmarks/guard_tick.py --soak 1000000              # a long run; exit status 1 if it breaks a promise

The long run commands everything that can be commanded, sensible and not, beside people who come for the arm, and
visitors who come and go. Ticks come
up to 30 % early or late, one in 2,000 after 1 to 5 ticks without any, one in 5,000 twice; joint positions are measured
with noise of 0.1 mrad, or not at all; 1 in 1,000 commands, people and stamps are none. What is counted: exceptions,
ticks beyond a joint limit, answers that are not where the jerks before have led, memory that was not given back.
"""

import argparse
import gc
import sys
import time
import tracemalloc

import numpy as np

import jssa_gym
from jssa_gym.envs.surroundings import Surroundings
from jssa_gym.evaluation.identity import made_with
from jssa_gym.humans import make_human, nobody
from jssa_gym.humans.visitors import HIGH, LOW
from jssa_gym.kernels.motion import integrate
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.types import MeasuredPeople

SHIFT = 1000
"""Ticks of a long run beside one person."""

KINDS = ("position", "velocity", "jerk", "tip", "twist", "pose", "stream")


class Controller:
    """Commands of all kinds, of each for a while."""

    def __init__(self, robot: jssa_gym.RobotModel, seed: int, kinds: tuple[str, ...] = KINDS) -> None:
        self._rng, self._robot, self._kinds = np.random.default_rng(seed), robot, kinds
        self._left, self._phase = 0, 0.0
        self._command: object = None
        self._low, self._high = robot.limits.position.T

    def command(self, dt: float) -> object:
        """The next one."""
        self._left -= 1
        rng, n = self._rng, self._robot.n
        if self._left <= 0:
            self._left, self._kind = int(rng.integers(50, 300)), str(rng.choice(self._kinds))
            wide, size = self._high - self._low, rng.choice((0.1, 1.2))
            self._centre = np.array(self._robot.home) + rng.choice((0.03, 0.5)) * rng.uniform(-1, 1, n) * wide
            self._swing, self._rate = 0.1 * rng.uniform(-1, 1, n) * wide, rng.uniform(0.3, 3.0)
            limits = self._robot.limits
            self._command = {
                "position": jssa_gym.JointPosition(self._centre),
                "velocity": jssa_gym.JointVelocity(size * rng.uniform(-1, 1, n) * limits.velocity),
                "jerk": jssa_gym.JointJerk(size * rng.uniform(-1, 1, n) * limits.jerk),
                "tip": jssa_gym.TipVelocity(size * rng.uniform(-1, 1, 3)),
                "twist": jssa_gym.Twist(size * rng.uniform(-1, 1, 3), rng.uniform(-2, 2, 3)),
                "pose": jssa_gym.ToolPose(rng.uniform((-0.7, -0.7, 0.7), (0.7, 0.7, 2.0)), _turned(rng)),
                "stream": None,
            }[self._kind]
        if self._kind == "stream":
            self._phase += dt
            return jssa_gym.JointPosition(self._centre + self._swing * np.sin(self._rate * self._phase))
        return self._command


def _turned(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def soak(ticks: int, dt: float, seed: int, humans: list[str], measured: bool) -> dict[str, float]:
    """A long run; see above."""
    late = 6 * dt
    watched = WatchedRegion.box(LOW, HIGH) if "visitors" in humans else None
    guard = jssa_gym.Guard(dt=dt, failsafe={"actuation_lag": late}, watched=watched)
    guard.start(guard.robot.home)
    robot, rng = guard.robot, np.random.default_rng(seed)
    controller, around = Controller(robot, seed), Surroundings(robot, 6)
    stamp, unmeasured, still = 0.0, np.full(6, np.nan), np.zeros(6)
    state, after = np.array(guard.state), np.empty((3, 6))
    found = dict.fromkeys(("exceptions", "limits exceeded", "not where the jerks led", "moving contacts"), 0)
    shares, moved, first = [0] * 5, 0, 0
    for k in range(ticks):
        if k % SHIFT == 0:  # somebody else comes, wherever the arm has got to
            motion = make_human(humans[k // SHIFT % len(humans)])
            people = motion.reset(rng)
            around.take(people)
            state[:] = (robot.home, still, still)
            guard.start(robot.home)
            around.move(state, still, 0.0)
        if k == len(humans) * SHIFT:  # everything was met once
            gc.collect()
            tracemalloc.start()
        if k == len(humans) * SHIFT + 2000:
            gc.collect()
            tracemalloc.reset_peak()
            first = tracemalloc.get_traced_memory()[0]
        if k % 100_000 == 0 and first:
            gc.collect()
            print(f"after {k:,} ticks {tracemalloc.get_traced_memory()[0] - first:,} B more are kept", flush=True)
        command, seen, now = controller.command(dt), people, stamp
        odd = rng.random()
        if odd < 1e-3:
            command = (None, jssa_gym.JointJerk(np.full(6, np.nan)), jssa_gym.JointPosition(np.zeros(5)), "go", 7)[
                k % 5
            ]
        elif odd < 2e-3:
            seen = (None, 3, people._replace(start=people.start * np.nan), MeasuredPeople(people, np.nan))[k % 4]
        elif odd < 2.2e-3:
            now = (float("nan"), "noon", stamp - 2.0 * dt, None)[k % 4]
        joints = None
        if measured:
            joints = jssa_gym.JointState(guard.state.position + 1e-4 * rng.normal(size=6), unmeasured, unmeasured)
        try:
            answer = guard.tick(command, seen, now, joints)  # ty: ignore[invalid-argument-type]
        except Exception as error:
            found["exceptions"] += 1
            print(f"tick {k}: {error!r}", file=sys.stderr)
            continue
        shares[answer.status] += 1
        integrate(state, answer.jerk.copy(), dt, after)
        if np.abs(after - [answer.position, answer.velocity, answer.acceleration]).max() > 0.0:
            found["not where the jerks led"] += 1
        if rng.random() < 2e-4:
            continue_in = 0.0  # the same tick once more
        else:
            missed = int(rng.integers(1, 6)) if rng.random() < 5e-4 else 0
            continue_in = dt * (1 + missed + rng.uniform(-0.3, 0.3))
        if continue_in > 0.0:
            people = motion.step(continue_in, around.robot_capsules)
        around.take(people)
        _, _, speed, violation = around.move(state, np.array(answer.jerk), dt)
        state[:] = after
        found["limits exceeded"] += violation
        found["moving contacts"] += speed > 1e-3
        moved += float(np.abs(state[1]).max()) > 0.05
        stamp += continue_in
    gc.collect()
    current, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    names = dict(zip((status.name for status in jssa_gym.Status), (s / ticks for s in shares), strict=True))
    return {**found, "kept [B]": current - first, "peak [B]": peak - first, "moving": moved / ticks, **names}


def times(ticks: int, dt: float) -> dict[str, tuple[float, float, float]]:
    """Median, 99th percentile and largest processor time of a tick by kind of command [µs]."""
    found = {}
    for kind in (*KINDS, "nobody"):
        guard = jssa_gym.Guard(dt=dt)
        guard.start(guard.robot.home)
        controller = Controller(guard.robot, 1, (kind if kind in KINDS else "stream",))
        motion = make_human("none" if kind == "nobody" else "walk_by")
        people = motion.reset(np.random.default_rng(0))
        spent = np.empty(ticks)
        gc.disable()
        for k in range(ticks):
            command, stamp = controller.command(dt), k * dt
            begun = time.thread_time()
            guard.tick(command, people, stamp)  # ty: ignore[invalid-argument-type]
            spent[k] = time.thread_time() - begun
            people = motion.step(dt, nobody())
        gc.enable()
        found[kind] = tuple(float(x) * 1e6 for x in (*np.percentile(spent[100:], (50, 99)), spent[100:].max()))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=20_000, help="of each kind, to be timed")
    parser.add_argument("--soak", type=int, default=0, help="ticks of a long run instead")
    parser.add_argument("--dt", type=float, default=0.008, help="control step [s]")
    everybody = ["random", "walk_by", "approach_retreat", "hand", "pursuit", "visitors"]
    parser.add_argument("--human", nargs="+", default=everybody, help="beside visitors a region is watched")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--unmeasured", action="store_true", help="no joint positions are measured")
    given = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    if not given.soak:
        for kind, (median, most, largest) in times(given.ticks, given.dt).items():
            print(f"{kind:10} median {median:7.1f} µs, 99 % {most:7.1f} µs, largest {largest:8.1f} µs")
        return 0
    found = soak(given.soak, given.dt, given.seed, given.human, not given.unmeasured)
    for name, value in found.items():
        print(f"{name:24} {value:g}")
    broken = sum(found[name] for name in ("exceptions", "limits exceeded", "not where the jerks led"))
    return int(bool(broken) or found["kept [B]"] > 200_000)  # room for every number of people, once


if __name__ == "__main__":
    sys.exit(main())
