"""From a description to a policy: legs between checkpoints, resumed wherever they were cut off."""

import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from jssa_gym.evaluation.runner import evaluate
from jssa_gym.exceptions import BlockedError, CheckpointError, MissingExtraError, how_to_install
from jssa_gym.policies.files import read_policy, save_policy
from jssa_gym.policies.learned import LearnedPolicy
from jssa_gym.train.checkpoint import Checkpoint, latest_checkpoint, write_checkpoint
from jssa_gym.train.config import EVALUATION_SEED, TrainConfig
from jssa_gym.train.environment import control_env
from jssa_gym.train.history import RECORD, EpisodeCounter, Leg, as_rows, from_rows, write_history, write_record
from jssa_gym.train.learner import build, to_policy
from jssa_gym.train.state import (
    BUFFER,
    PARAMETERS,
    STATISTICS,
    load_buffer,
    load_parameters,
    load_statistics,
    save_buffer,
    save_parameters,
    save_statistics,
)

CHECKPOINTS, BEST, LAST, HISTORY, LOGS = "checkpoints", "best.npz", "last.npz", "history.csv", "tensorboard"
LOCK = ".lock"
"""What is in a training's folder."""

_ENOUGH = 3
"""Episodes of a leg that have to be nothing but FAULTs before it is given up."""

_PACKAGES = ("jssa-gym", "stable-baselines3", "sb3-contrib", "torch", "numpy", "gymnasium", "numba")

Say = Callable[[str], Any]
"""Called with a line about what happens."""

Watch = Callable[[int], Any]
"""Called with the policy steps so far, often."""


@dataclass(frozen=True, slots=True, eq=False)
class Training:
    """What came out."""

    policy: LearnedPolicy
    """The best one by the evaluations: most successes without a violation, then the largest return."""
    history: tuple[Leg, ...]
    folder: Path


def train(
    config: TrainConfig,
    folder: str | Path,
    *,
    say: Say | None = None,
    watch: Watch | None = None,
    device: str = "cpu",
    command: str = "",
) -> Training:
    """Train a policy, or go on with a training that was interrupted.

    A training is cut into legs of ``config.interval`` policy steps. Every leg begins with environments that are reset,
    and with seeds that depend on the training's seed and the leg's number alone; it ends with an evaluation and a
    checkpoint. So a training that was killed loses at most the leg that it was in, and what follows is, on the same
    machine, bit for bit what it would have been.

    Args:
        config: The training.
        folder: For checkpoints, ``best.npz`` and ``last.npz`` (see :func:`jssa_gym.load_policy`), ``history.csv``,
            ``training.json`` and TensorBoard's logs; one that is there already is continued. A training that has ended
            goes on if it is given more ``steps``, unless its learning rate decays.
        say: Told in a line what happens.
        watch: Told of the progress.
        device: Of torch.
        command: Noted in the policy files as what made them.

    Raises:
        CheckpointError: The folder is of another training or another process trains in it, all its checkpoints are bad,
            or the disk is full.
        BlockedError: Every decision of the shield is a FAULT.
        MissingExtraError: A package is not installed.
    """
    folder = Path(folder)
    lock = FileLock(folder / LOCK, timeout=0)  # where files can be locked, its end frees it, whichever
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = lock.acquire()
    except Timeout as error:
        raise CheckpointError(f"another process trains in {folder}; wait for it, or give another folder") from error
    except OSError as error:
        raise CheckpointError(f"cannot write to {folder}: {error.strerror or error}") from error
    with held:
        try:
            return _train(config, folder, say or (lambda line: None), watch, device, command)
        except OSError as error:  # of TensorBoard's writer, which tells of a full disk later, and of others' files
            raise CheckpointError(f"the training in {folder} cannot go on: {error.strerror or error}") from error


def _train(config: TrainConfig, folder: Path, tell: Say, watch: Watch | None, device: str, command: str) -> Training:
    """:func:`train` in a folder that nobody else writes to."""
    found, refused = latest_checkpoint(folder / CHECKPOINTS)
    if found is None and (folder / HISTORY).exists():
        raise CheckpointError(f"{folder} has a history but no checkpoint to go on from; give another folder")
    for error in refused:
        tell(f"passed over a checkpoint: {error}")
    if found is not None and found.data.get("config") != config.digest:
        other = _differences(found.data.get("training"), config.as_dict())
        raise CheckpointError(
            f"{folder} holds another training ({other}); give another folder, or the settings that it began with"
        )
    rollout = getattr(config.settings, "rollout", 1)
    if config.interval % rollout or config.steps % rollout:
        tell(f"legs end with whole rollouts of {rollout:,} policy steps; --set rollout=... changes that")
    model = build(config, device)
    history: tuple[Leg, ...] = ()
    logger: Logger | None = None
    try:
        if found is not None:
            history = restore(model, found)
            tell(f"going on from {found.steps:,} policy steps")
        logger = _logger(folder / LOGS)
        model.set_logger(logger)
        counter = _Counter(watch)
        while model.num_timesteps < config.steps:
            history = learn_leg(model, config, folder, history, counter, command)
            last = history[-1]
            tell(
                f"{last.steps:,} steps: {last.eval_safe:.0%} success without a violation, "
                f"{last.eval_moving_contacts} moving contacts in {config.eval_episodes} episodes; training: "
                + (f"{last.success:.0%}, {last.moving_contacts} in {last.episodes}" if last.episodes else "none ended")
            )
        best = folder / BEST
        if not best.exists():
            tell(f"{best} is gone; the policy is that of {LAST}, which need not be the best")
            best = folder / LAST
        return Training(read_policy(best), history, folder)
    finally:
        if logger is not None:
            logger.close()
        env = model.get_env()
        if env is not None:
            with suppress(EOFError, OSError):  # of processes that have ended already
                env.close()


def _differences(begun: Any, asked: Mapping[str, Any]) -> str:
    if not isinstance(begun, Mapping):
        return "of which it does not say what"
    names = [name for name in asked if begun.get(name) != asked[name]]
    why = ", and its learning rate decays over all steps" if names == ["steps"] else ""
    return f"other {', '.join(names)}{why}" if names else "by another version"


def _logger(folder: Path) -> Logger:
    try:
        return configure(str(folder), ["tensorboard"])
    except (ImportError, AssertionError) as error:  # the latter is what Stable-Baselines3 says without it
        raise MissingExtraError(f"training needs the extra 'train' ({error}): {how_to_install('train')}") from error
    except OSError as error:
        raise CheckpointError(f"cannot write to {folder}: {error.strerror or error}") from error


def restore(model: BaseAlgorithm, found: Checkpoint) -> tuple[Leg, ...]:
    """Put a model where a checkpoint says it was; the legs until then."""
    history = from_rows(found.data.get("history", []))
    if not history or history[-1].steps != found.steps:
        raise CheckpointError(f"{found.folder} has a history that does not end with its {found.steps:,} steps")
    model.num_timesteps = found.steps
    load_parameters(model, found.file(PARAMETERS))
    load_statistics(model, found.file(STATISTICS))
    if isinstance(model, OffPolicyAlgorithm):
        load_buffer(model, found.file(BUFFER))
    return history


def learn_leg(
    model: BaseAlgorithm,
    config: TrainConfig,
    folder: Path,
    history: tuple[Leg, ...],
    counter: "_Counter",
    command: str,
) -> tuple[Leg, ...]:
    """Learn for one interval, evaluate, write everything; the history with the new leg."""
    number = len(history)
    model.set_random_seed(_seed(config.seed, number))
    model._last_obs = None  # the environments begin anew, as they would after an interruption
    end = min((number + 1) * config.interval, config.steps)
    interval = 100 if isinstance(model, OffPolicyAlgorithm) else 1  # episodes, or updates
    begun, busy = time.monotonic(), time.process_time()
    model.learn(max(end - model.num_timesteps, 1), counter, reset_num_timesteps=False, log_interval=interval)
    seconds, processor_seconds = time.monotonic() - begun, time.process_time() - busy
    policy = to_policy(model, config)
    report = evaluate(partial(control_env, config), policy, config.eval_episodes, EVALUATION_SEED)
    if report.blocked:
        raise BlockedError(_blocked(report.blocked))
    leg = counter.tally.leg(model.num_timesteps, seconds, processor_seconds, report)
    history = (*history, leg)
    _log(model, leg)
    policy = policy.with_provenance(_provenance(config, history, command))
    try:
        if leg is max(reversed(history), key=lambda one: (one.eval_safe, one.eval_return)):
            save_policy(folder / BEST, policy)
        save_policy(folder / LAST, policy)
    except OSError as error:
        raise CheckpointError(f"cannot write the policy to {folder}: {error.strerror or error}") from error
    writers = {PARAMETERS: partial(save_parameters, model), STATISTICS: partial(save_statistics, model)}
    if isinstance(model, OffPolicyAlgorithm):
        writers[BUFFER] = partial(save_buffer, model)
    data = {"config": config.digest, "training": config.as_dict(), "history": as_rows(history)}
    write_checkpoint(folder / CHECKPOINTS, model.num_timesteps, data, writers)
    try:
        write_history(folder / HISTORY, history)
        write_record(folder / RECORD, config.as_dict(), history)
    except OSError as error:
        raise CheckpointError(f"cannot write the history to {folder}: {error.strerror or error}") from error
    return history


class _Counter(BaseCallback):
    """Looks at every episode that ends during the learning; ends it if the shield does nothing but fail."""

    def __init__(self, watch: Watch | None) -> None:
        super().__init__()
        self.tally, self._watch = EpisodeCounter(), watch

    def _on_training_start(self) -> None:
        self.tally = EpisodeCounter()

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if self.tally.take(info) and self.tally.blocked(_ENOUGH):
                raise BlockedError(_blocked(str(info.get("shield/reason", ""))))
        if self._watch is not None:
            self._watch(self.num_timesteps)
        return True


def _blocked(reason: str) -> str:
    return f"nothing can be learnt: every decision of the shield is a FAULT; the reason: {reason}"


def _seed(seed: int, leg: int) -> int:
    """The seed of a leg: nothing in common with its neighbours, below what evaluations use."""
    return int(np.random.SeedSequence([seed, leg]).generate_state(1)[0] % 1_000_000_000)


def _log(model: BaseAlgorithm, leg: Leg) -> None:
    for name in ("success", "collisions", "moving_contacts", "limit_violations", "interventions"):
        model.logger.record(f"safety/{name}", getattr(leg, name))
    for name in ("success", "safe", "moving_contacts", "interventions", "return"):
        model.logger.record(f"eval/{name}", getattr(leg, f"eval_{name}"))
    model.logger.dump(leg.steps)


def _provenance(config: TrainConfig, history: Sequence[Leg], command: str) -> Mapping[str, Any]:
    return {
        "command": command,
        "training": config.as_dict(),
        "steps": history[-1].steps,
        "seconds": round(sum(leg.seconds for leg in history), 1),
        "versions": {"python": platform.python_version(), **{name: v for name in _PACKAGES if (v := _version(name))}},
        "curve": [[leg.steps, leg.eval_safe, leg.eval_moving_contacts] for leg in history],
        "training_episodes": sum(leg.episodes for leg in history),
        "training_moving_contacts": sum(leg.moving_contacts for leg in history),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
