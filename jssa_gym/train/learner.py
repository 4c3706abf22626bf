"""The Stable-Baselines3 model of a training: built, and turned into a policy."""

import multiprocessing
import signal
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import stable_baselines3 as sb3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from jssa_gym.engine.workers import UNABLE
from jssa_gym.exceptions import MissingExtraError, ParameterError, WorkerError, how_to_install
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.policies.network import Network
from jssa_gym.text import show_messages
from jssa_gym.train.config import TrainConfig
from jssa_gym.train.environment import training_env
from jssa_gym.train.lagrangian import ConstrainedPPO, ConstrainedSAC, CostBuffer, CostLimit, ExecutedBuffer
from jssa_gym.train.settings import PPO, TD3, TQC, OffPolicy, PPOLagrangian, SACLagrangian
from jssa_gym.train.vector import ArmVecEnv, training_vector

_CLIP = 10.0
"""Normalised observations are clipped to this."""


def make_vec_env(config: TrainConfig) -> VecEnv:
    """The environments, stepped together."""
    if config.steps_as_vector:
        return ArmVecEnv(training_vector(config))
    functions: list[Callable[[], gym.Env]] = [partial(monitored, partial(training_env, config))] * config.envs
    if config.processes:
        try:
            return Processes(functions, start_method="spawn")
        except (EOFError, BrokenPipeError, ConnectionResetError, RuntimeError) as error:
            raise WorkerError(f"{UNABLE}; or train without processes") from error
    return DummyVecEnv(functions)


class Processes(SubprocVecEnv):
    """Environments in processes of their own, which give what they would in one."""

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = super().step_wait()
        return observations, rewards.astype(np.float32), dones, infos  # as DummyVecEnv has it


def monitored(make: Callable[[], gym.Env]) -> gym.Env:
    """An environment with its episodes counted, in whatever process it is made."""
    if multiprocessing.parent_process() is not None:
        # the parent alone answers Ctrl-C, and ends its environments
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        show_messages()
    return Monitor(make())


def build(config: TrainConfig, device: str = "cpu") -> BaseAlgorithm:
    """The model with its environments, before it has learnt anything.

    Args:
        config: The training.
        device: Of torch; small networks are fastest on the CPU.

    Raises:
        MissingExtraError: The algorithm's package is not installed.
    """
    env = make_vec_env(config)
    try:
        return _model(config, env, device)
    except BaseException:
        env.close()
        raise


def _model(config: TrainConfig, env: VecEnv, device: str) -> BaseAlgorithm:
    settings = config.settings
    on_policy = isinstance(settings, PPO)
    if config.normalise:
        env = VecNormalize(env, norm_obs=True, norm_reward=on_policy, gamma=settings.gamma, clip_obs=_CLIP)
    rate = _Falling(settings.learning_rate, config.steps)
    common: dict[str, Any] = {
        "learning_rate": rate if settings.decay else settings.learning_rate,
        "batch_size": settings.batch_size,
        "gamma": settings.gamma,
        "seed": config.seed,
        "device": device,
    }
    shape: dict[str, Any] = {"net_arch": [settings.width] * settings.layers}
    if isinstance(settings, PPO):
        kind = ConstrainedPPO if isinstance(settings, PPOLagrangian) else sb3.PPO
        model = kind(
            "MlpPolicy",
            env,
            n_steps=settings.rollout // config.envs,
            n_epochs=settings.n_epochs,
            gae_lambda=settings.gae_lambda,
            clip_range=settings.clip_range,
            ent_coef=settings.ent_coef,
            policy_kwargs={**shape, "log_std_init": settings.log_std, "activation_fn": torch.nn.Tanh},
            **common,
        )
    elif isinstance(settings, OffPolicy):
        model = _off_policy(config, settings, env, shape, common)
    else:
        raise ParameterError(f"no model for {settings!r}")
    if isinstance(settings, PPOLagrangian | SACLagrangian):
        assert isinstance(model, ConstrainedPPO | ConstrainedSAC)
        model.constrain(CostLimit(settings.cost_limit, settings.multiplier_rate, config.ticks))
    rate.model = model
    return model


def _off_policy(
    config: TrainConfig, settings: OffPolicy, env: VecEnv, shape: dict[str, Any], common: dict[str, Any]
) -> OffPolicyAlgorithm:
    replay: dict[str, Any] = {
        "buffer_size": settings.buffer_size,
        "learning_starts": settings.learning_starts,
        "tau": settings.tau,
        "train_freq": 1,
        "gradient_steps": max(1, round(settings.updates * config.envs)),
        "replay_buffer_class": ExecutedBuffer if config.stores_executed else None,
        "policy_kwargs": shape,
    }
    if isinstance(settings, TD3):
        zero = np.zeros(env.action_space.shape or ())
        noise = NormalActionNoise(zero, zero + settings.noise)
        return sb3.TD3("MlpPolicy", env, action_noise=noise, **replay, **common)
    if isinstance(settings, SACLagrangian):
        replay["replay_buffer_class"] = CostBuffer
        return ConstrainedSAC("MlpPolicy", env, **replay, **common)
    if not isinstance(settings, TQC):
        return sb3.SAC("MlpPolicy", env, **replay, **common)
    try:
        import sb3_contrib
    except ImportError as error:
        raise MissingExtraError(f"tqc needs sb3-contrib: {how_to_install('train')}") from error
    return sb3_contrib.TQC("MlpPolicy", env, **replay, **common)


class _Falling:
    """A learning rate that falls linearly to 0 over the whole training; ``learn`` is told of one leg at a time."""

    def __init__(self, rate: float, steps: int) -> None:
        self._rate, self._steps = rate, steps
        self.model: BaseAlgorithm | None = None

    def __call__(self, left_of_leg: float) -> float:
        done = 0 if self.model is None else self.model.num_timesteps
        return self._rate * max(1.0 - done / self._steps, 0.0)


def to_policy(model: BaseAlgorithm, config: TrainConfig, provenance: dict[str, Any] | None = None) -> LearnedPolicy:
    """What the model has learnt so far, without torch: its deterministic action.

    Args:
        model: As :func:`build` makes it.
        config: Its training.
        provenance: What the file says about where it comes from.
    """
    state = {name: value.detach().cpu().numpy().astype(np.float64) for name, value in model.policy.state_dict().items()}
    if isinstance(config.settings, PPO):
        body, head, activation, output = "mlp_extractor.policy_net.", "action_net", "tanh", "clip"
    elif isinstance(config.settings, TD3):
        body, head, activation, output = "actor.mu.", None, "relu", "tanh"
    else:
        body, head, activation, output = "actor.latent_pi.", "actor.mu", "relu", "tanh"
    hidden = [name.removesuffix(".weight") for name in state if name.startswith(body) and name.endswith(".weight")]
    names = sorted(hidden, key=lambda name: int(name.rsplit(".", 1)[1])) + ([head] if head else [])
    layers = tuple((state[f"{name}.weight"], state[f"{name}.bias"]) for name in names)
    size = layers[0][0].shape[1]
    mean, std, norm = np.zeros(size), np.ones(size), model.get_vec_normalize_env()
    if norm is not None:
        rms: Any = norm.obs_rms
        mean, std = np.array(rms.mean), np.sqrt(rms.var + norm.epsilon)
    env = model.get_env()
    assert env is not None
    robot = env.get_attr("robot", 0)[0]
    network = Network(
        layers=layers,
        activation=activation,
        output=output,
        mean=mean,
        std=std,
        clip=_CLIP if norm is not None else np.inf,
    )
    return LearnedPolicy(
        network,
        control=config.control,
        share=config.share,
        ticks=config.ticks,
        limits=robot.limits,
        task=config.task,
        robot=robot.name,
        observes_intervention=config.observe_intervention,
        provenance={} if provenance is None else provenance,
    )
