"""What a shield believes of joints and of people, each by itself: the control step's own functions, one at a time."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from jssa_gym.humans import nobody
from jssa_gym.kernels.joints import deviates
from jssa_gym.kernels.records import CAPSULE, LINK, records
from jssa_gym.kernels.verification import SAFE
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.reading import Reading
from jssa_gym.shields.records import ONE, Records
from jssa_gym.shields.words import Told, fault_in_words
from jssa_gym.tick import admit, joints, layout, loop, people
from jssa_gym.tick.assumed import Assumed
from jssa_gym.tick.proposals.nothing import Nothing
from jssa_gym.types import CapsuleSet, Planes, Scene

_NO_PLANES = Planes(np.zeros((0, 3)), np.zeros(0), ())


@njit
def _read(arms):
    return joints.read(arms.settings, arms.memory, arms.scene, 0)


@njit
def _judge(arms, form):
    return joints.judge(arms.settings, arms.memory, arms.scene, form, 0)


@njit
def _persistent(arms):
    return joints.persistent(arms.memory, 0)


@njit
def _update(arms, time):
    told = arms.answer.told[0]
    told["detail"], told["other"], told["moment"] = 0, -1, 0.0
    return people._update(arms.settings, arms.memory, arms.scene, time, arms.work, arms.answer, 0)


@njit
def _present(arms):
    people.people_now(arms.memory, arms.work, arms.answer, 0)


def _records(n: int, limits, dt: float, tolerance, position_error: float, max_age: float) -> Records:
    arm = layout.ArmRecord(records(n, LINK), records(0, CAPSULE), np.zeros((0, 2), np.int64), np.zeros((0, n)), limits)
    settings = layout.StepSettings(
        dt=dt, guarded=True, viability=False, static_rows=False, diagonal=True, weight=np.ones(n), inverse=np.eye(n),
        stop_limits=limits, hardness=np.ones(1), soft_limits=np.array(limits)[None],
        tolerance=tolerance, position_error=position_error, max_age=max_age, lag=0.0, astray=0.0,
    )  # fmt: skip
    return Records(arm, settings, Nothing())


class _Shown(NamedTuple):
    """A scene without people."""

    robot: object
    time: object


class JointMonitor:
    """Whether readings of the joints are where the applied jerks must have led."""

    def __init__(self, bounds, dt, tolerance):
        self.records = _records(bounds.shape[1], np.array(bounds), dt, np.array(tolerance), 0.0, 0.2)
        exact = bool(np.any(tolerance == 0.0))
        self.reading = Reading(
            self.records, False, exact, False, lambda names: Assumed(*np.zeros((2, 0, 2)), *np.zeros((2, 0)))
        )
        self.reset(None)

    @property
    def expected(self):
        return self.records.memory.expected[0]

    @property
    def begun(self):
        return bool(self.records.memory.arm[0]["begun"])

    @property
    def persistent(self):
        return _persistent(self.records.view.arms)

    def reset(self, robot):
        self.reading.read(_Shown(robot, 0.0))
        loop.start(self.records.view.arms, ONE)
        self.reading.forget()

    def read(self, robot, time):
        self.reading.read(_Shown(robot, time))
        return _read(self.records.view.arms)

    def judge(self, form):
        code, ticks = _judge(self.records.view.arms, form)
        return "" if code == 0 else _in_words(self, code, ticks)

    def agrees(self, state, expected):
        settings = self.records.settings
        return not deviates(state, expected, settings.stop_limits, settings.tolerance)


def _in_words(monitor, code, ticks=0):
    told = Told(*monitor.records.answer.told.item())
    return fault_in_words(told._replace(code=code, ticks=ticks), monitor.records, monitor.reading)


class Watch(NamedTuple):
    """What can be relied on in one tick."""

    human: CapsuleSet
    age: np.ndarray
    fault: bool
    reason: str
    fresh: bool
    moved: CapsuleSet

    def present(self):
        """People moved on to the present."""
        return self.moved


class HumanMonitor:
    """Which measurements of people are believed."""

    def __init__(self, speed=2.0, *, position_error=0.0, max_age=0.2, acceleration=0.0, velocity_error=0.0):
        self.speed, self.acceleration, self.velocity_error = speed, acceleration, velocity_error
        self.records = _records(1, np.ones((5, 1)), 0.008, np.zeros((3, 1)), position_error, max_age)
        self.reading = Reading(self.records, False, True, False, self._assumed)
        self.reset()

    def _assumed(self, names):
        speed = np.asarray(self.speed, float)
        speed = np.broadcast_to(speed[..., None] if speed.ndim < 2 else speed, (len(names), 2))
        acceleration = np.full(len(names), self.acceleration)
        return Assumed(speed, speed, np.zeros(len(names)), acceleration, self.velocity_error)

    @property
    def steady(self):
        """Whether each capsule has kept its acceleration bound."""
        return self.records.memory.tracks[0]["steady"].tolist()

    def reset(self):
        self.reading.forget()
        self.reading.read(None)
        loop.start(self.records.view.arms, ONE)
        self.reading.forget()

    def update(self, time, human, age, valid):
        self.reading.read(Scene(time, None, human, nobody(), _NO_PLANES, age, valid))
        records = self.records
        arms, told = records.view.arms, records.answer.told
        try:
            now = float(time)
        except (TypeError, ValueError):
            now = math.nan
        code = _update(arms, now) if records.scene.now[0]["seen"] else 407
        told["code"] = code
        work, memory = records.work, records.memory
        shown = code or (411 + told[0]["sample"] if told[0]["other"] >= 0 else 0)
        reason = _in_words(self, shown) if shown else ""
        if code and not 410 < code < 420:
            # a tick in which nothing was taken: all that is trusted ages
            work.people[:] = np.moveaxis(memory.tracks[0]["trusted"], 1, 0)
            work.radius[:] = memory.tracks[0]["radius"]
            late = max(now, float(memory.arm[0]["people_time"])) if math.isfinite(now) else math.inf
            work.age[:] = late - memory.tracks[0]["stamp"]
        if not memory.arm[0]["met"]:
            return Watch(nobody(), np.zeros(0), True, reason, False, nobody())
        trusted = work.people.copy()
        _present(arms)
        agents, names = records.work.agents, self.reading.names or ()
        person = memory.tracks[0]["person"].copy()
        people = CapsuleSet(*trusted, work.radius.copy(), names, person)
        fields = ("start", "end", "start_velocity", "end_velocity", "radius")
        moved = CapsuleSet(*(agents[field].copy() for field in fields), names, person)
        return Watch(people, work.age.copy(), bool(code), reason, bool(told[0]["fresh"]), moved)


# ---- what a filter's verified stop remembers ----------------------------------------------------------


@njit
def _watch(arms):
    return people.check_people(arms.settings, arms.memory, arms.scene, arms.work, arms.answer, 0)


@njit
def _forget_people(arms):
    people.forget_people(arms.memory, 0)


@njit
def _keeps_safe(arms, jerk):
    return admit.keeps_safe(arms.robot, arms.settings, arms.memory, jerk, 0, arms.work, 0)


def stored(filter):
    """The stored stop, shape (n,) of ``STOP``."""
    return filter.records.memory.stored[0]


def step_of(filter) -> int:
    """How many of its ticks are over."""
    return int(filter.records.memory.arm[0]["step"])


def forget_people(filter) -> None:
    """Whoever comes now is who there is."""
    filter.reading.names, filter.reading._met = None, False
    _forget_people(filter.records.view.arms)


def watch(filter, scene) -> bool:
    """Look at the people of a scene, and at nothing else; whether they can be relied on."""
    return wrong_with_people(filter, scene) == 0


def wrong_with_people(filter, scene) -> int:
    """Look at the people of a scene, and at nothing else; the code of what is wrong with them, or 0."""
    filter.reading.read(scene)
    return _watch(filter.records.view.arms)


class Unsolvable(JSSAFilter):
    """Its compiled projection finds no solution after that: the metric of Eq. (14) is none."""

    def make_unsolvable(self) -> None:
        records = self.records
        records.settings = records.settings._replace(diagonal=False, inverse=-np.eye(self.robot.n))
        records.release()


def keeps_safe(filter, jerk) -> bool:
    """Whether a filter that has just decided would verify a jerk; the stop after it is in its ``work.next``."""
    return _keeps_safe(filter.records.view.arms, np.array(jerk, float))[0] == SAFE
