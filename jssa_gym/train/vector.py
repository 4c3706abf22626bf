"""Many environments of a training in one vector, as Stable-Baselines3 takes them."""

import time
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from jssa_gym.control.vector import VectorCommands
from jssa_gym.entry_points import make_vector
from jssa_gym.envs.vector import VectorArmEnv
from jssa_gym.evaluation.record_vector import VectorRecordSafety
from jssa_gym.registration import ENTRIES
from jssa_gym.shields.vector import VectorShield
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.environment import ENDINGS
from jssa_gym.types import Array


class ArmVecEnv(VecEnv):
    """The environments of a training, stepped in one compiled call a tick.

    It gives, bit for bit, what a ``DummyVecEnv`` of :func:`~jssa_gym.train.environment.training_env` gives; the
    dictionaries in ``infos`` have what Stable-Baselines3 and :func:`~jssa_gym.train.train` read at the ends of
    episodes, and ``TimeLimit.truncated``, no more.

    Args:
        config: The training.
    """

    def __init__(self, config: TrainConfig) -> None:
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
        arms = made.unwrapped
        assert isinstance(arms, VectorArmEnv)
        self.arms, self._config = arms, config
        # an episode that ends while an action is repeated waits for the others
        arms.waits = True
        self._env = VectorRecordSafety(made)
        self._shield = made if isinstance(made, VectorShield) else None
        self._commands = None
        if config.control != "jerk":
            self._commands = VectorCommands(arms.robot, config.control, config.share)
        size = arms.robot.n if self._commands is None else self._commands.size
        self._returns, self._begun = np.zeros(config.envs), time.time()
        self._lengths = np.zeros(config.envs, np.int64)
        self._actions: NDArray[Any] = np.zeros((config.envs, size))
        space = arms.single_observation_space
        assert isinstance(space, gym.spaces.Box)
        if config.observe_intervention:
            low, high = np.append(space.low, np.float32(0.0)), np.append(space.high, np.float32(1.0))
            space = gym.spaces.Box(low, high, dtype=np.float32)
        super().__init__(config.envs, space, gym.spaces.Box(-1.0, 1.0, (size,), np.float32))

    def reset(self) -> VecEnvObs:
        """Reset all environments, with the seeds of :meth:`seed`."""
        observations, _ = self._env.reset(seed=self._seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._observed(observations, np.zeros(self.num_envs))

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take actions, shape (E, size)."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Apply every action for its ticks, or to the end of its episode."""
        count, total = self.num_envs, np.zeros(self.num_envs)
        running, last, success = np.ones(count, np.bool_), np.zeros(count), np.zeros(count, np.bool_)
        ends, safety, reasons = np.zeros((2, count), np.bool_), [None] * count, [""] * count
        for _ in range(self._config.ticks):
            observations, rewards, terminated, truncated, infos = self._env.step(self._jerk())
            change = _change(infos)
            if self._config.penalises:
                rewards = rewards + -self._config.penalty * change
            total[running] += rewards[running]
            last[running] = change[running]
            success |= running & infos["is_success"]
            over = running & (terminated | truncated)
            ends[:, over] = terminated[over], truncated[over]
            if self._shield is not None and over.any():
                reasons = [new if o else old for o, new, old in zip(over, self._shield.reasons(), reasons, strict=True)]
            for e in np.flatnonzero(over).tolist():
                safety[e] = {name: array[e].item() for name, array in infos["safety"].items() if name[0] != "_"}
            running &= ~over
            if not running.any():
                break
        self._returns += total
        self._lengths += 1
        seen, done = self._observed(observations, last), ~running
        told = [{"TimeLimit.truncated": False} for _ in range(count)]
        for e in np.flatnonzero(done).tolist():
            cut = bool(ends[1, e] and not ends[0, e])
            told[e] = self._end(e, cut, bool(success[e]), seen[e].copy()) | {
                "safety": safety[e],
                "shield/reason": reasons[e],
            }
        if done.any():
            observations, _ = self._env.reset(options={"reset_mask": done})
            last[done] = 0.0
            seen = self._observed(observations, last)
        return seen, total.astype(np.float32), done, told

    def _jerk(self) -> NDArray[Any]:
        """What this tick's actions mean, in jerk bounds, shape (E, n)."""
        if self._commands is None:
            return self._actions
        return self._commands.jerk(self.arms.state, self._actions.astype(np.float64))

    def _observed(self, observations: NDArray[np.float32], last: Array) -> NDArray[np.float32]:
        if not self._config.observe_intervention:
            return observations
        return np.concatenate([observations, last[:, None].astype(np.float32)], axis=1)

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
