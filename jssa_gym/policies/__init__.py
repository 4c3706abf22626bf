"""What drives an arm: callables from observation to action in [-1, 1]."""

from jssa_gym.policies.scripted import HoldPolicy, Policy, RandomPolicy

__all__ = ["HoldPolicy", "Policy", "RandomPolicy"]
