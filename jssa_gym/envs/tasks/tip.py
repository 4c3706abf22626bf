"""Tasks of the tool centre point: bring it somewhere and hold it there."""

import math
from dataclasses import dataclass, fields
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.envs.observation import FAR, Feature
from jssa_gym.envs.tasks.task import Moment, RewardTerm, Task
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.postures import clearances, farther_than_stretched, nearest, reach_of, room, tool_point
from jssa_gym.types import Array, CapsuleSet, Planes
from jssa_gym.validation import positive_number, real_array

NEAR = 0.1
"""Distance [m] at which the reward begins to tell centimetres apart; far away its distance term alone does."""

HAND = "right_arm"
"""Body part whose end is the hand that takes what the arm brings."""


def draw_point(rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
    """Tip of a random posture around home that is clear of table and itself, in front of the base, shape (3,) [m].

    Raises:
        ParameterError: None was found.
    """
    low, high = robot.limits.position.T
    around = 0.35 * (high - low)
    # a range that does not hold 0 has ends that are nearer to it than 5 %
    inner = np.maximum(0.95 * low, low), np.minimum(0.95 * high, high)
    off_planes, off_itself = room(robot, planes, (0.05, 0.02))
    away = min(0.3, 0.3 * reach_of(robot))
    for _ in range(1000):
        posture = np.clip(robot.home + rng.uniform(-around, around), *inner)
        from_planes, from_itself = clearances(robot, posture, planes)
        tip = tool_point(robot, posture)
        aside = np.hypot(tip[0] - robot.mount[0], tip[1] - robot.mount[1])
        if from_planes > off_planes and from_itself > off_itself and aside > away:
            return tip
    raise ParameterError(
        f"found no reachable target for {robot.name} that is clear of table and arm; at home "
        f"{nearest(robot, robot.home, planes)}"
    )


def check_in_reach(robot: RobotModel, point: Array) -> None:
    """Refuse a point, shape (3,) [m], that is farther away than the arm is long, with a ParameterError."""
    if farther_than_stretched(robot, point):
        shoulder, length = robot.links["offset"][0].round(3).tolist(), reach_of(robot)
        raise ParameterError(
            f"goal {point.tolist()} m cannot be reached: {robot.name} is {length:.2f} m long from {shoulder} m on"
        )


@dataclass(frozen=True, slots=True)
class TipTask(Task):
    """Be at a point with the tool centre point, at rest; subclasses say which.

    Raises:
        ParameterError: A parameter is not positive.
    """

    space: ClassVar[Literal["joints", "tip"]] = "tip"
    tolerance: float = 0.02
    """Distance that counts as there [m]."""
    speed: float = 0.05
    """Speed that counts as rest [m/s]."""

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, positive_number(field.name, getattr(self, field.name)))

    def observe(self, goal: Array, moment: Moment) -> Array:
        return goal - moment.tip

    def value(self, goal: Array, moment: Moment) -> float:
        return math.dist(goal, moment.tip)

    def rewarded(self, value: float, success: bool) -> tuple[float, ...]:
        return value, math.tanh(value / NEAR), float(success)

    def reached(self, value: float, moment: Moment) -> bool:
        return moment.tip_speed < self.speed and value <= self.tolerance


@dataclass(frozen=True, slots=True)
class Reach(TipTask):
    """Bring the tool centre point to a random reachable target and hold it there."""

    name: ClassVar[str] = "reach"
    human: ClassVar[str] = "random"
    text: ClassVar[str] = (
        "Bring the tool centre point within 0.02 m of a random target, slower than 0.05 m/s, for 0.1 s."
    )
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("reach", -1.0, "distance of the tool centre point from the target [m]"),
        RewardTerm("near", -1.0, "tanh(that distance / 0.1 m)"),
        RewardTerm("success", 10.0, "1 on success, else 0"),
    )

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        return (Feature("goal", 3, (1.0,), -FAR, FAR, "target minus tool centre point, world axes [m]"),)

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        return draw_point(rng, robot, planes)

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        point = real_array("goal", goal, (3,), "a point in world coordinates [m]")
        check_in_reach(robot, point)
        return point


@dataclass(frozen=True, slots=True)
class Handover(TipTask):
    """Bring the tool centre point to a person's right hand, which moves: goal and obstacle in one.

    The goal is the point at ``offset`` from the end of the axis of the first capsule named ``right_arm``, level with
    it on the side of the base axis. It is made of the human capsules alone, which is what perception knows, anew
    after every step.

    Raises:
        ParameterError: A parameter is not positive.
    """

    name: ClassVar[str] = "handover"
    human: ClassVar[str] = "receive"
    text: ClassVar[str] = (
        "Bring the tool centre point to a person's right hand, which moves: within 0.03 m of a point 0.27 m from the "
        "hand on the robot's side, slower than 0.05 m/s, for 0.1 s."
    )
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("handover", -1.0, "distance of the tool centre point from the handover point [m]"),
        RewardTerm("near", -1.0, "tanh(that distance / 0.1 m)"),
        RewardTerm("success", 10.0, "1 on success, else 0"),
    )
    evolves: ClassVar[bool] = True
    offset: float = 0.27
    """Distance of the goal from the hand [m]: 0.10 m of the arm's capsule, 0.06 m of the tool's, and 0.10 m between
    the two, beside a forearm that slopes as well."""
    tolerance: float = 0.03

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        return (Feature("goal", 3, (1.0,), -FAR, FAR, "handover point minus tool centre point, world axes [m]"),)

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        """Nothing is drawn: the people that are drawn next bring the goal along."""
        return np.zeros(3)

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        raise ParameterError("the goal of a handover is the person's right hand; set human_start or human instead")

    def follow(self, goal: Array, people: CapsuleSet) -> Array:
        if HAND not in people.names:
            raise ParameterError(f"a handover needs a person with a body part {HAND!r}, got {people.names}")
        x, y, z = people.end[people.names.index(HAND)].tolist()
        share = 1.0 - self.offset / max(math.hypot(x, y), self.offset)
        return np.array([share * x, share * y, z])
