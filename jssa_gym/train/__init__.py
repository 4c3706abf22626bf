"""Training of Stable-Baselines3 policies, inside the shield or without it; :func:`train` needs the extra ``train``."""

import importlib
from typing import TYPE_CHECKING, Any

from jssa_gym.exceptions import MissingExtraError, how_to_install
from jssa_gym.train.aggregate import interquartile_mean, stratified_interval
from jssa_gym.train.config import PRESETS, TrainConfig, preset
from jssa_gym.train.curves import Band, LearningCurve, learning_curves
from jssa_gym.train.environment import control_env, training_env
from jssa_gym.train.settings import ALGORITHMS, PPO, SAC, TD3, TQC, PPOLagrangian, SACLagrangian, Settings
from jssa_gym.train.sweep import SeedOutcome, train_seeds
from jssa_gym.train.variation import Curriculum, DomainRandomisation
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention

if TYPE_CHECKING:
    from jssa_gym.train.lagrangian import ExecutedBuffer
    from jssa_gym.train.learner import build, to_policy
    from jssa_gym.train.loop import Training, train

__all__ = [
    "ALGORITHMS",
    "PPO",
    "PRESETS",
    "SAC",
    "TD3",
    "TQC",
    "Band",
    "Curriculum",
    "DomainRandomisation",
    "ExecutedAction",
    "ExecutedBuffer",
    "InterventionPenalty",
    "LearningCurve",
    "ObserveIntervention",
    "PPOLagrangian",
    "SACLagrangian",
    "SeedOutcome",
    "Settings",
    "TrainConfig",
    "Training",
    "build",
    "control_env",
    "interquartile_mean",
    "learning_curves",
    "preset",
    "stratified_interval",
    "to_policy",
    "train",
    "train_seeds",
    "training_env",
]

_HOMES = {
    "ExecutedBuffer": "lagrangian",
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
        raise MissingExtraError(f"training needs the extra 'train' ({error}): {how_to_install('train')}") from error
    globals()[name] = value
    return value
