"""Keypoints with confidence and stamps to people's capsules with ages, validity and errors."""

from collections.abc import Iterable
from numbers import Integral
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.perception.detector import Frame, TrackerParams
from jssa_gym.perception.skeletons import KeypointTable, make_skeleton
from jssa_gym.perception.tracked_body import Look, TrackedBody
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Array, CapsuleSet, Scene

_NOBODY = -1
"""Person of every capsule once somebody is there whom nobody has announced: to a shield that is a fault at once."""


class Tracked(NamedTuple):
    """People as a :class:`~jssa_gym.types.Scene` has them, and how far they may be off."""

    human: CapsuleSet
    age: Array
    """Age of each capsule's measurement, shape (m,) [s]; inf for what has never been seen."""
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
        """Stamp of the last frame that was not left out [s]."""
        self._stranger = False
        self._bodies = tuple(
            TrackedBody(self.parts, self._joints, len(self.skeleton.keypoints), self.assumed, self.params)
            for _ in self.people
        )

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

    def _believed(self, stamp: float, looks: list[Look]) -> list[NDArray[np.bool_]]:
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
