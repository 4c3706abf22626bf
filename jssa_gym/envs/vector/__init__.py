"""Many arms in one environment: each does, bit for bit, what it would do in an environment of its own."""

from jssa_gym.envs.vector.env import VectorArmEnv

__all__ = ["VectorArmEnv"]
