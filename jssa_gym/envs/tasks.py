"""What the arm is to do: goal, observation of it, reward, success."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.envs.observation import FAR, Feature
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import nobody
from jssa_gym.kernels.chain import forward, tool_motion
from jssa_gym.kernels.records import FRAME, records
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import measure
from jssa_gym.types import Array, JointState, Planes
from jssa_gym.validation import known_name, real_array


class Moment(NamedTuple):
    """What a reward can depend on: the state after a step and the action that led to it."""

    position: Array
    """Shape (n,) [rad]."""
    tip: Array
    """Tool centre point, shape (3,) [m]."""
    tip_speed: float
    """[m/s]."""
    action: Array
    """Executed jerk in jerk bounds, shape (n,)."""
    distance: float
    """Smallest robot-human surface distance [m]."""
    moving_contact: bool


class RewardTerm(NamedTuple):
    """One summand of the reward: weight times value."""

    name: str
    weight: float
    text: str


COMMON_TERMS = (
    RewardTerm("effort", -0.01, "mean squared action"),
    RewardTerm("closeness", -0.5, "1 if the smallest distance is below d_min, else 0"),
    RewardTerm("contact", -5.0, "1 in a contact with the arm moving, else 0"),
)


@dataclass(frozen=True, slots=True)
class Task(ABC):
    """Goal, reward and success; a new task is a subclass and an entry in :data:`TASKS`."""

    name: ClassVar[str]
    human: ClassVar[str]
    """Default human motion."""
    text: ClassVar[str]
    space: ClassVar[Literal["joints", "tip"]]
    """What a goal is: joint positions (n,) or (K, n) [rad], or a point (3,) for the tool centre in the world [m]."""
    terms: ClassVar[tuple[RewardTerm, ...]]
    """The task's own terms; :data:`COMMON_TERMS` follow."""
    hold_time: ClassVar[float] = 0.1
    """For how long :meth:`reached` has to hold for success [s]."""
    ends: ClassVar[bool] = True
    """Whether success may end an episode."""

    @abstractmethod
    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        """What is observed of the goal."""

    @abstractmethod
    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        """A goal that can be reached."""

    @abstractmethod
    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        """A user's goal, or a :class:`~jssa_gym.exceptions.ParameterError`."""

    @abstractmethod
    def observe(self, goal: Array, moment: Moment) -> Array:
        """Raw values of :meth:`features`, concatenated."""

    @abstractmethod
    def value(self, goal: Array, moment: Moment) -> float:
        """Value of the task's own term."""

    @abstractmethod
    def reached(self, value: float, moment: Moment) -> bool:
        """Whether the goal is met at this moment; ``value`` is what :meth:`value` says of it."""


@dataclass(frozen=True, slots=True)
class Home(Task):
    """Hold the home position: the paper's task. It never terminates on success."""

    name: ClassVar[str] = "home"
    space: ClassVar[Literal["joints", "tip"]] = "joints"
    human: ClassVar[str] = "approach_retreat"
    text: ClassVar[str] = (
        "Hold the home position (the paper's task). Success, within 0.05 rad (root mean square) for 0.1 s, "
        "never ends it."
    )
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("posture", -1.0, "root mean square distance of the joints from home [rad]"),
    )
    ends: ClassVar[bool] = False
    tolerance: float = 0.05
    """Root mean square distance from home that counts as there [rad]."""

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        span = robot.limits.position[:, 1] - robot.limits.position[:, 0]
        return (Feature("goal", robot.n, tuple(span.tolist()), -1.0, 1.0, "home minus joint position / range"),)

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        return np.array(robot.home)

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        return real_array("goal", goal, (robot.n,), "a joint position [rad]")

    def observe(self, goal: Array, moment: Moment) -> Array:
        return goal - moment.position

    def value(self, goal: Array, moment: Moment) -> float:
        gap = goal - moment.position
        return math.sqrt(gap.dot(gap) / len(gap))

    def reached(self, value: float, moment: Moment) -> bool:
        return value <= self.tolerance


@dataclass(frozen=True, slots=True)
class Reach(Task):
    """Bring the tool centre point to a random reachable target and hold it there."""

    name: ClassVar[str] = "reach"
    space: ClassVar[Literal["joints", "tip"]] = "tip"
    human: ClassVar[str] = "random"
    text: ClassVar[str] = (
        "Bring the tool centre point within 0.02 m of a random target, slower than 0.05 m/s, for 0.1 s."
    )
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("reach", -1.0, "distance of the tool centre point from the target [m]"),
        RewardTerm("success", 10.0, "1 on success, else 0"),
    )
    tolerance: float = 0.02
    """[m]."""
    speed: float = 0.05
    """[m/s]."""

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        return (Feature("goal", 3, (1.0,), -FAR, FAR, "target minus tool centre point, world axes [m]"),)

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        """Tip of a random posture around home that is clear of table and itself, in front of the base."""
        low, high = robot.limits.position.T
        around = 0.35 * (high - low)
        for _ in range(1000):
            posture = np.clip(robot.home + rng.uniform(-around, around), 0.95 * low, 0.95 * high)
            tip = _tip(robot, posture)
            rest = JointState(posture, np.zeros(robot.n), np.zeros(robot.n))
            near = measure(robot, rest, nobody(), planes)
            clear = near.planes.min(initial=np.inf) > 0.05 and near.own.min(initial=np.inf) > 0.02
            if clear and np.hypot(tip[0] - robot.mount[0], tip[1] - robot.mount[1]) > 0.3:
                return tip
        raise ParameterError(f"found no reachable target for {robot.name} that is clear of table and arm")

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        return real_array("goal", goal, (3,), "a point in world coordinates [m]")

    def observe(self, goal: Array, moment: Moment) -> Array:
        return goal - moment.tip

    def value(self, goal: Array, moment: Moment) -> float:
        return math.dist(goal, moment.tip)

    def reached(self, value: float, moment: Moment) -> bool:
        return moment.tip_speed < self.speed and value <= self.tolerance


def _tip(robot: RobotModel, posture: Array) -> Array:
    frames, out = records(robot.n, FRAME), np.zeros((2, 3))
    forward(robot.links, np.array([posture, np.zeros(robot.n), np.zeros(robot.n)]), frames)
    tool_motion(frames, robot.tool_link, robot.tool_offset, out)
    return out[0]


TASKS: dict[str, type[Task]] = {"home": Home, "reach": Reach}
"""Tasks by name."""


def make_task(task: str | Task) -> Task:
    """A task from its name in :data:`TASKS`, or as it is.

    Raises:
        ParameterError: Unknown name.
    """
    if isinstance(task, Task):
        return task
    return TASKS[known_name("task", task, TASKS)]()
