"""Figures and films; they need the extra ``plots``."""

from jssa_gym.plots.audit import audited
from jssa_gym.plots.backend import require, write_png
from jssa_gym.plots.campaigns import Curve, degradation
from jssa_gym.plots.episodes import gauge, label, profile, ribbon, write_film
from jssa_gym.plots.handover import handovers
from jssa_gym.plots.lambda_map import lambda_map
from jssa_gym.plots.portrait import portraits, shifts
from jssa_gym.plots.sensitivity import sensitivity

__all__ = [
    "Curve",
    "audited",
    "degradation",
    "gauge",
    "handovers",
    "label",
    "lambda_map",
    "portraits",
    "profile",
    "require",
    "ribbon",
    "sensitivity",
    "shifts",
    "write_film",
    "write_png",
]
