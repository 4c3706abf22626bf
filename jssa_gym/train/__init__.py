"""Training of Stable-Baselines3 policies, inside the shield or without it; :func:`train` needs the extra ``train``."""

import importlib
from typing import TYPE_CHECKING, Any

from jssa_gym.exceptions import MissingExtraError
from jssa_gym.train.config import INSTALL, PRESETS, TrainConfig, preset
from jssa_gym.train.environment import control_env, training_env
from jssa_gym.train.settings import ALGORITHMS, PPO, SAC, TD3, TQC, Settings
from jssa_gym.train.variation import Curriculum, DomainRandomisation
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention

if TYPE_CHECKING:
    from jssa_gym.train.learner import ExecutedBuffer, build, to_policy
    from jssa_gym.train.loop import Training, train

__all__ = [
    "ALGORITHMS",
    "PPO",
    "PRESETS",
    "SAC",
    "TD3",
    "TQC",
    "Curriculum",
    "DomainRandomisation",
    "ExecutedAction",
    "ExecutedBuffer",
    "InterventionPenalty",
    "ObserveIntervention",
    "Settings",
    "TrainConfig",
    "Training",
    "build",
    "control_env",
    "preset",
    "to_policy",
    "train",
    "training_env",
]

_HOMES = {
    "ExecutedBuffer": "learner",
    "Training": "loop",
    "build": "learner",
    "to_policy": "learner",
    "train": "loop",
}
"""What needs torch, and where it is."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value = getattr(importlib.import_module(f"jssa_gym.train.{_HOMES[name]}"), name)
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"training needs the extra 'train' ({error}): {INSTALL}") from error
    globals()[name] = value
    return value
