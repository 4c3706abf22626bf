"""Safety filters, and the wrappers that put them around an environment."""

from jssa_gym.shields.baselines import NoFilter, StopFilter
from jssa_gym.shields.closed_form import (
    PFMFilter,
    PFMParams,
    SMAFilter,
    SMAParams,
    SSMFilter,
    SSMParams,
)
from jssa_gym.shields.energy import CBFFilter, CBFParams, SSAFilter, SSAParams, SSSFilter, SSSParams
from jssa_gym.shields.filter import SafetyFilter
from jssa_gym.shields.jssa import JSSAFilter
from jssa_gym.shields.options import JSSAOptions
from jssa_gym.shields.registry import FILTERS, PROFILES, STOP, TASK_SHIELD, Build, FilterName, make_filter, read_name
from jssa_gym.shields.shield import JSSAShield, Shield

__all__ = [
    "FILTERS",
    "PROFILES",
    "STOP",
    "TASK_SHIELD",
    "Build",
    "CBFFilter",
    "CBFParams",
    "FilterName",
    "JSSAFilter",
    "JSSAOptions",
    "JSSAShield",
    "NoFilter",
    "PFMFilter",
    "PFMParams",
    "SMAFilter",
    "SMAParams",
    "SSAFilter",
    "SSAParams",
    "SSMFilter",
    "SSMParams",
    "SSSFilter",
    "SSSParams",
    "SafetyFilter",
    "Shield",
    "StopFilter",
    "make_filter",
    "read_name",
]
