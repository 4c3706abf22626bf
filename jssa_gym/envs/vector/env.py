"""Many environments as one: arms driven by joint jerk beside people, moved in one compiled call a step."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from jssa_gym import robots
from jssa_gym.envs.arm import DT, MOVING, ArmEnv
from jssa_gym.envs.observation import bodies
from jssa_gym.envs.tasks import Task
from jssa_gym.envs.vector.options import checked_mask, checked_mode, checked_seeds, refuse_singular
from jssa_gym.envs.vector.people import beside, refuse_foreign
from jssa_gym.envs.vector.tasks import Moments, batched
from jssa_gym.exceptions import InvalidActionError
from jssa_gym.humans import Given, make_human
from jssa_gym.kernels.records import SEGMENT, records
from jssa_gym.registration import HORIZON
from jssa_gym.robots import RobotModel
from jssa_gym.tick.moves import Measured, measured, move_all, observe_all, take_actions
from jssa_gym.types import Array
from jssa_gym.validation import positive_integer
from jssa_gym.vectors import Infos, Mask, as_infos, stacked

Stepped = tuple[NDArray[np.float32], Array, Mask, Mask, Infos]


class VectorArmEnv(VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Many arms, each beside people of its own; see :class:`~jssa_gym.ArmEnv` for what each of them is.

    Environment ``e`` gives, bit for bit, what a single one gives that was reset with the same seed: ``reset(seed=s)``
    seeds them with s, s + 1, and so on. Nothing depends on how many there are.

    ``infos`` has Gymnasium's form: arrays of shape (E, ...) under the keys of a single ``info``, and beside each of
    them, under ``_key``, who says it. With ``AutoresetMode.SAME_STEP`` there are ``final_obs`` and ``final_info`` too;
    with ``DISABLED`` those that are over are to be reset by ``reset(options={"reset_mask": ...})``.

    Args:
        num_envs: How many.
        task, human, scene, robot, terminate_on, d_min, dt: As of :class:`~jssa_gym.ArmEnv`.
        observation: ``"closest"`` or ``"full"``; dictionaries are single environments'.
        dynamics: ``"kinematic"``; MuJoCo simulates one arm at a time.
        max_episode_steps: Steps after which an episode is truncated; None for never.
        autoreset_mode: When those that are over begin anew, an ``AutoresetMode`` or its value.
        render_mode: None; a single environment with the same seed draws the same.

    Raises:
        ParameterError: An argument is unknown or out of range, or asks for what cannot be done for many at once; the
            message says what to do instead.
    """

    def __init__(
        self,
        num_envs: int,
        task: str | Task = "home",
        *,
        human: Given | Sequence[Given] | None = None,
        dynamics: Literal["kinematic", "servo"] = "kinematic",
        scene: Literal["table", "floor"] = "table",
        robot: str | Path | RobotModel = robots.DEFAULT,
        terminate_on: Sequence[str] = ("success", "moving_contact"),
        d_min: float = 0.05,
        dt: float = DT,
        max_episode_steps: int | None = HORIZON,
        observation: Literal["closest", "full"] = "closest",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = count = positive_integer("num_envs", num_envs)
        refuse_singular(dynamics, observation, render_mode)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self._limit = np.inf if max_episode_steps is None else positive_integer("max_episode_steps", max_episode_steps)
        self.prototype = one = ArmEnv(
            task, human=human, scene=scene, robot=robot, terminate_on=terminate_on, d_min=d_min, dt=dt,
            observation=observation,
        )  # fmt: skip
        """A single environment like all of them: what begins their episodes."""
        refuse_foreign(one.human)
        self.robot, self.dt, self.d_min, self.planes = one.robot, one.dt, one.d_min, one.planes
        self.task, self.human, self.terminate_on = one.task, one.human, one.terminate_on
        self.single_observation_space, self.single_action_space = one.observation_space, one.action_space
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)

        rehearsal = make_human(one.human).reset(np.random.default_rng(0))
        self.part_names = rehearsal.names
        """Names of everybody's capsules."""
        n, k = self.robot.n, len(rehearsal.radius)
        self.person = np.array(rehearsal.person)
        """Person of each of them, shape (k,)."""
        one._around.take(rehearsal)
        self._crowd = beside(one.human, count, k)
        looked_at = len(self.robot.capsules) if one.human.reacts else 0
        parts = one._around.seen.parts.shape[0]
        self._measured = measured(count, parts, records((count, looked_at), SEGMENT))
        self._task = batched(self.task, count, n, self.part_names)
        self.state = np.zeros((count, 3, n))
        """Joint states, rows position, velocity, acceleration."""
        self.time = np.zeros(count)
        """Time of each episode [s]."""
        self._dts = np.full(count, self.dt)
        self._steps, self._held = np.zeros((2, count), np.int64)
        self._over = np.zeros(count, np.bool_)
        self.began = np.zeros(count, np.bool_)
        """Which episodes began in the last ``step`` or ``reset``."""
        self.waits = False
        """With ``DISABLED``, whether those that are over sit out what follows, rather than that ``step`` refuses it."""
        self._rngs: list[np.random.Generator | None] = [None] * count
        self._seeds: list[int | None] = [None] * count
        self._observations = np.zeros((count, one.layout.size), np.float32)
        self._begun = False

    # ---- who is there ----------------------------------------------------------------------------------

    @property
    def people(self) -> tuple[Array, Array]:
        """Everybody's capsules: starts, ends, their velocities, shape (E, 4, k, 3), and radii, shape (E, k)."""
        return self._crowd.ends, self._crowd.radius

    @property
    def measured(self) -> Measured:
        """What was measured of everybody's last step; views."""
        return self._measured

    @property
    def goals(self) -> Array:
        """The tasks' goals, shape (E, ...); of waypoints each arm's first :meth:`goal_of` are its own. A view."""
        return self._task.goal

    def goal_of(self, e: int) -> Array:
        """The goal of arm ``e`` at present, as a single environment's; a copy."""
        return self._task.goal_of(e).copy()

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # ty: ignore[incompatible-property-override]  # as Gymnasium's
        """Seed of every environment; None for none so far."""
        return tuple(self._seeds)

    @property
    def np_random(self) -> tuple[np.random.Generator | None, ...]:  # ty: ignore[incompatible-property-override]
        """Generator of every environment; None for none so far."""
        return tuple(self._rngs)

    # ---- beginnings ------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Infos]:
        """Begin episodes.

        Args:
            seed: The first environment's, the next has the next; or one for each. None goes on drawing.
            options: ``reset_mask``, shape (E,) of bool, says which begin, all without it; the rest is as of a single
                environment's and the same for all.

        Raises:
            ParameterError: Seeds, mask or another option are unsound.
        """
        options = dict(options or {})
        which = checked_mask(options.pop("reset_mask", None), self.num_envs)
        seeds = checked_seeds(seed, self.num_envs)
        values = self._begin(which, seeds, options)
        self._over[which] = False
        self._begun = self._begun or bool(which.all())
        return self._observations.copy(), as_infos(values, which)

    def _begin(
        self, which: Mask, seeds: Sequence[int | None], options: dict[str, Any]
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """Begin an episode of each arm ``which`` as a single environment begins it; what is said of them."""
        one, crowd, values = self.prototype, self._crowd, {}
        for e in np.flatnonzero(which).tolist():
            one._np_random, one._np_random_seed = self._rngs[e], self._seeds[e]
            one.human = crowd.motion_of(e)
            self._observations[e], info = one.reset(seed=seeds[e], options=options)
            self._rngs[e], self._seeds[e] = one._np_random, one._np_random_seed
            self.state[e], self.time[e], self._steps[e], self._held[e] = one.state, 0.0, 0, 0
            self._task.begin(e, one._goal, one._progress)
            crowd.begin(e, one._people, self._rngs[e])
            self._measured.segments[e] = one._around.seen.segments[: self._measured.segments.shape[1]]
            values = values or stacked(info, self.num_envs)
            for key, value in info.items():
                values[key][e] = value
        self.began = which
        return values

    # ---- steps -----------------------------------------------------------------------------------------

    def step(self, actions: NDArray[Any]) -> Stepped:
        """Apply joint jerks for one control step.

        Args:
            actions: Jerks in jerk bounds, shape (E, n); finite values outside [-1, 1] are clipped. Those of arms that
                begin an episode in this step do not count.

        Raises:
            InvalidActionError: Wrong shape or type, or not finite.
            gymnasium.error.ResetNeeded: There was no ``reset`` yet, or of one that is over.
        """
        live, jerk = self.ready(), np.zeros((self.num_envs, self.robot.n))
        fraction = self.checked(actions)
        wrong = take_actions(fraction, self.prototype._jerk_bound, live, jerk)
        if wrong >= 0:
            raise InvalidActionError(f"an action has to be finite, got {actions[wrong]!r} for environment {wrong}")
        values, rewards, terminated, observations = self._advance(fraction, jerk, live)
        truncated = self._steps >= self._limit
        again = ~live
        rewards[again], terminated[again], truncated[again] = 0.0, False, False
        self._observations[live] = observations[live]
        self._over = terminated | truncated
        infos: Infos = {}
        if self.autoreset_mode == AutoresetMode.DISABLED:
            self._over |= again
            again = np.zeros_like(again)
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            again = self._over.copy()
            if again.any():
                # copies: in what is said now, beginnings take the place of ends
                ends = {key: value.copy() for key, value in values.items()}
                infos = final_infos(self._observations, as_infos(ends, again), again)
        if again.any():
            for key, value in self._begin(again, [None] * self.num_envs, {}).items():
                values[key][again] = value[again]
        self.began = again
        everybody = np.ones(self.num_envs, np.bool_)
        return self._observations.copy(), rewards, terminated, truncated, infos | as_infos(values, everybody)

    def ready(self) -> Mask:
        """Who moves in the next step, shape (E,).

        Raises:
            gymnasium.error.ResetNeeded: Nobody can.
        """
        if not self._begun:
            raise gym.error.ResetNeeded("reset() has to come before step()")
        disabled = self.autoreset_mode == AutoresetMode.DISABLED
        if disabled and not self.waits and self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise gym.error.ResetNeeded(f"environments {over} are over: reset(options={{'reset_mask': ...}}) them")
        return np.ones(self.num_envs, np.bool_) if self.autoreset_mode == AutoresetMode.SAME_STEP else ~self._over

    def checked(self, actions: Any) -> Array:
        """Actions as float64, shape (E, n), a copy.

        Raises:
            InvalidActionError: They are no array of that shape of real numbers.
        """
        shape = (self.num_envs, self.robot.n)
        array = np.asarray(actions)
        if isinstance(actions, np.ma.MaskedArray) or array.dtype.kind not in "fiu" or array.shape != shape:
            raise InvalidActionError(
                f"actions are an array of real numbers of shape {shape}, got shape {array.shape} of type {array.dtype}"
            )
        return array.astype(np.float64)

    def _advance(
        self, fraction: Array, jerk: Array, live: Mask
    ) -> tuple[dict[str, NDArray[Any]], Array, Mask, NDArray[np.float32]]:
        """Move people and arms, and judge what has become of them; what is said of arms that do not live is nothing."""
        one, crowd, seen, task = self.prototype, self._crowd, self._measured, self._task
        crowd.step(live, self._dts, seen.segments, self.robot.capsule_names)
        self._steps[live] += 1
        self.time = self._steps * self.dt
        body, scratch = one._around.pointers
        move_all(body, (crowd.ends, crowd.radius), live, self.state, jerk, self.dt, scratch, seen)
        moments = Moments(self.state[:, 0], self.state[:, 1], seen.tip[:, 0], seen.tip_speed)
        task.advance(moments, crowd.ends, live, self.dt)
        value = task.value(moments)
        self._held = np.where(task.reached(value, moments), self._held + 1, 0)
        success = self._held >= one._hold_steps
        moving = seen.contact_speed > MOVING
        values = self._told(jerk, success)
        values |= task.metrics(value)
        effort = (fraction[:, None, :] @ fraction[:, :, None])[:, 0, 0] / fraction.shape[1]
        rewards = np.zeros(self.num_envs)
        own = task.rewarded(value, success)
        for (key, weight), x in zip(one._terms, (*own, effort, values["cost"], moving.astype(np.float64)), strict=True):
            values[key] = weight * x
            rewards += values[key]
        terminated = (
            (success & one._ends_success)
            | (moving & one._ends_moving)
            | (seen.violation & one._ends_violation)
            | ((seen.distance <= 0.0) & one._ends_contact)
        )
        observations = np.empty_like(self._observations)
        own = task.observe(moments)
        if one._parts:
            own = np.concatenate([bodies(crowd.ends, self.robot.mount, one._parts), own], axis=1)
        observe_all(self.state, seen, own, one._scaling, observations)
        return values, rewards, terminated, observations

    def _told(self, jerk: Array, success: Mask) -> dict[str, NDArray[Any]]:
        """What ``info`` says, as of a single environment's."""
        distance = self._measured.distance.copy()
        values: dict[str, NDArray[Any]] = {
            "distance": distance,
            "contact": distance <= 0.0,
            "contact_speed": self._measured.contact_speed.copy(),
            "cost": (distance < self.d_min).astype(np.float64),
            "jerk": jerk,
            "limit_violation": self._measured.violation.copy(),
            "success": success,
            "is_success": success.copy(),
        }
        if self.robot.uncovered:
            uncovered = np.full(self.num_envs, None, object)
            uncovered[:] = [self.robot.uncovered] * self.num_envs
            values["uncovered"] = uncovered
        return values

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing is open."""


def final_infos(observations: NDArray[np.float32], infos: Infos, who: Mask) -> Infos:
    """The ends of episodes, as Gymnasium's vectors tell them."""
    last = np.full(len(who), None, object)
    for e in np.flatnonzero(who):
        last[e] = observations[e].copy()
    return {"final_obs": last, "_final_obs": who.copy(), "final_info": infos, "_final_info": who.copy()}
