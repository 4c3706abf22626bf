"""Which track the capsules of a scene belong to, where people come and go: by id, and by place where ids are wrong."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.kernels.people import STAMP_ROUNDING
from jssa_gym.shields.records import Records
from jssa_gym.shields.shapes import fit_together, unlike
from jssa_gym.tick.assumed import Assumed, assume
from jssa_gym.tick.people import coming_clock
from jssa_gym.tick.region import as_they_were, sample_came_in, sample_fits, track_left
from jssa_gym.types import Array, CapsuleSet, Scene

Key = tuple[int, str, int]
"""A person, a body part, and which of those of the same name."""

_NEW, _IGNORED = -1, -2


class _Samples(NamedTuple):
    """What a scene shows."""

    keys: tuple[Key, ...]
    ends: Array
    """Shape (4, m, 3)."""
    radius: Array
    age: Array
    valid: NDArray[np.bool_]
    time: float
    """When, by the clock that people move by [s]."""


class Association:
    """Puts the capsules of each scene in the places of their tracks, and makes and drops tracks.

    A capsule is known by person and name. Where samples cannot be of the tracks that their ids say, those of all who
    are known and measured are distributed among their tracks by where they can be. A sample with a new id where nobody
    unseen can have got is of the only other track of that name that it can be of; of none, if there are several.
    A track that is in no scene any more goes on growing, until it is certain to be outside of the watched region.

    Args:
        records: Of the arm's control step, whose tracks these are.
        capacity: As many tracks there may be.
        assumed: See :class:`~jssa_gym.shields.reading.Reading`.
    """

    def __init__(self, records: Records, capacity: int, assumed: Callable[[tuple[str, ...]], Assumed]) -> None:
        self._records, self._capacity, self._assumed = records, capacity, assumed
        self.forget()

    def forget(self) -> None:
        """Nobody is there."""
        self.names: tuple[str, ...] = ()
        """Names of the tracks."""
        self.shown: list[int] = []
        """Which capsule of the scene each track has, -1 for none."""
        self.frame_age = np.nan
        """See :class:`~jssa_gym.types.Scene`; NaN where there is no frame [s]."""
        # a track whose id another one has now has none
        self._keys: list[Key | None] = []
        # who was dropped but is listed still, not measured
        self._gone: set[Key] = set()
        self._listed: tuple[Any, Any, tuple[Key, ...]] = ((), None, ())
        # whether the tracks are the scene's capsules, one by one
        self._plain = False
        self._records.rearrange([])

    def arrange(self, scene: Scene, now: float) -> tuple[CapsuleSet, Array, NDArray[np.bool_]]:
        """Capsules, ages and validity in the order of the tracks; those that the scene has not are not valid.

        Args:
            scene: The present.
            now: Its time [s].

        Raises:
            ValueError, TypeError, AttributeError: It cannot be read, and nothing has changed.
        """
        human, age, valid = scene.human, scene.age, scene.valid
        if wrong := unlike(human, age, valid):
            raise ValueError(wrong)
        if not fit_together(human, age, valid) or human.person.dtype.kind not in "iu":
            raise ValueError("the arrays' shapes do not fit together")
        seen = self._samples(human, age, valid, now)
        frame_age = _frame_age(scene, seen)
        arms = self._records.view.arms
        plain = self._plain and tuple(self._keys) == seen.keys
        if not (plain and as_they_were(arms, seen.time, *seen[1:5])):
            self._take(seen, *self._sorted(seen, arms))
        self.frame_age = frame_age
        return (human, age, valid) if self._plain else self._arranged(human, seen)

    def _samples(self, human: CapsuleSet, age: Any, valid: Any, now: float) -> _Samples:
        time = coming_clock(self._records.view.arms, now)
        if not time < np.inf:
            raise ValueError(f"the time is {now}")
        if valid.dtype != np.bool_:
            raise ValueError(f"valid is {valid.dtype}, no bool")
        names, person, keys = self._listed
        if human.names is not names or not np.array_equal(human.person, person):
            keys = _keys(human.names, human.person)
            self._listed = human.names, human.person.copy(), keys
        ends = np.array(human[:4], np.float64)
        return _Samples(keys, ends, np.array(human.radius, np.float64), np.array(age, np.float64), valid.copy(), time)

    # ---- who is who ----------------------------------------------------------------------------------

    def _sorted(self, seen: _Samples, arms: Any) -> tuple[list[int], list[int]]:
        """The track of each sample, ``_NEW`` for one to be made, ``_IGNORED`` for none; and the tracks without any."""
        met = (self._records.memory.tracks[0]["stamp"] > -np.inf).tolist()
        own = {key: j for j, key in enumerate(self._keys) if key is not None}
        place = [own.get(key, _NEW) for key in seen.keys]
        known = [i for i, j in enumerate(place) if j >= 0 and met[j] and seen.valid[i]]

        # of the others nothing would be believed
        sound = ((seen.age >= 0.0) & (seen.radius > 0.0) & np.isfinite(seen.ends).all(axis=(0, 2))).tolist()

        def fits(i: int, j: int) -> bool:
            alike = met[j] and sound[i] and self.names[j] == seen.keys[i][1]
            return alike and bool(sample_fits(arms, seen.time, seen.ends, seen.radius, seen.age, i, j))

        exchanged, unsettled = _exchanged(place, known, [key[1] for key in seen.keys], fits)
        renamed = self._renamed(seen, place, unsettled, arms, fits)
        for i, j in enumerate(place):
            if seen.valid[i]:
                place[i] = exchanged.get(i, renamed.get(i, j))
            elif j in renamed.values() or (j < 0 and seen.keys[i] in self._gone):
                place[i] = _IGNORED
        kept = set(place)
        for i, j in enumerate(place):
            if j >= 0 and met[j] and not seen.valid[i] and track_left(arms, seen.time, j, True):
                place[i] = _IGNORED
        lost = [j for j in range(len(met)) if j not in kept and met[j] and not track_left(arms, seen.time, j, False)]
        return place, lost

    def _renamed(
        self, seen: _Samples, place: Sequence[int], unsettled: set[str], arms: Any, fits: Callable[[int, int], bool]
    ) -> dict[int, int]:
        """Tracks of samples with a new id that are of nobody who has come in: the only one that it can be of.

        Who is still listed has no new id; and where the sample is older than a track, or others are where they cannot
        be, whose it is cannot be told: then it is of somebody who was not known.
        """
        claims: dict[int, list[int]] = {}
        listed, stamps = set(seen.keys), self._records.memory.tracks[0]["stamp"]
        free = [j for j, key in enumerate(self._keys) if key not in listed]
        for i, j in enumerate(place):
            name = seen.keys[i][1]
            if j >= 0 or not seen.valid[i] or name in unsettled:
                continue
            if any(self.names[k] == name and seen.time - seen.age[i] < stamps[k] - STAMP_ROUNDING for k in free):
                continue
            if sample_came_in(arms, seen.time, seen.ends, seen.radius, seen.age, i):
                continue
            near = [j for j in free if fits(i, j)]
            if len(near) == 1:
                claims.setdefault(near[0], []).append(i)
        return {who[0]: j for j, who in claims.items() if len(who) == 1}

    # ---- their tracks --------------------------------------------------------------------------------

    def _take(self, seen: _Samples, place: Sequence[int], lost: Sequence[int]) -> None:
        """Make, move and drop tracks."""
        rows = [i for i, j in enumerate(place) if j != _IGNORED]
        source = [place[i] for i in rows] + list(lost)
        if len(source) > self._capacity:
            raise ValueError(f"{len(source)} body parts are more than the watched region's capacity, {self._capacity}")
        listed = set(seen.keys)
        keys = [seen.keys[i] for i in rows] + [None if (key := self._keys[j]) in listed else key for j in lost]
        names = tuple([seen.keys[i][1] for i in rows] + [self.names[j] for j in lost])
        whose = [seen.keys[i][0] for i in rows] + self._records.memory.tracks[0]["person"][list(lost)].tolist()
        person = np.array(whose, np.int64)  # raises for what is no id before anything has changed
        if source != list(range(len(self._keys))) or names != self.names:
            assumed = self._assumed(names)
            self._records.rearrange(source)
            assume(self._records.memory, assumed)
        self._records.memory.tracks[0]["person"] = person
        self.names, self._keys = names, keys
        self._gone = {seen.keys[i] for i, j in enumerate(place) if j == _IGNORED}
        self.shown = rows + [-1] * len(lost)
        self._plain = self.shown == list(range(len(seen.keys)))

    def _arranged(self, human: CapsuleSet, seen: _Samples) -> tuple[CapsuleSet, Array, NDArray[np.bool_]]:
        """The samples in the order of the tracks."""
        shown = np.array(self.shown, np.int64)
        there, m = shown >= 0, len(seen.radius)
        pick = np.where(there, shown, m)
        ends = np.concatenate([seen.ends, np.full((4, 1, 3), np.nan)], axis=1)[:, pick]
        radius, age = (np.append(one, np.nan)[pick] for one in (seen.radius, seen.age))
        person = self._records.memory.tracks[0]["person"].copy()
        people = CapsuleSet(ends[0], ends[1], ends[2], ends[3], radius, self.names, person)
        return people, age, np.append(seen.valid, False)[pick]


def _exchanged(
    place: Sequence[int], known: Sequence[int], names: Sequence[str], fits: Callable[[int, int], bool]
) -> tuple[dict[int, int], set[str]]:
    """Tracks of samples whose people have each other's ids: all of a name anew, where some cannot be of their own.

    Whichever fitting way the samples of those people are distributed among their tracks, all of them are covered. The
    names of which some are of no track come second.
    """
    odd = [i for i in known if not fits(i, place[i])]
    found: dict[int, int] = {}
    unsettled: set[str] = set()
    for name in dict.fromkeys(names[i] for i in odd):
        group = [i for i in known if names[i] == name]
        holder = {place[i]: i for i in group if i not in odd}

        def settle(i: int, tried: set[int]) -> bool:
            for j in (place[other] for other in group):  # noqa: B023  # called in this turn alone
                if j in tried or not fits(i, j):
                    continue
                tried.add(j)
                if j not in holder or settle(holder[j], tried):  # noqa: B023
                    holder[j] = i  # noqa: B023
                    return True
            return False

        if all(settle(i, set()) for i in odd if names[i] == name):
            found |= {i: j for j, i in holder.items()}
        else:
            unsettled.add(name)
    return found, unsettled


def _keys(names: Any, person: NDArray[Any]) -> tuple[Key, ...]:
    met: Counter[tuple[int, str]] = Counter()
    keys = []
    for who, name in zip(person.tolist(), names, strict=True):
        keys.append((who, name, met[who, name]))
        met[who, name] += 1
    return tuple(keys)


def _frame_age(scene: Scene, seen: _Samples) -> float:
    """See :class:`~jssa_gym.types.Scene`; NaN for a frame that is none."""
    given = scene.frame_age
    if given is not None:
        return float(given)
    if len(seen.valid) and not seen.valid.any():  # nobody was measured: there was no frame since who was last
        return float(seen.age.min())
    return float(seen.age[seen.valid].max(initial=0.0))
