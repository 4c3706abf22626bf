"""Policies of many arms at once: each arm does, bit for bit, what it would do with a policy of its own."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from jssa_gym.control import Cascade
from jssa_gym.control.vector import VectorResolvedRates
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.exceptions import InterfaceError
from jssa_gym.kernels.reach import nearest_to_point
from jssa_gym.policies.adversarial import BangBangPolicy, ChasePolicy, ConstantPolicy, LimitSeekingPolicy
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.loading import policy_file
from jssa_gym.policies.scripted import HoldPolicy, Policy, RandomPolicy, WanderPolicy
from jssa_gym.policies.straight import StraightPolicy
from jssa_gym.policies.vector_jpc import VectorJPCPolicy
from jssa_gym.policies.vector_learned import VectorLearned
from jssa_gym.types import Array, JointState

_AHEAD = 32
"""For how many steps is drawn at once."""


class VectorPolicy(Protocol):
    """Anything that maps observations of many arms to actions in [-1, 1].

    It is made for a vector of environments and reads what else it needs from there, as a policy of one arm does.
    """

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms have been reset to begin an episode, and draw from these seeds."""
        ...

    def __call__(self, observation: Array) -> Array:
        """The actions for observations of shape (E, ...), shape (E, n)."""
        ...


def arms_of(envs: VectorEnv) -> VectorArmEnv:
    """The arms of a vector, within its wrappers.

    Raises:
        InterfaceError: It is another vector.
    """
    arms = envs.unwrapped
    if not isinstance(arms, VectorArmEnv):
        raise InterfaceError(f"{envs} is no VectorArmEnv: give each environment a policy of its own")
    return arms


P = TypeVar("P", bound=Policy)


class _Each(Generic[P]):
    """Policies of one arm each, who are asked for what they draw, and what is calculated for all of them.

    Args:
        envs: The vector.
        kind: Makes the policy of an arm, by an environment like its own and a seed.
    """

    def __init__(self, envs: VectorEnv, kind: Callable[[gym.Env, int], P]) -> None:
        self._arms, self._kind = arms_of(envs), kind
        self._robot, self._limits = self._arms.robot, self._arms.robot.limits
        # what those who never begin do is nobody's
        self._ones = [kind(self._arms.prototype, 0)] * self._arms.num_envs

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """These arms have been reset to begin an episode, and draw from these seeds."""
        for e, seed in zip(arms.tolist(), seeds, strict=True):
            self._ones[e] = self._kind(self._arms.prototype, seed)

    @property
    def _states(self) -> JointState:
        """All joint states, of fields of shape (E, n)."""
        state = self._arms.state
        return JointState(state[:, 0], state[:, 1], state[:, 2])


class _Ahead(_Each[P]):
    """Those who draw in every step, ahead, as one after the other."""

    def __init__(self, envs: VectorEnv, kind: Callable[[gym.Env, int], P], draw: Callable[[P, int], NDArray]) -> None:
        super().__init__(envs, kind)
        self._draw = draw
        self._drawn = np.repeat(draw(self._ones[0], _AHEAD)[None], envs.num_envs, axis=0)
        self._used = np.full(envs.num_envs, _AHEAD)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        self._used[arms] = _AHEAD

    def _next(self) -> NDArray:
        """What each has of this step, shape (E, n)."""
        for e in np.flatnonzero(self._used == _AHEAD).tolist():
            self._drawn[e], self._used[e] = self._draw(self._ones[e], _AHEAD), 0
        drawn = self._drawn[np.arange(len(self._used)), self._used]
        self._used += 1
        return drawn


class VectorRandom(_Ahead[RandomPolicy]):
    """:class:`~jssa_gym.policies.RandomPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, RandomPolicy, RandomPolicy.draw)

    def __call__(self, observation: Array) -> Array:
        """Random actions, shape (E, n)."""
        return self._next()


class VectorBangBang(_Ahead[BangBangPolicy]):
    """:class:`~jssa_gym.policies.BangBangPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, BangBangPolicy, BangBangPolicy.draw)
        self._action = np.ones((envs.num_envs, self._robot.n))

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        for e in arms.tolist():
            self._action[e] = self._ones[e].action

    def __call__(self, observation: Array) -> Array:
        """Actions of ones and minus ones, shape (E, n)."""
        self._action = np.where(self._next(), -self._action, self._action)
        return self._action.copy()


class VectorConstant(_Each[ConstantPolicy]):
    """:class:`~jssa_gym.policies.ConstantPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, ConstantPolicy)
        self._action, self._until = np.zeros((envs.num_envs, self._robot.n)), np.full(envs.num_envs, -np.inf)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        self._until[arms] = -np.inf

    def __call__(self, observation: Array) -> Array:
        """The present actions, shape (E, n)."""
        time = self._arms.time
        for e in np.flatnonzero(time >= self._until).tolist():
            self._action[e], duration = self._ones[e].draw()
            self._until[e] = time[e] + duration
        return self._action.copy()


class VectorHold(_Each[HoldPolicy]):
    """:class:`~jssa_gym.policies.HoldPolicy` of many arms, at home."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, lambda env, seed: HoldPolicy(env))
        self._cascade, self._home = Cascade(self._limits), np.array(self._robot.home)

    def __call__(self, observation: Array) -> Array:
        """Actions towards home, shape (E, n)."""
        return self._cascade.jerk(self._states, self._home) / self._limits.jerk


class VectorWander(_Each[WanderPolicy]):
    """:class:`~jssa_gym.policies.WanderPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, WanderPolicy)
        count, n = envs.num_envs, self._robot.n
        self._cascade = Cascade(self._limits)
        self._target, self._share, self._until = np.zeros((count, n)), np.ones((count, 1)), np.full(count, -np.inf)

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        self._until[arms] = -np.inf

    def __call__(self, observation: Array) -> Array:
        """Actions towards the present postures, shape (E, n)."""
        arms, states, limits = self._arms, self._states, self._limits
        there = np.abs(self._target - states.position).max(axis=1) < WanderPolicy.NEAR
        for e in np.flatnonzero((arms.time >= self._until) | there).tolist():
            self._target[e], self._share[e] = self._ones[e].draw(arms.planes)
            self._until[e] = arms.time[e] + self._ones[e].patience
        wanted = self._cascade.velocity(states, self._target)
        fastest, hardest = self._share * limits.velocity, self._share * limits.acceleration
        return self._cascade.within(states, wanted, fastest, hardest) / limits.jerk


class VectorLimitSeeking(_Each[LimitSeekingPolicy]):
    """:class:`~jssa_gym.policies.LimitSeekingPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, LimitSeekingPolicy)
        shape, self._cascade = (envs.num_envs, self._robot.n), Cascade(self._limits, share=1.0)
        self._side, self._until = np.ones(shape), np.full(shape, -np.inf)
        self._fastest, self._hardest = np.zeros((2, *shape))

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        self._side[arms], self._until[arms] = 1.0, -np.inf

    def __call__(self, observation: Array) -> Array:
        """Actions that seek the limits, shape (E, n)."""
        states, time, (low, high) = self._states, self._arms.time, self._limits.position.T
        past = np.where(self._side > 0.0, states.position > high, states.position < low)
        turn = past | (time[:, None] >= self._until)
        for e in np.flatnonzero(turn.any(axis=1)).tolist():
            one = self._ones[e]
            one.redirect(float(time[e]), past[e], turn[e])
            self._side[e], self._until[e] = one.side, one.until
            self._fastest[e], self._hardest[e] = one.fastest, one.hardest
        wanted = self._side * self._fastest
        return self._cascade.within(states, wanted, self._fastest, self._hardest) / self._limits.jerk


class VectorChase(_Each[ChasePolicy]):
    """:class:`~jssa_gym.policies.ChasePolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, ChasePolicy)
        self._cascade = Cascade(self._limits, share=1.0)
        self._rates = VectorResolvedRates(self._robot, self._ones[0].damping)

    def __call__(self, observation: Array) -> Array:
        """Actions towards the nearest people, shape (E, n)."""
        states, (ends, radius) = self._states, self._arms.people
        velocity = np.zeros(states.position.shape)
        if radius.shape[1]:
            tip = self._rates.look(self._arms.state)[:, 0]
            nearest = [nearest_to_point(tip[e], *ends[e, :2], radius[e])[1] for e in range(len(radius))]
            velocity = self._rates.joint_velocity(np.array(nearest) - tip)
            share = np.max(np.abs(velocity) / self._limits.velocity, axis=1)
            velocity /= np.maximum(share, 1e-9)[:, None]
        target = states.position + velocity / self._cascade.kp
        return self._cascade.jerk(states, target) / self._limits.jerk


class VectorStraight(_Each[StraightPolicy]):
    """:class:`~jssa_gym.policies.StraightPolicy` of many arms."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__(envs, lambda env, seed: StraightPolicy(env))
        one = self._ones[0]
        self._gain, self._speed, self._cascade = one.gain, one.speed, one.cascade
        self._tip = self._arms.task.space == "tip"
        self._rates = VectorResolvedRates(self._robot, one.damping)
        self._target = np.zeros((envs.num_envs, self._robot.n))

    def begin(self, arms: NDArray[np.int64], seeds: Sequence[int]) -> None:
        super().begin(arms, seeds)
        for e in arms.tolist() if not self._tip else ():
            self._target[e] = np.atleast_2d(self._arms.goal_of(e))[-1]

    def __call__(self, observation: Array) -> Array:
        """Actions towards the goals, shape (E, n)."""
        if self._tip:
            jerk = self._cascade.jerk_at_speed(self._states, self._velocity())
        else:
            jerk = self._cascade.jerk(self._states, self._target)
        return jerk / self._limits.jerk

    def _velocity(self) -> Array:
        """Joint velocities that move tool centre points towards their goals, shape (E, n) [rad/s]."""
        way = self._arms.goals - self._rates.look(self._arms.state)[:, 0]
        # the very scalar product that a single one has
        length = np.sqrt((way[:, None, :] @ way[:, :, None])[:, 0, 0])
        rate = np.minimum(self._gain, self._speed / np.maximum(length, 1e-9))
        return self._rates.joint_velocity(rate[:, None] * way)


VECTOR_POLICIES: dict[str, Callable[[VectorEnv], VectorPolicy]] = {
    "hold": VectorHold,
    "random": VectorRandom,
    "wander": VectorWander,
    "bang_bang": VectorBangBang,
    "constant": VectorConstant,
    "limit_seeking": VectorLimitSeeking,
    "chase": VectorChase,
    "straight": VectorStraight,
    "jpc": VectorJPCPolicy,
    "jpc_paper": partial(VectorJPCPolicy, yielding=False),
}
"""Those of :data:`~jssa_gym.policies.POLICIES` that there are for many arms: called with a vector."""


def has_vector_form(policy: Any) -> bool:
    """Whether there is most likely one of a policy: a name, a file or anything else that plays."""
    if isinstance(policy, str) and policy not in VECTOR_POLICIES:
        return (file := policy_file(policy)) is not None and file.suffix == ".npz"
    return isinstance(policy, LearnedPolicy | str)


def make_vector_policy(policy: Any, envs: VectorEnv) -> VectorPolicy | None:
    """What drives many arms as a policy of its own would drive each; None where that has to be asked one by one.

    Args:
        policy: A name of :data:`VECTOR_POLICIES`, or a :class:`~jssa_gym.policies.LearnedPolicy`.
        envs: The vector that they act in, with its shield.
    """
    if isinstance(policy, LearnedPolicy):
        return VectorLearned(policy, envs)
    if isinstance(policy, str) and policy in VECTOR_POLICIES:
        return VECTOR_POLICIES[policy](envs)
    return None
