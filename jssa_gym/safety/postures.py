"""Joint postures at rest: how clear they are of what stands still, and where they put the tool."""

import numpy as np

from jssa_gym.humans import nobody
from jssa_gym.kernels.chain import forward, tool_motion
from jssa_gym.kernels.postures import StandingArm
from jssa_gym.kernels.records import FRAME, PAIR, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import agent_records, measure, plane_records
from jssa_gym.types import Array, CapsuleSet, JointState, Planes


def standing(robot: RobotModel, planes: Planes, static: CapsuleSet | None = None) -> StandingArm:
    """An arm among what stands still, for :func:`~jssa_gym.kernels.postures.smallest_gap`.

    Args:
        robot: The arm, where it stands.
        planes: Half-spaces, such as the table.
        static: Capsules that stand still; None for none.
    """
    agents, half_spaces = agent_records(nobody() if static is None else static), plane_records(planes)
    n, m = robot.n, len(robot.capsules)
    return StandingArm(
        # copies: arrays for reading alone are of another type to kernels, which would be compiled for both
        np.array(robot.links),
        np.array(robot.capsules),
        np.array(robot.self_pairs),
        agents,
        half_spaces,
        np.zeros((3, n)),
        records(n, FRAME),
        records(m, SEGMENT),
        records((m, len(agents)), PAIR),
        records((m, len(half_spaces)), PAIR),
        np.zeros(len(robot.self_pairs)),
    )


def clearances(robot: RobotModel, position: Array, planes: Planes) -> tuple[float, float]:
    """Smallest distances of the arm at rest from the half-spaces and from itself [m]; inf where there is nothing.

    Args:
        robot: The arm, where it stands.
        position: Joint position, shape (n,) [rad].
        planes: Half-spaces, such as the table.
    """
    zero = np.zeros(robot.n)
    near = measure(robot, JointState(position, zero, zero), nobody(), planes)
    return float(near.planes.min(initial=np.inf)), float(near.own.min(initial=np.inf))


def room(robot: RobotModel, planes: Planes, wanted: tuple[float, float]) -> tuple[float, float]:
    """Distances [m] that postures can be asked to keep from half-spaces and from themselves: at most half of home's.

    Args:
        robot: The arm, where it stands.
        planes: Half-spaces, such as the table.
        wanted: What is asked for where there is room enough [m].
    """
    here = clearances(robot, robot.home, planes)
    return min(wanted[0], max(0.5 * here[0], 0.0)), min(wanted[1], max(0.5 * here[1], 0.0))


def nearest(robot: RobotModel, position: Array, planes: Planes) -> str:
    """What is closest to something that it must not touch, in words for a message.

    Args:
        robot: The arm, where it stands.
        position: Joint position, shape (n,) [rad].
        planes: Half-spaces, such as the table.
    """
    zero = np.zeros(robot.n)
    near = measure(robot, JointState(position, zero, zero), nobody(), planes)
    names, told = robot.capsule_names, []
    if near.planes.size:
        i, j = np.unravel_index(int(np.argmin(near.planes)), near.planes.shape)
        told.append((float(near.planes[i, j]), f"'{names[i]}' and {planes.names[j]}"))
    if near.own.size:
        k = int(np.argmin(near.own))
        one, other = robot.self_pairs[k]
        told.append((float(near.own[k]), f"'{names[one]}' and '{names[other]}'"))
    distance, pair = min(told, default=(np.inf, "nothing"))
    return f"{pair} are {1e3 * distance:.0f} mm apart" if distance < np.inf else "nothing is near"


def reach_of(robot: RobotModel) -> float:
    """No tool centre point is farther from the second joint's axis [m]."""
    return float(np.linalg.norm(robot.links["offset"][1:], axis=1).sum() + np.linalg.norm(robot.tool_offset))


def farther_than_stretched(robot: RobotModel, point: Array) -> bool:
    """Whether a point is out of reach by the triangle inequality: no posture needs to be looked for.

    Args:
        robot: The arm, where it stands.
        point: In the world, shape (3,) [m].
    """
    return bool(np.linalg.norm(point - robot.links["offset"][0]) > reach_of(robot))


def tool_point(robot: RobotModel, position: Array) -> Array:
    """The tool centre point in the world, shape (3,) [m].

    Args:
        robot: The arm, where it stands.
        position: Joint position, shape (n,) [rad].
    """
    frames, out = records(robot.n, FRAME), np.zeros((2, 3))
    forward(robot.links, np.array([position, np.zeros(robot.n), np.zeros(robot.n)]), frames)
    tool_motion(frames, robot.tool_link, robot.tool_offset, out)
    return out[0]
