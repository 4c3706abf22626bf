r"""Jerk that follows what is commanded: nested loops of velocity and acceleration, each reference clipped to a limit.

Where the command is a position, joint or tool, the velocity that leads there is what the innermost loops are given. It
is :math:`k_p e` for a small error :math:`e`, and never more than lets the arm brake until it is there.
"""

import numpy as np

from jssa_gym.kernels.chain import forward, jacobian, tool_motion
from jssa_gym.kernels.jit import jit

HARDNESS = 0.4
"""Share of deceleration and jerk that what is commanded is approached with: the loops take time too."""

OPPOSITE = 1e-9
"""Sine of the angle between two orientations below which they are alike, or half a turn apart."""


@jit
def lead(state, velocity, acceleration, bounds, share, gains, out):
    r"""Jerk towards a joint velocity that changes as ``acceleration`` says.

    .. math:: v^* = \mathrm{clip}(v),\quad a^* = \mathrm{clip}(a + k_v (v^* - \dot q)),\quad
              u = \mathrm{clip}(k_a (a^* - \ddot q))

    with :math:`k_v` smaller for large errors :math:`e`, such that :math:`k_v e \le \sqrt{2 j e}`: from no more can the
    acceleration be brought to 0 by the jerk :math:`j` until they are gone.

    Args:
        state: Rows position, velocity, acceleration, shape (3, n).
        velocity: Shape (n,) [rad/s].
        acceleration: Shape (n,) [rad/s²].
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        share: Of the velocity and acceleration limits that the references may use.
        gains: :math:`k_p, k_v, k_a` [1/s].
        out: The jerk, shape (n,) [rad/s³].
    """
    _, kv, ka = gains
    for j in range(out.shape[0]):
        fastest, hardest, sharpest = share * bounds[2, j], share * bounds[3, j], bounds[4, j]
        v = min(max(velocity[j], -fastest), fastest)
        missing = v - state[1, j]
        gain = np.copysign(min(kv * abs(missing), np.sqrt(2.0 * HARDNESS * sharpest * abs(missing))), missing)
        a = min(max(acceleration[j] + gain, -hardest), hardest)
        out[j] = min(max(ka * (a - state[2, j]), -sharpest), sharpest)


@jit
def approach(error, kp, deceleration, jerk):
    """Speed at which an error is worked off: proportional to it, and slow enough to brake until it is gone.

    Braking from v takes the way v²/2a + v a/2j; where there is no time for the whole ramp that is more than it takes.
    """
    way, ramp = abs(error), 0.0
    if jerk < np.inf:
        ramp = deceleration * deceleration / (2.0 * jerk)
    speed = np.sqrt(ramp * ramp + 2.0 * deceleration * way) - ramp
    return np.copysign(min(kp * way, speed), error)


@jit
def lead_to_position(state, target, velocity, acceleration, tick, bounds, share, gains, scratch, out):
    """Jerk towards where the joints are to be at the end of this tick, and how they are to move there.

    Args:
        state, bounds, share, gains: As of :func:`lead`.
        target: Shape (n,) [rad]; clipped to the position limits.
        velocity: Shape (n,) [rad/s].
        acceleration: Shape (n,) [rad/s²].
        tick: Duration of the tick [s].
        scratch: Shape (n,).
        out: The jerk, shape (n,) [rad/s³].
    """
    for j in range(out.shape[0]):
        goal = min(max(target[j], bounds[0, j]), bounds[1, j])
        # where they would have to be now
        error = goal - tick * (velocity[j] - tick * acceleration[j] / 2.0) - state[0, j]
        braking = HARDNESS * share * bounds[3, j]
        scratch[j] = velocity[j] - tick * acceleration[j] + approach(error, gains[0], braking, HARDNESS * bounds[4, j])
    lead(state, scratch, acceleration, bounds, share, gains, out)


@jit
def look(links, link, offset, state, frames, tool, J):
    """Where the tool is and how it moves: position and velocity into ``tool`` (2, 3), its Jacobian into ``J`` (6, n).

    It turns with the last link, whichever link its centre point is fixed to.

    Args:
        links: Chain geometry, shape (n,) of ``LINK``.
        link: What the tool centre point is fixed to ...
        offset: ... and where in that link's frame, shape (3,) [m].
        state: Joint state, shape (3, n).
        frames: Shape (n,) of ``FRAME``.
        tool: Result [m, m/s].
        J: Result: rows of the velocity [m] and of the rotation [1].
    """
    forward(links, state, frames)
    tool_motion(frames, link, offset, tool)
    jacobian(frames, link, tool[0], J[:3])
    for j in range(J.shape[1]):
        for i in range(3):
            J[3 + i, j] = frames[j]["axis"][i]


@jit
def turn_between(rotation, target, out):
    """The rotation vector, shape (3,) [rad], that turns one orientation into another, each of shape (3, 3)."""
    trace, size = 0.0, 0.0
    for i in range(3):
        out[i] = 0.0
        for column in range(3):
            trace += rotation[i, column] * target[i, column]
            # half of the skew part of target · rotationᵀ: the axis times the sine of the angle
            a, b = (i + 1) % 3, (i + 2) % 3
            out[i] += (rotation[a, column] * target[b, column] - rotation[b, column] * target[a, column]) / 2.0
        size += out[i] * out[i]
    size = np.sqrt(size)
    angle = np.arctan2(size, (trace - 1.0) / 2.0)
    if size > OPPOSITE:
        for i in range(3):
            out[i] *= angle / size
    elif angle > 1.0:  # half a turn, about the axis that both columns of target · rotationᵀ + 1 lie along
        best, longest = 0, -1.0
        for i in range(3):
            square = 1.0
            for column in range(3):
                square += rotation[i, column] * target[i, column]
            if square > longest:
                best, longest = i, square
        for i in range(3):
            out[i] = 1.0 if i == best else 0.0
            for column in range(3):
                out[i] += target[i, column] * rotation[best, column]
            out[i] *= angle / np.sqrt(2.0 * longest)


@jit
def resolve(J, twist, damping, fastest, square, out):
    r"""Joint velocities for a motion of the tool: :math:`J^\top (J J^\top + \mu^2 I)^{-1} v`, the same way if slower.

    Args:
        J: Jacobian, shape (m, n).
        twist: :math:`v`, shape (m,); it is written over.
        damping: :math:`\mu`; near singular postures the tool moves more slowly than wanted.
        fastest: Largest joint velocities, shape (n,) [rad/s]; what exceeds one is slowed down as a whole.
        square: Scratch, shape (m, m).
        out: Result, shape (n,) [rad/s].
    """
    m, n = J.shape
    for i in range(m):
        for k in range(i + 1):
            total = damping * damping if i == k else 0.0
            for j in range(n):
                total += J[i, j] * J[k, j]
            for c in range(k):  # Cholesky's factor of it
                total -= square[i, c] * square[k, c]
            square[i, k] = np.sqrt(total) if i == k else total / square[k, k]
    for i in range(m):
        for c in range(i):
            twist[i] -= square[i, c] * twist[c]
        twist[i] /= square[i, i]
    for i in range(m - 1, -1, -1):
        for c in range(i + 1, m):
            twist[i] -= square[c, i] * twist[c]
        twist[i] /= square[i, i]
    slowed = 1.0
    for j in range(n):
        out[j] = 0.0
        for i in range(m):
            out[j] += J[i, j] * twist[i]
        slowed = max(slowed, abs(out[j]) / fastest[j])
    for j in range(n):
        out[j] /= slowed


@jit
def towards(way, kp, fastest, deceleration, out):
    """Add to ``out`` (3,) the velocity that works off a way (3,) [m or rad]: see :func:`approach`."""
    length = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    if length > 0.0:
        speed = min(approach(length, kp, deceleration, np.inf), fastest)
        for i in range(3):
            out[i] += way[i] / length * speed


@jit
def lead_to_pose(frame, tool, position, rotation, kp, most, way, out):
    """The motion of the tool, into ``out`` (6,), that leads to where it is to be.

    Args:
        frame: Of the last link, one of ``FRAME``.
        tool: Where it is, first row of (2, 3) [m].
        position: Where it is to be, shape (3,) [m] ...
        rotation: ... and its orientation, shape (3, 3).
        kp: Gain [1/s].
        most: Speed and deceleration, then those of the turn, shape (4,) [m/s, m/s², rad/s, rad/s²].
        way: Scratch, shape (3,).
        out: Result [m/s, rad/s].
    """
    for i in range(3):
        out[i] = out[3 + i] = 0.0
        way[i] = position[i] - tool[0, i]
    towards(way, kp, most[0], most[1], out[:3])
    turn_between(frame["rotation"], rotation, way)
    towards(way, kp, most[2], most[3], out[3:])


@jit
def exceeds(values, most):
    """Whether the size of some value is above its bound, each of shape (n,); what is no number is not."""
    found = False
    for j in range(values.shape[0]):
        found = found or abs(values[j]) > most[j]
    return found


@jit
def is_finite(values):
    """Whether all values, shape (n,), are finite."""
    finite = True
    for j in range(values.shape[0]):
        finite = finite and np.isfinite(values[j])
    return finite


@jit
def turns(matrix):
    """Whether a matrix (3, 3) is a rotation, to a millionth."""
    for i in range(3):
        for k in range(i, 3):
            product = 0.0
            for c in range(3):
                product += matrix[i, c] * matrix[k, c]
            if not abs(product - (1.0 if i == k else 0.0)) <= 1e-6:
                return False
    volume = 0.0
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        volume += matrix[0, i] * (matrix[1, a] * matrix[2, b] - matrix[1, b] * matrix[2, a])
    return volume > 0.0
