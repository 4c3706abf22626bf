"""Safety filters, and the wrappers that put them around an environment.

- a filter: ``filter`` has what all share, ``asking`` asks those that are Python about a ``tick``; ``jssa``, ``ahead``,
  ``energy`` (SSA, SSS, CBF), ``closed_form`` (PFM, SMA, SSM) and ``baselines`` are the classes, whose mathematics is in
  :mod:`jssa_gym.tick.proposals`; ``records`` and ``reading`` are what a control step of one arm is given.
- by name: ``registry`` has them all, ``profiles`` those with settings for a purpose, ``options`` rare switches.
- around an environment: ``shield``, which ``wrappers`` may lie inside; ``vector`` around many, ``batch`` for many arms
  without one, ``inplace`` for one.
- what is said: ``reasons`` and ``words``, of the codes in :mod:`jssa_gym.tick.codes`; ``alarm`` says it aloud.
"""

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
