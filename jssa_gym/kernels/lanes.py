"""Eight joints at once, in the lanes of a processor's vector registers.

A loop over :data:`LANES` numbers becomes one stream of vector instructions if nothing in it branches: what a branch
would leave out is computed and thrown away. Every lane does the very operations that its joint would do alone, so that
results are the same bits. What is rare, a joint whose stop has to be searched for, is left to the code for single ones.
"""

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.core.extending import intrinsic

from jssa_gym.kernels.jit import inlined
from jssa_gym.kernels.motion import advance
from jssa_gym.kernels.rest import REST_PLANNED

LANES = 8
"""Doubles in a register of AVX-512; narrower ones take them in several steps."""


@intrinsic
def _on_stack(context):
    array = types.Array(types.float64, 1, "C")

    def make(context, builder, signature, arguments):
        place = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), LANES))
        result = context.make_array(array)(context, builder)
        count, size = context.get_constant(types.intp, LANES), context.get_constant(types.intp, 8)
        data = builder.bitcast(place, ir.DoubleType().as_pointer())
        context.populate_array(result, data=data, shape=[count], strides=[size], itemsize=size, meminfo=None)
        return result._getvalue()

    return array(), make


lanes = (lambda: np.empty(LANES)) if config.DISABLE_JIT else _on_stack
"""Room for a number of every lane, on the stack: it is gone when the function returns."""


@inlined
def keeps(q, v, a, u, t, low, high, V, A, J):
    """Whether one joint keeps its limits for the time t at jerk u; ``stopping._stays`` without branches."""
    end_q, end_v, end_a = advance(q, v, a, u, t)
    kept = (abs(u) <= J) & (abs(a) <= A) & (abs(end_a) <= A) & (abs(v) <= V) & (abs(end_v) <= V)
    kept &= (low <= q) & (q <= high) & (low <= end_q) & (end_q <= high)
    turn = v - a * a / (2.0 * u) if a * end_a < 0.0 else v
    kept &= abs(turn) <= V
    turns = (v * turn < 0.0) | (turn * end_v < 0.0)
    root = a + np.copysign(np.sqrt(max(a * a - 2.0 * u * v, 0.0)), a)
    late, early = -2.0 * v / root, -root / u
    late_q, early_q = advance(q, v, a, u, late)[0], advance(q, v, a, u, early)[0]
    late_out = (late > 0.0) & (late < t) & ~((low <= late_q) & (late_q <= high))
    early_out = (u != 0.0) & (early > 0.0) & (early < t) & ~((low <= early_q) & (early_q <= high))
    return kept & ~(turns & (late_out | early_out))


@inlined
def stop_keeps(q, v, a, ramp, hold, release, jerk_in, jerk_out, low, high, V, A, J, tau):
    """Whether one joint keeps its limits through a stop, then rests; ``stopping.parts_keep`` without branches."""
    kept = keeps(q, v, a, jerk_in, ramp * tau, low, high, V, A, J)
    q, v, a = advance(q, v, a, jerk_in, ramp * tau)
    kept &= keeps(q, v, a, 0.0, hold * tau, low, high, V, A, J)
    q, v, a = advance(q, v, a, 0.0, hold * tau)
    kept &= keeps(q, v, a, jerk_out, release * tau, low, high, V, A, J)
    _, v, a = advance(q, v, a, jerk_out, release * tau)
    return kept & (abs(v) <= REST_PLANNED) & (abs(a) <= REST_PLANNED)
