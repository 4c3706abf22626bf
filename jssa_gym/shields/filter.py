"""The interface of a safety filter, and the part that all of them share: failing closed."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.motion import brake, integrate, make_representable
from jssa_gym.kernels.verification import NO_FACES, NO_PIECES
from jssa_gym.robots import RobotModel
from jssa_gym.safety.action import checked_action
from jssa_gym.safety.failsafe import FailsafeParams, levers
from jssa_gym.shields.alarm import Alarm
from jssa_gym.shields.asking import ask, foreseen
from jssa_gym.shields.copying import refuse_shared_memory
from jssa_gym.shields.offers import Offered, alternatives_of, tell
from jssa_gym.shields.people import tell_of_unmet_names
from jssa_gym.shields.reading import Reading, part_of, words_of
from jssa_gym.shields.reasons import REASONS
from jssa_gym.shields.rebasing import rebase
from jssa_gym.shields.records import ONE, Records
from jssa_gym.shields.tick import Tick
from jssa_gym.shields.words import Told, in_words, kind_of
from jssa_gym.tick import codes, layout, loop
from jssa_gym.tick.assumed import Assumed
from jssa_gym.tick.parts import compile_parts
from jssa_gym.tick.proposals.nothing import Foreign
from jssa_gym.tick.propose import KINDS
from jssa_gym.types import Array, Decision, Scene, Status
from jssa_gym.validation import positive_number, true_or_false

_STATUSES = tuple(Status)

_ASKED_BEFORE = {
    "_filter": "respond(tick)",
    "_respond": "answer(tick, pairs, index)",
    "_amended": "amend(tick, decision, held, halt)",
    "_foresee": "foresee(decision, jerk)",
    "_coefficients": "coefficients()",
}
"""What filters implemented before, and what they do now: an old one must not go unasked in silence."""


def _softened(limits: Array, hardness: Sequence[float]) -> Array:
    """The limits (5, n) with shares of the acceleration and jerk limits, shape (c, 5, n)."""
    soft = np.repeat(limits[None], len(hardness), axis=0)
    soft[:, 3:] *= np.array(hardness)[:, None, None]
    return soft


def alike(offered: Array, jerk: Array, bound: Array) -> int:
    """The number of the first of the alternatives (a, n) that is a jerk (n,) but for rounding, -1 if none is."""
    same = np.abs(offered - jerk).max(axis=1) <= 1e-12 * np.max(bound)
    return int(same.argmax()) if same.any() else -1


class SafetyFilter:
    """Decides which jerk is applied instead of the nominal one.

    A subclass of a user's own implements :meth:`respond` and may rely on finite, complete inputs: :meth:`decide`
    answers everything else itself, with the fallback and :attr:`Status.FAULT`. The nominal is never returned because
    something failed. Filters with a compiled :attr:`proposal` instead are decided in one compiled call.

    Around every filter, if asked for, lie a **viability box** (jerk bounds that keep the joint limits recoverable; else
    the box is the jerk bounds) and a **verified stop**: a jerk is applied only if a jerk-limited stop after it is
    verified, else the stop verified before goes on; see :mod:`jssa_gym.tick.admit`.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        params: The filter's own parameters, a :attr:`params_type`; None for its defaults.
        viability: Whether the jerk is kept in bounds that keep position, velocity and acceleration limits recoverable.
        failsafe: Assumptions of the verified stop; None for no verified stop.

    Raises:
        ParameterError: ``dt`` is not a positive number, ``params`` of another type, ``viability`` no truth value
            or ``failsafe`` no FailsafeParams.
    """

    params_type: ClassVar[type | None] = None
    """Frozen dataclass of the filter's own parameters; None for a filter without any."""

    fixed: ClassVar[frozenset[str]] = frozenset({"robot", "dt", "params", "viability", "failsafe"})
    """Attributes that say how an arm is looked after."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name in _ASKED_BEFORE.keys() & vars(cls).keys():
            raise TypeError(f"{cls.__name__}.{name} would never be asked: a filter implements {_ASKED_BEFORE[name]}")

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to change how a filter looks after an arm: its control step has been told when it was made."""
        if name in self.__dict__ and (name in self.fixed or (name == "projector" and self.compiled)):
            raise AttributeError(f"{name} of a filter is fixed when it is made: make another one")
        super().__setattr__(name, value)

    def __init__(
        self,
        robot: RobotModel,
        dt: float,
        params: Any = None,
        *,
        viability: bool = False,
        failsafe: FailsafeParams | None = None,
    ) -> None:
        self.params = self._checked(params)
        self.robot = robot
        self.dt = positive_number("dt", dt)
        self.viability = true_or_false("viability", viability)
        if failsafe is not None and not isinstance(failsafe, FailsafeParams):
            raise ParameterError(f"failsafe has to be None or FailsafeParams, got {failsafe!r}")
        self.failsafe = failsafe
        self._alarm = Alarm(self.dt)
        if failsafe is not None:
            failsafe.tolerance_of(robot)
        announce_compilation(loop.decide_all)

    @property
    def proposal(self) -> Any:
        """Parameters of what proposes in the compiled step: their type, in :data:`~jssa_gym.tick.propose.KINDS`, says
        what that is. ``Foreign()``: :meth:`respond` does.
        """
        return Foreign()

    def respond(self, tick: Tick) -> Decision:
        """Propose a jerk, in the box, and say why; without an answer of a subclass, what the compiled step proposes.

        Of an answer with :attr:`Status.FAULT`, which :meth:`failed` makes, only the reason counts: the arm then brakes
        or stops.
        """
        if not self._known:
            raise NotImplementedError(f"{type(self).__name__} answers to nothing")
        view = self.records.view
        loop.propose(view.arms, view.nominal)
        return self._proposed(tick)

    def amend(self, tick: Tick, decision: Decision, held: int, halt: Array) -> Array:
        """The jerk to apply if the first ``held`` joints have to go on with the stored stop's, ``halt`` (n,)."""
        view = self.records.view
        if self._known and loop.ask_again(view.arms, view.nominal, held):
            return self.records.work.wanted.copy()
        return np.concatenate([halt[:held], decision.jerk[held:]])

    def foresee(self, decision: Decision, jerk: Array) -> tuple[float, float, tuple[int, int]]:
        """Index, smallest distance and its pair at the end of the step under another jerk; NaN where not computed."""
        if not self._known:
            return np.nan, np.nan, (-1, -1)
        loop.foresee(self.records.view.arms)
        told = Told(*self.records.view.told.item())
        return told.phi, told.distance, (told.row, told.column)

    def _proposed(self, tick: Tick, note: str = "") -> Decision:
        """The compiled step's proposal as a decision; ``note`` goes behind its reason."""
        told = Told(*self.records.view.told.item())
        if told.status == Status.FAULT:
            return self.failed(tick, REASONS[told.code])
        reason = "; ".join(part for part in (REASONS.get(told.code, ""), note) if part)
        return Decision(
            self.records.work.wanted.copy(), tick.nominal, Status(told.status), reason,
            told.phi, told.distance, (told.row, told.column), told.slack, told.rows,
        )  # fmt: skip

    def failed(self, tick: Tick, reason: str) -> Decision:
        """The answer of a :meth:`respond` that found no jerk."""
        still = np.zeros(self.robot.n)
        return Decision(still, tick.nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0)

    def compile_ahead(self) -> None:
        """Let a second process begin to compile what the first step needs; nothing if that is cached."""
        # a user's own filter is no other process's to import
        if self.compiled and type(self).__module__.startswith("jssa_gym."):
            records = vars(self).get("records") or self._new_records()
            compile_parts(records.view.arms, records.view.nominal, ONE)

    # ---- records -------------------------------------------------------------------------------------

    def settings(self) -> layout.StepSettings:
        """The numbers that the control step goes by."""
        n, params, limits = self.robot.n, self.failsafe, self.robot.limits.bounds()
        assumed = params or FailsafeParams()
        faces, pieces = (NO_FACES, NO_PIECES) if assumed.watched is None else assumed.watched.faces()
        return layout.StepSettings(
            dt=self.dt,
            guarded=params is not None,
            viability=self.viability,
            static_rows=False,
            diagonal=True,
            weight=np.ones(n),
            inverse=np.eye(n),
            stop_limits=limits,
            hardness=np.array(assumed.hardness),
            soft_limits=_softened(limits, assumed.hardness),
            tolerance=assumed.tolerance_of(self.robot),
            position_error=assumed.position_error,
            max_age=assumed.max_age,
            lag=assumed.actuation_lag,
            astray=assumed.displacement(self.robot),
            faces=faces,
            pieces=pieces,
            entry_speed=assumed.entry_speed,
        )

    def assumed(self, names: Sequence[str]) -> Assumed:
        """How body parts move, how fast they can reach an arm and how fast it may touch them."""
        params = self.failsafe or FailsafeParams()
        tell_of_unmet_names(params, names)
        speed = np.array([params.end_speeds_of(name) for name in names], np.float64).reshape(-1, 2)
        touch, acceleration = (
            np.array([of(name) for name in names], np.float64)
            for of in (params.contact_speed_of, params.acceleration_of)
        )
        return Assumed(speed, speed.copy(), touch, acceleration, params.velocity_error)

    @cached_property
    def records(self) -> Records:
        """What the control step reads, remembers and answers; made when it is needed first."""
        return self._new_records()

    def _new_records(self) -> Records:
        # copies: arrays for reading alone are of another type to kernels, and those of a filter's copy are none
        robot = self.robot
        parts = (np.array(part) for part in (robot.links, robot.capsules, robot.self_pairs))
        arm = layout.ArmRecord(*parts, levers(robot), robot.limits.bounds())
        return Records(arm, self.settings(), self.proposal)

    @cached_property
    def reading(self) -> Reading:
        """Takes down scenes in the records."""
        settings = self.records.settings
        exact, fixed = bool(np.any(settings.tolerance == 0.0)), settings.guarded or settings.static_rows
        watched = None if self.failsafe is None else self.failsafe.watched
        capacity = None if watched is None else watched.capacity
        return Reading(self.records, not settings.guarded, exact, fixed, self.assumed, capacity)

    @cached_property
    def _asks(self) -> bool:
        """Whether :meth:`respond` proposes."""
        return not self.compiled

    @property
    def lower(self) -> Array:
        """The box of the last step, shape (n,) [rad/s³]: jerk bounds, or what the viability box left of them."""
        return self.records.work.lower

    @property
    def upper(self) -> Array:
        """See :attr:`lower`."""
        return self.records.work.upper

    @property
    def expected(self) -> Array:
        """Where the applied jerks have led since the reset, shape (3, n): what a verified stop plans from."""
        return self.records.memory.expected[0]

    @property
    def verified(self) -> bool:
        """Whether the stored stop is verified, or the arm rests inside its limits."""
        return bool(self.records.memory.arm[0]["verified"])

    def __getstate__(self) -> dict[str, Any]:
        """What is copied and sent: all there is, unless a copy would be blind.

        Raises:
            InterfaceError: An attribute is a view of another's memory.
        """
        if "records" in vars(self):
            self.records.release()
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

    # ---- a control step ------------------------------------------------------------------------------

    def reset(self, scene: Scene) -> None:
        """Forget the past: a new episode begins with ``scene``."""
        reading = self.reading
        self._alarm.well()
        self.compile_ahead()
        reading.forget()
        reading.read(scene)
        loop.start(self.records.view.arms, ONE)
        self.records.answer.told["margin"] = np.inf
        reading.forget()

    def rebase(self, scene: Scene) -> None:
        """Take an arm that rests, but was moved by something else, to be where ``scene`` says.

        For an arm that was moved by hand, say, while the shield kept it at rest because its joint state was not where
        the applied jerks had led. A filter without a verified stop reads the arm in every step and needs none of this.

        Raises:
            ParameterError: The arm moves, by what the shield or the scene knows, or is outside its limits, or the scene
                is no newer than the last one.
        """
        if self.failsafe is not None:
            rebase(self.records, self.reading, scene)

    def decide(self, scene: Scene | None, nominal: Array, path: Offered | None = None) -> Decision:
        """The jerk to apply in this step.

        Never raises for bad numbers: a non-finite nominal or measurement, a missing one, a joint state that is not
        where the applied jerks have led, a scene that does not fit or is None, and a filter that fails or answers
        outside the box end in :attr:`Status.FAULT` with the reason in the decision: the stored stop goes on or, without
        a verified stop, the arm brakes. With a verified stop the arm is taken to be where the applied jerks have led,
        not where it is read.

        Args:
            scene: The present.
            nominal: The policy's jerk, shape (n,) [rad/s³].
            path: Offers other jerks, in order of preference, that are applied rather than the nominal: the first that
                lies in the box, that the filter would leave alone, and with a verified stop behind it. Whatever fails
                about a path, the nominal is filtered as without one.

        Raises:
            InvalidActionError: ``nominal`` has another shape or is not made of real numbers.
        """
        nominal, decided = checked_action(nominal, self.robot.n), False
        try:
            self.reading.read(scene)
            view, decision = self.records.view, None
            view.nominal[0], view.now[0]["alternatives"] = nominal, 0
            if path is not None:
                self._consider(path)
            if self._asks:
                decision = ask(self, self._alarm, scene, nominal)
            else:
                loop.decide_all(view.arms, view.nominal, ONE)
            decided = True
            answer = self._answer(nominal, decision)
            return answer if path is None else self._chosen(path, answer)
        except Exception as error:  # reading raises for no scene: this came from the step itself
            reason = f"{REASONS[codes.FAILED]}: {type(error).__name__}: {words_of(error)}"
            emergency = self._emergency(scene, nominal, reason, decided)
            return emergency if path is None else emergency._replace(override=tell(path, -1, self._alarm))

    @property
    def compiled(self) -> bool:
        """Whether the compiled step proposes: for a class that says what does, not for one that answers itself."""
        asked = {"respond", "amend", "foresee"}
        owner = next(kind for kind in type(self).__mro__ if {"proposal", *asked} & vars(kind).keys())
        return self._known and "proposal" in vars(owner)

    @cached_property
    def _known(self) -> bool:
        """Whether there is something compiled that can propose."""
        return type(self.proposal) in KINDS

    def _answer(self, nominal: Array, proposed: Decision | None) -> Decision:
        """The decision that the answer in the records comes to; ``proposed`` is that of a filter that was asked."""
        view = self.records.view
        numbers, jerk = view.told.item(), view.jerk.copy()
        status, phi, distance, row, column, slack, rows = numbers[:7]
        column = self.reading.shown(column)
        if status == 0 and proposed is None:  # NOMINAL, the usual case: there is nothing to say
            self._alarm.well()
            margin = numbers[-1]
            return Decision(jerk, nominal, Status.NOMINAL, "", phi, distance, (row, column), slack, rows, margin)
        told, pair = Told(*numbers), (row, column)
        if proposed is not None and told.chosen <= 0 and told.code in (0, codes.FOREIGN):
            reason = proposed.reason + (f"; {REASONS[codes.UNVERIFIED]}" if told.unverified else "")
        else:
            reason = self._say(told, nominal)
        if proposed is not None and told.chosen > 0 and not np.isnan(phi):
            phi, distance, pair = foreseen(self, proposed, jerk.copy())
        if told.status == Status.FAULT:
            self._alarm.fault(reason, told.persistent)
        else:
            self._alarm.well()
        return Decision(
            jerk, nominal, _STATUSES[status], reason, phi, distance, pair, slack, rows, told.margin, kind_of(told)
        )  # fmt: skip

    def _consider(self, path: Offered) -> None:
        """Take down what a path offers."""
        view = self.records.view
        guarded = self.records.settings.guarded
        state = self.expected if guarded else view.joints
        margin = float(view.told[0]["margin"]) if guarded else np.inf
        room = self.records.scene.alternatives[0]
        view.now[0]["alternatives"] = alternatives_of(path, state.copy(), margin, room, self._alarm)

    def _chosen(self, path: Offered, decision: Decision) -> Decision:
        """Tell a path what became of what it offered."""
        view, choice = self.records.view, -1
        if decision.status == Status.NOMINAL:
            choice = int(view.told[0]["choice"])
            if choice < 0:  # but what is applied may be one of them
                offered = self.records.scene.alternatives[0, : view.now[0]["alternatives"]]
                choice = alike(offered, decision.jerk, self.robot.limits.jerk)
        override = tell(path, choice, self._alarm)
        if choice < 0:
            return decision._replace(override=override)
        return decision._replace(nominal=decision.jerk.copy(), choice=choice, kind="alternative", override=override)

    def _say(self, told: Told, nominal: Array) -> str:
        """The reason in words; it is decided already, whatever names turn out to be."""
        try:
            return in_words(told, nominal, self.robot, self.records, self.reading)
        except Exception as error:
            return f"{REASONS.get(abs(told.code), '')} ({type(error).__name__})"

    def _emergency(self, scene: Scene | None, nominal: Array, reason: str, decided: bool) -> Decision:
        """Brake though the control step itself failed; once it has ``decided``, that is what the arm does."""
        self._alarm.failure("step", f"{reason}; the arm brakes")
        jerk = np.zeros(self.robot.n)  # the last resort is to add nothing
        try:
            view = self.records.view
            if not decided:
                self._brake(scene)
            jerk = view.jerk.copy()
            if view.told[0]["unverified"]:
                reason = f"{reason}; {REASONS[codes.UNVERIFIED]}"
        except Exception:
            self._alarm.failure("brake", "the arm cannot even brake")
        self._alarm.fault(reason, persistent=False)
        return Decision(jerk, nominal, Status.FAULT, reason, np.nan, np.nan, (-1, -1), np.nan, 0, kind="fault")

    def _brake(self, scene: Scene | None) -> None:
        """Go on with the stored stop or, without one, brake from where the arm is read or must have gone."""
        view = self.records.view
        if not self.records.settings.guarded:
            lost = self.reading.read_joints(part_of(scene, "robot")[0])
            if not lost and np.isfinite(view.joints).all():
                view.state[:] = view.joints
            else:  # where the last jerk must have led
                integrate(view.state, self.records.memory.applied[0], self.dt, view.state)
        loop.stop(view.arms, codes.FAILED)

    def fallback(self, state: Array) -> Array:
        """The jerk when nothing else is known to be good: brakes as fast as the jerk bounds allow, shape (n,)."""
        bound = np.array(self.robot.limits.jerk)
        jerk = np.empty(self.robot.n)
        brake(state, -bound, bound, self.dt, jerk)
        make_representable(jerk, bound)
        return jerk
