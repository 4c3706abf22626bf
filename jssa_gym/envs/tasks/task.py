"""What a task is: goal, observation of it, reward, success."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.envs.observation import Feature
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, CapsuleSet, Planes


class Progress(NamedTuple):
    """What a task remembers of an episode; only those whose :attr:`Task.evolves` is true change it."""

    start: Array | None = None
    """Joint position that the episode began at, shape (n,) [rad]; None for the first waypoint."""
    visited: int = 0
    """Waypoints visited in order, or legs done."""
    clock: float = 0.0
    """Time of the reference [s]: it stands still while the waypoint that is due was not visited; of deliveries, the
    time until the last."""
    lateness: float = 0.0
    """For how long it stood still [s]."""
    arrived: bool = False
    """Whether everything was visited, the reference is at its end and the joints are at rest; or all was delivered."""
    stayed: float = 0.0
    """For how long the tool has been at the place that is next, at rest [s]."""


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
    progress: Progress = Progress()


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
    """Goal, reward and success; a new task is a subclass and an entry in :data:`jssa_gym.registration.ENTRIES`."""

    name: ClassVar[str]
    human: ClassVar[str]
    """Default human motion."""
    text: ClassVar[str]
    space: ClassVar[Literal["joints", "tip"]]
    """What a goal is: a joint position (n,) or waypoints (K, n) [rad], or a point (3,) for the tool centre point in
    world coordinates [m], which may move."""
    terms: ClassVar[tuple[RewardTerm, ...]]
    """The task's own terms; :data:`COMMON_TERMS` follow."""
    hold_time: ClassVar[float] = 0.1
    """For how long :meth:`reached` has to hold for success [s]; 0 for one step."""
    ends: ClassVar[bool] = True
    """Whether success may end an episode."""
    evolves: ClassVar[bool] = False
    """Whether :meth:`follow`, :meth:`advance` and their like do something; if not, a step is spared the calls."""

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
        """What the task's terms and :meth:`reached` are made of."""

    def rewarded(self, value: float, success: bool) -> tuple[float, ...]:
        """Values of :attr:`terms`, in their order; ``value`` is what :meth:`value` says.

        Unless overridden, ``value`` for the only term, or ``value`` and 1 on success for two.
        """
        return (value,) if len(self.terms) == 1 else (value, float(success))

    def rewarded_at(self, goal: Array, moment: Moment, value: float, success: bool) -> tuple[float, ...]:
        """Values of :attr:`terms` of a task that :attr:`evolves`, where they depend on more than ``value``."""
        return self.rewarded(value, success)

    @abstractmethod
    def reached(self, value: float, moment: Moment) -> bool:
        """Whether the goal is met at this moment; ``value`` is what :meth:`value` says of it."""

    def present(self, goal: Array, progress: Progress) -> Array:
        """What of the goal is to be met next: what ``env.unwrapped.goal`` says; most goals are one."""
        return goal

    def desired(self, goal: Array, progress: Progress) -> Array:
        """The point (3,) [m] or joint position (n,) [rad] that is to be met next, for ``observation="goal"``."""
        return self.present(goal, progress)

    def follow(self, goal: Array, people: CapsuleSet) -> Array:
        """The goal among the people as they are now; most goals stay.

        Raises:
            ParameterError: The goal is somebody's who is not there.
        """
        return goal

    def advance(self, goal: Array, moment: Moment, velocity: Array, dt: float) -> Progress:
        """Progress at the end of a step; ``moment.progress`` is what it was before.

        Args:
            goal: The present goal.
            moment: The end of the step.
            velocity: Joint velocity there, shape (n,) [rad/s].
            dt: Duration of the step [s].
        """
        return moment.progress

    def metrics(self, value: float, moment: Moment) -> dict[str, Any]:
        """Further entries of ``info``, of a task that :attr:`evolves`; ``value`` is what :meth:`value` says."""
        return {}
