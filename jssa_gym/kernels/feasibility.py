"""Random states on the boundary of the safe set, and what the best jerk makes of them."""

import numpy as np

from jssa_gym.kernels.chain import forward, place, point_on, tool_motion
from jssa_gym.kernels.index import advance, approach, assess, exact_rows, index_of
from jssa_gym.kernels.jit import jit, jit_released
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.vector import add, along, dot, put, scale, subtract
from jssa_gym.kernels.viability import jerk_box


@jit
def _beside(segment, where, direction):
    """A fraction of a capsule's axis, and a direction in which that is the closest point of the axis."""
    s = min(max(2.0 * where - 0.5, 0.0), 1.0)
    e = subtract(segment["end"], segment["start"])
    n = (direction[0], direction[1], direction[2])
    ee = dot(e, e)
    if ee > 0.0:
        lengthwise = dot(n, e) / ee
        if 0.0 < s < 1.0:
            n = subtract(n, scale(e, lengthwise))
        elif (lengthwise > 0.0) == (s == 0.0):
            n = subtract(n, scale(e, 2.0 * lengthwise))
    return s, scale(n, 1.0 / np.sqrt(dot(n, n)))


@jit
def _put_beside(segment, draw, domain, agent):
    """Put a moving sphere beside a robot capsule as drawn; ``draw`` and ``domain`` as of :func:`probe`."""
    speed, radius = domain[1], domain[4]
    s, n = _beside(segment, draw[0], draw[4:7])
    point, _, _ = point_on(segment, s)
    distance = domain[2] + (domain[3] - domain[2]) * draw[1]
    centre = add(point, scale(n, distance + segment["radius"] + radius))
    across = (draw[7], draw[8], draw[9])
    across = subtract(across, scale(n, dot(across, n)))
    velocity = scale(across, speed * draw[10] / max(np.sqrt(dot(across, across)), 1e-12))
    agent["radius"] = radius
    put(agent["start"], centre)
    put(agent["end"], centre)
    put(agent["start_velocity"], velocity)
    put(agent["end_velocity"], velocity)


@jit
def _move_to_boundary(segment, agent, at, phi, draw, domain, index):
    r"""Give the sphere the velocity along the distance, in which :math:`\phi` is linear, that makes it as drawn.

    Returns:
        Whether the sphere is no faster than the domain says.
    """
    velocity = along(agent["start_velocity"], agent["end_velocity"], 0.0)
    # n points from the sphere to the robot
    velocity = add(velocity, scale(at.n, (-domain[5] * draw[3] - phi) / index.lambda1))
    put(agent["start_velocity"], velocity)
    put(agent["end_velocity"], velocity)
    return dot(velocity, velocity) <= domain[1] ** 2


@jit_released
def probe(
    links,
    capsules,
    tool_link,
    tool_offset,
    bounds,
    dt,
    parameters,
    domain,
    viability,
    states,
    draws,
    agents,
    planes,
    before,
    pairs,
    frames,
    segments,
    after,
    out,
):
    r"""The smallest index one step ahead that a jerk can make of states with :math:`\phi = 0`, Eq. (7).

    The jerk is the box's best for the exact row at zero jerk; the index is that of the arm's true motion under it.

    Args:
        links, tool_link, tool_offset: The robot.
        capsules: The capsule to look at, shape (1,) of ``CAPSULE``.
        bounds: Rows lower and upper position, velocity, acceleration and jerk limits, shape (5, n).
        dt: Step [s].
        parameters: Of the index, shape (6,).
        domain: Tip speed [m/s], sphere's speed [m/s], least and largest distance [m], sphere's radius [m], and how
            far below 0 the index may be [m²], shape (6,).
        viability: Whether the box keeps joint limits recoverable.
        states: Joint states, shape (N, 3, n); velocities are scaled down where the tip is too fast.
        draws: Shape (N, 11): uniform numbers for the place on the axis, distance, tip speed and index; normal ones
            for the sphere's direction (3) and velocity across it (3); a uniform one for the latter's size.
        agents: Result, the spheres, shape (N,) of ``AGENT``.
        planes: Shape (0,) of ``PLANE``.
        before, pairs, frames, segments, after: Scratch: (1, 1) of ``PAIR`` twice, ``FRAME``, (1,) ``SEGMENT``, (3, n).
        out: Result, shape (N, 6): index one step ahead [m²] and the third derivative of the distance in this
            step [m/s³], both under the best jerk; distance [m] and its rate [m/s] now; how much normal jerk the
            joints' jerk bounds can give [m/s³]; tip speed [m/s]. The first is NaN for a state outside the domain.
    """
    index, n = index_of(parameters), links.shape[0]
    lower, upper, jerk = -bounds[4], bounds[4].copy(), np.zeros(n)
    L, S, target, owner = np.zeros((1, n)), np.zeros(1), np.zeros(1), np.zeros(1, np.int64)
    tip = np.zeros((2, 3))
    for i in range(states.shape[0]):
        out[i] = np.nan
        state, draw, agent = states[i], draws[i], agents[i : i + 1]
        forward(links, state, frames)
        speed = tool_motion(frames, tool_link, tool_offset, tip)
        if speed > domain[0]:
            for j in range(n):
                state[1, j] *= draw[2] * domain[0] / speed
            speed = draw[2] * domain[0]
        if viability and not jerk_box(state, bounds, dt, lower, upper):
            continue
        # look at the present, at the end of the step without jerk, and at its end under the best jerk; in one loop,
        # because what is called is long and would be compiled into every place it is called from
        now, ahead, tau = 0.0, 0.0, 0.0
        for j in range(n):
            jerk[j] = 0.0
        for look in range(3):
            if look == 0:
                integrate(state, jerk, 0.0, after)
                forward(links, after, frames)
                place(frames, capsules, segments)
                _put_beside(segments[0], draw, domain, agent[0])
            ahead, _, _ = assess(
                links, capsules, state, jerk, agent, planes, tau, index, after, frames, segments, pairs
            )
            pair = pairs[0, 0]
            at = approach(segments[0], agent[0], pair["s"], pair["r"], pair["distance"], index)
            if look == 0:
                if not _move_to_boundary(segments[0], agent[0], at, ahead, draw, domain, index):
                    break
                now, tau = at.curvature, dt
                # the sphere's velocity along the distance has changed since
                at = approach(segments[0], agent[0], pair["s"], pair["r"], pair["distance"], index)
                out[i, 2], out[i, 3], out[i, 5] = pair["distance"], at.rate, speed
                advance(agent, dt)
                for j in range(n):
                    jerk[j] = min(max(0.0, lower[j]), upper[j])
            elif look == 1:
                exact_rows(
                    frames,
                    segments,
                    agent,
                    planes,
                    pairs,
                    jerk,
                    lower,
                    upper,
                    dt,
                    index,
                    0,
                    -np.inf,
                    bounds[4],
                    -1.0,
                    0.0,
                    before,
                    L,
                    S,
                    owner,
                    target,
                )
                span = 0.0
                for j in range(n):
                    span += abs(L[0, j]) * bounds[4, j]
                    jerk[j] = upper[j] if L[0, j] > 0.0 else lower[j] if L[0, j] < 0.0 else jerk[j]
                out[i, 4] = span / (index.lambda2 * dt)
            else:
                out[i, 0], out[i, 1] = ahead, (at.curvature - now) / dt
                advance(agent, -dt)
