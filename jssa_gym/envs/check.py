"""Whether an environment of one's own offers what a shield relies on."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import gymnasium as gym
import numpy as np

from jssa_gym.envs.deviation import largest
from jssa_gym.envs.diagnosis import Motion
from jssa_gym.envs.probe import Run, difference, drive, probing_jerks
from jssa_gym.envs.scenery import scene_troubles
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.kernels.motion import violates
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.text import counted
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer, whole_number

_ROUNDING = 1e-9
"""Share of the limits by which an arm at rest may move, or be beyond them."""

_FEWEST = 8
"""Ticks that tell one mistake from another."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that an environment does not do as a shield relies on it."""

    name: str
    """What kind of mistake it is; :func:`check_env` lists them."""
    severity: Literal["error", "warning"]
    """Whether a shield around the environment fails or stands still, or only works worse."""
    message: str
    """What was wrong and what would be right."""

    def __str__(self) -> str:
        return f"{self.name} ({self.severity}): {self.message}"


@dataclass(frozen=True, slots=True)
class EnvReport:
    """What :func:`check_env` found."""

    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Those of severity ``error``."""
        return tuple(finding for finding in self.findings if finding.severity == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Those of severity ``warning``."""
        return tuple(finding for finding in self.findings if finding.severity == "warning")

    def __str__(self) -> str:
        if not self.findings:
            return "nothing found"
        return "\n".join(f"- {finding}" for finding in self.findings)


def check_env(
    env: gym.Env,
    *,
    params: FailsafeParams | None = None,
    ticks: int = 80,
    seed: int = 0,
    raise_on_error: bool = True,
) -> EnvReport:
    """Whether an environment offers what a shield relies on: try it before a shield is put around it.

    It drives the arm by small random jerks, twice from the same seed, compares the joint states with the exact motion
    and looks at every field of every scene. It needs no people, but sees only those who are there, and only for as
    long as it looks: that nothing is found does not prove that nothing is wrong.

    ====================================================  ============================================================
    names of findings                                     what is looked at
    ====================================================  ============================================================
    ``robot``, ``dt``, ``scene``, ``action_space``,       the interface; ``shield``: there is one already
    ``shield``, ``raises``
    ``reset``                                             the arm begins at rest, inside its limits, and not where the
                                                          last episode ended
    ``time``                                              advances by ``dt`` a step
    ``frozen``, ``stale``, ``lag``, ``euler``,            the motion of the arm
    ``rounded``, ``repeated``, ``scaled``, ``clipped``,
    ``bias``, ``drift``, ``measured``, ``position``,
    ``velocity``, ``acceleration``, ``float32``,
    ``motion``
    ``fields``, ``age``, ``valid``, ``radius``,           the scene; ``precision``: people in single precision
    ``planes``, ``names``, ``masked``, ``precision``,
    ``constant``, ``reread``
    ``speed``, ``velocities``, ``frozen``                 people: within their speed bounds, velocities as they move
    ``random``                                            the same seed and actions give the same bits
    ``short``                                             the episode ended before much could be seen
    ====================================================  ============================================================

    Args:
        env: The environment, wrapped or not, without a shield. It is reset twice and left in the middle of an episode.
        params: What the shield will assume about people; by default what it assumes by default.
        ticks: How long to look, at least 8.
        seed: Of ``reset`` and of the jerks.
        raise_on_error: Whether errors are raised, all at once, or only returned.

    Raises:
        InterfaceError: There is an error, and ``raise_on_error``; the message lists all findings.
        ParameterError: ``env`` is no environment, or an argument is out of range.
    """
    if not isinstance(env, gym.Env):
        raise ParameterError(f"env has to be a gymnasium.Env, got {env!r}")
    if positive_integer("ticks", ticks) < _FEWEST:
        raise ParameterError(f"ticks has to be at least {_FEWEST}, got {ticks}")
    if params is not None and not isinstance(params, FailsafeParams):
        raise ParameterError(f"params has to be FailsafeParams, got {params!r}")
    found = _findings(env, FailsafeParams() if params is None else params, ticks, whole_number("seed", seed))
    report = EnvReport(tuple(dict.fromkeys(found)))
    if report.errors and raise_on_error:
        raise InterfaceError(f"{env} is not what a shield relies on:\n{report}")
    return report


def _findings(env: gym.Env, params: FailsafeParams, ticks: int, seed: int) -> Iterator[Finding]:
    robot, dt = _offered(env, "robot"), _offered(env, "dt")
    wrong = [*_interface(env, robot, dt)]
    if wrong:
        # whether there is a scene can be said all the same
        yield from wrong
        yield from _scene_missing(env, seed)
        return
    actions = probing_jerks(robot, float(dt), ticks, seed)
    first, second = drive(env, actions, seed), drive(env, actions, seed)
    if first.shielded:
        yield Finding("shield", "error", "the environment has a shield already: check what is inside it")
        return
    for run in (first, second):
        if run.trouble:
            yield Finding("raises", "error", run.trouble)
    seen = [*_scenes(first, robot, float(dt), params)]
    yield from seen
    moved, tolerance = _motion(first, robot, float(dt), params, actions)
    for number, run in enumerate((first, second)):
        yield from _reset(run, robot, tolerance, ("", " the second time")[number])
    yield from _left_over(first, second, robot, tolerance)
    for one in moved:
        # what the types say already needs not be said of the values
        if one.name != "float32" or all(other.name != "float32" for other in seen):
            yield one
    yield from _deterministic(first, second)
    if not first.trouble and len(first.scenes) <= _FEWEST:
        yield Finding(
            "short",
            "warning",
            f"the episode ended after {counted(len(first.scenes) - 1, 'step')}: too early to see much",
        )


# ---- interface -----------------------------------------------------------------------------------------


def _offered(env: gym.Env, name: str) -> Any:
    """An attribute from anywhere in the wrapper chain; the exception if it cannot be had."""
    try:
        return env.get_wrapper_attr(name)
    except Exception as error:  # whatever an environment of somebody's does, it is reported
        return error


def _interface(env: gym.Env, robot: Any, dt: Any) -> Iterator[Finding]:
    if not isinstance(robot, RobotModel):
        had = f"got {type(robot).__name__}" if not isinstance(robot, Exception) else f"there is none: {robot}"
        yield Finding("robot", "error", f"robot has to be a RobotModel, as make_robot('arm.xml') returns; {had}")
    try:
        step = float(dt)
    except (TypeError, ValueError):
        step = np.nan
    if not 0.0 < step < np.inf:
        yield Finding("dt", "error", f"dt has to be the control step, a positive number [s]; got {dt!r}")
    space = getattr(env, "action_space", None)
    shape = (robot.n,) if isinstance(robot, RobotModel) else None
    if not (
        isinstance(space, gym.spaces.Box)
        and (shape is None or space.shape == shape)
        and np.all(space.low == -1.0)
        and np.all(space.high == 1.0)
    ):
        wanted = f"Box(-1, 1, {shape or '(n,)'})"
        yield Finding("action_space", "error", f"it has to be {wanted}, shares of the joints' jerk bounds; got {space}")


def _scene_missing(env: gym.Env, seed: int) -> Iterator[Finding]:
    try:
        env.reset(seed=seed)
    except Exception as error:
        yield Finding("raises", "error", f"reset raised {type(error).__name__}: {error}")
        return
    if isinstance(scene := _offered(env, "scene"), Exception):
        yield Finding("scene", "error", f"scene has to be the present as a Scene, after reset and every step: {scene}")


# ---- what was seen -------------------------------------------------------------------------------------


def _scenes(run: Run, robot: RobotModel, dt: float, params: FailsafeParams) -> Iterator[Finding]:
    """What is wrong with the fields of the scenes, their clock and their people."""
    seen: set[tuple[str, str]] = set()
    for name, severity, what, message in scene_troubles(run.scenes, robot, dt, params):
        if (name, what) not in seen:
            seen.add((name, what))
            yield Finding(name, severity, message)
    for k, what in enumerate(run.rereads):
        if what:
            yield Finding("reread", "error", f"{what} was another one when tick {k}'s scene was read again")
            break


def _reset(run: Run, robot: RobotModel, tolerance: Array, when: str) -> Iterator[Finding]:
    states = _states(run, robot, tolerance)
    if len(states) == 0:
        return
    limits, state = robot.limits, states[0]
    bounds = limits.bounds()
    scale = np.array([np.full(robot.n, np.inf), limits.velocity, limits.acceleration])
    over = np.maximum(np.abs(state) - tolerance, 0.0) / scale
    if not np.all(over <= _ROUNDING):
        moves = largest(np.where(over > _ROUNDING, state, 0.0), robot, scale)
        yield Finding("reset", "error", f"the arm has to be at rest after reset{when}, it moves at {moves}")
    if violates(np.array([state[0], 0.0 * state[0], 0.0 * state[0]]), np.zeros(robot.n), bounds, _ROUNDING):
        beyond = "; ".join(
            f"{robot.joint_names[j]} is at {state[0, j]:.4g} rad, its limits are {low:.4g} to {high:.4g} rad"
            for j, (low, high) in enumerate(limits.position)
            if not low <= state[0, j] <= high
        )
        yield Finding("reset", "error", f"the arm has to be inside its position limits after reset{when}: {beyond}")


def _left_over(first: Run, second: Run, robot: RobotModel, tolerance: Array) -> Iterator[Finding]:
    """Whether the second episode begins where the first one ended."""
    one, other = (_states(run, robot, tolerance) for run in (first, second))
    if len(one) < 2 or len(other) == 0:
        return
    allowed = tolerance[0] + _ROUNDING * (robot.limits.position @ [-1.0, 1.0])
    start, end, again = one[0, 0], one[-1, 0], other[0, 0]
    j = int(np.argmax(np.abs(again - start) - allowed))
    if np.abs(again[j] - start[j]) > allowed[j] and np.all(np.abs(again - end) <= allowed):
        yield Finding(
            "reset",
            "error",
            f"the arm begins where the last episode ended: with the same seed {robot.joint_names[j]} is at "
            f"{again[j]:.9g} rad after reset the second time, at {start[j]:.9g} rad the first",
        )


def _states(run: Run, robot: RobotModel, tolerance: Array) -> Array:
    """Joint states as long as they are some, shape (k, 3, n); 0 where they are neither finite nor measured."""
    states, unmeasured = [], tolerance == np.inf
    for scene in run.scenes:
        try:
            state = np.array([np.asarray(values, np.float64) for values in scene.robot])
        except Exception:  # said elsewhere
            break
        if state.shape != (3, robot.n) or not np.all(np.isfinite(state) | unmeasured):
            break
        states.append(np.where(unmeasured & ~np.isfinite(state), 0.0, state))
    return np.array(states)


def _motion(
    run: Run, robot: RobotModel, dt: float, params: FailsafeParams, actions: Array
) -> tuple[list[Finding], Array]:
    """What is wrong with the arm's motion; how far its readings may be off, or are if measured, shape (3, n)."""
    tolerance = params.tolerance_of(robot)
    states = _states(run, robot, tolerance)
    if len(states) < 2:
        return [], tolerance
    motion = Motion(robot, dt, actions[: len(states) - 1], states, tolerance)
    diagnosis = motion.diagnose()
    if diagnosis is None:
        return [], tolerance
    if diagnosis.tolerance is not None:
        tolerance = np.maximum(tolerance, diagnosis.tolerance)
    if motion.tolerated:
        text = f"{diagnosis.message} (it is within state_tolerance while looked at)"
        return [Finding(diagnosis.name, "warning", text)], tolerance
    return [Finding(diagnosis.name, "error", diagnosis.message)], tolerance


def _deterministic(first: Run, second: Run) -> Iterator[Finding]:
    text = "the same seed and actions have to give the same bits, or nothing can be played again"
    if len(first.scenes) != len(second.scenes):
        yield Finding("random", "warning", f"the episode ends at another tick the second time: {text}")
        return
    for k in range(len(first.scenes)):
        what = difference(first.scenes[k], second.scenes[k])
        if not what and first.results[k] != second.results[k]:
            what = "observation or reward"
        if what:
            yield Finding("random", "warning", f"{what} is another one at tick {k} the second time: {text}")
            return
