"""The interface of a safety filter, and the part that all of them share: failing closed."""

import logging
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.contact import unsound
from jssa_gym.kernels.motion import brake, integrate
from jssa_gym.kernels.records import AGENT, records
from jssa_gym.kernels.tick import take_in, unfit
from jssa_gym.robots import RobotModel
from jssa_gym.safety.action import checked_action
from jssa_gym.safety.proximity import records_for
from jssa_gym.types import Array, Decision, JointState, Scene, Status
from jssa_gym.validation import positive_number

_FAULTS = (
    "",
    "nominal jerk is not finite",
    "joint state is not finite",
    "human measurement is not finite",
    "a human capsule was not measured",
)


OUTSIDE = "outside the jerk bounds"
"""Reason of a decision that only clipped the nominal."""


_UNFIT = (
    "",
    "the filter's answer is not finite",
    "the filter's answer is outside the jerk bounds",
    "the filter's answer is not the nominal, as it claims",
)
_logger = logging.getLogger("jssa_gym")


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
        announce_compilation()
        self.robot = robot
        self.dt = positive_number("dt", dt)
        self.lower = np.array(-robot.limits.jerk)
        self.upper = np.array(robot.limits.jerk)
        self._state = np.zeros((3, robot.n))
        self._incoming = np.zeros((3, robot.n))
        self._applied = np.zeros(robot.n)
        self._clipped = np.zeros(robot.n)
        self._none = records(0, AGENT)
        self._agents = records(0, AGENT)

    def reset(self, scene: Scene) -> None:
        """Forget the past: a new episode begins with ``scene``."""
        self._applied[:] = 0.0
        try:
            self._read_state(scene.robot)
            self._state[:] = np.nan_to_num(self._incoming)
        except Exception:  # decide() will say what is wrong
            self._state[:] = 0.0

    def decide(self, scene: Scene | None, nominal: Array) -> Decision:
        """The jerk to apply in this step.

        Never raises for bad numbers: a non-finite nominal or measurement, a missing one, a scene that does not fit
        or is None, and a filter that fails or answers outside the box end in :meth:`fallback` and
        :attr:`Status.FAULT`, with the reason in the decision.

        Args:
            scene: The present.
            nominal: The policy's jerk, shape (n,) [rad/s³].

        Raises:
            InvalidActionError: ``nominal`` has another shape or is not made of real numbers.
        """
        nominal = checked_action(nominal, self.robot.n)
        try:
            # kernels do not look at shapes: everything is compared before they see it
            if scene is None:
                raise ValueError("there is no scene")
            arm, human, valid, shape = scene.robot, scene.human, scene.valid, nominal.shape
            if arm.position.shape != shape or arm.velocity.shape != shape or arm.acceleration.shape != shape:
                raise ValueError(f"the joint state does not have shape {shape}")
            self._agents = agents = records_for(human, self._agents)
            if valid.shape != human.radius.shape or valid.dtype != np.bool_:
                raise ValueError(f"valid has shape {valid.shape} for {len(agents)} capsules")
            fault, inside = take_in(
                arm.position,
                arm.velocity,
                arm.acceleration,
                human.start,
                human.end,
                human.start_velocity,
                human.end_velocity,
                human.radius,
                valid,
                nominal,
                self.lower,
                self.upper,
                self._incoming,
                agents,
                self._clipped,
            )
        except Exception as error:  # whatever a perception system delivers, the arm must go on safely
            return self._unfit_scene(scene, nominal, error)
        if fault:
            return self._fault(nominal, _FAULTS[fault], readable=fault != 2)
        self._state, self._incoming = self._incoming, self._state
        try:
            decision = self._filter(scene, self._state, agents, nominal, inside)
            jerk = decision.jerk
            if jerk.shape != nominal.shape or jerk.dtype != np.float64:
                raise ValueError(f"the answer has shape {jerk.shape} and type {jerk.dtype}")
            wrong = unfit(jerk, nominal, self.lower, self.upper, decision.status == Status.NOMINAL)
        except Exception as error:  # whatever a filter runs into, the arm must go on safely
            _logger.exception("the filter failed; the arm brakes")
            return self._brake(nominal, f"the filter failed: {type(error).__name__}: {error}")
        if wrong:
            return self._brake(nominal, _UNFIT[wrong])
        self._applied[:] = jerk
        return decision

    def _unfit_scene(self, scene: Scene | None, nominal: Array, error: Exception) -> Decision:
        """Brake without people to look at, from the joint state if at least that can be read."""
        try:
            if scene is None:
                raise ValueError("there is no scene")
            self._read_state(scene.robot)
        except Exception as worse:
            return self._fault(nominal, f"the joint state cannot be read: {worse}", readable=False)
        fault = unsound(self._incoming, nominal, self._none)
        reason = _FAULTS[fault] if fault else f"the scene does not fit: {error}"
        return self._fault(nominal, reason, readable=fault != 2)

    def _read_state(self, robot: JointState) -> None:
        shape = (self.robot.n,)
        for row, values in enumerate((robot.position, robot.velocity, robot.acceleration)):
            if values.shape != shape:
                raise ValueError(f"it has shape {values.shape}, expected {shape}")
            self._incoming[row] = values

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
        """Brake on bad input: from the state just read or, unreadable, from where the last jerk must have led."""
        if readable:
            self._state, self._incoming = self._incoming, self._state
        else:
            integrate(self._state, self._applied, self.dt, self._state)
        return self._brake(nominal, reason)

    def _brake(self, nominal: Array, reason: str) -> Decision:
        jerk = self.fallback(self._state)
        # a state beyond all bounds can overflow; then at least nothing is added
        jerk = np.where(np.isfinite(jerk), jerk, 0.0)
        self._applied[:] = jerk
        return Decision(jerk, nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0)


class NoFilter(SafetyFilter):
    """Applies the nominal inside the jerk bounds: the baseline that protects nobody, but still fails closed."""

    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        status, reason = (Status.NOMINAL, "") if inside else (Status.PROJECTED, OUTSIDE)
        return Decision(self._clipped.copy(), nominal, status, reason, np.nan, np.nan, (-1, -1), 0.0, 0)
