"""Gymnasium environments."""

from jssa_gym.envs.arm import ArmEnv
from jssa_gym.envs.tasks import TASKS, Task

__all__ = ["TASKS", "ArmEnv", "Task"]
