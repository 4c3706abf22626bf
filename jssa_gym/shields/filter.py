"""The interface of a safety filter, and the part that all of them share: failing closed."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.motion import brake, integrate, make_representable
from jssa_gym.kernels.projection import clip
from jssa_gym.kernels.records import AGENT, records
from jssa_gym.kernels.tick import take_in, unfit
from jssa_gym.robots import RobotModel
from jssa_gym.safety.action import checked_action
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.monitor import Watch
from jssa_gym.safety.proximity import plain, plain_capsules, records_for
from jssa_gym.shields.answers import part_of, sound
from jssa_gym.shields.copying import refuse_shared_memory
from jssa_gym.shields.failsafe import Verdict, VerifiedStop
from jssa_gym.shields.reasons import FAULTS, NO_SCENE, UNFIT
from jssa_gym.types import Array, Decision, JointState, Scene, Status
from jssa_gym.validation import positive_number

_logger = logging.getLogger("jssa_gym")

_LONG = 125
"""Faults in a row that are said aloud: a second of them."""


class SafetyFilter(ABC):
    """Decides which jerk is applied instead of the nominal one.

    A subclass implements :meth:`_filter` and may rely on finite, complete inputs: :meth:`decide` answers everything
    else itself, with the fallback and :attr:`Status.FAULT`. The nominal is never returned because something failed.

    Around every filter, if asked for, lie a **viability box** (jerk bounds that keep the joint limits recoverable; else
    the box is the jerk bounds) and a **verified stop** (:class:`~jssa_gym.shields.failsafe.VerifiedStop`).

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        params: The filter's own parameters, a :attr:`params_type`; None for its defaults.
        viability: Whether the jerk is kept in bounds that keep position, velocity and acceleration limits recoverable.
        failsafe: Assumptions of the verified stop; None for no verified stop.

    Raises:
        ParameterError: ``dt`` is not a positive number, ``params`` of another type, ``viability`` no bool or
            ``failsafe`` no FailsafeParams.
    """

    params_type: ClassVar[type | None] = None
    """Frozen dataclass of the filter's own parameters; None for a filter without any."""

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: Any = None,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        announce_compilation(take_in)
        self.params = self._checked(params)
        self.robot = robot
        self.dt = positive_number("dt", dt)
        if not isinstance(viability, bool):
            raise ParameterError(f"viability has to be True or False, got {viability!r}")
        if failsafe is not None and not isinstance(failsafe, FailsafeParams):
            raise ParameterError(f"failsafe has to be None or FailsafeParams, got {failsafe!r}")
        limits = robot.limits
        self.viability, self.failsafe = viability, failsafe
        self.lower = np.array(-limits.jerk)
        self.upper = np.array(limits.jerk)
        self._bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
        self._guard = None if failsafe is None else VerifiedStop(robot, self.dt, failsafe)
        self._state = np.zeros((3, robot.n))
        self._incoming = np.zeros((3, robot.n))
        self._applied = np.zeros(robot.n)
        self._clipped = np.zeros(robot.n)
        self._valid = np.ones(0, np.bool_)
        # faults in a row; whether those have been said aloud, and which failure was logged last
        self._faults, self._told, self._logged = 0, False, ""
        self._agents = records(0, AGENT)

    def __getstate__(self) -> dict[str, Any]:
        """What is copied and sent: all there is, unless a copy would be blind.

        Raises:
            InterfaceError: An attribute is a view of another's memory.
        """
        refuse_shared_memory(self)
        return self.__dict__.copy()

    def _checked(self, params: Any) -> Any:
        """The parameters, or their defaults; raises ParameterError if they are another filter's."""
        kind = self.params_type
        if params is None:
            return None if kind is None else kind()
        if kind is None or not isinstance(params, kind):
            wanted = "has no parameters" if kind is None else f"takes {kind.__name__}"
            raise ParameterError(f"{type(self).__name__} {wanted}, got {params!r}")
        return params

    def reset(self, scene: Scene) -> None:
        """Forget the past: a new episode begins with ``scene``."""
        self._applied[:] = 0.0
        self._faults = 0
        robot, _ = part_of(scene, "robot")
        try:
            self._read_state(robot)
            self._state[:] = np.nan_to_num(self._incoming)
        except Exception:  # decide() will say what is wrong
            self._state[:] = 0.0
        if self._guard is not None:
            self._guard.reset(robot)

    def rebase(self, scene: Scene) -> None:
        """Take an arm that rests, but was moved by something else, to be where ``scene`` says.

        For an arm that was moved by hand, say, while the shield kept it at rest because its joint state was not where
        the applied jerks had led. A filter without a verified stop reads the arm in every step and needs none of this.

        Raises:
            ParameterError: The arm moves, by what the shield or the scene knows, or is outside its limits, or the scene
                is no newer than the last one.
        """
        if self._guard is not None:
            self._guard.rebase(part_of(scene, "robot")[0], part_of(scene, "time")[0])

    def decide(self, scene: Scene | None, nominal: Array) -> Decision:
        """The jerk to apply in this step.

        Never raises for bad numbers: a non-finite nominal or measurement, a missing one, a joint state that is not
        where the applied jerks have led, a scene that does not fit or is None, and a filter that fails or answers
        outside the box end in :attr:`Status.FAULT` with the reason in the decision: the stored stop goes on or, without
        a verified stop, the arm brakes. With a verified stop the arm is taken to be where the applied jerks have led,
        not where it is read.

        Args:
            scene: The present.
            nominal: The policy's jerk, shape (n,) [rad/s³].

        Raises:
            InvalidActionError: ``nominal`` has another shape or is not made of real numbers.
        """
        nominal = checked_action(nominal, self.robot.n)
        try:
            return self._decide(scene, nominal)
        except Exception as error:  # kernels, not the scene: those are looked at where they are read
            reason = f"the control step failed: {type(error).__name__}: {error}"
            self._log(reason)
            try:
                return self._blind(scene, nominal, reason) if self._guard is None else self._brake(nominal, reason)
            except Exception:  # what is left is to add nothing
                return self._faulty(np.zeros(self.robot.n), nominal, reason)

    def _decide(self, scene: Scene | None, nominal: Array) -> Decision:
        guard, watch, astray = self._guard, None, ""
        if guard is not None:
            astray, watch = self._watch(guard, scene)
            if astray or watch.fault:
                reason = astray or watch.reason
                return self._brake(nominal, reason if np.isfinite(nominal).all() else f"{FAULTS[1]}; {reason}")
        try:
            # kernels look neither at shapes nor at types: everything is compared before they see it
            if scene is None:
                raise ValueError("there is no scene")
            if guard is None or watch is None:
                self._read_state(scene.robot)
                human, valid = plain_capsules(scene.human), plain(scene.valid)
                self._agents = records_for(human, self._agents)
                if valid.shape != human.radius.shape or valid.dtype != np.bool_:
                    raise ValueError(f"valid has shape {valid.shape} for {len(human.radius)} capsules")
            else:  # what is believed is sound
                self._incoming = guard.expected.copy()
                human, count = watch.present(), len(watch.age)
                if len(self._valid) != count or len(self._agents) != count:
                    self._valid, self._agents = np.ones(count, np.bool_), records(count, AGENT)
                valid = self._valid
            agents = self._agents
        except Exception as error:  # whatever a perception system delivers, the arm must go on safely
            return self._blind(scene, nominal, f"the scene does not fit: {error}")
        fault, inside, room = take_in(
            human.start,
            human.end,
            human.start_velocity,
            human.end_velocity,
            human.radius,
            valid,
            nominal,
            self._bounds,
            self.dt,
            self.viability,
            self._incoming,
            agents,
            self.lower,
            self.upper,
            self._clipped,
        )
        if fault:
            return self._fault(nominal, FAULTS[fault], readable=fault != 2)
        self._state, self._incoming = self._incoming, self._state
        asked = nominal.copy()  # a filter may write into what it is given; the nominal stays what was asked for
        try:
            decision = self._filter(scene, self._state, agents, nominal, inside) if room else self._cornered(nominal)
            decision = sound(decision, nominal.shape)
            jerk, forwarded = np.empty(len(asked)), decision.status == Status.NOMINAL
            wrong = unfit(decision.jerk, asked, self.lower, self.upper, forwarded, self._bounds[4], jerk)
        except Exception as error:  # whatever a filter runs into, the arm must go on safely
            reason = f"the filter failed: {type(error).__name__}: {error}"
            self._log(reason)
            return self._brake(nominal, reason)
        if decision.status == Status.FAULT:
            return self._brake(nominal, decision.reason)
        if wrong:
            return self._brake(nominal, UNFIT[wrong])
        if not forwarded:
            # what is verified is what an environment integrates: a share of the bound, times the bound
            decision = decision._replace(jerk=jerk)
        if guard is not None and watch is not None:
            if reason := guard.take_fixtures(scene):
                return self._brake(nominal, f"the scene does not fit: {reason}")
            verdict = guard.confirm(
                guard.expected, decision.jerk, watch, lambda held, halt: self._spare(decision, held, halt)
            )
            if not verdict.proposed:
                decision = self._overruled(decision, verdict)
        self._applied[:] = decision.jerk
        self._faults = 0 if decision.status != Status.FAULT else self._faults + 1
        return decision

    def _log(self, reason: str) -> None:
        """Where a failure came from, with its traceback: once, not in every tick in which it goes on."""
        if reason != self._logged:
            self._logged = reason
            _logger.exception("%s; the arm brakes", reason)

    def _watch(self, guard: VerifiedStop, scene: Scene | None) -> tuple[str, Watch]:
        """What is wrong with the arm's reading, and what can be believed about the people; once a tick."""
        if scene is None:
            guard.follow(None, None)
            return NO_SCENE, guard.watch(None)
        try:
            robot, time, lost = scene.robot, scene.time, ""
        except Exception:  # whatever a perception system throws, the arm must go on safely
            (robot, lost), (time, _) = part_of(scene, "robot"), part_of(scene, "time")
        astray = guard.follow(robot, time)
        return f"the joint state cannot be read: {lost}" if lost else astray, guard.watch(scene)

    def _representable(self, jerk: Array) -> Array:
        jerk = jerk.copy()
        make_representable(jerk, self._bounds[4])
        return jerk

    def _spare(self, decision: Decision, held: int, halt: Array) -> Array:
        try:
            jerk = self._amended(decision, held, halt)
            if jerk.shape != halt.shape or jerk.dtype != np.float64:
                raise ValueError(f"the answer has shape {jerk.shape} and type {jerk.dtype}")
        except Exception:  # whatever a filter runs into, the arm must go on safely
            _logger.exception("the filter failed to spare joints; all follow the stored stop")
            return halt
        return self._representable(jerk)

    def _amended(self, decision: Decision, held: int, halt: Array) -> Array:
        """The jerk to apply if the first ``held`` joints have to follow the stored stop's, ``halt`` (n,)."""
        return np.concatenate([halt[:held], decision.jerk[held:]])

    @contextmanager
    def _held(self, nominal: Array, held: int, halt: Array) -> Generator[None]:
        """For a while, a box that leaves the first ``held`` joints no choice but ``halt``."""
        lower, upper = self.lower, self.upper
        self.lower, self.upper = lower.copy(), upper.copy()
        self.lower[:held] = self.upper[:held] = halt[:held]
        try:
            clip(nominal, self.lower, self.upper, self._clipped)
            yield
        finally:
            self.lower, self.upper = lower, upper

    def _overruled(self, decision: Decision, verdict: Verdict) -> Decision:
        """The verified stop has decided."""
        status, reason = Status.FAILSAFE, verdict.reason
        if not verdict.verified:
            status, reason = Status.FAULT, f"no verified stop: {reason}"
        decision = decision._replace(jerk=verdict.jerk, status=status, reason=reason, slack=np.nan)
        if np.isnan(decision.phi):
            return decision
        try:
            phi, distance, pair = self._foresee(verdict.jerk)
        except Exception:  # what it says is for the eye; the stop is on its way
            phi, distance, pair = np.nan, np.nan, (-1, -1)
        return decision._replace(phi=phi, distance=distance, pair=pair)

    def _cornered(self, nominal: Array) -> Decision:
        """No jerk keeps all joint limits recoverable: the box is the braking jerk alone."""
        reason = "no jerk keeps the joint limits"
        return Decision(self._clipped.copy(), nominal, Status.RELAXED, reason, np.nan, np.nan, (-1, -1), 0.0, 0)

    def _foresee(self, jerk: Array) -> tuple[float, float, tuple[int, int]]:
        """Index, smallest distance and its pair at the end of the step under ``jerk``; NaN where not computed."""
        return np.nan, np.nan, (-1, -1)

    def _blind(self, scene: Scene | None, nominal: Array, reason: str) -> Decision:
        """Brake without people to look at, from the joint state if at least that can be read."""
        try:
            if scene is None:
                raise ValueError("there is no scene")
            self._read_state(scene.robot)
        except Exception as worse:
            return self._fault(nominal, f"the joint state cannot be read: {worse}", readable=False)
        if not np.isfinite(self._incoming).all():
            return self._fault(nominal, FAULTS[2], readable=False)
        return self._fault(nominal, reason if np.isfinite(nominal).all() else FAULTS[1])

    def _read_state(self, robot: JointState) -> None:
        shape = (self.robot.n,)
        for row, values in enumerate((robot.position, robot.velocity, robot.acceleration)):
            if plain(values).shape != shape:
                raise ValueError(f"it has shape {values.shape}, expected {shape}")
            self._incoming[row] = values

    @abstractmethod
    def _filter(self, scene: Scene, state: Array, agents: NDArray, nominal: Array, inside: bool) -> Decision:
        """Decide on sound input.

        ``state`` (3, n) and ``agents`` hold the scene as the kernels read it, ``self._clipped`` the nominal clipped
        to the box; ``inside`` says that it lay in the box. Of an answer with :attr:`Status.FAULT`, which
        :meth:`_failed` makes, only the reason counts: :meth:`decide` then brakes or stops.
        """

    def _failed(self, nominal: Array, reason: str) -> Decision:
        """For :meth:`_filter` to answer that it found no jerk."""
        still = np.zeros(self.robot.n)
        return Decision(still, nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0)

    def fallback(self, state: Array) -> Array:
        """The jerk when nothing else is known to be good: brakes as fast as the jerk bounds allow, shape (n,)."""
        jerk, bound = np.empty(self.robot.n), self._bounds[4]
        brake(state, -bound, bound, self.dt, jerk)
        make_representable(jerk, bound)
        return jerk

    def _fault(self, nominal: Array, reason: str, readable: bool = True) -> Decision:
        """Brake on bad input: from the state just read or, unreadable, from where the last jerk must have led."""
        if readable:
            self._state, self._incoming = self._incoming, self._state
        else:
            integrate(self._state, self._applied, self.dt, self._state)
        return self._brake(nominal, reason)

    def _brake(self, nominal: Array, reason: str) -> Decision:
        guard = self._guard
        if guard is None:
            jerk = self.fallback(self._state)
        else:
            if not guard.verified:
                reason = f"{reason}; no verified stop"
            self._state[:] = guard.expected
            jerk = guard.stop()
        # a state beyond all bounds can overflow; then at least nothing is added
        return self._faulty(np.where(np.isfinite(jerk), jerk, 0.0), nominal, reason)

    def _faulty(self, jerk: Array, nominal: Array, reason: str) -> Decision:
        self._applied[:] = jerk
        self._faults += 1
        if self._faults == _LONG and not self._told:
            self._told = True
            _logger.warning(
                "Every decision of the last %d control steps was a FAULT (%s): the arm does not move.", _LONG, reason
            )
        return Decision(jerk, nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0)
