"""How long does a general CBF library take for the decision that the shield takes?

Peer: CBFpy (``cbfpy``, Stanford ASL), a control-barrier-function filter on JAX. Both get the same scenes: joint
state, nominal jerk, six human capsules; both return the nearest jerk in the box that keeps the safety index of all
30 capsule pairs. Give it both packages in one environment, ``elastiqp`` is CBFpy's faster solver for CPUs::

    pip install jssa-gym cbfpy "elastiqp[jax]"
    python benchmarks/cbfpy_peer.py

What is compared: one call from numpy arrays to a numpy jerk, compiled beforehand, double precision, CBFpy's own
recommended settings for CPUs, the contenders taking turns scene by scene. CBFpy's state is the triple integrator's
[q, v, a] and a time of its own, 0 at every call, by which the human moves; h = -phi has relative degree one in the jerk.
For CBFpy the scenes are packed into arrays beforehand; the shield reads its ``Scene`` and checks it within its time.

What is not compared: safety in closed loop, CBFpy on a GPU or on batches (where JAX is at home), gradients through
the filter. CBFpy writes the barrier once and differentiates by itself; the shield's kernels are written for this one
index, and skip rows and projection while the nominal is safe. So the times by decision are printed, too.

Why the jerks differ: CBFpy keeps the continuous-time ``h_dot >= -alpha h`` at the present state; the shield keeps
``phi <= 0`` at the end of the step, and linearises there. With alpha = 1/dt, the default here, the first is the
second's first-order expansion, so that they agree up to the curvature of phi over one step: no equality is to be
expected. Where box and rows exclude each other, CBFpy minimises the sum of all violations, the shield the largest.
"""

import os
from typing import Any

os.environ.setdefault("JAX_ENABLE_X64", "1")  # these three are what CBFpy recommends, and warns without
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBFConfig

import jssa_gym
from jssa_gym.safety.index import IndexParams

ROBOT = jssa_gym.ROBOTS["lr_mate_200id_7l"]()
INDEX = IndexParams(d_min=0.05, lambda1=1.25, lambda2=0.39)
DT = 0.008
N = ROBOT.n


def capsule_ends(q: Any) -> Any:
    """Ends of the robot capsules' axes in the world, shape (capsules, 2, 3)."""
    rotation, origin, frames = jnp.eye(3), jnp.zeros(3), []
    for link, angle in zip(ROBOT.links, q, strict=True):
        k = np.cross(np.eye(3), -link["axis"])
        origin = origin + rotation @ link["offset"]
        turn = jnp.eye(3) + jnp.sin(angle) * k + (1.0 - jnp.cos(angle)) * (k @ k)
        rotation = rotation @ link["rotation"] @ turn
        frames.append((rotation, origin))
    ends = []
    for capsule in ROBOT.capsules:
        rotation, origin = frames[capsule["link"]]
        ends.append(np.stack([capsule["start"], capsule["end"]]) @ rotation.T + origin)
    return jnp.stack(ends)


def closest(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """Fractions of the closest points of the segments a-b and c-d, points and parallels included."""
    e, f, w = b - a, d - c, a - c
    ee, ff, ef = (e * e).sum(-1), (f * f).sum(-1), (e * f).sum(-1)
    ew, fw = (e * w).sum(-1), (f * w).sum(-1)
    det = ee * ff - ef * ef
    safe_ee, safe_ff = jnp.maximum(ee, 1e-30), jnp.maximum(ff, 1e-30)
    skew = det > 1e-12 * ee * ff
    s = jnp.where(skew, jnp.clip((ef * fw - ew * ff) / jnp.where(skew, det, 1.0), 0.0, 1.0), 0.0)
    free = (ef * s + fw) / safe_ff
    r = jnp.clip(free, 0.0, 1.0)
    s = jnp.where((free != r) | (ff <= 1e-30), jnp.clip((ef * r - ew) / safe_ee, 0.0, 1.0), s)
    return jax.lax.stop_gradient(s[..., None]), jax.lax.stop_gradient(r[..., None])


class JerkConfig(CBFConfig):
    """The arm under joint jerk beside human capsules; z = [q, v, a, time since the measurement]."""

    def __init__(self, humans: int, alpha: float, **options: Any) -> None:
        self.gain = alpha
        jerk = ROBOT.limits.jerk
        super().__init__(3 * N + 1, N, u_min=-jerk, u_max=jerk, init_args=(np.ones((humans, 13)),), **options)

    def f(self, z: Any, human: Any) -> Any:
        return jnp.concatenate([z[N : 3 * N], jnp.zeros(N), jnp.ones(1)])

    def g(self, z: Any, human: Any) -> Any:
        return jnp.zeros((3 * N + 1, N)).at[2 * N : 3 * N].set(jnp.eye(N))

    def h_1(self, z: Any, human: Any) -> Any:
        """-phi of all pairs, robot capsule by robot capsule; the closest points are fixed to their bodies."""
        q, v, a = z[:N], z[N : 2 * N], z[2 * N : 3 * N]

        def moving(q: Any, v: Any) -> tuple[Any, Any]:
            return jax.jvp(capsule_ends, (q,), (v,))

        (p, p_dot), (_, p_ddot) = jax.jvp(moving, (q, v), (v, a))
        rate = human[:, 6:12].reshape(-1, 2, 3)
        x = human[:, :6].reshape(-1, 2, 3) + z[-1] * rate
        p, p_dot, p_ddot = p[:, None], p_dot[:, None], p_ddot[:, None]
        s, r = closest(p[..., 0, :], p[..., 1, :], x[:, 0], x[:, 1])

        def on(ends: Any, at: Any) -> Any:
            return (1.0 - at) * ends[..., 0, :] + at * ends[..., 1, :]

        w, w_dot, w_ddot = on(p, s) - on(x, r), on(p_dot, s) - on(rate, r), on(p_ddot, s)
        d = jnp.sqrt((w * w).sum(-1))
        D = d - ROBOT.capsules["radius"][:, None] - human[:, 12]
        D_dot = (w * w_dot).sum(-1) / d
        D_ddot = ((w * w_ddot).sum(-1) + (w_dot * w_dot).sum(-1) - D_dot**2) / d
        phi = INDEX.d_min**2 - D * jnp.abs(D) - INDEX.lambda1 * D_dot - INDEX.lambda2 * D_ddot
        return -phi.ravel()

    def alpha(self, h: Any, human: Any) -> Any:
        return self.gain * h

    def alpha_2(self, h_2: Any, human: Any) -> Any:
        return h_2
