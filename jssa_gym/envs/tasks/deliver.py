"""Fetch and bring: a task of several legs between two places."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.envs.observation import FAR, Feature
from jssa_gym.envs.tasks.task import Moment, Progress, RewardTerm
from jssa_gym.envs.tasks.tip import NEAR, TipTask, check_in_reach, draw_point
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import RobotModel
from jssa_gym.safety.postures import reach_of
from jssa_gym.types import Array, Planes
from jssa_gym.validation import check_fields, number_within, positive_integer, positive_number, real_array

_APART = 0.4, 0.8
"""Distances of the two places that are drawn, as shares of the arm's reach."""

SHORTEST_STAY = 0.05
"""Shortest stay at a place [s]: several steps of any environment, so that every leg is seen in a step of its own."""

ROUNDING = 1e-9
"""Rounding of times that add up [s]."""


def per_minute(deliveries: int, time: float) -> float:
    """Deliveries in so much time [s] as deliveries per minute; 0 before any time has passed."""
    return 60.0 * deliveries / time if time > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Deliver(TipTask):
    """Fetch something at one place and bring it to another, again and again; there is no gripper.

    The tool centre point stays at the first place for ``stay`` seconds, at rest, which fetches; then at the second,
    which delivers; and so on, ``count`` deliveries long. The goal, ``env.unwrapped.goal``, is the place that is next;
    ``reset(options={"goal": ...})`` takes both, shape (2, 3). What the reward asks for is the way that is left, all
    legs together, so that it does not jump where a leg ends and the next begins.

    Raises:
        ParameterError: A parameter is not positive, or ``stay`` shorter than 0.05 s.
    """

    name: ClassVar[str] = "deliver"
    human: ClassVar[str] = "random"
    text: ClassVar[str] = (
        "Fetch at one place and bring to another, twice: the tool centre point within 0.02 m of the place that is "
        "next, slower than 0.05 m/s, for 0.1 s, four legs in all. info: deliver/legs, deliver/deliveries, "
        "deliver/per_minute (until the last delivery)."
    )
    terms: ClassVar[tuple[RewardTerm, ...]] = (
        RewardTerm("deliver", -1.0, "way that is left: to the next place, and the legs after it [m]"),
        RewardTerm("near", -1.0, "tanh(distance to the next place / 0.1 m) + number of legs after it"),
        RewardTerm("success", 10.0, "1 on success, else 0"),
    )
    evolves: ClassVar[bool] = True
    hold_time: ClassVar[float] = 0.0
    """The tool has stayed there already."""
    stay: float = 0.1
    """For how long the tool has to be at a place, at rest [s]."""
    count: int = 2
    """Deliveries that are asked for, each of two legs: 4 legs take an arm that nobody disturbs about half of 8 s."""

    def __post_init__(self) -> None:
        check_fields(self, ("tolerance", "speed"), positive_number)
        check_fields(self, ("stay",), number_within, SHORTEST_STAY)
        check_fields(self, ("count",), positive_integer)

    @property
    def legs(self) -> int:
        """How many there are."""
        return 2 * self.count

    def features(self, robot: RobotModel) -> tuple[Feature, ...]:
        return (
            Feature("goal", 3, (1.0,), -FAR, FAR, "next place minus tool centre point, world axes [m]"),
            Feature("other", 3, (1.0,), -FAR, FAR, "the other place minus tool centre point, world axes [m]"),
            Feature("done", 1, (1.0,), 0.0, 1.0, "share of the legs done"),
            Feature("stay", 1, (self.stay,), 0.0, 1.0, "time at the next place, at rest / time asked for"),
        )

    def draw_goal(self, rng: np.random.Generator, robot: RobotModel, planes: Planes) -> Array:
        """Where to fetch and where to bring, shape (2, 3) [m]: points as of Reach, 0.4 to 0.8 of the reach apart."""
        least, most = (share * reach_of(robot) for share in _APART)
        for _ in range(1000):
            fetch, bring = (draw_point(rng, robot, planes) for _ in range(2))
            if least <= math.dist(fetch, bring) <= most:
                return np.array([fetch, bring])
        raise ParameterError(f"found no two places for {robot.name} that are {least:.2f} m to {most:.2f} m apart")

    def check_goal(self, goal: ArrayLike, robot: RobotModel) -> Array:
        places = real_array("goal", goal, (2, 3), "two points in world coordinates, to fetch at and to bring to [m]")
        for place in places:
            check_in_reach(robot, place)
        if not math.dist(*places) > 2.0 * self.tolerance:
            raise ParameterError(f"the two places of goal have to be over {2.0 * self.tolerance} m apart, got {goal!r}")
        return places

    def present(self, goal: Array, progress: Progress) -> Array:
        return goal[min(progress.visited, self.legs - 1) % 2]

    def advance(self, goal: Array, moment: Moment, velocity: Array, dt: float) -> Progress:
        start, visited, clock, lateness, arrived, stayed = moment.progress
        if arrived:
            return moment.progress
        there = TipTask.reached(self, math.dist(self.present(goal, moment.progress), moment.tip), moment)
        stayed = stayed + dt if there else 0.0
        if stayed >= self.stay - ROUNDING:
            visited, stayed = visited + 1, 0.0
        return Progress(start, visited, clock + dt, lateness, visited == self.legs, stayed)

    def observe(self, goal: Array, moment: Moment) -> Array:
        progress = moment.progress
        following = min(progress.visited, self.legs - 1) % 2
        done = progress.visited / self.legs
        return np.concatenate([goal[following] - moment.tip, goal[1 - following] - moment.tip, (done, progress.stayed)])

    def value(self, goal: Array, moment: Moment) -> float:
        return math.dist(self.present(goal, moment.progress), moment.tip)

    def rewarded_at(self, goal: Array, moment: Moment, value: float, success: bool) -> tuple[float, ...]:
        after = max(self.legs - 1 - moment.progress.visited, 0)
        return value + after * math.dist(*goal), math.tanh(value / NEAR) + after, float(success)

    def reached(self, value: float, moment: Moment) -> bool:
        return moment.progress.arrived and value <= self.tolerance

    def metrics(self, value: float, moment: Moment) -> dict[str, Any]:
        progress = moment.progress
        deliveries = progress.visited // 2
        return {
            "deliver/legs": progress.visited,
            "deliver/deliveries": deliveries,
            "deliver/per_minute": per_minute(deliveries, progress.clock),
        }
