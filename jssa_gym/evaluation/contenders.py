"""Who takes part in a campaign, by name: shields whole and weakened, and faults; the people are in ``people``."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from jssa_gym.envs.faults import FAULTS as SENSOR_FAULTS
from jssa_gym.envs.keypoint_camera import CAMERAS
from jssa_gym.envs.sensor import MissedTicks, SensorModel
from jssa_gym.evaluation.people import too_fast
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS, STOP, JSSAShield, Shield, read_name
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.offers import Offered
from jssa_gym.shields.registry import PROFILES, UNSHIELDED
from jssa_gym.tick import loop
from jssa_gym.tick.admit import GRADED, HALFWAY, WANTED
from jssa_gym.tick.assumed import Assumed
from jssa_gym.tick.layout import StepSettings
from jssa_gym.types import Array, CapsuleSet, Decision, Scene
from jssa_gym.validation import known_name

LAG = 0.1
"""Time from a command to the arm's motion where there is one [s]."""

_SLOW = 0.3
"""Speed that people are wrongly believed to keep [m/s]."""


# ---- what is wrong between environment and shield ----------------------------------------------------


class Late(gym.Wrapper):
    """Shows a shield the people as they were ``ticks`` ago and says that this is the present.

    To people, an arm that follows its commands late is the same as this: commands are chosen for people as they were.
    """

    def __init__(self, env: gym.Env, ticks: int) -> None:
        super().__init__(env)
        self.ticks = ticks
        self._past: deque[tuple[CapsuleSet, Array, Any]] = deque(maxlen=ticks + 1)

    @property
    def scene(self) -> Scene | None:
        """The present with the people of the past."""
        scene = self.env.get_wrapper_attr("scene")
        if scene is None or not self._past:
            return scene
        human, age, valid = self._past[0]
        return scene._replace(human=human, age=age, valid=valid)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and forget the past."""
        result = self.env.reset(seed=seed, options=options)
        self._past.clear()
        self._look()
        return result

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and look at the people."""
        result = self.env.step(action)
        self._look()
        return result

    def _look(self) -> None:
        scene = self.env.get_wrapper_attr("scene")
        if scene is not None:
            self._past.append((scene.human, scene.age, scene.valid))


class Ageless(gym.Wrapper):
    """Says of every measurement that it is fresh."""

    @property
    def scene(self) -> Scene | None:
        """The present with all ages 0."""
        scene = self.env.get_wrapper_attr("scene")
        return None if scene is None else scene._replace(age=np.zeros_like(scene.age))


def _ticks(env: gym.Env, time: float) -> int:
    return round(time / env.get_wrapper_attr("dt"))


# ---- filters with one thing wrong --------------------------------------------------------------------


class _SlowPeople(JSSAFilter):
    """Believes that people are slow to come; what it believes of their measurements is left alone."""

    def assumed(self, names: Sequence[str]) -> Assumed:
        assumed = super().assumed(names)
        return assumed._replace(growth=np.minimum(assumed.growth, _SLOW))


class _OffByOne(JSSAFilter):
    """Begins a stored stop one tick late: its first jerk is applied twice."""

    def decide(self, scene: Scene | None, nominal: Array, path: Offered | None = None) -> Decision:
        decision = super().decide(scene, nominal, path)
        if self.records.answer.told[0]["chosen"] in (WANTED, HALFWAY, GRADED):
            self.records.memory.arm[0]["step"] = -1
        return decision


class _Credulous(JSSAFilter):
    """Believes every joint state that is finite, and plans from it."""

    def decide(self, scene: Scene | None, nominal: Array, path: Offered | None = None) -> Decision:
        if scene is not None:
            state = np.array(scene.robot, np.float64)
            if np.isfinite(state).all() and not np.array_equal(state, self.expected):
                self.expected[:] = state
                loop.rebase(self.records.view.arms)
        return super().decide(scene, nominal, path)


class _Boundless(JSSAFilter):
    """Knows no joint ranges and no speed limits; its stops keep acceleration and jerk limits."""

    def settings(self) -> StepSettings:
        settings = super().settings()
        limits = settings.stop_limits.copy()
        limits[:3] = np.array([-1e3, 1e3, 1e3])[:, None]
        return settings._replace(stop_limits=limits)


def _weakened(kind: type[JSSAFilter], env: gym.Env, params: FailsafeParams, viability: bool = True) -> JSSAShield:
    """The shield with another filter than its own."""
    shield = JSSAShield(env, viability=viability, failsafe=params)
    shield.filter = kind(shield.filter.robot, shield.filter.dt, viability=viability, failsafe=params)
    return shield


# ---- shields -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Contender:
    """A shield that takes part in a campaign."""

    wrap: Callable[[gym.Env, FailsafeParams], gym.Env]
    """Puts it around an environment, given what may be assumed about people and sensors."""
    promises: bool = False
    """Whether limits are to be kept and the arm is to be at rest at every contact."""
    without: str = ""
    """Which guard it lacks, and what that should let happen; empty if it is no weakened ``full``."""


def _named(name: str) -> Contender:
    """The shield of a filter's name, whose verified stop knows what may be assumed; it promises what the stop does."""
    guarded = read_name(name).guarded
    return Contender(lambda env, params: Shield(env, name, stop=params if guarded else False), promises=guarded)


CONTENDERS: dict[str, Contender] = {
    "full": _named("jssa+stop"),
    "stop": replace(_named("stop"), without="safety rows: more contacts at rest, more stored stops"),
    "jssa": _named("jssa"),
    "published": _named("jssa_published"),
    UNSHIELDED: Contender(lambda env, params: env),
    "lag": Contender(
        lambda env, params: JSSAShield(Late(env, _ticks(env, LAG)), failsafe=replace(params, actuation_lag=LAG)),
        promises=True,
    ),
    "no_lag": Contender(
        lambda env, params: JSSAShield(Late(env, _ticks(env, LAG)), failsafe=params),
        without="the lag of the arm: moving contact",
    ),
    "no_speed": Contender(
        partial(_weakened, _SlowPeople), without="the people's speed bound in the stop: moving contact"
    ),
    "low_speed": Contender(
        lambda env, params: JSSAShield(env, failsafe=replace(params, human_speed=_SLOW, limb_speed=_SLOW)),
        without="the people's speed bound in stop and monitor: moving contact",
    ),
    "no_age": Contender(
        lambda env, params: JSSAShield(Ageless(env), failsafe=params),
        without="the age of measurements: moving contact",
    ),
    "no_joint_check": Contender(
        partial(_weakened, _Credulous),
        without="the comparison of joint readings with where the applied jerks led: moving contact, limit violation",
    ),
    "no_verification": Contender(
        lambda env, params: JSSAShield(env, failsafe=False), without="the verified stop: moving contact"
    ),
    "off_by_one": Contender(partial(_weakened, _OffByOne), without="the stored stop's right tick: moving contact"),
    "no_limits": Contender(
        lambda env, params: _weakened(_Boundless, env, params, viability=False),
        without="viability box and the stop's check of range and speed: limit violation",
    ),
    "no_box": Contender(
        lambda env, params: JSSAShield(env, viability=False, failsafe=params),
        without="viability box: a stop that does not exist",
    ),
    "no_limit_check": Contender(
        partial(_weakened, _Boundless),
        without="the stop's check of range and speed: limit violation, unless the box is enough",
    ),
    "closest_row": Contender(
        lambda env, params: JSSAShield(env, rows="closest", failsafe=params),
        promises=True,
        without="rows of all pairs: more contacts at rest, more stored stops",
    ),
    "one_step": Contender(
        lambda env, params: JSSAShield(env, recovery=0.0, failsafe=params),
        promises=True,
        without="recovery rate: more contacts at rest, more stored stops",
    ),
}
"""Shields by the names that campaigns have for them, whole ones first.

``full`` is ``jssa+stop``, ``published`` is ``jssa_published``, and ``unshielded`` is no shield at all; ``none`` is the
filter, as everywhere, which keeps the jerk bounds and brakes for a fault. Filters under their own names:
:func:`contender`.
"""


def contender_names() -> tuple[str, ...]:
    """All that :func:`contender` takes."""
    return (
        *CONTENDERS,
        *PROFILES,
        *(name + end for end in ("", STOP) for name in FILTERS if name + end not in CONTENDERS),
    )


def contender(name: str) -> Contender:
    """The contender of a name in :data:`CONTENDERS`, or a filter by its own name, bare or with the verified stop.

    Raises:
        ParameterError: Unknown name.
    """
    known_name("filter", name, contender_names())
    return CONTENDERS[name] if name in CONTENDERS else _named(name)


# ---- faults ------------------------------------------------------------------------------------------

LATENCIES = (0, 25, 50, 100, 150, 200)
"""Delays that nobody reports [ms]."""

FAULTS: tuple[str, ...] = (*SENSOR_FAULTS, "missed ticks", *(f"unmodelled {ms} ms" for ms in LATENCIES), *CAMERAS)
"""Names of what can be wrong between people and shield."""

NO_SENSOR = "none"
"""The fault that is none: the truth is seen."""

REPORTED = (*(name for name, faults in SENSOR_FAULTS.items() if faults.reported), "missed ticks")
"""Faults within the assumptions: age and validity, with the bound on the noise, tell all."""


JOINTS = tuple(name for name, faults in SENSOR_FAULTS.items() if faults.seen and not faults.reported)
"""Faults of joint state and clock, which a shield has to notice by itself."""

SEEN = tuple(name for name, camera in CAMERAS.items() if camera.reported)
"""Cameras within the assumptions that a shield behind them is given."""


def within_assumptions(human: str, fault: str) -> bool:
    """Whether a shield that promises something has to keep its promise with these people under this fault."""
    return not too_fast(human) and fault in (*REPORTED, *JOINTS, *SEEN, f"unmodelled {LATENCIES[0]} ms")


def spoiled(env: gym.Env, fault: str) -> gym.Env:
    """An environment with a fault of :data:`FAULTS` between it and the shield that will be put around it.

    Raises:
        ParameterError: Unknown fault.
    """
    known_name("fault", fault, FAULTS)
    if fault == NO_SENSOR:
        return env
    if fault == "missed ticks":
        return MissedTicks(env)
    if fault in SENSOR_FAULTS or fault in CAMERAS:
        return SensorModel(env, fault)
    return Late(env, _ticks(env, 1e-3 * float(fault.split()[1])))


def assumed_of(fault: str) -> FailsafeParams:
    """What a shield behind a fault of :data:`FAULTS` is told: the bound on its noise; behind a camera what it says."""
    if fault in CAMERAS:
        return CAMERAS[fault].assumptions
    return FailsafeParams(position_error=SENSOR_FAULTS[fault].noise if fault in SENSOR_FAULTS else 0.0)


def shielded(env: gym.Env, name: str, fault: str = "none") -> gym.Env:
    """An environment with a fault and a shield of :func:`contender` that knows what :func:`assumed_of` says.

    Raises:
        ParameterError: Unknown shield or fault.
    """
    return contender(name).wrap(spoiled(env, fault), assumed_of(fault))
