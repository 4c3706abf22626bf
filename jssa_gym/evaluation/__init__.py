"""Episodes, what they recorded, and numbers about them."""

from jssa_gym.evaluation.metrics import Summary, summarise
from jssa_gym.evaluation.rollout import rollout

__all__ = ["Summary", "rollout", "summarise"]
