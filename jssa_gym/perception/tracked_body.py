"""One person from frame to frame: which keypoints are believed, and what capsules they make."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.perception.detector import TrackerParams
from jssa_gym.perception.filtering import VelocityFilter
from jssa_gym.perception.skeletons import BodyPart, ancestors
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.types import Array

_ROUNDING = 1e-9
"""Added to what a keypoint may have moved [m]."""


class Look(NamedTuple):
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


class TrackedBody:
    """One person: what is known of the keypoints, and the capsules that follow from it.

    Args:
        parts: The body's parts, m of them.
        joints: The keypoints whose mean each joint is, as their numbers.
        count: How many keypoints a frame has of a person, k.
        assumed: What the shield assumes.
        params: Of the detector.
    """

    def __init__(
        self,
        parts: Sequence[BodyPart],
        joints: Mapping[str, NDArray[np.int64]],
        count: int,
        assumed: FailsafeParams,
        params: TrackerParams,
    ) -> None:
        self._parts, self._joints, self._params = parts, joints, params
        self._allowed, m = assumed.position_error, len(parts)
        self._made_of = np.zeros((len(joints), count), np.bool_)
        for row, points in zip(self._made_of, joints.values(), strict=True):
            row[points] = True
        # of a head any point of the face will do
        self._needed = [1 if joint == "head" else len(points) for joint, points in joints.items()]
        self._speeds = np.array([assumed.end_speeds_of(part.name) for part in parts]).reshape(m, 2)
        self._held = np.array([assumed.acceleration_of(part.name) == 0.0 for part in parts])
        fastest = float(self._speeds.max(initial=assumed.human_speed))
        self._speed = self._speeds_of_keypoints(count, fastest)
        self._filter = VelocityFilter(count, params.acceleration, fastest, params.deviation)
        self._last, self._last_error = np.full((count, 3), np.nan), np.zeros(count)
        self._last_stamp = np.full(count, -np.inf)
        self._now = -np.inf
        self.ends = np.full((m, 2, 3), np.nan)
        self.velocities = np.full((m, 2, 3), np.nan)
        self.stamp = np.full(m, -np.inf)
        self.usable = np.zeros(m, np.bool_)
        self.position_error, self.velocity_error = np.full(m, np.inf), np.full(m, np.inf)

    def _speeds_of_keypoints(self, count: int, fastest: float) -> Array:
        """No keypoint is faster than any part that it is an end of allows, shape (k,) [m/s]."""
        found = np.full(count, fastest)
        for part, speeds in zip(self._parts, self._speeds, strict=True):
            for joint, speed in zip((part.start, part.end), speeds, strict=True):
                points = self._joints[joint]
                if len(points) == 1 or joint == "head":  # of two, one may be faster than their mean
                    found[points] = np.minimum(found[points], speed)
        return found

    # ---- keypoints -----------------------------------------------------------------------------------

    def look(self, position: Array, confidence: Array) -> Look:
        """What is to be seen of one frame's keypoints, shapes (k, 3) and (k,)."""
        params = self._params
        sure = np.where((confidence > 0.0) & (confidence <= 1.0), confidence, 0.0)
        error = params.unsure + sure * (params.sure - params.unsure)
        finite = np.asarray(np.isfinite(position).all(axis=1))
        seen = finite & (sure > 0.0) & (error <= self._allowed + _ROUNDING)
        return Look(np.where(finite[:, None], position, 0.0), error, seen)

    def can_be(self, stamp: float, look: Look, known: bool = False) -> NDArray[np.bool_]:
        """Which keypoints are no farther from where they were believed than a person moves since, shape (k,).

        Of those that never were nobody can tell: they can be, unless they have to be ``known``.
        """
        there = np.isfinite(self._last_stamp)
        elapsed = np.where(there, stamp - self._last_stamp, 0.0)
        way = np.linalg.norm(look.position - np.where(there[:, None], self._last, look.position), axis=1)
        near = way <= self._speed * elapsed + look.error + self._last_error + _ROUNDING
        return near & there if known else near

    def update(self, stamp: float, look: Look, seen: NDArray[np.bool_]) -> None:
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

    def _seen_joints(self, seen: NDArray[np.bool_], place: Array, error: Array) -> dict[str, _Joint]:
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

    def _report_part(self, k: int, part: BodyPart, joints: dict[str, _Joint], stamp: float) -> None:
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

    def _joint_of(self, joint: str, joints: dict[str, _Joint], speed: float) -> tuple[_Joint, float] | None:
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
