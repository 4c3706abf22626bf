"""Episodes, what they recorded, and numbers about them."""

from jssa_gym.evaluation.metrics import Summary, summarise
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.trace import load_trace, read_meta, save_trace

__all__ = ["Summary", "load_trace", "read_meta", "rollout", "save_trace", "summarise"]
