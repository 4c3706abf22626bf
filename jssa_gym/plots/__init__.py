"""Figures and films; they need the extra ``plots``."""

from jssa_gym.plots.audit import audited
from jssa_gym.plots.backend import require, write_film, write_png
from jssa_gym.plots.campaigns import Curve, degradation
from jssa_gym.plots.episodes import profile
from jssa_gym.plots.handover import handovers
from jssa_gym.plots.lambda_map import lambda_map
from jssa_gym.plots.learning import learning
from jssa_gym.plots.portrait import portraits, shifts
from jssa_gym.plots.sensitivity import sensitivity
from jssa_gym.plots.strips import Caption, footer, gauge, heading, label, ribbon

__all__ = [
    "Caption",
    "Curve",
    "audited",
    "degradation",
    "footer",
    "gauge",
    "handovers",
    "heading",
    "label",
    "lambda_map",
    "learning",
    "portraits",
    "profile",
    "require",
    "ribbon",
    "sensitivity",
    "shifts",
    "write_film",
    "write_png",
]
