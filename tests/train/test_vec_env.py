"""Vectors of a user's own as Stable-Baselines3 takes them: to the bit what single environments give."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")

from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.shields import Shield
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.vector import ArmVecEnv

MADE = {"human": "pursuit", "terminate_on": ("contact",), "max_episode_steps": 90}


def test_a_vector_of_ones_own_is_what_monitored_environments_are():
    def single():
        return Monitor(Shield(gym.make("jssa_gym/Reach-v0", disable_env_checker=True, **MADE), "work"))

    count, ends = 3, 0
    vector = ArmVecEnv(gym.make_vec("jssa_gym/Reach-v0", count, shield="work", autoreset_mode="Disabled", **MADE))
    alone = DummyVecEnv([single] * count)
    for envs in (vector, alone):
        envs.seed(4)
    np.testing.assert_array_equal(vector.reset(), alone.reset())
    for k in range(250):
        actions = np.sin(0.1 * k + np.arange(count)[:, None]) * np.ones((count, 6))
        (seen, rewards, dones, infos), (seen1, rewards1, dones1, infos1) = vector.step(actions), alone.step(actions)
        np.testing.assert_array_equal(seen, seen1)
        np.testing.assert_array_equal(rewards, rewards1)
        np.testing.assert_array_equal(dones, dones1)
        for one, other in zip(infos, infos1, strict=True):
            for key in ("cost", "TimeLimit.truncated", "is_success", "shield/reason"):
                assert key not in one or one[key] == other[key], key
            assert ("episode" in one) == ("episode" in other)
            if "episode" in one:
                ends += 1
                assert (one["episode"]["r"], one["episode"]["l"]) == (other["episode"]["r"], other["episode"]["l"])
                np.testing.assert_array_equal(one["terminal_observation"], other["terminal_observation"])
                assert "safety" not in one  # nobody records it
    assert ends >= 2 * count


def test_vectors_that_it_cannot_have_are_refused():
    with pytest.raises(InterfaceError, match="DummyVecEnv"):
        ArmVecEnv(gym.make_vec("jssa_gym/Reach-v0", 2, vectorization_mode="sync"))
    with pytest.raises(ParameterError, match='autoreset_mode="Disabled"'):
        ArmVecEnv(gym.make_vec("jssa_gym/Reach-v0", 2))
    with pytest.raises(InterfaceError, match="training_vector"):
        ArmVecEnv(TrainConfig("reach"))
