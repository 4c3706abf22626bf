"""The observation as a table: what is in it, how it is scaled, within which bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel

FAR = 2.0
"""Distances and positions beyond this are observed as this [m]."""

OBSERVATIONS = ("closest", "full", "goal")
"""What can be observed: the closest points of people; all their body parts too; or the closest, and the goal apart."""

MOST_PEOPLE = 3
"""So many have room in ``"full"``."""


@dataclass(frozen=True, slots=True)
class Feature:
    """Some consecutive numbers of the observation: raw value divided by ``scale``, clipped to ``bound``."""

    name: str
    size: int
    scale: tuple[float, ...]
    """Divisor of each number, in the unit of the raw value; one number serves all."""
    low: float
    high: float
    text: str

    def __post_init__(self) -> None:
        if self.size < 1 or len(self.scale) not in (1, self.size):
            raise ParameterError(f"feature {self.name}: {len(self.scale)} scales for {self.size} numbers")


class Observation:
    """What a table of features says about the observation vector.

    Args:
        features: The table, in the order of :func:`jssa_gym.tick.move.fill_observation`.
    """

    def __init__(self, features: Sequence[Feature]) -> None:
        self.features = tuple(features)
        self.size = sum(feature.size for feature in features)
        self.gain = np.concatenate([np.full(f.size, 1.0) / np.array(f.scale) for f in features])
        self.low = np.concatenate([np.full(f.size, f.low) for f in features])
        self.high = np.concatenate([np.full(f.size, f.high) for f in features])
        self.slices: dict[str, slice] = {}
        begin = 0
        for feature in self.features:
            self.slices[feature.name] = slice(begin, begin + feature.size)
            begin += feature.size

    def scaling(self, shifts: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
        """Shift, gain, low and high of every number as the kernel reads them, shape (4, size).

        Args:
            shifts: What is subtracted from the features named; 0 from the others.
        """
        shift = np.zeros(self.size)
        for name, value in shifts.items():
            shift[self.slices[name]] = value
        return np.array([shift, self.gain, self.low, self.high])

    @property
    def space(self) -> spaces.Box:
        """The vector's space: its bounds, float32."""
        return spaces.Box(self.low.astype(np.float32), self.high.astype(np.float32), dtype=np.float32)


def arm_features(robot: RobotModel, parts: int) -> tuple[Feature, ...]:
    """What every task observes before its own features: the arm and the people."""
    limits, n = robot.limits, robot.n
    half = (limits.position[:, 1] - limits.position[:, 0]) / 2.0
    return (
        Feature("position", n, tuple(half.tolist()), -1.5, 1.5, "joint position from mid-range / half range"),
        Feature("velocity", n, tuple(limits.velocity.tolist()), -2.0, 2.0, "joint velocity / limit"),
        Feature("acceleration", n, tuple(limits.acceleration.tolist()), -2.0, 2.0, "joint acceleration / limit"),
        Feature("tip", 3, (1.0,), -FAR, FAR, "tool centre point from the robot's base [m]"),
        Feature("gap", 3, (1.0,), -FAR, FAR, "closest axis points: human's minus robot's [m]"),
        Feature("human_point", 3, (1.0,), -FAR, FAR, "closest human axis point from the robot's base [m]"),
        Feature("human_velocity", 3, (1.0,), -3.0, 3.0, "its velocity [m/s]"),
        Feature("human_distance", parts, (1.0,), -0.5, FAR, "surface distance of each body part to the arm [m]"),
    )


def body_features(parts: int) -> tuple[Feature, ...]:
    """Every body part of up to :data:`MOST_PEOPLE` people, in the order of :func:`bodies`.

    Args:
        parts: Capsules of each person.
    """
    count = MOST_PEOPLE * parts
    return (
        Feature("part_start", 3 * count, (1.0,), -FAR, FAR, "start of each body part from the robot's base [m]"),
        Feature("part_end", 3 * count, (1.0,), -FAR, FAR, "its end"),
        Feature("part_start_velocity", 3 * count, (1.0,), -3.0, 3.0, "velocity of the start [m/s]"),
        Feature("part_end_velocity", 3 * count, (1.0,), -3.0, 3.0, "velocity of the end"),
        Feature("part_there", count, (1.0,), 0.0, 1.0, "1 where there is such a part, else 0, and its numbers 0"),
    )


def bodies(ends: NDArray[np.float64], base: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    """Raw values of :func:`body_features`, shape (..., 13 · MOST_PEOPLE · parts); capsules beyond that are left out.

    Args:
        ends: Starts, ends and their velocities of everybody's capsules, shape (..., 4, k, 3) [m, m/s].
        base: Of the robot, shape (3,) [m].
        parts: Capsules of each person.
    """
    count = MOST_PEOPLE * parts
    ends = ends[..., :count, :]
    *shape, _, there, _ = ends.shape
    out = np.zeros((*shape, 13 * count))
    told = out[..., : 12 * count].reshape(*shape, 4, count, 3)
    told[..., :there, :] = ends
    told[..., :2, :there, :] -= base
    out[..., 12 * count : 12 * count + there] = 1.0
    return out


def feature_table(features: Sequence[Feature]) -> str:
    """Features as lines of index, name, bounds and meaning."""
    lines = []
    begin = 0
    for f in features:
        index = str(begin) if f.size == 1 else f"{begin}-{begin + f.size - 1}"
        bounds = f"[{f.low:g}, {f.high:g}]"
        lines.append(f"{index:<7} {f.name:<16} {bounds:<12} {f.text}")
        begin += f.size
    return "\n".join(lines)
