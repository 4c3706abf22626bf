"""Episodes, what they recorded, numbers about them, and a second judge."""

from jssa_gym.evaluation.metrics import Summary, summarise
from jssa_gym.evaluation.replay import judge
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.statistics import (
    PairedDifference,
    Rate,
    bootstrap_interval,
    clopper_pearson,
    paired_difference,
)
from jssa_gym.evaluation.trace import load_trace, read_meta, save_trace
from jssa_gym.evaluation.verdict import Contact, Excess, Overlap, Verdict

__all__ = [
    "Contact",
    "Excess",
    "Overlap",
    "PairedDifference",
    "Rate",
    "Summary",
    "Verdict",
    "bootstrap_interval",
    "clopper_pearson",
    "judge",
    "load_trace",
    "paired_difference",
    "read_meta",
    "rollout",
    "save_trace",
    "summarise",
]
