"""Distances between a robot and what is around it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.capsules import load_agents, measure_planes, measure_self
from jssa_gym.kernels.contact import observe
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.index import IndexParams
from jssa_gym.types import Array, CapsuleSet, JointState, Planes

TRUTH = IndexParams(sliding=True, sliding_limit=1e3, sin2_floor=1e-4)
"""Parameters for measuring: the distance's second derivative as it is."""


def agent_records(capsules: CapsuleSet, out: NDArray | None = None) -> NDArray:
    """Capsules as the kernels read them, shape (m,) of ``AGENT``; into ``out`` if it is given and fits.

    Raises:
        ValueError: The arrays' shapes do not fit together.
    """
    out = records_for(capsules, out)
    load_agents(capsules.start, capsules.end, capsules.start_velocity, capsules.end_velocity, capsules.radius, out)
    return out


def records_for(capsules: CapsuleSet, out: NDArray | None = None) -> NDArray:
    """Records of the right number for :func:`agent_records`, ``out`` if it fits, still to be filled.

    Raises:
        ValueError: The arrays' shapes do not fit together.
    """
    check_capsules(capsules)
    count = len(capsules.radius)
    return records(count, AGENT) if out is None or len(out) != count else out


def check_capsules(capsules: CapsuleSet) -> None:
    """Compare the arrays' shapes: kernels do not look.

    Raises:
        ValueError: They do not fit together.
    """
    shape = capsules.radius.shape
    ends = (*shape, 3)
    if (
        len(shape) != 1
        or capsules.start.shape != ends
        or capsules.end.shape != ends
        or capsules.start_velocity.shape != ends
        or capsules.end_velocity.shape != ends
    ):
        raise ValueError(f"capsules need ends and velocities of shape {ends} for radii of shape {shape}")


def checked_array(array: NDArray) -> NDArray:
    """An array as it is, once it is known to be one.

    Raises:
        ValueError: It is none, or masked: what a mask hides is no measurement.
    """
    if isinstance(array, np.ma.MaskedArray):
        raise ValueError("an array is masked")
    if not isinstance(array, np.ndarray):
        raise ValueError(f"{type(array).__name__} instead of an array")
    return array


def checked_capsules(capsules: CapsuleSet) -> CapsuleSet:
    """Capsules in float64, the type that kernels are compiled for; as they are where nothing has to be done.

    Raises:
        ValueError, TypeError: An array is masked, or not made of real numbers.
    """
    arrays = (capsules.radius, capsules.start, capsules.end, capsules.start_velocity, capsules.end_velocity)
    if all(type(array) is np.ndarray and array.dtype == np.float64 for array in arrays):
        return capsules
    radius, start, end, start_velocity, end_velocity = (np.asarray(checked_array(x), np.float64) for x in arrays)
    return capsules._replace(
        start=start, end=end, start_velocity=start_velocity, end_velocity=end_velocity, radius=radius
    )


def plane_records(planes: Planes) -> NDArray:
    """Half-spaces as the kernels read them, shape (p,) of ``PLANE``."""
    out = records(len(planes.offset), PLANE)
    out["normal"] = planes.normal
    out["offset"] = planes.offset
    return out


def state_rows(state: JointState) -> Array:
    """Joint state as the kernels read it: position, velocity, acceleration, shape (3, n)."""
    return np.array([state.position, state.velocity, state.acceleration], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Proximity:
    """Signed surface distances at one instant; negative in penetration."""

    distance: Array
    """Robot capsule against agent, shape (m, k) [m]."""
    planes: Array
    """Robot capsule against half-space, shape (m, p) [m]; inf where no joint can change it: a column stands on it."""
    own: Array
    """The robot's self-collision pairs, shape (len(robot.self_pairs),) [m]."""
    pair: tuple[int, int]
    """Robot capsule and agent that are closest; (-1, -1) without agents."""
    points: tuple[Array, Array] | None
    """Their closest axis points, robot's first, each of shape (3,) [m]; None without agents."""
    rate: float
    """Rate of the smallest distance [m/s]."""
    curvature: float
    """Second derivative of the smallest distance [m/s²], the agents at constant velocity."""
    contact_speed: float
    """Largest speed of a touching point of the robot, 0 without contact [m/s]."""

    @property
    def smallest(self) -> float:
        """Smallest distance to an agent [m]; inf without agents."""
        return float(self.distance.min()) if self.distance.size else np.inf


def measure(robot: RobotModel, state: JointState, agents: CapsuleSet, planes: Planes) -> Proximity:
    """Measure all pairs: robot against agents, half-spaces and itself.

    Args:
        robot: The arm, where it stands.
        state: Joint state.
        agents: Capsules, dynamic or static.
        planes: Half-spaces.
    """
    others, half_spaces = agent_records(agents), plane_records(planes)
    m = len(robot.capsules)
    frames, segments = records(robot.n, FRAME), records(m, SEGMENT)
    pairs, plane_pairs = records((m, len(others)), PAIR), records((m, len(half_spaces)), PAIR)
    own, closest = np.zeros(len(robot.self_pairs)), np.zeros(13)
    row, column = observe(
        # copies: arrays for reading alone are of another type to kernels, which would be compiled for both
        np.array(robot.links),
        np.array(robot.capsules),
        state_rows(state),
        others,
        TRUTH.kernel(),
        frames,
        segments,
        pairs,
        closest,
        np.zeros(max(len(others), 1)),
    )
    measure_planes(segments, half_spaces, plane_pairs)
    measure_self(segments, robot.self_pairs, own)
    return Proximity(
        pairs["distance"].copy(),
        plane_pairs["distance"].copy(),
        own,
        (int(row), int(column)),
        (closest[7:10] - closest[4:7], closest[7:10]) if row >= 0 else None,
        float(closest[1]),
        float(closest[2]),
        float(closest[3]),
    )
