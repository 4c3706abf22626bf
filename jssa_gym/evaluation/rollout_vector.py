"""Episodes of many arms at once, recorded."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.evaluation.trace import WITHOUT_SHIELD, beginning, trace_of_columns
from jssa_gym.exceptions import InterfaceError
from jssa_gym.policies.vector import VectorPolicy, arms_of
from jssa_gym.shields.vector_perceived import PerceivingShield
from jssa_gym.shields.words import KINDS, kind_codes
from jssa_gym.tick import layout
from jssa_gym.types import Array, CapsuleSet, Status, Trace
from jssa_gym.vectors import Infos, Mask

_TOLD = {name: absent for name, absent in WITHOUT_SHIELD.items() if not isinstance(absent, str)}
"""What a shield says in numbers, and what stands there without one."""

_KINDS = np.array(KINDS, object)
"""Kinds by their codes."""


class TimedShield(PerceivingShield):
    """A shield of many arms that also measures how long their decisions take."""

    elapsed = np.nan
    """What one arm has of the last call that decided for all that were under way [s]."""

    @property
    def chosen(self) -> NDArray[np.int64]:
        """What was chosen by each arm's last decision, shape (E,); a view."""
        return self._batch.answer.told["chosen"]

    def _decide(self, live: Mask) -> layout.Answer:
        start = time.perf_counter()
        answer = super()._decide(live)
        self.elapsed = (time.perf_counter() - start) / max(int(np.count_nonzero(live)), 1)
        return answer


class VectorRecorder:
    """Takes down episodes of a vector, a row a control step, as :class:`~jssa_gym.evaluation.rollout.Recorder` does.

    Args:
        envs: A :class:`~jssa_gym.VectorArmEnv`, or a :class:`TimedShield` around it; all arms have just been reset.
        steps: There are at most so many.
    """

    def __init__(self, envs: VectorEnv, steps: int) -> None:
        arms, shield = envs.unwrapped, envs if isinstance(envs, TimedShield) else None
        if not (isinstance(arms, VectorArmEnv) and (shield is not None or arms is envs)):
            raise InterfaceError(f"{envs} is neither a VectorArmEnv nor a TimedShield around one")
        self._arms, self._shield = arms, shield
        state, goals, (ends, self._radius) = arms.state, arms.goals, arms.people
        self._first = state.copy(), ends[:, :2].copy(), [arms.goal_of(e) for e in range(arms.num_envs)]
        shape, n = (steps, arms.num_envs), arms.robot.n
        self._said: dict[str, NDArray[Any]] = {
            name: np.empty((*shape, *rest), kind)
            for name, kind, rest in (
                *(("jerk", np.float64, (n,)), ("reward", np.float64, ()), ("success", np.bool_, ())),
                *(("limit_violation", np.bool_, ()), ("contact", np.bool_, ()), ("contact_speed", np.float64, ())),
            )
        }
        self._told = {name: np.full(shape, absent) for name, absent in _TOLD.items()}
        self._chosen = np.zeros(shape, np.int64)
        self._reasons: list[dict[int, str]] = [{} for _ in range(arms.num_envs)]
        self._state, self._ends = np.empty((*shape, 3, n)), np.empty((*shape, *ends[0, :2].shape))
        self._near, self._pair = np.empty((*shape, 3)), np.empty((*shape, 2), np.int64)
        self._goal = np.empty((*shape, *goals.shape[1:]))
        self._nominal = np.empty((*shape, n))
        self._time, self._elapsed = np.empty(shape), np.full(shape, np.nan)
        self._count = 0

    def take(self, rewards: Array, infos: Infos, live: Mask) -> None:
        """Take down the step that was just done.

        Args:
            rewards: Of the step, shape (E,).
            infos: What the environments say of it.
            live: Whose step it was, shape (E,).
        """
        t, arms, shield, measured = self._count, self._arms, self._shield, self._arms.measured
        for name, array in self._said.items():
            array[t] = rewards if name == "reward" else infos[name]
        self._state[t], self._time[t], self._goal[t] = arms.state, arms.time, arms.goals
        self._ends[t], self._near[t], self._pair[t] = arms.people[0][:, :2], measured.near[:, :3], measured.pair
        if shield is None:
            self._nominal[t] = infos["jerk"]
        else:
            self._nominal[t], self._chosen[t], self._elapsed[t] = shield.nominal, shield.chosen, shield.elapsed
            for name, array in self._told.items():
                array[t] = infos[f"shield/{name}"]
            told = np.flatnonzero(live & (infos["shield/status"] != Status.NOMINAL))
            for e, reason in zip(told.tolist(), shield.reasons(told), strict=True):
                self._reasons[e][t] = reason
        self._count += 1

    def trace(self, e: int, count: int, name: str = "", ended: str = "running") -> Trace:
        """What was taken down of the first ``count`` steps of arm ``e``."""
        arms, (states, ends, goals), reasons = self._arms, self._first, self._reasons[e]
        own = slice(count), e
        state, people, near, goal = self._state[own], self._ends[own], self._near[own], goals[e]
        human = CapsuleSet(*ends[e], *np.zeros_like(ends[e]), self._radius[e], arms.part_names, arms.person)
        once = {
            **beginning(arms.robot, states[e], human, arms.planes),
            "name": name,
            "ended": ended,
            "dt": arms.dt,
            "dynamics": arms.prototype.dynamics,
            "task": arms.task.name,
            "holds": not arms.task.ends,
            "d_min": arms.d_min,
        }
        columns: dict[str, Any] = {name: array[own] for name, array in (self._said | self._told).items()}
        columns |= {
            "time": self._time[own],
            "position": state[:, 0],
            "velocity": state[:, 1],
            "acceleration": state[:, 2],
            "nominal": self._nominal[own],
            # of waypoints there may be fewer than somebody else's
            "goal": self._goal[own].reshape(count, -1)[:, : goal.size],
            "distance": near[:, 0],
            "speed": near[:, 1],
            "acceleration_of_distance": near[:, 2],
            "pair": self._pair[own],
            "reason": [reasons.get(t, "") for t in range(count)],
            "kind": self._kinds(own),
            "shield_time": self._elapsed[own],
            "human_start": people[:, 0],
            "human_end": people[:, 1],
        }
        return trace_of_columns(once, columns)

    def _kinds(self, own: tuple[slice, int]) -> list[str]:
        """What kind of jerk was applied in the steps of an arm; nothing without a shield."""
        status, choice, chosen = self._told["status"][own], self._told["choice"][own], self._chosen[own]
        if self._shield is None:
            return [""] * len(status)
        return _KINDS[kind_codes({"status": status, "choice": choice, "chosen": chosen})].tolist()


def rollouts(
    envs: VectorEnv,
    policy: VectorPolicy,
    seeds: Sequence[int],
    policy_seeds: Sequence[int],
    names: Sequence[str],
    *,
    steps: int,
) -> Iterator[tuple[Trace, float]]:
    """Run one episode of every arm and record them all.

    Args:
        envs: As of :class:`VectorRecorder`, with ``AutoresetMode.DISABLED``.
        policy: Maps observations to actions.
        seeds: Of the episodes, one for each arm.
        policy_seeds: Of what the policy draws in each.
        names: Of the traces.
        steps: At most so many.

    Returns:
        The traces, as of :func:`~jssa_gym.evaluation.rollout.rollout`, made one by one, and how long each episode took:
        its share, by its steps, of the time that all of them took [s].
    """
    arms, begin = arms_of(envs), time.perf_counter()
    arms.waits = True
    observations, _ = envs.reset(seed=list(seeds))  # ty: ignore[invalid-argument-type]  # one for each
    recorder, count = VectorRecorder(envs, steps), np.zeros(envs.num_envs, np.int64)
    policy.begin(np.arange(envs.num_envs), policy_seeds)
    ended, live = ["running"] * envs.num_envs, np.ones(envs.num_envs, np.bool_)
    for _ in range(steps):
        observations, rewards, terminated, truncated, infos = envs.step(policy(observations))
        recorder.take(rewards, infos, live)
        count += live
        for e in np.flatnonzero(live & (terminated | truncated)).tolist():
            ended[e] = "terminated" if terminated[e] else "truncated"
        live &= ~(terminated | truncated)
        if not live.any():
            break
    each, counts = (time.perf_counter() - begin) / int(count.sum()), count.tolist()
    return ((recorder.trace(e, done, names[e], ended[e]), each * done) for e, done in enumerate(counts))
