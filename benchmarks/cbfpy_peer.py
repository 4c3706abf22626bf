"""How long does a general library for control barrier functions take for the decision that the shield takes?

The peer is CBFpy (``cbfpy``, built on JAX). Both get the same scenes: joint state, nominal jerk, six human capsules.
Both return the nearest jerk in the box that keeps the safety index of all 30 capsule pairs. It needs both packages in
one environment; ``elastiqp`` is CBFpy's faster solver for CPUs and is left out if it is missing::

    pip install -e . cbfpy "elastiqp[jax]"
    python benchmarks/cbfpy_peer.py

What is compared: one call, numpy arrays in and a numpy jerk out, compiled beforehand, double precision, CBFpy's
recommended settings for CPUs and default penalties, the contenders taking turns call by call. CBFpy's state is the
triple integrator's [q, v, a] and a time, 0 at every call, by which the human moves; without it h_dot would miss the
human's motion. Its scenes are packed into arrays beforehand; the shield reads and checks its ``Scene`` while timed.
Taking turns cools both caches and costs the shorter call relatively more: alone, the shield gains more than CBFpy.
Kinematics are products and sums rather than matrix products, because XLA fuses them: twice as fast here.

What is not compared: safety in closed loop, CBFpy on a GPU or on batches, where JAX is at home, and gradients through
the filter. CBFpy takes any barrier and differentiates it by itself. The shield's kernels are written for this index,
and skip rows and projection while the nominal is safe, so that its times are printed by decision, too.

Why the jerks differ, so that no equality is to be expected:

- CBFpy keeps the continuous-time ``h_dot >= -alpha h``, linear at the present state; the shield keeps ``phi <= 0`` at
  the end of the step, linearised there. With alpha = 1/dt, the default here, one is the first-order expansion of the
  other, and they agree up to the curvature of phi over one step. A smaller alpha intervenes earlier.
- The shield drops pairs that no jerk moves noticeably; CBFpy bends the jerk for them as far as its penalty pays.
- Where box and rows exclude each other, CBFpy minimises the sum of all violations, the shield the largest.

"given to the shield" therefore says by how much the shield would still change CBFpy's jerk: hardly at all.
"""

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from typing import Any

os.environ.setdefault("JAX_ENABLE_X64", "1")  # these three are CBFpy's recommendation for CPUs
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

import jssa_gym
from jssa_gym.cli.demo import paper_scene
from jssa_gym.evaluation.identity import made_with
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.shields import JSSAFilter
from jssa_gym.types import Array, Scene, Status

INDEX = IndexParams()
DT = 0.008
SOLVERS: dict[str, dict[str, Any]] = {
    "qpax": {"backend": "qpax"},
    "elastiqp": {"backend": "elastiqp", "solver_tol": 1e-5},  # its loosest recommended tolerance
}


def closest(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """Fractions of the closest points of the segments a-b and c-d, points and parallels included, held fixed."""
    e, f, w = b - a, d - c, a - c
    ee, ff, ef = (e * e).sum(-1), (f * f).sum(-1), (e * f).sum(-1)
    ew, fw = (e * w).sum(-1), (f * w).sum(-1)
    det = ee * ff - ef * ef
    skew = det > 1e-12 * ee * ff
    s = jnp.where(skew, jnp.clip((ef * fw - ew * ff) / jnp.where(skew, det, 1.0), 0.0, 1.0), 0.0)
    free = (ef * s + fw) / jnp.maximum(ff, 1e-30)
    r = jnp.clip(free, 0.0, 1.0)
    s = jnp.where((free != r) | (ff <= 1e-30), jnp.clip((ef * r - ew) / jnp.maximum(ee, 1e-30), 0.0, 1.0), s)
    return jax.lax.stop_gradient(s[..., None]), jax.lax.stop_gradient(r[..., None])


def at(ends: Any, fraction: Any) -> Any:
    return (1.0 - fraction) * ends[..., 0, :] + fraction * ends[..., 1, :]


class JerkConfig(CBFConfig):
    """An arm under joint jerk beside human capsules (m, 13): start, end, their velocities, radius."""

    def __init__(self, robot: RobotModel, humans: int, alpha: float, **options: Any) -> None:
        self.joints, self.gain = robot.n, alpha
        cross = np.cross(np.eye(3), robot.links["axis"][:, None])
        fixed = robot.links["rotation"]
        self.turns = fixed, fixed @ cross, fixed @ cross @ cross  # Rodrigues' formula, by 1, sin q, 1 - cos q
        self.offsets = robot.links["offset"]
        self.links = robot.capsules["link"]
        self.ends = np.stack([robot.capsules["start"], robot.capsules["end"]], 1)
        self.radii = robot.capsules["radius"][:, None]
        jerk, example = robot.limits.jerk, (np.ones((humans, 13)),)
        super().__init__(3 * robot.n + 1, robot.n, u_min=-jerk, u_max=jerk, init_args=example, **options)

    def f(self, z: Any, human: Any) -> Any:
        return jnp.concatenate([z[self.joints : -1], jnp.zeros(self.joints), jnp.ones(1)])

    def g(self, z: Any, human: Any) -> Any:
        n = self.joints
        return np.vstack([np.zeros((2 * n, n)), np.eye(n), np.zeros((1, n))])

    def alpha(self, h: Any, human: Any) -> Any:
        return self.gain * h

    def capsule_ends(self, q: Any) -> Any:
        """Ends of the robot capsules' axes in the world, shape (capsules, 2, 3)."""
        fixed, sine, versine = self.turns
        turns = fixed + jnp.sin(q)[:, None, None] * sine + (1.0 - jnp.cos(q))[:, None, None] * versine
        rotation, origin, frames = jnp.eye(3), jnp.zeros(3), []
        for turn, offset in zip(turns, self.offsets, strict=True):
            origin = origin + (rotation * offset).sum(-1)
            rotation = (rotation[:, :, None] * turn).sum(1)
            frames.append((rotation, origin))
        rotations, origins = (jnp.stack(part)[self.links][:, None] for part in zip(*frames, strict=True))
        return (rotations * self.ends[:, :, None, :]).sum(-1) + origins

    def h_1(self, z: Any, human: Any) -> Any:
        """-phi of all pairs, the closest points fixed to their bodies."""
        q, v, a = jnp.split(z[:-1], 3)

        def motion(q: Any, v: Any) -> tuple[Any, Any]:
            return jax.jvp(self.capsule_ends, (q,), (v,))

        arm = jax.jvp(motion, (q, v), (v, a))
        p, p_dot, p_ddot = (ends[:, None] for ends in (arm[0][0], arm[0][1], arm[1][1]))
        x_dot = human[:, 6:12].reshape(-1, 2, 3)
        x = human[:, :6].reshape(-1, 2, 3) + z[-1] * x_dot
        s, r = closest(p[..., 0, :], p[..., 1, :], x[:, 0], x[:, 1])
        w, w_dot, w_ddot = at(p, s) - at(x, r), at(p_dot, s) - at(x_dot, r), at(p_ddot, s)
        d = jnp.sqrt((w * w).sum(-1))
        D = d - self.radii - human[:, 12]
        D_dot = (w * w_dot).sum(-1) / d
        D_ddot = ((w * w_ddot).sum(-1) + (w_dot * w_dot).sum(-1) - D_dot**2) / d
        phi = INDEX.d_min**2 - D * jnp.abs(D) - INDEX.lambda1 * D_dot - INDEX.lambda2 * D_ddot
        return -phi.ravel()


def measure(
    states: Array,
    nominals: Array,
    humans: Array,
    repeats: int,
    *,
    robot: RobotModel | None = None,
    alpha: float = 1.0 / DT,
    solver: str = "qpax",
    beside: Callable[[int], Any] | None = None,
) -> dict[str, Any]:
    """Time CBFpy on scenes.

    Args:
        states: Rows [q, v, a], shape (k, 3 n) [rad, rad/s, rad/s²].
        nominals: Jerks, shape (k, n) [rad/s³].
        humans: Capsules, shape (k, m, 13), as in :class:`JerkConfig`.
        repeats: Passes over all scenes.
        robot: The arm where it stands; None for the one of ``jssa_gym/Home-v0``.
        alpha: Gain [1/s].
        solver: Key of ``SOLVERS``.
        beside: Called with a scene's number and timed in turns with CBFpy.

    Returns:
        ``median`` and ``p99`` of a decision [s], ``compile`` [s] (configuration and first call, not in the times),
        ``times`` and ``beside`` of shape (repeats, k) [s], ``jerk`` of shape (k, n) [rad/s³].
    """
    robot = robot or gym.make("jssa_gym/Home-v0").get_wrapper_attr("robot")
    z = np.hstack([states, np.zeros((len(states), 1))])
    jerk = np.zeros_like(nominals)
    start = time.perf_counter()
    cbf = CBF.from_config(JerkConfig(robot, humans.shape[1], alpha, **SOLVERS[solver]))
    np.asarray(cbf.safety_filter(z[0], nominals[0], humans[0]))
    compiled = time.perf_counter() - start
    times, others = np.zeros((repeats, len(z))), np.full((repeats, len(z)), np.nan)
    for i in range(repeats):
        for k in range(len(z)):
            start = time.perf_counter()
            jerk[k] = np.asarray(cbf.safety_filter(z[k], nominals[k], humans[k]))
            times[i, k] = time.perf_counter() - start
            if beside is not None:
                start = time.perf_counter()
                beside(k)
                others[i, k] = time.perf_counter() - start
    median, p99 = np.percentile(times, [50, 99])
    return {
        "median": float(median),
        "p99": float(p99),
        "compile": compiled,
        "times": times,
        "beside": others,
        "jerk": jerk,
    }


def record(count: int) -> tuple[RobotModel, list[Scene], Array]:
    """Scenes and nominal jerks, evenly from a shielded episode of the paper's scene."""
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=()))
    robot, policy = env.get_wrapper_attr("robot"), jssa_gym.HoldPolicy(env)
    observation, _ = env.reset(seed=0)
    scenes, nominals = [], []
    for _ in range(jssa_gym.HORIZON):
        action = policy(observation)
        scenes.append(env.get_wrapper_attr("scene"))
        nominals.append(action * robot.limits.jerk)
        observation, *_ = env.step(action)
    env.close()
    chosen = np.linspace(0, len(scenes) - 1, count).astype(int)
    return robot, [scenes[k] for k in chosen], np.array(nominals)[chosen]


def line(name: str, times: Array) -> str:
    median, p99 = np.percentile(times, [50, 99]) * 1e6
    return f"  {name:32s} median {median:7.1f} µs   p99 {p99:7.1f} µs   {times.size} calls"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--alpha", type=float, default=1.0 / DT, help="CBFpy's gain [1/s]; default 1/dt")
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    robot, scenes, nominals = record(args.scenes)
    shield = JSSAFilter(robot, DT, INDEX)
    decisions = [shield.decide(scene, nominal) for scene, nominal in zip(scenes, nominals, strict=True)]
    ours = np.array([decision.jerk for decision in decisions])
    acts = np.array([decision.status != Status.NOMINAL for decision in decisions])
    arms, people = [scene.robot for scene in scenes], [scene.human for scene in scenes]
    states = np.array([np.concatenate([arm.position, arm.velocity, arm.acceleration]) for arm in arms])
    humans = np.array([np.column_stack([p.start, p.end, p.start_velocity, p.end_velocity, p.radius]) for p in people])
    print(f"{len(scenes)} scenes, the shield intervenes in {acts.sum()}; alpha {args.alpha:g} 1/s")
    for solver in SOLVERS:
        if importlib.util.find_spec(solver) is None:
            print(f"{solver} is not installed")
            continue
        result = measure(
            states,
            nominals,
            humans,
            args.repeats,
            robot=robot,
            alpha=args.alpha,
            solver=solver,
            beside=lambda k: shield.decide(scenes[k], nominals[k]),
        )
        theirs = result["jerk"]
        print(f"{solver}: compiled in {result['compile']:.1f} s")
        for name, chosen in (("all", np.full(len(acts), True)), ("intervening", acts), ("nominal kept", ~acts)):
            if chosen.any():
                cbfpy, jssa = result["times"][:, chosen], result["beside"][:, chosen]
                print(line(f"CBFpy {solver}, {name}", cbfpy))
                print(line(f"JSSAFilter.decide, {name}", jssa))
                print(f"  ratio of the medians {np.median(cbfpy) / np.median(jssa):.1f}")
        again = np.array([shield.decide(scene, u).jerk for scene, u in zip(scenes, theirs, strict=True)])
        for name, change in (
            ("the shield's correction", ours - nominals),
            ("CBFpy's jerk less the shield's", theirs - ours),
            ("CBFpy's jerk given to the shield", again - theirs),
        ):
            largest = np.abs(change).max(1)
            if acts.any():
                median, p90, worst = np.percentile(largest[acts], [50, 90, 100])
                print(f"  {name:34s} median {median:8.2g}   p90 {p90:8.2g}   max {worst:8.2g} rad/s³, intervening")
        if (~acts).any():
            worst = np.abs(theirs - nominals)[~acts].max()
            print(f"  CBFpy's jerk less the nominal      max {worst:8.2g} rad/s³, nominal kept")


if __name__ == "__main__":
    main()
