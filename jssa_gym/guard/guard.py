"""The shield without an environment: a controller's command in, the next safe joint position out."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jssa_gym import robots
from jssa_gym.control.commands import Command
from jssa_gym.control.follower import Follower
from jssa_gym.control.path import pace_of
from jssa_gym.envs.options import LONGEST, SHORTEST
from jssa_gym.envs.world import placed, planes_of
from jssa_gym.exceptions import NotStartedError, ParameterError
from jssa_gym.guard.answers import Answers, GuardAnswer
from jssa_gym.guard.clock import TickRate
from jssa_gym.guard.inputs import JointReader, PeopleReader
from jssa_gym.humans import nobody
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import DEFAULT
from jssa_gym.safety.region import WatchedRegion
from jssa_gym.shields.inplace import InPlace
from jssa_gym.shields.options import JSSAOptions
from jssa_gym.shields.profiles import assumptions, profiled_filter, watching
from jssa_gym.types import Array, CapsuleSet, JointState, MeasuredPeople, Planes, Scene, Status
from jssa_gym.validation import number_within, real_array

STATE_TOLERANCE = (1e-3, math.inf, math.inf)
"""How far measured joints may be from the commanded ones where the assumptions say nothing: positions [rad] alone."""

HASTY_TICK = "the tick came less than half a tick after the last one: the arm stays at the last position"


class Guard:
    """Lets a command through as far as it is safe, tick by tick, by the control step of a shielded environment.

    ::

        guard = jssa_gym.Guard("lr_mate_200id_7l", dt=0.008)
        guard.start(position)
        while running:
            answer = guard.tick(jssa_gym.JointPosition(wanted), people, stamp)
            drives.send(answer.position)

    It keeps the commanded state itself: what it answers is where the arm is to be at the end of the tick, within all
    limits, and there is always a verified stop behind it. :meth:`tick` never raises for what it is given: a command,
    people, a measured state or a clock that cannot be used end in the stored stop, ``Status.FAULT`` and a reason.
    docs/guarantees.md says what is promised under which assumptions, docs/controller.md how to use it.

    Args:
        robot: A name, a model, an MJCF file or a prepared folder, see :func:`~jssa_gym.robots.make_robot`.
        dt: Control step [s], 0.001 to 0.02: ticks come at 50 to 1,000 Hz.
        profile, horizon, lambda1, lambda2, d_min, rows, recovery, options: See :class:`~jssa_gym.JSSAShield`.
        failsafe: Assumptions of the verified stop, as :class:`~jssa_gym.FailsafeParams` or a mapping of its fields;
            None for its defaults. ``actuation_lag`` has to cover the drives' lag and by how much all ticks of a stop
            together may be late. Where they leave ``state_tolerance`` at 0, measured positions may be
            :data:`STATE_TOLERANCE` off as soon as some are given.
        watched: Where everybody is measured, so that people may come and go; see :class:`~jssa_gym.JSSAShield`.
        scene: ``"table"`` or ``"floor"`` as in the environments, where the robot then stands; or the half-spaces that
            it must stay out of, with the robot standing where its model says.
        static: Capsules that stand still; None for none.
        share: Share of the velocity and acceleration limits with which commands are followed, in (0, 1].

    Raises:
        ParameterError: An argument is unknown or out of range.
        RobotModelError: The robot's file cannot be modelled.
    """

    def __init__(
        self,
        robot: str | Path | RobotModel = robots.DEFAULT,
        dt: float = 0.008,
        *,
        profile: Literal["paper", "work", "yield"] = "paper",
        horizon: float | None = None,
        lambda1: float = DEFAULT.lambda1,
        lambda2: float = DEFAULT.lambda2,
        d_min: float = DEFAULT.d_min,
        rows: Literal["all", "closest"] = "all",
        recovery: float = 0.5,
        failsafe: FailsafeParams | Mapping[str, Any] | None = None,
        options: JSSAOptions | Mapping[str, Any] | None = None,
        watched: WatchedRegion | Mapping[str, Any] | None = None,
        scene: Literal["table", "floor"] | Planes = "table",
        static: CapsuleSet | None = None,
        share: float = 1.0,
    ) -> None:
        self.dt = number_within("dt", dt, SHORTEST, LONGEST)
        arm = make_robot(robot)
        self.robot, self._planes = (arm, scene) if isinstance(scene, Planes) else (placed(arm, scene), planes_of(scene))
        if not isinstance(static, CapsuleSet | None):
            raise ParameterError(f"static has to be a CapsuleSet or None, got {static!r}")
        self._static = nobody() if static is None else static
        if isinstance(failsafe, bool):
            raise ParameterError(
                "a guard always verifies a stop: failsafe has to be FailsafeParams or a mapping of them"
            )
        given = watching(True if failsafe is None else failsafe, watched)

        def decider(tolerance: tuple[Any, ...] | None = None) -> InPlace:
            filter = profiled_filter(
                self.robot,
                self.dt,
                profile=profile,
                horizon=horizon,
                lambda1=lambda1,
                lambda2=lambda2,
                d_min=d_min,
                rows=rows,
                recovery=recovery,
                failsafe=given if tolerance is None else _tolerant(given, tolerance, profile),
                options=JSSAOptions.of(options),
            )
            return InPlace(filter)

        tolerance = (assumptions("failsafe", given) or FailsafeParams()).state_tolerance
        exact = tolerance == (0.0, 0.0, 0.0)
        self.state_tolerance = STATE_TOLERANCE if exact else tolerance
        """How far measured joints may be from the commanded ones [rad, rad/s, rad/s²]."""
        # states that are not measured need no distance for their error
        self._unmeasured = decider()
        self._measuring = decider(STATE_TOLERANCE) if exact else self._unmeasured
        self._step = self._unmeasured
        self._follower = Follower(self.robot, self.dt, share)
        self._rate, self._answers = TickRate(self.dt), Answers(self.robot.n)
        self._seen, self._measured = PeopleReader(), JointReader(self.robot.n)
        self._nominal = np.zeros(self.robot.n)
        self._started = self._watched = False

    @property
    def state(self) -> JointState:
        """Where the arm was commanded to be at the end of the last tick, and how it moves there; copies."""
        return JointState(*self._step.state.copy())

    @property
    def failsafe(self) -> FailsafeParams:
        """Assumptions of the verified stop."""
        return self._step.failsafe

    @property
    def rests(self) -> bool:
        """Whether the commanded arm is at rest."""
        return self._step.rests

    def start(self, position: Any) -> None:
        """Begin, or begin anew, with an arm that rests; who is beside it the next tick says.

        Args:
            position: Where it rests, shape (n,) [rad]: what its drives hold.

        Raises:
            ParameterError: It is no joint position, or outside the position limits.
        """
        position = real_array("position", position, (self.robot.n,), "a joint position [rad]")
        if not self.robot.limits.contain(position):
            low, high = self.robot.limits.position.T
            j = int(np.flatnonzero((position < low) | (position > high))[0])
            raise ParameterError(
                f"the arm has to begin inside its position limits: {self.robot.joint_names[j]} is at {position[j]:.4g} "
                f"rad, outside [{low[j]:.4g}, {high[j]:.4g}] rad"
            )
        self._begin(self._unmeasured, position)
        self._rate.forget()
        self._watched, self._started = False, True

    def _begin(self, step: InPlace, position: Array) -> None:
        still, zero = np.zeros(self.robot.n), np.zeros(0)
        at = JointState(position, still, still)
        step.start(Scene(0.0, at, nobody(), self._static, self._planes, zero, zero.astype(np.bool_)))
        self._step = step
        self._follower.forget()

    def tick(
        self,
        command: Command | None,
        people: MeasuredPeople | CapsuleSet | None,
        stamp: float,
        measured: JointState | Array | None = None,
    ) -> GuardAnswer:
        """Decide about one tick; has to be asked once in each.

        Args:
            command: What the arm should do; None where there is none: the stored stop goes on.
            people: Everybody beside the arm, as :class:`~jssa_gym.types.MeasuredPeople`, or as capsules that were all
                measured at the stamp. None where nobody knows, which is a fault.
            stamp: Time of this tick by a clock that never goes back, such as ``time.monotonic()`` [s].
            measured: Where the joints are, shape (n,) [rad], or their state: compared with the commanded state of the
                last answer, within :attr:`state_tolerance`. Who gives one has to give one in each tick from then on.

        Returns:
            The answer; its arrays are used again once nobody holds them, and not before.

        Raises:
            NotStartedError: There was no :meth:`start` yet.
        """
        if not self._started:
            raise NotStartedError("start(position) has to come before tick()")
        if self._hasty(stamp):
            # the drives are to be there already: another step would have them make several in one tick
            step = self._step
            return self._answers.make(step.state, step.jerk, Status.FAULT, HASTY_TICK, math.nan, 0.0)
        wrong = self._joins(measured)
        state = self._step.state
        wrong = self._follower.jerk(command, state, self._nominal) or wrong
        wrong = self._clocked(stamp) or wrong
        if wrong:
            self._nominal.fill(math.nan)
        human, age, valid, frame_age = self._seen.read(people)
        joints = self._measured.read(measured) if self._watched else self._measured.commanded(state)
        now = Scene(stamp, joints, human, self._static, self._planes, age, valid, frame_age)
        status, reason, margin = self._step.decide(now, self._nominal, wrong)
        override = 0.0 if status == Status.FAULT else pace_of(margin)
        return self._answers.make(self._step.state, self._step.jerk, status, reason, margin, override)

    def _joins(self, measured: Any) -> str:
        """Take note that states are measured from now on; what is wrong with that, or nothing."""
        if self._watched or measured is None:
            return ""
        if self._step is not self._measuring:
            if not self._step.rests:
                return "measured states began while the arm moves: they are compared once it rests"
            self._begin(self._measuring, self._step.state[0].copy())
        self._watched = True
        return ""

    def _hasty(self, stamp: Any) -> bool:
        try:
            return self._rate.hasty(float(stamp))
        except Exception:  # as below
            return False

    def _clocked(self, stamp: Any) -> str:
        try:
            return self._rate.wrong(float(stamp))
        except Exception:  # whatever a clock delivers; the control step says what
            return ""


def _tolerant(given: Any, tolerance: tuple[Any, ...], profile: str) -> Any:
    """The same assumptions with a tolerance."""
    if isinstance(given, FailsafeParams):
        return replace(given, state_tolerance=tolerance)
    return {**({} if given is True else given), "state_tolerance": tolerance}
