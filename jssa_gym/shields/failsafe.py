"""The outermost layer of a filter: nothing is applied that a verified stop does not follow."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jssa_gym.kernels.compiled import announce_compilation
from jssa_gym.kernels.motion import integrate, violates
from jssa_gym.kernels.records import AGENT, FRAME, PLANE, SEGMENT, STOP, records
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.kernels.verification import (
    HALF_SPACE,
    LIMITS,
    REACH,
    REST,
    SELF,
    STATIC,
    choose,
    deviates,
    load_fixtures,
    load_people,
)
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams, levers
from jssa_gym.safety.monitor import HumanMonitor, Watch
from jssa_gym.safety.proximity import records_for
from jssa_gym.types import Array, CapsuleSet, Scene

_ROUNDING = 1e-9
"""Share of the joint limits by which an arm at rest may be beyond them."""

_STRAY = 1e-6
"""Share of the joint limits by which the arm may be elsewhere than the last jerk must have led."""


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
        self._stored, self._next = records(n, STOP), records(n, STOP)
        self._expected, self._after = np.zeros((3, n)), np.zeros((3, n))
        self._posture, self._fastest = np.zeros((3, n)), np.zeros(n)
        self._frames, self._segments = records(n, FRAME), records(len(robot.capsules), SEGMENT)
        self._agents, self._statics, self._planes = records(0, AGENT), records(0, AGENT), records(0, PLANE)
        self._begin()

    def _begin(self) -> None:
        self._monitor: HumanMonitor | None = None
        self._growth = self._touch = np.zeros(0)
        self._time, self._tick, self._verified = math.nan, 0, False
        # people's clock: the scene's, set forward where that one does not keep up with the ticks
        self._seen, self._ahead, self._due = math.nan, 0.0, 0

    def reset(self, state: Array) -> None:
        """Forget the past; the arm is in ``state`` (3, n)."""
        self._begin()
        self._replan(state)

    @property
    def verified(self) -> bool:
        """Whether the stored stop is verified, or the arm rests inside its limits."""
        return self._verified

    def _replan(self, state: Array) -> None:
        """Make the stop from ``state`` the stored one; nobody has verified it, unless there is nothing to stop."""
        self._expected[:] = state
        plan_stop(state, self._bounds, self.dt, self._stored)
        self._tick = 0
        still = np.zeros(self.robot.n)
        self._verified = bool(np.all(np.abs(state[1:]) < REST)) and not violates(state, still, self._bounds, _ROUNDING)

    def watch(self, scene: Scene) -> Watch:
        """What can be believed about the people; never raises."""
        if self._monitor is None:
            try:
                names = scene.human.names
                self._growth = np.array([self.params.speed_of(name) for name in names], np.float64)
                self._touch = np.array([self.params.contact_speed_of(name) for name in names], np.float64)
                self._monitor = HumanMonitor(
                    self._growth if len(names) else self.params.human_speed,
                    position_error=self.params.position_error,
                    max_age=self.params.max_age,
                )
            except Exception as error:  # whatever a perception system delivers, the arm must go on safely
                return Watch(scene.human, np.zeros(0), True, f"the people cannot be read: {error}")
        return self._monitor.update(self._clock(scene.time), scene.human, scene.age, scene.valid)

    def _clock(self, time: Any) -> Any:
        """The scene's time, but never behind the ticks: people move on though a clock stands still."""
        self._due += 1
        try:
            now = float(time)
        except Exception:  # whatever a perception system delivers, the arm must go on safely
            return time
        # a reading that is none, or went back, does not count: the ticks since the last that does are still due
        if now < self._seen or not math.isfinite(now):
            return time
        gap, due = now - self._seen, self.dt * self._due
        self._seen, self._due = now, 0
        if gap < due * (1.0 - 1e-6):
            self._ahead += due - gap
        return now + self._ahead

    def follow(self, state: Array, scene: Scene) -> str:
        """Compare the arm with where the last jerk must have led; what is wrong, or nothing. Never raises.

        Ticks in which no decision was made, as the clock has it, must have gone on with the stored stop. An arm that
        is elsewhere gets a new stop from where it is, which is not verified; where only the clock is wrong the stored
        one stays.
        """
        try:
            time = float(scene.time)
        except Exception:  # whatever a perception system delivers, the arm must go on safely
            time = math.nan
        late = (time - self._time) / self.dt
        forward = math.isfinite(time) and not late <= 0.0
        self._time = time if forward else self._time + self.dt
        due = max(round(min(late, 1e4)), 1) if forward and late > 0.0 else 1
        for passed in range(1, due + 1):
            if not deviates(state, self._expected, self._bounds, _STRAY):
                if passed == due or np.all(np.abs(state[1:]) < REST):
                    return ""
                return "the clock leapt ahead of the arm"
            self._advance()
        self._replan(state)
        return "the joint state is not where the last jerk led"

    def _advance(self) -> Array:
        """The stored stop's next jerk; the arm is taken to follow it."""
        jerk = np.empty(self.robot.n)
        stop_jerk(self._stored, self._tick, jerk)
        integrate(self._expected, jerk, self.dt, self._expected)
        self._tick += 1
        return jerk

    def stop(self, blind: bool) -> Array:
        """Go on with the stored stop: its next jerk, shape (n,) [rad/s³]; ``blind`` if :meth:`follow` was not asked."""
        if blind:
            self._time += self.dt
            self._due += 1
        return self._advance()

    def confirm(
        self, scene: Scene, state: Array, wanted: Array, watch: Watch, amend: Callable[[int, Array], Array]
    ) -> Verdict:
        """The wanted jerk (n,) if its stop is verified; else half way to the stored stop's; else the stored stop's.

        What stands in the way concerns one capsule, and only the joints that carry it. Before all joints are slowed
        down, another jerk is asked for, once, with which only these go on with the stored stop: a hand near the base
        shall not keep the arm from folding away.

        Args:
            scene: The present; of it the static agents are read. Raises if they cannot be.
            state: Shape (3, n).
            wanted: Shape (n,) [rad/s³], finite.
            watch: The people, from :meth:`watch`, without a fault.
            amend: Called with a number of joints, counted from the base, and the stored stop's jerk (n,); the jerk
                wanted if those joints have to go on with that.
        """
        static, planes, people = scene.static, scene.planes, watch.human
        self._statics = records_for(static, self._statics)
        if planes.normal.shape != (len(planes.offset), 3):
            raise ValueError(f"{len(planes.offset)} half-spaces with normals of shape {planes.normal.shape}")
        if len(self._planes) != len(planes.offset):
            self._planes = records(len(planes.offset), PLANE)
        if not load_fixtures(
            static.start, static.end, static.radius, planes.normal, planes.offset, self._statics, self._planes
        ):
            raise ValueError("a static capsule or half-space is not finite, or a normal is no unit vector")
        self._agents, params, n = records_for(people, self._agents), self.params, self.robot.n
        jerk, halt, reach = np.empty(n), np.empty(n), np.empty(len(self._agents))
        load_people(
            people.start,
            people.end,
            people.radius,
            self._growth,
            watch.age,
            params.actuation_lag,
            params.position_error + params.tracking_error,
            self._agents,
            reach,
        )
        which, code, row, column, moment = self._choose(state, wanted, reach, jerk)
        reason = self._describe(code, row, column, moment, scene, people)
        carried = int(self.robot.capsules[row]["link"]) + 1 if row >= 0 else n
        proposed = which == 0
        if not proposed:
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
            self._tick, self._verified = 0, True
        self._expected, self._after = self._after, self._expected
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
            self.params.tracking_error,
            jerk,
            self._after,
            self._next,
            self._posture,
            self._fastest,
            self._frames,
            self._segments,
        )

    def _describe(self, code: int, row: int, column: int, moment: float, scene: Scene, people: CapsuleSet) -> str:
        if code == 0:
            return ""
        if code == LIMITS:
            return "no stop inside the joint limits"
        if row < 0:
            return "its stop takes too many checks"
        part, when = self.robot.capsule_names[row], f"{moment:.3f} s"
        if code == REACH:
            return f"{people.names[column]} can reach {part} before it rests, in {when}"
        if code == HALF_SPACE:
            return f"{part} would meet {scene.planes.names[column]} in {when}"
        if code == STATIC:
            return f"{part} would meet {scene.static.names[column]} in {when}"
        if code == SELF:
            return f"{part} would meet {self.robot.capsule_names[column]} in {when}"
        raise ValueError(f"unknown code {code}")
