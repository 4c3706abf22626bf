"""Figures and films; they need the extra ``plots``."""

from jssa_gym.plots.backend import require
from jssa_gym.plots.campaigns import Curve, degradation
from jssa_gym.plots.episodes import gauge, label, profile, write_film

__all__ = ["Curve", "degradation", "gauge", "label", "profile", "require", "write_film"]
