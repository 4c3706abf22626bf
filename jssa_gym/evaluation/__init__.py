"""Episodes: planned, played, recorded, measured, judged, reported.

- plan: ``plan`` says what every plan offers, ``study`` has evaluations, ``campaign`` what is to break shields, with
  the ``contenders`` of both; ``policy`` and ``identity`` tell what is played from anything else.
- play: ``play`` has the one player of all plans, ``runner`` finishes a plan with workers of ``jssa_gym.engine``, and
  the ``ledger`` is what it leaves in a folder and goes on from.
- record: ``rollout`` makes a trace of an episode and ``trace`` keeps it; ``record`` is for training loops.
- measure: ``rows`` are episodes in numbers; ``metrics`` has them from ``steps``, ``motion``, ``geometry`` and
  ``counterfactual``.
- judge: ``judge`` plays a trace again with MuJoCo, its ``oracle``, and says a ``judgement``.
- report: ``report``, ``standings`` and ``slowdown`` with the intervals of ``statistics``; ``comparison_page`` is the
  page, whose drawings are ``svg``.
"""

from jssa_gym.engine.cluster import Cluster
from jssa_gym.evaluation.geometry import Geometry, geometry
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.judgement import Contact, Excess, Judgement, Overlap
from jssa_gym.evaluation.metrics import SeparationParams, Summary, summarise
from jssa_gym.evaluation.policy import make_policy
from jssa_gym.evaluation.record import RecordSafety
from jssa_gym.evaluation.report import Report
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.evaluation.runner import evaluate
from jssa_gym.evaluation.slowdown import Slowdown, slowdown
from jssa_gym.evaluation.statistics import (
    Mean,
    PairedDifference,
    Rate,
    bootstrap_interval,
    clopper_pearson,
    mean_difference,
    means,
    paired_difference,
)
from jssa_gym.evaluation.steps import StepSummary
from jssa_gym.evaluation.study import Study, put_filter
from jssa_gym.evaluation.trace import load_trace, read_meta, save_trace

__all__ = [
    "Cluster",
    "Contact",
    "Excess",
    "Geometry",
    "Judgement",
    "Mean",
    "Overlap",
    "PairedDifference",
    "Rate",
    "RecordSafety",
    "Report",
    "SeparationParams",
    "Slowdown",
    "StepSummary",
    "Study",
    "Summary",
    "bootstrap_interval",
    "clopper_pearson",
    "evaluate",
    "geometry",
    "judge",
    "load_trace",
    "make_policy",
    "mean_difference",
    "means",
    "paired_difference",
    "put_filter",
    "read_meta",
    "rollout",
    "save_trace",
    "slowdown",
    "summarise",
]
