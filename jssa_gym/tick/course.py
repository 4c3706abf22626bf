"""What an arm has done, looked at step by step: whole courses in one call."""

from jssa_gym.kernels.chain import forward, place, tool_motion
from jssa_gym.kernels.derivatives import derivatives
from jssa_gym.kernels.jit import jit
from jssa_gym.kernels.vector import copy


@jit
def look_along(arm, states, agents, index, scratch, out):
    """:func:`~jssa_gym.kernels.derivatives.derivatives` of every state of a course, and where the tool is.

    Args:
        arm: Links (n,) of ``LINK``, capsules (m,) of ``CAPSULE``, the link of the tool centre point, and where in that
            link's frame it is (3,) [m].
        states: Joint states, shape (T, 3, n).
        agents: People beside each, shape (T, k) of ``AGENT``.
        index: Parameters of the index.
        scratch: Frames (n,) of ``FRAME``, rows (m k, n), and the tool's motion (2, 3).
        out: Results: segments (T, m) of ``SEGMENT``, pairs (T, m, k) of ``PAIR``, their motion (T, m k, 4), normals
            (T, m k, 3), and tool centre points (T, 3) [m].
    """
    links, capsules, tool_link, tool_offset = arm
    frames, rows, tool = scratch
    segments, pairs, motion, normals, tip = out
    for t in range(states.shape[0]):
        derivatives(
            links, capsules, states[t], agents[t], index, frames, segments[t], pairs[t], motion[t], rows, normals[t]
        )  # fmt: skip
        tool_motion(frames, tool_link, tool_offset, tool)
        copy(tool[0], tip[t])


@jit
def place_along(links, capsules, position, state, frames, segments):
    """Where capsules are, into ``segments`` (T, m) of ``SEGMENT``, at joint positions (T, n), at rest.

    Args:
        links: Shape (n,) of ``LINK``.
        capsules: Shape (m,) of ``CAPSULE``.
        position: Shape (T, n) [rad].
        state: Scratch, shape (3, n), whose last two rows are 0.
        frames: Scratch, shape (n,) of ``FRAME``.
        segments: Results.
    """
    for t in range(position.shape[0]):
        copy(position[t], state[0])
        forward(links, state, frames)
        place(frames, capsules, segments[t])
