"""What is near and what touches at the present time."""

import numpy as np

from jssa_gym.kernels.capsules import measure_agents, nearest
from jssa_gym.kernels.chain import forward, place, point_on, velocity_of
from jssa_gym.kernels.index import approach
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import add, along, dot, put, scale, subtract


@jit
def touching_speed(frames, segment, agent, s, r):
    """Speed of the robot's surface point that faces the agent [m/s]: a spinning link's surface moves too."""
    point, _, _ = point_on(segment, s)
    w = subtract(point, along(agent["start"], agent["end"], r))
    d = np.sqrt(dot(w, w))
    surface = add(point, scale(w, -segment["radius"] / d)) if d > 1e-9 else point
    frame = frames[segment["link"]]
    v = velocity_of(frame, subtract(surface, frame["origin"]))
    return np.sqrt(dot(v, v))


@jit
def observe(links, capsules, state, agents, index, frames, segments, pairs, out, parts):
    """The arm's motion, its closest pair with the agents and the contacts.

    Args:
        links, capsules: The robot, shape (n,) of ``LINK`` and (m,) of ``CAPSULE``.
        state: Shape (3, n) [rad, rad/s, rad/s²].
        agents: Shape (k,) of ``AGENT``.
        index: Parameters; decide about the sliding term in the distance's second derivative.
        frames, segments, pairs: Results, shape (n,) of ``FRAME``, (m,) of ``SEGMENT``, (m, k) of ``PAIR``.
        out: Result, shape (13,): distance [m], its rate [m/s], its second derivative [m/s²], largest speed of a
            touching point of the robot [m/s]; of the closest pair's axis points the agent's minus the robot's (3)
            [m], the agent's (3) [m] and its velocity (3) [m/s].
        parts: Result, shape (p,): smallest distance to the agents number j, j + p, j + 2 p, ... [m].

    Returns:
        Row and column of the closest pair; -1, -1 without agents.
    """
    forward(links, state, frames)
    place(frames, capsules, segments)
    measure_agents(segments, agents, pairs)
    row, column, distance = nearest(pairs, agents.shape[0])
    for k in range(out.shape[0]):
        out[k] = 0.0
    out[0] = distance
    for k in range(parts.shape[0]):
        parts[k] = np.inf
    for i in range(segments.shape[0]):
        for j in range(agents.shape[0]):
            part = j % parts.shape[0]
            parts[part] = min(parts[part], pairs[i, j]["distance"])
    if row < 0:
        out[4:10] = np.inf
        return row, column
    pair, agent = pairs[row, column], agents[column]
    s, r = pair["s"], pair["r"]
    moving = approach(segments[row], agent, s, r, distance, index)
    out[1], out[2] = moving.rate, moving.curvature
    on_robot, _, _ = point_on(segments[row], s)
    on_agent = along(agent["start"], agent["end"], r)
    put(out[4:7], subtract(on_agent, on_robot))
    put(out[7:10], on_agent)
    put(out[10:13], along(agent["start_velocity"], agent["end_velocity"], r))
    if not (distance > 0.0):
        for i in range(segments.shape[0]):
            for j in range(agents.shape[0]):
                pair = pairs[i, j]
                if not (pair["distance"] > 0.0):
                    speed = touching_speed(frames, segments[i], agents[j], pair["s"], pair["r"])
                    out[3] = max(out[3], speed)
    return row, column


@jit
def unsound(state, nominal, agents):
    """Which input is not finite: 0 none, 1 the nominal jerk, 2 the joint state (it counts first), 3 an agent."""
    for k in range(nominal.shape[0]):
        for i in range(3):
            if not np.isfinite(state[i, k]):
                return 2
    for k in range(nominal.shape[0]):
        if not np.isfinite(nominal[k]):
            return 1
    for j in range(agents.shape[0]):
        agent = agents[j]
        for k in range(3):
            total = agent["start"][k] + agent["end"][k] + agent["start_velocity"][k] + agent["end_velocity"][k]
            if not np.isfinite(total):
                return 3
        if not (0.0 < agent["radius"] < np.inf):
            return 3
    return 0
