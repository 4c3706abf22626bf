"""The shield in front of a controller of one's own: commands in, safe positions out."""

from jssa_gym.guard.answers import GuardAnswer
from jssa_gym.guard.guard import Guard

__all__ = ["Guard", "GuardAnswer"]
