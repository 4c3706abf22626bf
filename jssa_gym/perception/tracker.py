"""Keypoints with confidence and stamps to people's capsules with ages, validity and errors."""

from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.perception.filtering import VelocityFilter, velocity_lag
from jssa_gym.perception.skeletons import BodyPart, KeypointTable, ancestors, make_skeleton
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Array, CapsuleSet, Scene
from jssa_gym.validation import check_fields, number_within, positive_number

_ROUNDING = 1e-9
"""Added to what a keypoint may have moved [m]."""

_NOBODY = -1
"""Person of every capsule once somebody is there whom nobody has announced: to a shield that is a fault at once."""


class Frame(NamedTuple):
    """What a detector found in one picture: p people of k keypoints."""

    stamp: float
    """When the picture was taken, by the scene's clock [s]."""
    person: Any
    """Ids, shape (p,)."""
    position: Any
    """Keypoints in the world, z up, the robot's base on the z axis, shape (p, k, 3) [m]; NaN where not found."""
    confidence: Any
    """In [0, 1], shape (p, k); 0 where not found."""


class Tracked(NamedTuple):
    """People as a :class:`~jssa_gym.types.Scene` has them, and how far they may be off."""

    human: CapsuleSet
    age: Array
    """Of each capsule's measurement, shape (m,) [s]; inf for what has never been seen."""
    valid: NDArray[np.bool_]
    """Shape (m,)."""
    position_error: Array
    """Largest error of each capsule's ends at its stamp, shape (m,) [m]; inf where an end is held by another joint:
    there only the age says how far it may be."""
    velocity_error: Array
    """The same of their velocities, shape (m,) [m/s]."""

    def shown_in(self, scene: Scene) -> Scene:
        """The scene with these people."""
        return scene._replace(human=self.human, age=self.age, valid=self.valid)


@dataclass(frozen=True, slots=True)
class TrackerParams:
    """How good a detector is, and what to do when it does not see.

    Raises:
        ParameterError: A number is out of range.
    """

    sure: float = 0.02
    """Largest error of a keypoint of confidence 1 [m]: a bound, no deviation. In between it is linear."""
    unsure: float = 0.10
    """The same at confidence 0 [m]."""
    hold: float = 1.0
    """How long a joint that is not seen is held by the limb that it ends [s]; then its parts are invalid."""
    acceleration: float = 10.0
    """No keypoint changes its velocity faster [m/s²]: what the filter expects, and ``velocity_error`` relies on."""
    deviation: float = 0.5
    """Standard deviation of a keypoint's error along an axis, as a share of its largest error."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sure", positive_number("sure", self.sure))
        object.__setattr__(self, "unsure", number_within("unsure", self.unsure, self.sure))
        object.__setattr__(self, "hold", number_within("hold", self.hold, 0.0))
        check_fields(self, ("acceleration", "deviation"), positive_number)

    def lag(self, rate: float) -> float:
        """By how much time velocities lag behind a steady acceleration at so many frames a second [s].

        Raises:
            ParameterError: The rate is not positive.
        """
        return velocity_lag(positive_number("rate", rate), self.sure, self.acceleration, self.deviation)


class Tracker:
    """Follows people whose ids are known, from frame to frame.

    A keypoint is believed if it is finite, sure enough for the shield's ``position_error``, and no farther from where
    it was last believed than a person moves in the time between. Of several people, all of a person's have to be so,
    and one that could as well be somebody else's counts only if theirs is believed too: whoever is called by whose
    name, everybody is where somebody is said to be. Capsules are *measurements*: a part is as old as the last frame in
    which all that it needs was believed. Positions are the filter's, but never farther from what was measured than
    ``position_error`` leaves room for; velocities are the filter's.

    A joint of an arm or leg that is not seen is within its limb's length ℓ of the joint that it hangs on. It is then
    reported there, as old as somebody at the speed bound v of its part takes for that length, ℓ/v: what a shield makes
    of that, the ball of radius ℓ and what it grows by, contains the joint. That is so for ``hold`` at the longest, for
    no part with a bound on its acceleration, and only where that is younger than what was measured and no jump: from
    about 2 ℓ/v after the joint was seen. Until then the part is what was measured.

    Nothing that a detector delivers makes it raise: a frame of other shapes, without a stamp or older than the last one
    is left out, and parts grow older. Whoever is not among ``people`` makes everybody somebody else's until ``reset``,
    which to a shield is a fault: it would have to know who came.

    Args:
        skeleton: The detector's keypoints, or a name in :data:`~jssa_gym.perception.SKELETONS`.
        assumed: What the shield assumes: its ``position_error`` is what is promised here, its speeds what is believed.
        people: Ids of everybody who will be seen.
        body: ``"jointed"`` or ``"six"``, see :meth:`~jssa_gym.perception.KeypointTable.body`.
        params: Of the detector.

    Raises:
        ParameterError: A value is unknown or out of range, or ``position_error`` is so small that nothing would ever be
            believed.
    """

    def __init__(
        self,
        skeleton: str | KeypointTable,
        assumed: FailsafeParams,
        people: Iterable[int] = (0,),
        *,
        body: str = "jointed",
        params: TrackerParams | None = None,
    ) -> None:
        self.skeleton = make_skeleton(skeleton)
        self.params = TrackerParams() if params is None else params
        self.parts = self.skeleton.body(body)
        self.people = _checked_people(people)
        self.assumed = assumed
        if not isinstance(assumed, FailsafeParams):
            raise ParameterError(f"assumed has to be FailsafeParams, those of the shield, got {assumed!r}")
        if assumed.position_error < self.params.sure:
            raise ParameterError(
                f"a position_error of {assumed.position_error} m is less than the {self.params.sure} m of the surest "
                "keypoint: no keypoint would be believed; give the shield FailsafeParams(position_error=...) of at "
                "least that"
            )
        self._names = tuple(part.name for part in self.parts) * len(self.people)
        self._person = np.repeat(np.array(self.people, np.int64), len(self.parts))
        self._radius = np.tile([part.radius for part in self.parts], len(self.people))
        self._joints = {
            joint: np.array([self.skeleton.keypoints.index(point) for point in points])
            for joint, points in self.skeleton.joints.items()
        }
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self.refused = ""
        """Why the last frame was left out; empty if it was not."""
        self.stamp = -np.inf
        """Of the last frame that was not left out [s]."""
        self._stranger = False
        self._bodies = tuple(_TrackedBody(self) for _ in self.people)

    def update(self, frame: Frame) -> bool:
        """Take in a frame; whether it was not left out. Never raises."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # of numbers that nothing is as far as
                self.refused = self._take(frame)
        except Exception as error:  # whatever a detector delivers, the arm must go on safely
            self.refused = f"the frame cannot be read: {error or type(error).__name__}"
        return not self.refused

    def _take(self, frame: Frame) -> str:
        stamp, ids = float(frame.stamp), np.asarray(frame.person)
        position = np.asarray(frame.position, np.float64)
        confidence = np.asarray(frame.confidence, np.float64)
        shape = (len(ids), len(self.skeleton.keypoints))
        if ids.ndim != 1 or position.shape != (*shape, 3) or confidence.shape != shape:
            return f"positions {position.shape} and confidences {confidence.shape} do not fit {shape} keypoints"
        if ids.size and ids.dtype.kind not in "iu":
            return f"ids have to be integers, they are {ids.dtype}"
        if not np.isfinite(stamp):
            return f"its stamp is {stamp}"
        if not stamp > self.stamp:
            return f"its stamp {stamp:g} s is not after {self.stamp:g} s"
        found = ids.tolist()
        self._stranger = self._stranger or not set(found) <= set(self.people)
        looks = []
        for person, one in zip(self.people, self._bodies, strict=True):
            # of two who are called alike neither can be known to be the one
            rows = found.index(person) if found.count(person) == 1 else None
            nothing = np.full(position.shape[1:], np.nan), np.zeros(confidence.shape[1])
            looks.append(one.look(*(nothing if rows is None else (position[rows], confidence[rows]))))
        for one, look, believed in zip(self._bodies, looks, self._believed(stamp, looks), strict=True):
            one.update(stamp, look, believed)
        self.stamp = stamp
        return ""

    def _believed(self, stamp: float, looks: list["_Look"]) -> list[NDArray[np.bool_]]:
        """Which keypoints of everybody are believed, shape (k,) each.

        Where a keypoint could be somebody else's, it is believed only if theirs is seen as well, where it can be: if
        the two are exchanged, each is still where one of the two is said to be.
        """
        bodies = self._bodies
        inside = [one.can_be(stamp, look) for one, look in zip(bodies, looks, strict=True)]
        if len(bodies) == 1:
            return [looks[0].seen & inside[0]]
        # of somebody of whom something cannot be, nothing is believed: it may be somebody else
        whole = [look.seen & (inside[i] | ~look.seen).all() for i, look in enumerate(looks)]
        doubt = {
            (i, j): look.seen & other.can_be(stamp, look, known=True)
            for i, look in enumerate(looks)
            for j, other in enumerate(bodies)
            if j != i
        }
        for _ in bodies:
            for (i, j), mistaken in doubt.items():
                whole[i] &= ~mistaken | whole[j]
        return whole

    def at(self, now: float) -> Tracked:
        """Everybody as known at a moment [s]; never raises."""
        seen = [_stacked([getattr(one, name) for one in self._bodies]) for name in _REPORTED]
        ends, velocities, stamp, usable, position_error, velocity_error = seen
        age = np.where(np.isfinite(stamp), now - stamp, np.inf)
        valid = usable.astype(np.bool_) & np.isfinite(age) & (not self._stranger)
        person = np.full_like(self._person, _NOBODY) if self._stranger else self._person.copy()
        human = CapsuleSet(
            ends[:, 0].copy(),
            ends[:, 1].copy(),
            velocities[:, 0].copy(),
            velocities[:, 1].copy(),
            self._radius.copy(),
            self._names,
            person,
        )
        return Tracked(human, age, valid, position_error, velocity_error)


_REPORTED = ("ends", "velocities", "stamp", "usable", "position_error", "velocity_error")


def _stacked(arrays: list[Array]) -> Array:
    return np.concatenate(arrays) if arrays else np.zeros(0)


def _checked_people(people: Iterable[int]) -> tuple[int, ...]:
    try:
        ids = tuple(people)
    except TypeError:
        ids = ()
    integers = all(isinstance(one, Integral) and not isinstance(one, bool) and one >= 0 for one in ids)
    if not ids or len(set(ids)) < len(ids) or not integers:
        raise ParameterError(f"people has to be the ids of everybody, integers from 0 on, each once; got {people!r}")
    return tuple(int(one) for one in ids)


class _TrackedBody:
    """One person: what is known of the keypoints, and the capsules that follow from it."""

    def __init__(self, of: Tracker) -> None:
        self._parts, self._joints, self._params = of.parts, of._joints, of.params
        self._allowed, assumed = of.assumed.position_error, of.assumed
        count, m = len(of.skeleton.keypoints), len(of.parts)
        self._made_of = np.zeros((len(of._joints), count), np.bool_)
        for row, points in zip(self._made_of, of._joints.values(), strict=True):
            row[points] = True
        # of a head any point of the face will do
        self._needed = [1 if joint == "head" else len(points) for joint, points in of._joints.items()]
        speeds = np.array([assumed.end_speeds_of(part.name) for part in of.parts]).reshape(m, 2)
        self._speeds = speeds
        self._held = np.array([assumed.acceleration_of(part.name) == 0.0 for part in of.parts])
        fastest = float(speeds.max(initial=assumed.human_speed))
        self._speed = self._speeds_of_keypoints(of, fastest)
        self._filter = VelocityFilter(count, of.params.acceleration, fastest, of.params.deviation)
        self._last, self._last_error = np.full((count, 3), np.nan), np.zeros(count)
        self._last_stamp = np.full(count, -np.inf)
        self._now = -np.inf
        self.ends = np.full((m, 2, 3), np.nan)
        self.velocities = np.full((m, 2, 3), np.nan)
        self.stamp = np.full(m, -np.inf)
        self.usable = np.zeros(m, np.bool_)
        self.position_error, self.velocity_error = np.full(m, np.inf), np.full(m, np.inf)

    def _speeds_of_keypoints(self, of: Tracker, fastest: float) -> Array:
        """No keypoint is faster than any part that it is an end of allows, shape (k,) [m/s]."""
        found = np.full(len(of.skeleton.keypoints), fastest)
        for part, speeds in zip(of.parts, self._speeds, strict=True):
            for joint, speed in zip((part.start, part.end), speeds, strict=True):
                points = of._joints[joint]
                if len(points) == 1 or joint == "head":  # of two, one may be faster than their mean
                    found[points] = np.minimum(found[points], speed)
        return found

    # ---- keypoints -----------------------------------------------------------------------------------

    def look(self, position: Array, confidence: Array) -> "_Look":
        """What is to be seen of one frame's keypoints, shapes (k, 3) and (k,)."""
        params = self._params
        sure = np.where((confidence > 0.0) & (confidence <= 1.0), confidence, 0.0)
        error = params.unsure + sure * (params.sure - params.unsure)
        finite = np.asarray(np.isfinite(position).all(axis=1))
        seen = finite & (sure > 0.0) & (error <= self._allowed + _ROUNDING)
        return _Look(np.where(finite[:, None], position, 0.0), error, seen)

    def can_be(self, stamp: float, look: "_Look", known: bool = False) -> NDArray[np.bool_]:
        """Which keypoints are no farther from where they were believed than a person moves since, shape (k,).

        Of those that never were nobody can tell: they can be, unless they have to be ``known``.
        """
        there = np.isfinite(self._last_stamp)
        elapsed = np.where(there, stamp - self._last_stamp, 0.0)
        way = np.linalg.norm(look.position - np.where(there[:, None], self._last, look.position), axis=1)
        near = way <= self._speed * elapsed + look.error + self._last_error + _ROUNDING
        return near & there if known else near

    def update(self, stamp: float, look: "_Look", seen: NDArray[np.bool_]) -> None:
        """Take in one frame's keypoints, of which those in ``seen`` (k,) are believed."""
        position, error = look.position, look.error
        known = np.isfinite(self._last_stamp)
        elapsed = np.where(known, stamp - self._last_stamp, 0.0)
        anew = seen & ~(known & (elapsed <= self._params.hold))
        if np.isfinite(self._now):
            self._filter.advance(stamp - self._now, seen & ~anew, position, error)
        self._filter.begin(anew, position, error)
        self._last[seen], self._last_stamp[seen], self._last_error[seen] = position[seen], stamp, error[seen]
        self._now = stamp
        self._report(stamp, seen, position, error)

    def _report(self, stamp: float, seen: NDArray[np.bool_], position: Array, error: Array) -> None:
        """Make capsules of the keypoints that are believed."""
        # as far towards the filter's place as the promise leaves room for
        off = self._filter.position - position
        length = np.linalg.norm(off, axis=1)
        room = np.maximum(self._allowed - error, 0.0)
        share = np.minimum(1.0, room / np.maximum(length, 1e-12))
        place = position + share[:, None] * off
        error = np.where(seen, error + share * length, 0.0)
        joints = self._seen_joints(seen, place, error)
        for k, part in enumerate(self._parts):
            self._report_part(k, part, joints, stamp)

    def _seen_joints(self, seen: NDArray[np.bool_], place: Array, error: Array) -> dict[str, "_Joint"]:
        """The joints of which enough keypoints are believed, at the means of those."""
        of = self._made_of & seen
        count = of.sum(axis=1)
        share = of / np.maximum(count, 1)[:, None]
        position = share @ np.where(seen[:, None], place, 0.0)
        velocity = share @ self._filter.velocity
        worst = np.minimum((of * error).max(axis=1), self._allowed).tolist()
        velocity_error = (of * self._filter.velocity_error).max(axis=1).tolist()
        return {
            joint: _Joint(position[k], velocity[k], worst[k], velocity_error[k])
            for k, joint in enumerate(self._joints)
            if count[k] >= self._needed[k]
        }

    def _report_part(self, k: int, part: BodyPart, joints: dict[str, "_Joint"], stamp: float) -> None:
        found = [
            self._joint_of(joint, joints, self._speeds[k, end]) for end, joint in enumerate((part.start, part.end))
        ]
        ends = [one for one in found if one is not None]
        if len(ends) == 2:
            late = max(extra for _, extra in ends)
            held = late > 0.0
            if not held or self._may_hold(k, part, [joint.position for joint, _ in ends], stamp - late, stamp):
                for i, (joint, _) in enumerate(ends):
                    self.ends[k, i], self.velocities[k, i] = joint.position, joint.velocity
                # a held end is somewhere within its limb's length, which is what its age stands for
                self.position_error[k] = np.inf if held else max(joint.position_error for joint, _ in ends)
                self.velocity_error[k] = np.inf if held else max(joint.velocity_error for joint, _ in ends)
                self.stamp[k] = stamp - late
        self.usable[k] = self.stamp[k] > -np.inf and self._recent(part, stamp)

    def _joint_of(self, joint: str, joints: dict[str, "_Joint"], speed: float) -> tuple["_Joint", float] | None:
        """A joint, and how much older it has to be called [s]; None if nothing tells where it is."""
        if joint in joints:
            return joints[joint], 0.0
        return next(
            ((joints[other], length / speed) for other, length in ancestors(joint) if other in joints),
            None,
        )

    def _may_hold(self, k: int, part: BodyPart, ends: list[Array], stamp: float, now: float) -> bool:
        """Whether a held part is younger than what was measured, and its ends are where those can have come to."""
        younger = stamp - self.stamp[k]
        if not (self._held[k] and younger > 0.0 and self._recent(part, now)):
            return False
        # a shield believes no capsule that jumps: until then what was measured serves it better
        moved = [float(np.linalg.norm(end - before)) for end, before in zip(ends, self.ends[k], strict=True)]
        return all(way <= speed * younger for way, speed in zip(moved, self._speeds[k], strict=True))

    def _recent(self, part: BodyPart, stamp: float) -> bool:
        """Whether all that a part needs was seen within the time for which it is held."""
        return all(stamp - self._joint_stamp(joint) <= self._params.hold for joint in (part.start, part.end))

    def _joint_stamp(self, joint: str) -> float:
        stamps = self._last_stamp[self._joints[joint]]
        return float(stamps.max() if joint == "head" else stamps.min())


class _Look(NamedTuple):
    """Keypoints of one person in a frame."""

    position: Array
    """Shape (k, 3) [m]; 0 where not found."""
    error: Array
    """Largest, shape (k,) [m]."""
    seen: NDArray[np.bool_]
    """Whether each was found and is sure enough, shape (k,)."""


class _Joint(NamedTuple):
    """A joint that was seen in a frame."""

    position: Array
    velocity: Array
    position_error: float
    velocity_error: float
