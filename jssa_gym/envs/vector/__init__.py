"""Many arms in one environment: each does, bit for bit, what it would do in an environment of its own."""

from jssa_gym.envs.vector.env import VectorArmEnv
from jssa_gym.envs.vector.repeat import VectorActionRepeat

__all__ = ["VectorActionRepeat", "VectorArmEnv"]
