"""What a shield believes about people: the last measurements that can be trusted, and how old they are."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import nobody
from jssa_gym.kernels.records import TRACK, records
from jssa_gym.kernels.trust import COVERED, LOST, NEVER, trust
from jssa_gym.types import Array, CapsuleSet
from jssa_gym.validation import number_within, positive_number

_VERDICTS = (
    "too old",
    "not measured",
    "older than one before",
    "frozen: the same again though it claims to move",
    "jumped farther than it can have moved",
    "of another person than before",
    "from the future",
    "not finite",
    "without a radius",
)


class Watch(NamedTuple):
    """What can be relied on in one tick."""

    human: CapsuleSet
    """The last trusted measurement of each capsule, NaN where there never was one; arrays of its own."""
    age: Array
    """How long ago each was measured, shape (m,) [s]; inf for never. Where a body part can be by now: no end farther
    from its trusted place than its speed bound times this age plus the position error."""
    fault: bool
    """Whether that does not cover everybody: the arm has to stop."""
    reason: str
    """What is wrong with the capsule that is worst off, fault or not; empty if all are fresh and plausible."""

    fresh: bool = False
    """Whether all were measured at this very moment."""

    def present(self) -> CapsuleSet:
        """People moved on at their measured velocities from when they were measured: what rows are about."""
        if self.fresh:
            return self.human
        human, late = self.human, self.age[:, None]
        start, end = human.start + late * human.start_velocity, human.end + late * human.end_velocity
        return human._replace(start=start, end=end)


_FLOAT64, _INT64, _BOOL = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)


def _unlike(human: Any, age: Any, valid: Any) -> str:
    """Which of the people's arrays is none, or masked; empty if all are arrays."""
    fields = ("start", "end", "start_velocity", "end_velocity", "radius", "person")
    parts = {**{name: getattr(human, name, None) for name in fields}, "age": age, "valid": valid}
    for name, part in parts.items():
        if isinstance(part, np.ma.MaskedArray):
            return f"{name} is masked"
        if not isinstance(part, np.ndarray):
            return f"{name} is of type {type(part).__name__}, no array"
    return ""


class HumanMonitor:
    r"""Believes a measurement only if it can be true, and lets the last believed one age meanwhile.

    For each capsule it keeps the last trusted sample and its stamp (time minus age). In every tick:

    ==================================================  ==========================================================
    the new sample                                      what happens
    ==================================================  ==========================================================
    belongs to another person than before               not taken, fault
    not valid                                           not taken
    valid, but a number, the radius or the age is no    not taken, fault: the source cannot be relied on
    finite one, or the age or the radius is negative
    is bit for bit the last one, which claimed to       its stamp is the one it had at first: the age counts from
    move faster than 0.05 m/s                           there, however fresh it is said to be
    has an older stamp than the trusted one             not taken
    has an end farther from the trusted one than        not taken; the bound grows with time, so that what is
    :math:`\hat v\,\Delta t + 2\epsilon` (1 µm for      right is taken again in the end
    rounding), a change of the radius added
    anything else, and the first of all                 trusted from now on
    ==================================================  ==========================================================

    A capsule is covered while its trusted sample is not older than ``max_age``; a fault is one that is not, or never
    was. Another number of capsules or other names than at first, arrays that cannot be read, and a clock that runs
    backwards or is not finite are faults too, and nothing is taken; only :meth:`reset` accepts other people.

    If nobody moves faster than :math:`\hat v` and each sample's error is at most :math:`\epsilon` at a stamp that is
    right (or too old), each end is within :math:`\hat v\cdot\text{age} + \epsilon` of its trusted place (1 µm for
    rounding left aside). Of sources that lie, jumps and freezes of people who moved are seen; not a wrong first
    sample, a lie that is slower than a person, one that lasts long enough to be possible, or a freeze of somebody
    who stood still.

    Args:
        speed: Bound :math:`\hat v` on the speed of any point of a body part, one for all or shape (m,) [m/s].
        position_error: Bound :math:`\epsilon` on the error of a measured end [m].
        max_age: How old a trusted sample may be [s].

    Raises:
        ParameterError: A parameter is out of range.
    """

    def __init__(self, speed: float | ArrayLike = 2.0, *, position_error: float = 0.0, max_age: float = 0.2) -> None:
        self.speed = np.array(speed, np.float64)
        if self.speed.ndim > 1 or not np.all((self.speed > 0.0) & np.isfinite(self.speed)):
            raise ParameterError(f"speed has to be positive numbers, one for all or one a capsule, got {speed!r}")
        self.position_error = number_within("position_error", position_error, 0.0)
        self.max_age = positive_number("max_age", max_age)
        self.reset()

    def reset(self) -> None:
        """Forget everybody: whoever is measured next is who there is."""
        self._time = -math.inf
        self._people = nobody()
        self._begun = False
        self._allocate(0)

    def update(self, scene_time: float, human: CapsuleSet, age: Array, valid: NDArray[np.bool_]) -> Watch:
        """Judge one tick's measurements; never raises, whatever they are.

        Args:
            scene_time: The present [s].
            human: The measured capsules.
            age: Of each capsule's measurement, shape (m,) [s].
            valid: Whether each was measured, shape (m,).
        """
        try:
            time = float(scene_time)
            if not -math.inf < time < math.inf:
                raise ValueError(f"the time is {time}")
            if not time >= self._time:
                raise ValueError(f"the time went back from {self._time:g} s to {time:g} s")
            self._read(human, age, valid)
        except Exception as error:  # whatever a perception system delivers, the arm must go on safely
            return self.miss(scene_time, f"the people cannot be read: {_unlike(human, age, valid) or error}")
        self._time = time
        return self._judged(time, "")

    def _read(self, human: CapsuleSet, age: Array, valid: NDArray[np.bool_]) -> None:
        """Copy a sample to where the kernel reads it.

        Raises:
            ValueError, TypeError, AttributeError: It does not fit.
        """
        shape, names = human.radius.shape, human.names
        ends = (*shape, 3)
        if not (
            len(shape) == 1
            and human.start.shape == human.end.shape == human.start_velocity.shape == human.end_velocity.shape == ends
            and human.person.shape == age.shape == valid.shape == shape
            and len(names) == shape[0]
        ):
            raise ValueError("the arrays' shapes do not fit together")
        if not self._begun:
            if self.speed.ndim == 1 and self.speed.shape != shape:
                raise ValueError(f"{shape[0]} capsules for {len(self.speed)} speed bounds")
            self._allocate(shape[0])
        elif self._people.radius.shape != shape:
            raise ValueError(f"{shape[0]} capsules instead of {len(self._people.radius)}")
        elif self._people.names != tuple(names):
            raise ValueError("the capsules have other names than before")
        start, end, start_velocity, end_velocity, radius = human[:5]
        if not (
            type(start) is type(end) is type(start_velocity) is type(end_velocity) is type(radius) is np.ndarray
            and type(human.person) is type(age) is type(valid) is np.ndarray
        ) and (wrong := _unlike(human, age, valid)):
            raise ValueError(wrong)
        # into arrays of one's own: of the type that the kernel is compiled for, whatever comes
        ends = self._ends
        if (
            start.dtype is end.dtype is start_velocity.dtype is end_velocity.dtype is _FLOAT64
            and radius.dtype is age.dtype is _FLOAT64
            and valid.dtype is _BOOL
            and human.person.dtype is _INT64
        ):
            ends[0], ends[1], ends[2], ends[3] = start, end, start_velocity, end_velocity
            self._radius[:], self._age[:], self._valid[:], self._person[:] = radius, age, valid, human.person
        else:  # slower, but raises for what is no number
            for mine, theirs in zip((*ends, self._radius, self._age), (*human[:5], age), strict=True):
                np.copyto(mine, theirs)
            np.copyto(self._valid, valid)
            np.copyto(self._person, human.person)
        if not self._begun:
            self._tracks["person"] = self._person
            empty = self._ends[0].copy()
            self._people = CapsuleSet(
                empty, empty, empty, empty, self._radius.copy(), tuple(names), self._person.copy()
            )
            self._begun = True

    def _allocate(self, m: int) -> None:
        self._ends, self._radius, self._age = np.zeros((4, m, 3)), np.zeros(m), np.zeros(m)
        self._valid, self._person = np.zeros(m, np.bool_), np.zeros(m, np.int64)
        self._tracks = records(m, TRACK)
        self._tracks["trusted"] = self._tracks["seen"] = self._tracks["radius"] = np.nan
        self._tracks["stamp"] = self._tracks["first"] = -np.inf
        if m:
            self._tracks["speed"] = self.speed

    def miss(self, scene_time: Any, reason: str) -> Watch:
        """A tick in which nothing can be read: all that is trusted ages."""
        try:
            time = float(scene_time)
        except Exception:
            time = math.nan
        if not self._begun:
            self._allocate(0)
        self._valid[:] = False
        # of a time that is none, nobody knows how late it is
        return self._judged(max(time, self._time) if math.isfinite(time) else math.inf, reason)

    def _judged(self, time: float, blind: str) -> Watch:
        m = len(self._radius)
        out, radius, age = np.empty((4, m, 3)), np.empty(m), np.empty(m)
        worst, verdict, cover, fresh = trust(
            time,
            self._ends,
            self._radius,
            self._age,
            self._valid,
            self._person,
            self.position_error,
            self.max_age,
            self._tracks,
            out,
            radius,
            age,
        )
        people = self._people
        human = CapsuleSet(*out, radius, people.names, people.person)
        if blind:
            return Watch(human, age, True, blind, fresh)
        if worst < 0:
            return Watch(human, age, False, "", fresh)
        reason = f"{people.names[worst]} of person {people.person[worst]}: {_VERDICTS[verdict]}"
        if cover == LOST:
            reason += f", nothing to trust for {age[worst]:.3g} s"
        elif cover == NEVER:
            reason += ", nothing to trust yet"
        return Watch(human, age, cover != COVERED, reason, fresh)
