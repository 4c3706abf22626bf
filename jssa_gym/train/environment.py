"""The environments that a learner acts in."""

from typing import Any

import gymnasium as gym

from jssa_gym.control import JPCAction
from jssa_gym.envs.repeat import ActionRepeat
from jssa_gym.evaluation.record import RecordSafety
from jssa_gym.registration import ENTRIES
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention

ENDINGS = ("success", "moving_contact")
"""What ends an episode of a training."""


def control_env(config: TrainConfig, endings: tuple[str, ...] = ENDINGS, shield: bool = True) -> gym.Env:
    """The environment at the control rate, with what a policy observes: what a policy is evaluated in.

    Args:
        config: The training.
        endings: ``terminate_on`` of the environment.
        shield: Whether there is a shield, if the training has one; an evaluation may go without.
    """
    kwargs: dict[str, Any] = {"robot": config.robot} | ({} if config.human is None else {"human": config.human})
    guarded = shield and config.shield
    env = gym.make(ENTRIES[config.task].env_id(guarded), terminate_on=endings, disable_env_checker=True, **kwargs)
    return ObserveIntervention(env) if config.observe_intervention else env


def training_env(config: TrainConfig) -> gym.Env:
    """The whole chain that a learner acts in, the shield inside, the action's meaning outside."""
    env: gym.Env = RecordSafety(control_env(config))
    if config.penalises:
        env = InterventionPenalty(env, config.penalty)
    if config.control != "jerk":
        env = JPCAction(env, mode=config.control, share=config.share)
    env = ActionRepeat(env, config.ticks)
    if config.stores_executed:
        env = ExecutedAction(env, config.control, config.share)
    return env
