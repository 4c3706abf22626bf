"""The outermost layer of a filter: nothing is applied that a verified stop does not follow."""

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jssa_gym.humans import nobody
from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.kernels.records import AGENT, FRAME, PLANE, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import make_plan_representable, plan_stop, stop_jerk, stop_length
from jssa_gym.kernels.verification import (
    CHANGED_PLANES,
    CHANGED_STATICS,
    HALF_SPACE,
    LIMITS,
    REACH,
    SELF,
    STATIC,
    choose,
    load_fixtures,
    load_people,
)
from jssa_gym.robots import RobotModel
from jssa_gym.safety.clock import TickClock
from jssa_gym.safety.failsafe import FailsafeParams, levers
from jssa_gym.safety.joints import JointMonitor, at_rest
from jssa_gym.safety.monitor import HumanMonitor, Watch
from jssa_gym.safety.proximity import plain, plain_capsules, records_for
from jssa_gym.types import Array, CapsuleSet, Planes, Scene

_ROUNDING = 1e-9
"""Share of the joint limits by which an arm at rest may be beyond them."""

_FIXTURES = (
    "",
    "a static capsule or half-space is not finite, a radius not positive, or a normal no unit vector",
    "the half-spaces are not those of the beginning",
    "the static capsules are not those of the beginning",
)
"""What is wrong with what stands still, by the number of :func:`~jssa_gym.kernels.verification.load_fixtures`: it does
not come, go or move."""

_logger = logging.getLogger("jssa_gym")


class Verdict(NamedTuple):
    """What :meth:`VerifiedStop.confirm` answers."""

    jerk: Array
    """To be applied, shape (n,) [rad/s³]."""
    proposed: bool
    """Whether it is the one that was proposed."""
    reason: str
    """What stood in the proposed one's way; empty if nothing did."""
    verified: bool
    """Whether a verified stop follows it."""


class VerifiedStop:
    """Applies a jerk only if the stop that would follow is verified, else goes on with the stop verified before.

    Verified means: the step and the stop keep all joint limits, and until the arm is at rest it is off table, static
    agents and itself, and off everything that a person can have reached by then. So a verified stop always exists:
    the rest of the last one. It needs an arm that begins at rest, or from a state whose stop is verified.

    Args:
        robot: The arm, where it stands.
        dt: Control step [s].
        params: What is assumed about people, sensors and drives.
    """

    def __init__(self, robot: RobotModel, dt: float, params: FailsafeParams) -> None:
        announce_compilation(choose)
        self.robot, self.dt, self.params = robot, dt, params
        limits, n = robot.limits, robot.n
        self._bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
        self._levers = levers(robot)
        # how far the arm may be from where it is expected [m]
        self._astray = params.displacement(robot)
        self._joints = JointMonitor(self._bounds, dt, params.tolerance_of(robot))
        self._stored, self._next = records(n, STOP), records(n, STOP)
        self._after, self._posture, self._fastest = np.zeros((3, n)), np.zeros((3, n)), np.zeros(n)
        self._frames, self._segments = records(n, FRAME), records(len(robot.capsules), SEGMENT)
        self._agents, self._statics, self._planes = records(0, AGENT), records(0, AGENT), records(0, PLANE)
        self._reach, self._told = np.empty(0), False
        self.reset(None)

    def reset(self, robot: Any) -> None:
        """Forget the past; the arm is in the joint state ``robot``, or where the first usable reading will say."""
        self._monitor: HumanMonitor | None = None
        self._growth = self._touch = np.zeros(0)
        self._clock = TickClock(self.dt)
        # static capsules and half-spaces: as they were shown last, what is read of them, whether those are the first
        self._shown: tuple[Any, Any] = (None, None)
        self._fixtures, self._names, self._first = (nobody(), np.zeros((0, 3)), np.zeros(0)), ((), ()), True
        self._joints.reset(robot)
        self._replan()

    def rebase(self, robot: Any, time: Any) -> None:
        """Take an arm that rests, but was moved by something else, to be where its reading says.

        Raises:
            ParameterError: See :meth:`~jssa_gym.safety.joints.JointMonitor.rebase`.
        """
        self._joints.rebase(robot, time)
        self._replan()

    @property
    def verified(self) -> bool:
        """Whether the stored stop is verified, or the arm rests inside its limits."""
        return self._verified

    @property
    def expected(self) -> Array:
        """Where the applied jerks have led since the reset, shape (3, n): what is planned from."""
        return self._joints.expected

    def _replan(self) -> None:
        """Store a stop from the expected state; nobody has verified it, unless there is nothing to stop."""
        state, still = self.expected, np.zeros(self.robot.n)
        plan_stop(state, self._bounds, self.dt, self._stored)
        make_plan_representable(self._stored, self._bounds)
        self._tick, self._rests = 0, False
        self._verified = self._joints.begun and at_rest(state) and not violates(state, still, self._bounds, _ROUNDING)

    def watch(self, scene: Scene | None) -> Watch:
        """What can be believed about the people; never raises. Has to be asked once a tick, after :meth:`follow`."""
        try:
            if scene is None:
                raise ValueError("there is no scene")
            time, human, age, valid = scene.time, scene.human, scene.age, scene.valid
            if self._monitor is None:
                self._monitor = self._monitor_of(human.names)
        except Exception as error:  # whatever a perception system delivers, the arm must go on safely
            self._clock.miss()
            return Watch(nobody(), np.zeros(0), True, f"the people cannot be read: {error}")
        now = self._clock.read(time)
        if not self._joints.timely:
            # joints that rest look the same at all times, but people go on: those of another tick are not those of now
            return self._monitor.miss(now, "the people are of another tick")
        return self._monitor.update(now, human, age, valid)

    def _monitor_of(self, names: tuple[str, ...]) -> HumanMonitor:
        params = self.params
        self._growth = np.array([params.speed_of(name) for name in names], np.float64)
        self._touch = np.array([params.contact_speed_of(name) for name in names], np.float64)
        speed = self._growth if len(names) else params.human_speed
        return HumanMonitor(speed, position_error=params.position_error, max_age=params.max_age)

    def follow(self, robot: Any, time: Any) -> str:
        """Compare a reading of the joints with where the applied jerks must have led; what is wrong, or nothing.

        Never raises; has to be asked once a tick. Ticks in which no decision was made, as the clock has it, must have
        gone on with the stored stop: a reading that agrees with that moves the expected state there, no other does.
        """
        joints = self._joints
        begun = joints.begun
        form = joints.read(robot, time)
        if not begun or (self._tick and not self._rests and self._tick >= stop_length(self._stored)):
            # there is a first reading, or a stop is over: that of a state that nobody verified may not end in rest
            self._rests = begun and at_rest(self.expected)
            if not self._rests:
                self._replan()
        leapt = joints.late > 0 and not form and not self._catch_up(joints.seen, joints.late)
        wrong = joints.judge(form)
        if wrong and joints.persistent and not self._told:
            self._told = True
            _logger.warning(
                "The arm is not where the applied jerks lead, again and again (%s): something else moves it, or its "
                "readings are not those of the commanded state. The shield keeps braking. jssa_gym.check_env(env) "
                "names what is wrong with an environment; FailsafeParams(state_tolerance=...) is for measured states.",
                wrong,
            )
        if leapt and not wrong:
            return "the clock leapt ahead of the arm"
        return wrong

    def _catch_up(self, seen: Array, late: int) -> bool:
        """Whether an arm went on with the stored stop for ``late`` ticks without a decision; ``seen`` (3, n) tells.

        Within a tolerance several numbers of ticks can agree: then the clock decides.
        """
        joints, states = self._joints, [self.expected.copy()]
        left = max(stop_length(self._stored) - self._tick, 0)
        for passed in range(min(late, left + 1)):
            states.append(states[-1].copy())
            self._stop_from(states[-1], self._tick + passed)
        for passed in (len(states) - 1, *range(len(states) - 1)):
            if joints.agrees(seen, states[passed]):
                self._tick += passed
                self.expected[:] = states[passed]
                return passed == late or at_rest(states[passed])
        return True

    def _stop_from(self, state: Array, tick: int) -> Array:
        """The stored stop's jerk at one of its ticks, applied to ``state`` (3, n)."""
        jerk = np.empty(self.robot.n)
        stop_jerk(self._stored, tick, jerk)
        integrate(state, jerk, self.dt, state)
        return jerk

    def stop(self) -> Array:
        """Go on with the stored stop: its next jerk, shape (n,) [rad/s³]."""
        jerk = self._stop_from(self.expected, self._tick)
        self._tick += 1
        return jerk

    def take_fixtures(self, scene: Scene) -> str:
        """Take down the static agents for :meth:`confirm`; what is wrong with them, or nothing. Never raises."""
        try:
            if scene.static is not self._shown[0] or scene.planes is not self._shown[1]:
                self._recognise(scene.static, scene.planes)
        except Exception as error:  # whatever static agents a scene has, the arm must go on safely
            return str(error)
        static, normal, offset = self._fixtures
        state = load_fixtures(
            static.start, static.end, static.radius, normal, offset, self._statics, self._planes, self._first
        )
        if state == 0:
            self._first = False
        return _FIXTURES[state]

    def _recognise(self, static: CapsuleSet, planes: Planes) -> None:
        """Take other objects for the fixtures; raises if they are no such thing, or have other names or numbers."""
        capsules, normal, offset = plain_capsules(static), plain(planes.normal), plain(planes.offset)
        names = tuple(planes.names), tuple(static.names)
        statics = records_for(capsules)
        if normal.shape != (len(offset), 3):
            raise ValueError(f"{len(offset)} half-spaces with normals of shape {normal.shape}")
        if (len(offset), len(statics)) != (len(names[0]), len(names[1])):
            raise ValueError(f"half-spaces and static capsules have the names {names}")
        fixtures = capsules, np.asarray(normal, np.float64), np.asarray(offset, np.float64)
        if not self._first and names != self._names:
            ends = capsules.start, capsules.end, capsules.radius
            unsound = load_fixtures(*ends, *fixtures[1:], statics, records(len(offset), PLANE), True)
            raise ValueError(_FIXTURES[unsound or (CHANGED_STATICS if names[0] == self._names[0] else CHANGED_PLANES)])
        if self._first:
            self._statics, self._planes, self._names = statics, records(len(offset), PLANE), names
        # copies in another type are made anew each time: what they were made of may have changed
        same = capsules is static and normal.dtype == offset.dtype == np.float64
        self._shown = (static, planes) if same else (None, None)
        self._fixtures = fixtures

    def confirm(self, state: Array, wanted: Array, watch: Watch, amend: Callable[[int, Array], Array]) -> Verdict:
        """The wanted jerk (n,) if its stop is verified; else half way to the stored stop's; else the stored stop's.

        What stands in the way concerns one capsule, and only the joints that carry it. Before all joints are slowed
        down, another jerk is asked for, once, with which only these go on with the stored stop: a hand near the base
        shall not keep the arm from folding away.

        Args:
            state: Shape (3, n).
            wanted: Shape (n,) [rad/s³], finite.
            watch: The people, from :meth:`watch`, without a fault.
            amend: Called with a number of joints, counted from the base, and the stored stop's jerk (n,); the jerk
                wanted if those joints have to go on with that.
        """
        people = watch.human
        params, n = self.params, self.robot.n
        if len(self._agents) != len(people.radius):
            self._agents, self._reach = records(len(people.radius), AGENT), np.empty(len(people.radius))
        jerk, reach = np.empty(n), self._reach
        load_people(
            people.start,
            people.end,
            people.radius,
            self._growth,
            watch.age,
            params.actuation_lag,
            params.position_error + self._astray,
            self._agents,
            reach,
        )
        which, code, row, column, moment = self._choose(state, wanted, reach, jerk)
        reason = self._describe(code, row, column, moment, people)
        carried = int(self.robot.capsules[row]["link"]) + 1 if row >= 0 else n
        proposed = which == 0
        if not proposed:
            halt = np.empty(n)
            stop_jerk(self._stored, self._tick, halt)
            if carried < n:
                which = self._choose(state, amend(carried, halt), reach, jerk)[0]
            if which == 2 and not self._verified:
                # the stop of an arm that was found in motion: perhaps it can be verified by now
                which = self._choose(state, halt, reach, jerk)[0]
        if which == 2:
            self._tick += 1
        else:
            self._stored, self._next = self._next, self._stored
            self._tick, self._verified, self._rests = 0, True, False
        self._joints.expected, self._after = self._after, self._joints.expected
        return Verdict(jerk, proposed, reason, self._verified)

    def _choose(self, state: Array, wanted: Array, reach: Array, jerk: Array) -> tuple[int, int, int, int, float]:
        """:func:`~jssa_gym.kernels.verification.choose`, into ``jerk``, ``self._after`` and ``self._next``."""
        return choose(
            self.robot.links,
            self.robot.capsules,
            self._levers,
            self.robot.self_pairs,
            state,
            wanted,
            self._stored,
            self._tick,
            self._bounds,
            self.dt,
            self._agents,
            reach,
            self._growth,
            self._touch,
            self._statics,
            self._planes,
            self._astray,
            jerk,
            self._after,
            self._next,
            self._posture,
            self._fastest,
            self._frames,
            self._segments,
        )

    def _outside(self) -> str:
        """Which joint is where it should not be, or nothing."""
        position, (low, high) = self.expected[0], self._bounds[:2]
        for j in np.flatnonzero((position < low) | (position > high))[:1]:
            name = self.robot.joint_names[j]
            return f": {name} is at {position[j]:.4g} rad, outside [{low[j]:.4g}, {high[j]:.4g}] rad"
        return ""

    def _describe(self, code: int, row: int, column: int, moment: float, people: CapsuleSet) -> str:
        if code == 0:
            return ""
        if code == LIMITS:
            return f"no stop inside the joint limits{self._outside()}"
        if row < 0:
            return "its stop takes too many checks"
        part, when = self.robot.capsule_names[row], f"{moment:.3f} s"
        planes, statics = self._names
        if code == REACH:
            return f"{people.names[column]} can reach {part} before it rests, in {when}"
        if code == HALF_SPACE:
            return f"{part} would meet {planes[column]} in {when}"
        if code == STATIC:
            return f"{part} would meet {statics[column]} in {when}"
        if code == SELF:
            return f"{part} would meet {self.robot.capsule_names[column]} in {when}"
        raise ValueError(f"unknown code {code}")
