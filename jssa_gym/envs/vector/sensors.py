"""Sensors of many arms: each shows, bit for bit, what one around a single environment shows."""

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.bursts import VectorBursts
from jssa_gym.envs.faults import SensorFaults
from jssa_gym.envs.keypoint_camera import to_ball
from jssa_gym.envs.sensor import GAPS, PEOPLE, ROUNDING, check_missing
from jssa_gym.envs.vector.env import VectorArmEnv
from jssa_gym.humans import nobody
from jssa_gym.tick.layout import SceneRecord
from jssa_gym.types import Array, CapsuleSet, JointState, Scene
from jssa_gym.vectors import Mask

Who = NDArray[np.int64]
"""Numbers of some arms, shape (L,)."""


class VectorSensors:
    """What shows arms to their shields; subclasses say how they draw, see :meth:`show` for the truth.

    Args:
        arms: The vector.
    """

    def __init__(self, arms: VectorArmEnv) -> None:
        self._arms = arms
        self._rngs = [np.random.default_rng(0)] * arms.num_envs
        self.lost: Mask = np.zeros(arms.num_envs, np.bool_)
        """Which arms nothing is seen of at present, shape (E,)."""

    def begin(self, which: Mask) -> None:
        """Episodes of those arms, which have been reset, begin with what is seen of them now."""

    def look(self, live: Mask) -> None:
        """Look at what those arms have become in a step."""

    def show(self, which: Mask, scene: SceneRecord) -> None:
        """Write what is seen of those arms, but for those that are lost, where their shields read it."""
        arms, (ends, radius) = self._arms, self._arms.people
        scene.now["time"][which], scene.joints[which] = arms.time[which], arms.state[which]
        scene.ends[which], scene.radius[which] = ends[which], radius[which]

    def _seed(self, who: Who, key: int) -> None:
        """Give arms generators of their own, by the seeds of their resets; an episode without one draws on."""
        seeds = self._arms.np_random_seed
        for e in who.tolist():
            self._rngs[e] = np.random.default_rng((key, abs(seeds[e] or 0)))


class VectorMissedTicks(VectorSensors):
    """:class:`~jssa_gym.envs.sensor.MissedTicks` of many arms.

    Args:
        arms: The vector.
        probability, longest: As of one.
    """

    def __init__(self, arms: VectorArmEnv, probability: float, longest: int) -> None:
        super().__init__(arms)
        self._gaps = VectorBursts(arms.num_envs, probability, longest)

    def begin(self, which: Mask) -> None:
        self._seed(np.flatnonzero(which), GAPS)
        self._gaps.begin(which)
        self.lost[which] = False

    def look(self, live: Mask) -> None:
        self._gaps.step(np.flatnonzero(live), self._rngs)
        self.lost[live] = self._gaps.on[live, 0]


class _Frames(NamedTuple):
    """A measurement of everybody of each arm, in arrays."""

    data: Array
    """Starts, ends and their velocities, shape (E, 4, m, 3) [m, m/s]."""
    stamp: Array
    """When each capsule was measured, -inf for never, shape (E, m) [s]."""
    measured: Mask
    """Shape (E, m)."""
    number: NDArray[np.int64]
    """Shape (E,)."""

    @classmethod
    def none(cls, *shape: int) -> "_Frames":
        """No measurement, of arrays of shape (E, ..., m)."""
        *arms, m = shape
        return cls(
            np.full((*arms, 4, m, 3), np.nan), np.full(shape, -np.inf), np.zeros(shape, np.bool_), np.full(arms, -1)
        )

    def put(self, where: Any, samples: "tuple[Array, Array, Mask, NDArray[np.int64]]") -> None:
        """Put others in some places."""
        for array, other in zip(self, samples, strict=True):
            array[where] = other

    def at(self, where: Any) -> "_Frames":
        """Those of some places."""
        return _Frames(*(array[where] for array in self))


class VectorSensorModel(VectorSensors):
    """:class:`~jssa_gym.envs.sensor.SensorModel` of many arms, for settings without faults of the joints, outliers
    and swaps.

    Args:
        arms: The vector.
        faults: What is wrong.

    Raises:
        ParameterError: ``missing`` names a body part that nobody has.
    """

    def __init__(self, arms: VectorArmEnv, faults: SensorFaults) -> None:
        super().__init__(arms)
        names = arms.part_names
        check_missing(faults.missing, names)
        count, m = arms.num_envs, len(names)
        self._faults, self._absent = faults, np.array([name in faults.missing for name in names], np.bool_)
        self._dropouts = VectorBursts(count, faults.dropout, faults.dropout_ticks, m)
        self._freezes = VectorBursts(count, faults.freeze, faults.freeze_ticks)
        self._misstamps = VectorBursts(count, faults.misstamp, 1)
        self._normal, self._even, self._jitter = np.zeros((count, 2, m, 3)), np.zeros((count, 2, m, 1)), np.zeros(count)
        self._last, self._arrived, self._shown = (_Frames.none(count, m) for _ in range(3))
        # what is under way, in rings: nothing is for longer than this many ticks
        places = int((faults.latency + faults.jitter) / arms.dt) + 3
        self._under_way, self._arrival = _Frames.none(count, places, m), np.full((count, places), np.inf)
        self._age, self._said = np.full((2, count, m), np.inf)

    @staticmethod
    def takes(faults: SensorFaults) -> bool:
        """Whether settings are without faults of the joints, outliers and swaps."""
        return not (faults.joints or faults.outlier > 0.0 or faults.swap > 0.0)

    def begin(self, which: Mask) -> None:
        who = np.flatnonzero(which)
        self._seed(who, PEOPLE)
        for bursts in (self._dropouts, self._freezes, self._misstamps):
            bursts.begin(which)
        nothing = np.nan, -np.inf, False, -1
        for samples in (self._last, self._arrived, self._shown):
            samples.put(who, nothing)  # ty: ignore[invalid-argument-type]  # the same everywhere
        self._arrival[who], self._age[who] = np.inf, np.inf
        self._perceive(who)

    def look(self, live: Mask) -> None:
        self._perceive(np.flatnonzero(live))

    def show(self, which: Mask, scene: SceneRecord) -> None:
        super().show(which, scene)
        scene.ends[which], scene.valid[which] = self._shown.data[which], self._shown.measured[which]
        scene.age[which] = self._said[which]

    def _perceive(self, who: Who) -> None:
        """One tick of those arms."""
        faults = self._faults
        self._measure(who)
        self._freezes.step(who, self._rngs)
        self._misstamps.step(who, self._rngs)
        frozen = self._freezes.on[who, 0]
        new = who[~frozen]
        self._shown.put(new, self._arrived.at(new))
        aged = who if faults.freeze_reported else new
        self._age[aged] = self._arms.time[aged][:, None] - self._shown.stamp[aged]
        wrong = self._misstamps.on[who]
        self._said[who] = np.where(wrong, self._age[who] + faults.shift, self._age[who])

    def _measure(self, who: Who) -> None:
        """Everybody as seen now, which arrives now or later; and what arrives now."""
        faults, rngs, last, now = self._faults, self._rngs, self._last.at(who), self._arms.time[who]
        data = self._arms.people[0][who]
        if faults.noise > 0.0:
            data[:, :2] += faults.noise * self._in_ball(who)
        if faults.velocity_noise > 0.0:
            data[:, 2:] += faults.velocity_noise * self._in_ball(who)
        data[:, :2] += 0.0  # where there is no outlier, which makes 0 of -0
        self._dropouts.step(who, rngs)
        measured = ~self._dropouts.on[who] & ~self._absent
        data = np.where(measured[:, None, :, None], data, np.nan if faults.blank else last.data)
        stamp = np.where(measured, now[:, None], last.stamp)
        samples = data, stamp, measured, last.number + 1
        self._last.put(who, samples)
        if faults.latency == 0.0 == faults.jitter:
            self._arrived.put(who, samples)
            return
        delay = np.full(len(who), faults.latency)
        if faults.jitter > 0.0:
            for e in who.tolist():
                self._jitter[e] = rngs[e].random()
            delay = faults.latency + faults.jitter * self._jitter[who]
        place = who, (last.number + 1) % self._arrival.shape[1]
        self._under_way.put(place, samples)
        self._arrival[place] = now + delay
        self._receive(who)

    def _receive(self, who: Who) -> None:
        """What arrives now, of all that is under way."""
        arrival, number = self._arrival[who], self._under_way.number[who]
        due = arrival <= self._arms.time[who][:, None] + ROUNDING
        if self._faults.reorder:  # the last to arrive, and of those the newest
            latest = np.where(due, arrival, -np.inf).max(axis=1)
            newest = np.where(due & (arrival == latest[:, None]), number, -1)
            least = np.full(len(who), -1)
        else:  # the newest, if it is newer than what is there
            newest, least = np.where(due, number, -1), self._arrived.number[who]
        pick = newest.argmax(axis=1)
        taken = newest.max(axis=1) > least
        self._arrived.put(who[taken], self._under_way.at((who[taken], pick[taken])))
        self._arrival[who] = np.where(due, np.inf, arrival)

    def _in_ball(self, who: Who) -> Array:
        """Points drawn evenly from the unit ball for both ends of everybody, shape (L, 2, m, 3)."""
        for e in who.tolist():
            self._rngs[e].standard_normal(out=self._normal[e])
            self._rngs[e].random(out=self._even[e])
        return to_ball(self._normal[who], self._even[who])


# ---- one by one --------------------------------------------------------------------------------------


class OneOf(gym.Env):
    """One arm of a vector, which a sensor looks at; it moves when the vector does.

    Args:
        arms: The vector.
        e: Which of its arms.
    """

    def __init__(self, arms: VectorArmEnv, e: int) -> None:
        self._arms, self._e = arms, e
        self.robot, self.dt = arms.robot, arms.dt
        self._static = nobody()

    @property
    def np_random_seed(self) -> int:
        """Seed of its environment, -1 for none."""
        seed = self._arms.np_random_seed[self._e]
        return -1 if seed is None else seed

    @property
    def scene(self) -> Scene:
        """The present; copies."""
        arms, e = self._arms, self._e
        (ends, radius), count = arms.people, len(arms.person)
        people = CapsuleSet(*ends[e].copy(), radius[e].copy(), arms.part_names, arms.person)
        robot, fresh = JointState(*arms.state[e].copy()), np.ones(count, np.bool_)
        return Scene(float(arms.time[e]), robot, people, self._static, arms.planes, np.zeros(count), fresh)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Nothing: the vector has been reset."""
        return None, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Nothing: the vector has stepped."""
        return None, 0.0, False, False, {}


class SensorsOneByOne(VectorSensors):
    """A sensor of each arm's own, as around a single environment.

    Args:
        arms: The vector.
        wrap: Puts the wrappers that change ``scene`` around an environment, such as
            :class:`~jssa_gym.envs.sensor.SensorModel`.
    """

    def __init__(self, arms: VectorArmEnv, wrap: Callable[[gym.Env], gym.Env]) -> None:
        super().__init__(arms)
        self._sensors = [wrap(OneOf(arms, e)) for e in range(arms.num_envs)]

    def begin(self, which: Mask) -> None:
        seeds = self._arms.np_random_seed
        for e in np.flatnonzero(which).tolist():
            self._sensors[e].reset(seed=seeds[e])

    def look(self, live: Mask) -> None:
        for e in np.flatnonzero(live).tolist():
            self._sensors[e].step(None)

    def show(self, which: Mask, scene: SceneRecord) -> None:
        for e in np.flatnonzero(which).tolist():
            seen: Scene | None = self._sensors[e].get_wrapper_attr("scene")
            self.lost[e] = seen is None
            if seen is not None:
                human = seen.human
                scene.now["time"][e], scene.joints[e] = seen.time, seen.robot
                scene.ends[e], scene.radius[e], scene.person[e] = human[:4], human.radius, human.person
                scene.age[e], scene.valid[e] = seen.age, seen.valid
