"""The interface of a safety filter, and the part that all of them share: failing closed."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.motion import brake
from jssa_gym.kernels.records import AGENT, records
from jssa_gym.kernels.tick import take_in
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import agent_records
from jssa_gym.types import Array, Decision, Scene, Status

_FAULTS = (
    "",
    "nominal jerk is not finite",
    "joint state is not finite",
    "human measurement is not finite",
    "a human capsule was not measured",
)


OUTSIDE = "outside the jerk bounds"
"""Reason of a decision that only clipped the nominal."""


class SafetyFilter(ABC):
    """Decides which jerk is applied instead of the nominal one.

    A subclass implements :meth:`_filter` and may rely on finite, complete inputs: :meth:`decide` answers everything
    else itself, with the fallback and :attr:`Status.FAULT`. The nominal is never returned because something failed.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].

    Raises:
        ParameterError: ``dt`` is not a positive number.
    """

    def __init__(self, robot: RobotModel, dt: float) -> None:
        if not (np.isfinite(dt) and dt > 0.0):
            raise ParameterError(f"dt has to be a positive number of seconds, got {dt!r}")
        self.robot = robot
        self.dt = float(dt)
        self.lower = np.array(-robot.limits.jerk)
        self.upper = np.array(robot.limits.jerk)
        self._state = np.zeros((3, robot.n))
        self._clipped = np.zeros(robot.n)
        self._agents = records(0, AGENT)

    def reset(self, scene: Scene) -> None:  # noqa: B027  # a filter without memory has nothing to reset
        """Forget the past: a new episode begins with ``scene``."""

    def decide(self, scene: Scene, nominal: Array) -> Decision:
        """The jerk to apply in this step.

        Never raises for bad numbers: a non-finite nominal or measurement, or a missing one, ends in
        :meth:`fallback` and :attr:`Status.FAULT`, with the reason in the decision.

        Args:
            scene: The present.
            nominal: The policy's jerk, shape (n,) float64 [rad/s³].
        """
        state, robot, human = self._state, scene.robot, scene.human
        n = self.robot.n
        try:
            if robot.position.shape != (n,) or scene.valid.shape != human.radius.shape:
                raise ValueError(f"positions {robot.position.shape}, valid {scene.valid.shape}")
            state[0] = robot.position
            state[1] = robot.velocity
            state[2] = robot.acceleration
            self._agents = agents = agent_records(human, self._agents)
        except (ValueError, TypeError, AttributeError) as error:
            return self._fault(nominal, f"the scene does not fit: {error}", readable=False)
        fault, inside = take_in(state, nominal, scene.valid, self.lower, self.upper, agents, self._clipped)
        if fault:
            return self._fault(nominal, _FAULTS[fault], readable=fault != 2)
        decision = self._filter(scene, state, agents, nominal, inside)
        if not decision.jerk.dot(decision.jerk) < np.inf:
            return self._fault(nominal, "the filter's answer is not finite")
        return decision

    @abstractmethod
    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        """Decide on sound input.

        ``state`` (3, n) and ``agents`` hold the scene as the kernels read it, ``self._clipped`` the nominal clipped
        to the box; ``inside`` says that it lay in the box.
        """

    def fallback(self, state: Array) -> Array:
        """The jerk when nothing else is known to be good: brakes as fast as the jerk bounds allow, shape (n,)."""
        jerk = np.empty(self.robot.n)
        brake(state, self.lower, self.upper, self.dt, jerk)
        return jerk

    def _fault(self, nominal: Array, reason: str, readable: bool = True) -> Decision:
        # without a readable joint state no jerk is known to brake; zero at least adds nothing
        jerk = self.fallback(self._state) if readable else np.zeros(self.robot.n)
        return Decision(jerk, nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0)


class NoFilter(SafetyFilter):
    """Applies the nominal inside the jerk bounds: the baseline that protects nobody, but still fails closed."""

    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        status, reason = (Status.NOMINAL, "") if inside else (Status.PROJECTED, OUTSIDE)
        return Decision(self._clipped.copy(), nominal, status, reason, np.nan, np.nan, (-1, -1), 0.0, 0)
