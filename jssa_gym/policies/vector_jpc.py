"""The position controller of many arms: each does, bit for bit, what a :class:`JPCPolicy` of its own would do."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.control import JPC
from jssa_gym.control.many import NEVER, ManyJPC
from jssa_gym.control.path import PacedPath
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import InterfaceError
from jssa_gym.humans import nobody
from jssa_gym.policies.delays import Delay
from jssa_gym.policies.jpc import JPCPolicy
from jssa_gym.types import Array, JointState, Scene
from jssa_gym.vectors import Mask, wrapper_with


class VectorJPCPolicy:
    """Drives many arms by position controllers, one for each.

    What happens to an arm (a new goal, a plan, an interruption) is handled by a :class:`JPCPolicy` of its own; the
    ticks between are one compiled call for all. Paths are offered to the :class:`~jssa_gym.shields.vector.VectorShield`
    among the wrappers, if there is one. It has to be called in every step; arms whose clock stands still wait.

    Args:
        envs: A :class:`~jssa_gym.envs.vector.VectorArmEnv`, wrapped or not, whose joint states and goals it reads.
        host_delay, tolerance, clear, patience, yielding: As of :class:`JPCPolicy`.

    Raises:
        InterfaceError: It is another vector.
        ParameterError: An argument is out of range.
    """

    def __init__(
        self,
        envs: VectorEnv,
        *,
        host_delay: Delay = (0.0, 0.1),
        tolerance: float = 0.01,
        clear: float = 0.01,
        patience: float = 2.5,
        yielding: bool = True,
    ) -> None:
        arms = envs.unwrapped
        if not isinstance(arms, VectorArmEnv):
            raise InterfaceError(f"{envs} is no VectorArmEnv: give each environment a JPCPolicy of its own")
        self._arms = arms
        self._shield: Any = wrapper_with(envs, "offer")
        count, self._robot = arms.num_envs, arms.robot
        self._seats = [_Seat(arms, e, self._shield is not None) for e in range(count)]
        self._policies: list[Any] = [
            JPCPolicy(
                seat,  # ty: ignore[invalid-argument-type]  # what it reads of an environment
                host_delay=host_delay,
                tolerance=tolerance,
                clear=clear,
                patience=patience,
                yielding=yielding,
            )
            for seat in self._seats
        ]
        limits = self._robot.limits
        self._many = ManyJPC([policy.jpc for policy in self._policies], limits, arms.dt)
        self._jerk_bound = np.array(limits.jerk)
        one = self._policies[0]
        self._tip, self._tolerance = one._tip, one._tolerance
        self._scheduled = one._period is not None
        self._near = self._robot.n * one._near**2 * (1.0 + 1e-9)  # who is asked decides for itself
        self._time = np.full(count, np.inf)
        self._goals = np.full_like(arms.goals, np.nan)
        self._follows = np.zeros(count, np.bool_)  # goals that move
        self._visited, self._waypoints = np.zeros((2, count), np.int64)
        self._rows = np.arange(count)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms begin an episode now.

        Args:
            arms: Their numbers, shape (k,).
            seeds: What single policies would be made with, k of them.
        """
        for e, seed in zip(np.asarray(arms).tolist(), seeds, strict=True):
            self._policies[e].reseed(seed)
            self._time[e] = np.inf

    def __call__(self, observation: Any) -> Array:
        """The next jerks as shares of the jerk bounds, shape (E, n)."""
        many, time, state = self._many, self._arms.time.copy(), self._arms.state
        moves, fresh = time != self._time, time < self._time  # a clock that went back is a new episode's
        self._time = time
        asked: Mask = moves & (fresh | self._sees_another_goal() | self._comes_near(state))
        jerk, calm = np.zeros((len(time), self._robot.n)), moves & ~asked
        left = many.play(state, self._visited, calm, jerk)
        if self._shield is None:  # the first alternative is what is applied
            many.took(np.zeros(len(time), np.int64), calm & ~left)
        actions = np.clip(jerk / self._jerk_bound, -1.0, 1.0)  # rounding
        for e in np.flatnonzero(asked | left).tolist():
            actions[e] = self._ask(e, fresh=bool(fresh[e]))
        if self._shield is not None:
            self._shield.offer(many)
        return actions

    @property
    def controllers(self) -> list[JPC]:
        """Each arm's, as it is now; to look at."""
        for e in self._rows.tolist():
            self._many.fetch(e)
        return [policy.jpc for policy in self._policies]

    def _sees_another_goal(self) -> Mask:
        """Who may have another goal, shape (E,)."""
        goals = self._arms.goals
        if goals.shape != self._goals.shape:  # there may be more waypoints now
            self._goals = np.full_like(goals, np.nan)
        if self._tip:
            return self._follows & ~(np.abs(goals - self._goals).max(axis=1) <= self._tolerance)
        return (goals != self._goals).reshape(len(goals), -1).any(axis=1)

    def _comes_near(self, state: Array) -> Mask:
        """Who may have come near the next waypoint, shape (E,)."""
        left = self._visited < self._waypoints
        if not left.any():
            return left
        gap = self._goals[self._rows, np.where(left, self._visited, 0)] - state[:, 0]
        return left & ((gap**2).sum(axis=1) <= self._near)

    def _ask(self, e: int, *, fresh: bool) -> Array:
        """What arm ``e``'s own policy does, shape (n,)."""
        policy, many = self._policies[e], self._many
        many.fetch(e)
        policy._tick, policy._time = policy.jpc.tick, np.inf if fresh else -np.inf
        action = policy(None)
        many.take_back(e, min((due[0] for due in policy._due), default=NEVER))
        self._goals[e] = policy._goal if self._tip else self._arms.goals[e]
        self._follows[e] = policy.follows
        if self._scheduled and policy._goal.ndim == 2:
            self._visited[e], self._waypoints[e] = policy._visited, len(policy._goal)
        return action


class _Seat:
    """What one arm's policy sees of its environment.

    Args:
        arms: All environments.
        e: Which one.
        shielded: Whether paths can be offered.
    """

    def __init__(self, arms: VectorArmEnv, e: int, shielded: bool) -> None:
        self._arms, self._e, self._shielded = arms, e, shielded
        self.robot, self.dt, self.task = arms.robot, arms.dt, arms.task
        self._rest = nobody(), nobody(), arms.planes, np.zeros(0), np.zeros(0, np.bool_)

    @property
    def unwrapped(self) -> "_Seat":
        """Itself: there are no wrappers."""
        return self

    @property
    def scene(self) -> Scene:
        """The present, without people."""
        state = self._arms.state[self._e].copy()
        return Scene(float(self._arms.time[self._e]), JointState(*state), *self._rest)

    @property
    def goal(self) -> Array:
        """The arm's goal, of the shape that the task's have."""
        return self._arms.goal_of(self._e)

    def offer(self, path: PacedPath) -> None:
        """All paths are offered at once."""

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether it has an attribute, as a :class:`gymnasium.Env` says it."""
        return name != "offer" or self._shielded

    def get_wrapper_attr(self, name: str) -> Any:
        """An attribute, as a :class:`gymnasium.Env` gives it."""
        return getattr(self, name)
