"""Many environments of a training in one vector, and any vector as Stable-Baselines3 takes it."""

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from jssa_gym.control.vector import VectorJPCAction
from jssa_gym.entry_points import make_vector
from jssa_gym.envs.vector import VectorActionRepeat, VectorArmEnv
from jssa_gym.envs.vector.options import checked_mode
from jssa_gym.evaluation.record_vector import VectorRecordSafety
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.registration import ENTRIES
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.environment import ENDINGS
from jssa_gym.types import Array
from jssa_gym.vectors import Infos, wrapper_with


class _Told(VectorWrapper):
    """What learners are told of the shield in every tick: a penalty in the reward, its change in the observation."""

    def __init__(self, env: VectorEnv, config: TrainConfig) -> None:
        super().__init__(env)
        self._weight = config.penalty if config.penalises else 0.0
        self._observes = config.observe_intervention
        if self._observes:
            space = env.single_observation_space
            assert isinstance(space, gym.spaces.Box)
            low, high = np.append(space.low, np.float32(0.0)), np.append(space.high, np.float32(1.0))
            self.single_observation_space = gym.spaces.Box(low, high, dtype=np.float32)
            self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        observations, infos = self.env.reset(seed=seed, options=options)  # ty: ignore[invalid-argument-type]  # or a list
        return self._observed(observations, np.zeros(self.num_envs)), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Infos]:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        change = _change(infos)
        if self._weight:
            rewards = rewards + -self._weight * change
        return self._observed(observations, change), rewards, terminated, truncated, infos

    def _observed(self, observations: NDArray[np.float32], last: Array) -> NDArray[np.float32]:
        if not self._observes:
            return observations
        return np.concatenate([observations, last[:, None].astype(np.float32)], axis=1)


def training_vector(config: TrainConfig) -> VectorEnv:
    """The environments of a training, as many as it has: what :func:`~jssa_gym.train.environment.training_env` chains
    around one, around all of them.
    """
    people = {} if config.human is None else {"human": config.human}
    made = make_vector(
        config.envs,
        config.task,
        shield=ENTRIES[config.task].shield if config.shield else None,
        robot=config.robot,
        terminate_on=ENDINGS,
        autoreset_mode="Disabled",
        **people,
    )
    env: VectorEnv = _Told(VectorRecordSafety(made), config)
    if config.control != "jerk":
        env = VectorJPCAction(env, mode=config.control, share=config.share)
    return VectorActionRepeat(env, config.ticks, "Disabled", ("cost", "is_success", "safety"))


class ArmVecEnv(VecEnv):
    """A vector of environments as Stable-Baselines3 takes it.

    It gives, bit for bit, what a ``DummyVecEnv`` of monitored single environments gives; the dictionaries in ``infos``
    have what Stable-Baselines3 and :func:`~jssa_gym.train.train` read at the ends of episodes,
    ``TimeLimit.truncated`` and ``cost``, no more.

    Args:
        env: A :class:`~jssa_gym.VectorArmEnv`, in whatever wrappers, that leaves it to others when episodes begin:
            ``autoreset_mode="Disabled"``.

    Raises:
        InterfaceError: It is another vector.
        ParameterError: It begins episodes by itself.
    """

    def __init__(self, env: VectorEnv) -> None:
        if isinstance(env, TrainConfig):
            raise InterfaceError("a training's settings are no vector: training_vector(config) makes one of them")
        arms = env.unwrapped
        if not isinstance(arms, VectorArmEnv):
            raise InterfaceError(f"{env} is no VectorArmEnv: put single environments into a DummyVecEnv")
        if (mode := checked_mode(env.metadata["autoreset_mode"])) != AutoresetMode.DISABLED:
            raise ParameterError(
                f'the vector begins episodes by itself, {mode}: make it with autoreset_mode="Disabled"'
            )
        self.arms, self._env, self._shield = arms, env, wrapper_with(env, "reasons")
        self._returns, self._begun = np.zeros(env.num_envs), time.time()
        self._lengths = np.zeros(env.num_envs, np.int64)
        self._actions: NDArray[Any] = np.zeros(env.action_space.shape or ())
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> VecEnvObs:
        """Reset all environments, with the seeds of :meth:`seed`."""
        observations, _ = self._env.reset(seed=self._seeds)  # ty: ignore[invalid-argument-type]  # or a list
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take actions, shape (E, size)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Apply every action for its ticks, or to the end of its episode."""
        seen, rewards, terminated, truncated, infos = self._env.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        done = terminated | truncated
        told: list[dict[str, Any]] = [{"TimeLimit.truncated": False, "cost": x} for x in infos["cost"].tolist()]
        if done.any():
            reasons = [""] * self.num_envs if self._shield is None else self._shield.reasons()
            for e in np.flatnonzero(done).tolist():
                cut = bool(truncated[e] and not terminated[e])
                told[e] |= self._end(e, cut, bool(infos["is_success"][e]), seen[e].copy())
                told[e]["shield/reason"] = reasons[e]
                if (safety := infos.get("safety")) is not None:
                    told[e]["safety"] = {name: of[e].item() for name, of in safety.items() if name[0] != "_"}
            seen = np.where(done[:, None], self._env.reset(options={"reset_mask": done})[0], seen)
        return seen, rewards.astype(np.float32), done, told

    def _end(self, e: int, cut: bool, success: bool, seen: NDArray[np.float32]) -> dict[str, Any]:
        """What is told of an episode that ended; as Stable-Baselines3's ``Monitor`` and ``DummyVecEnv`` tell it."""
        episode = {
            "r": round(float(self._returns[e]), 6), "l": int(self._lengths[e]),
            "t": round(time.time() - self._begun, 6),
        }  # fmt: skip
        self._returns[e], self._lengths[e] = 0.0, 0
        return {
            "TimeLimit.truncated": cut, "terminal_observation": seen, "episode": episode, "is_success": success,
        }  # fmt: skip

    def close(self) -> None:
        """Nothing is open."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute that all environments have alike, once for each."""
        value = None if attr_name == "render_mode" else getattr(self.arms, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refuse: environments of a vector are alike."""
        raise AttributeError(f"the environments of a vector are alike: {attr_name} of one cannot be set")

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Refuse: there is no single environment."""
        raise AttributeError(f"a vector holds no single environments whose {method_name} could be called")

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Whether episodes are monitored: they are, by no wrapper."""
        return [wrapper_class.__name__ == "Monitor" for _ in self._get_indices(indices)]


def _change(infos: dict[str, Any]) -> Array:
    """Largest changes of joints' actions by the shield, at most 1, shape (E,); what is not finite counts as 1."""
    correction: Array | None = infos.get("shield/correction")
    if correction is None:
        return np.zeros(len(infos["distance"]))
    return np.where(np.isfinite(correction), np.minimum(correction, 1.0), 1.0)
