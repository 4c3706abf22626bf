"""What a perception system makes of people and arm: noise, delay, gaps and lies, between environment and shield."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jssa_gym.envs.bursts import Bursts
from jssa_gym.envs.faults import FAULTS, SensorFaults
from jssa_gym.envs.keypoint_camera import CAMERAS, CameraSettings, KeypointCamera, directions, in_ball
from jssa_gym.envs.proprioception import Proprioception
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import HumanMotion
from jssa_gym.robots import RobotModel
from jssa_gym.types import Array, CapsuleSet, Scene
from jssa_gym.validation import known_name, number_within, positive_integer
from jssa_gym.vectors import refuse_vector

ROUNDING = 1e-9
"""A sample counts as arrived this much early [s]: times are multiples of the control step only up to rounding."""


PEOPLE, GAPS = 0x5E2502, 0x6A95
"""What seeds of resets are combined with to draw faults of the people, and missed ticks."""


class _Sample(NamedTuple):
    """One measurement of everybody, on its way or delivered."""

    number: int
    arrival: float
    """[s]."""
    data: Array
    """Starts, ends and their velocities, shape (4, m, 3) [m, m/s]."""
    stamp: Array
    """When each capsule was measured, -inf for never, shape (m,) [s]."""
    measured: NDArray[np.bool_]
    """Shape (m,)."""


def _stream(env: gym.Env, seed: int | None, rng: np.random.Generator | None, key: int) -> np.random.Generator:
    """A generator of one's own, from the seed of a reset: what it draws must not change the environment."""
    if seed is None and rng is not None:
        return rng
    # -1: the environment's seed is unknown
    return np.random.default_rng((key, abs(env.unwrapped.np_random_seed or 0) if seed is None else seed))


def _refuse_shield(env: gym.Env, kind: type) -> None:
    """A shield that lies further in reads the scene there, so that nothing shown out here would reach it."""
    if env.has_wrapper_attr("last_decision") and env.has_wrapper_attr("filter"):
        name = kind.__name__
        raise InterfaceError(
            f"{env} has a shield already, which would never see what {name} shows: put {name} around the "
            f"environment, and the shield around {name}, as in JSSAShield({name}(env, ...))"
        )


def settings_of(faults: SensorFaults | CameraSettings | str | Mapping[str, Any]) -> SensorFaults | CameraSettings:
    """Settings, those of a name, or those of a mapping of fields; a mapping with a ``rate`` is a camera's.

    Raises:
        ParameterError: They are unknown.
    """
    if isinstance(faults, str):
        known = {**FAULTS, **CAMERAS}
        return known[known_name("faults", faults, known)]
    if isinstance(faults, Mapping):
        kind = CameraSettings if "rate" in faults else SensorFaults
        for name in faults:
            known_name("fault", name, [field.name for field in fields(kind)])
        return kind(**faults)
    if not isinstance(faults, SensorFaults | CameraSettings):
        raise ParameterError(f"faults has to be SensorFaults, a name or a mapping, got {faults!r}")
    return faults


def check_missing(missing: Sequence[str], names: Sequence[str]) -> None:
    """Whether body parts that are never measured are some of those that there are, if there are any.

    Raises:
        ParameterError: They are not.
    """
    unknown = [name for name in missing if name not in names]
    if unknown and names:
        raise ParameterError(f"unknown body parts {unknown} in missing; valid: {', '.join(dict.fromkeys(names))}")


class SensorModel(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Shows a shield people and arm as a perception system with faults would.

    It goes between environment and shield, ``JSSAShield(SensorModel(env, "long dropouts"))``, and overrides
    ``scene``: the people's capsules with their ``age`` and ``valid``; with faults of the joints, also the joint state
    and the clock, from the first step on. Environment, observation and ``info`` stay untouched: metrics see the truth.
    A scene is made once a tick; reading it again gives the same object. Before the first sample has arrived the
    capsules are NaN, not valid and of infinite age.

    The faults are drawn from generators of their own, seeded by ``reset(seed=...)``: same seed, same bits. Those of the
    joints have another one than those of the people.

    With a camera, ``SensorModel(env, "camera 30 Hz")``, people are seen as keypoints, which go through
    :class:`jssa_gym.perception.Tracker` as those of a detector would; a shield around it has to assume what the
    camera's settings say, ``JSSAShield(env, failsafe=CAMERAS["camera 30 Hz"].assumptions)``.

    Args:
        env: An environment that offers ``scene``.
        faults: Settings, a name in :data:`~jssa_gym.envs.faults.FAULTS`, or the settings' fields as a mapping; or those
            of a camera, of :data:`~jssa_gym.envs.keypoint_camera.CAMERAS`, whose mapping has a ``rate``.

    Raises:
        ParameterError: Unknown faults; at ``reset``, ``missing`` names a body part that nobody has, or a camera's
            people have other parts than the package's own.
        InterfaceError: There is a shield inside, which would see nothing of this; or the environment has no ``robot``,
            whose limits faults of the joints are shares of.
    """

    def __init__(self, env: gym.Env, faults: SensorFaults | CameraSettings | str | Mapping[str, Any]) -> None:
        refuse_vector(env, "VectorSensorModel")
        faults = settings_of(faults)
        gym.utils.RecordConstructorArgs.__init__(self, faults=asdict(faults))  # JSON can hold it
        gym.Wrapper.__init__(self, env)
        _refuse_shield(env, type(self))
        human = vars(env.unwrapped).get("human")
        if isinstance(human, HumanMotion) and human.comers is not None:
            raise ParameterError(
                f"{type(human).__name__} come and go; a SensorModel has samples of people who are there throughout"
            )
        self.faults = faults
        self._direct = faults if isinstance(faults, SensorFaults) else SensorFaults()
        self._camera: KeypointCamera | None = None
        self._joints: Proprioception | None = None
        if isinstance(faults, SensorFaults) and faults.joints:
            robot = env.get_wrapper_attr("robot") if env.has_wrapper_attr("robot") else None
            if not isinstance(robot, RobotModel):
                raise InterfaceError(
                    f"faults of the joints are shares of their limits: {env} has no robot (RobotModel)"
                )
            self._joints = Proprioception(faults, robot.limits)
        self._rng: np.random.Generator | None = None
        self._scene: Scene | None = None
        self.latency_range: tuple[float, float] | None = None
        """What the latency is drawn from at every reset, instead of the faults' own [s]; None for theirs."""

    @property
    def latency(self) -> float:
        """The latency of this episode [s]."""
        return self._direct.latency

    @property
    def scene(self) -> Scene | None:
        """The present as it is perceived; None where the environment itself has none.

        Raises:
            gymnasium.error.ResetNeeded: There was no ``reset`` yet.
        """
        if self._rng is None:
            raise gym.error.ResetNeeded("a sensor has nothing to show before reset()")
        return self._scene

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, then the faults; a seed seeds both."""
        result = self.env.reset(seed=seed, options=options)
        self._rng = _stream(self.env, seed, self._rng, PEOPLE)
        if self.latency_range is not None:
            self._direct = replace(self._direct, latency=float(self._rng.uniform(*self.latency_range)))
        truth = self.env.get_wrapper_attr("scene")
        self._begin(truth)
        self._scene = self._perceive(truth, self._rng)
        if self._joints is not None:
            self._joints.reset(self._scene, _stream(self.env, seed, self._joints.rng, 0x301A7))
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and look at what it has become."""
        if self._rng is None:
            raise gym.error.ResetNeeded("reset() has to come before step()")
        result = self.env.step(action)
        self._scene = self._perceive(self.env.get_wrapper_attr("scene"), self._rng)
        if self._joints is not None:
            self._scene = self._joints.perceive(self._scene)
        return result

    def _begin(self, truth: Scene | None) -> None:
        if isinstance(self.faults, CameraSettings):
            self._camera = None if truth is None else KeypointCamera(self.faults, truth)
            return
        names = () if truth is None else truth.human.names
        check_missing(self._direct.missing, names)
        faults, m = self._direct, len(names)
        self._absent = np.array([name in faults.missing for name in names], np.bool_)
        self._dropouts = Bursts(faults.dropout, faults.dropout_ticks, m)
        self._outliers = Bursts(faults.outlier, faults.outlier_ticks, m)
        self._swaps = Bursts(faults.swap, faults.swap_ticks)
        self._freezes = Bursts(faults.freeze, faults.freeze_ticks)
        self._misstamps = Bursts(faults.misstamp, 1)
        self._elsewhere, self._order = np.zeros((m, 3)), np.arange(m)
        nothing = _Sample(-1, -np.inf, np.full((4, m, 3), np.nan), np.full(m, -np.inf), np.zeros(m, np.bool_))
        self._last = self._arrived = self._shown = nothing
        self._under_way: list[_Sample] = []
        self._age = np.full(m, np.inf)

    def _perceive(self, truth: Scene | None, rng: np.random.Generator) -> Scene | None:
        if truth is None:
            return None
        if self._camera is not None:
            return self._camera.perceive(truth, rng)
        people, now = truth.human, truth.time
        if len(people.radius) != len(self._age):
            self._begin(truth)
        self._last = self._measure(truth, rng)
        self._under_way.append(self._last)
        self._receive(now)
        self._freezes.step(rng)
        self._misstamps.step(rng)
        frozen = bool(self._freezes.on[0])
        if not frozen:
            self._shown = self._arrived
        if not frozen or self._direct.freeze_reported:
            self._age = now - self._shown.stamp
        age = self._age + self._direct.shift if self._misstamps.on[0] else self._age.copy()
        start, end, start_velocity, end_velocity = self._shown.data.copy()
        capsules = CapsuleSet(start, end, start_velocity, end_velocity, people.radius, people.names, people.person)
        return Scene(now, truth.robot, capsules, truth.static, truth.planes, age, self._shown.measured.copy())

    def _measure(self, truth: Scene, rng: np.random.Generator) -> _Sample:
        """Everybody as seen now, whenever that will arrive."""
        faults, people, m = self._direct, truth.human, len(self._age)
        if self._swaps.step(rng)[0]:
            self._order = _swapped(people.person, rng)
        order = self._order if self._swaps.on[0] else np.arange(m)
        data = np.array([people.start, people.end, people.start_velocity, people.end_velocity])[:, order]
        if faults.noise > 0.0:
            data[:2] += faults.noise * in_ball(rng, (2, m))
        if faults.velocity_noise > 0.0:
            data[2:] += faults.velocity_noise * in_ball(rng, (2, m))
        began = self._outliers.step(rng)
        if np.any(began):
            self._elsewhere[began] = faults.outlier_size * directions(rng, (m,))[began]
        data[:2] += np.where(self._outliers.on[:, None], self._elsewhere, 0.0)
        self._dropouts.step(rng)
        measured = truth.valid[order] & ~self._dropouts.on & ~self._absent
        gone = ~measured
        data[:, gone] = np.nan if faults.blank else self._last.data[:, gone]
        stamp = np.where(measured, truth.time - truth.age[order], self._last.stamp)
        delay = faults.latency + (faults.jitter * rng.random() if faults.jitter > 0.0 else 0.0)
        return _Sample(self._last.number + 1, truth.time + delay, data, stamp, measured)

    def _receive(self, now: float) -> None:
        arrived = [sample for sample in self._under_way if sample.arrival <= now + ROUNDING]
        self._under_way = [sample for sample in self._under_way if sample.arrival > now + ROUNDING]
        if not arrived:
            return
        if self._direct.reorder:
            self._arrived = max(arrived, key=lambda sample: (sample.arrival, sample.number))
        else:
            self._arrived = max(*arrived, self._arrived, key=lambda sample: sample.number)


def _swapped(person: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Which capsule is taken for which, shape (m,): two people exchanged, or two capsules of one person."""
    order, people = np.arange(len(person)), np.unique(person)
    if len(people) > 1:
        one, other = (np.flatnonzero(person == p) for p in rng.choice(people, 2, replace=False))
        count = min(len(one), len(other))
        one, other = one[:count], other[:count]
    elif len(person) > 1:
        one, other = rng.choice(len(person), 2, replace=False)
    else:
        return order
    order[one], order[other] = order[other], order[one]
    return order


class MissedTicks(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Shows a shield no scene at all at random ticks: ``scene`` is None, nothing is known about the arm either.

    Args:
        env: An environment that offers ``scene``.
        probability: Per tick, of a gap's beginning.
        longest: Gaps last 1 to so many ticks. The scene of a reset is always there.

    Raises:
        ParameterError: A value is out of range.
        InterfaceError: There is a shield inside, which would see nothing of this.
    """

    def __init__(self, env: gym.Env, probability: float = 0.05, longest: int = 15) -> None:
        self.probability = number_within("probability", probability, 0.0, 1.0)
        self.longest = positive_integer("longest", longest)
        gym.utils.RecordConstructorArgs.__init__(self, probability=self.probability, longest=self.longest)
        gym.Wrapper.__init__(self, env)
        _refuse_shield(env, type(self))
        self._rng: np.random.Generator | None = None
        self._gaps = Bursts(self.probability, self.longest)

    @property
    def scene(self) -> Scene | None:
        """The present, or None in a gap."""
        return None if self._gaps.on[0] else self.env.get_wrapper_attr("scene")

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; a seed seeds the gaps too."""
        result = self.env.reset(seed=seed, options=options)
        self._rng = _stream(self.env, seed, self._rng, GAPS)
        self._gaps = Bursts(self.probability, self.longest)
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment."""
        if self._rng is None:
            raise gym.error.ResetNeeded("reset() has to come before step()")
        result = self.env.step(action)
        self._gaps.step(self._rng)
        return result
