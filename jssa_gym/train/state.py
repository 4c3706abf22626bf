"""What a training needs to go on: networks, optimisers, statistics, replay buffer; arrays and tensors, no pickles."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from jssa_gym.exceptions import CheckpointError

PARAMETERS, STATISTICS, BUFFER = "parameters.pt", "statistics.npz", "buffer.npz"
"""Files of a checkpoint."""


def save_parameters(model: BaseAlgorithm, path: Path) -> None:
    """Networks, optimisers and counters; tensors only."""
    names, tensors = model._get_torch_save_params()
    state = {
        "parameters": model.get_parameters(),
        "tensors": {name: getattr(model, name).detach() for name in tensors},
        "counters": {"updates": model._n_updates, "episodes": model._episode_num},
    }
    assert set(names) == set(state["parameters"])
    content = io.BytesIO()  # torch's own writer says of a full disk that something is inconsistent
    torch.save(state, content)
    path.write_bytes(content.getvalue())


def load_parameters(model: BaseAlgorithm, path: Path) -> None:
    """Restore what :func:`save_parameters` wrote, without unpickling objects.

    Raises:
        CheckpointError: It is for another network, or no such file.
    """
    try:
        state = torch.load(path, map_location=model.device, weights_only=True)
        model.set_parameters(state["parameters"], exact_match=True, device=model.device)
        with torch.no_grad():
            for name, tensor in state["tensors"].items():
                getattr(model, name).copy_(tensor)
        model._n_updates = int(state["counters"]["updates"])
        model._episode_num = int(state["counters"]["episodes"])
    except Exception as error:  # whatever torch thinks of a file that somebody changed
        raise CheckpointError(f"{path} does not hold this training's parameters: {error}") from error


_MOMENTS = ("mean", "var", "count")


def save_statistics(model: BaseAlgorithm, path: Path) -> None:
    """Running statistics of observations and rewards."""
    arrays: dict[str, NDArray[Any]] = {}
    norm = model.get_vec_normalize_env()
    if norm is not None:
        for kind in ("obs", "ret"):
            rms: Any = getattr(norm, f"{kind}_rms")
            arrays |= {f"{kind}_{moment}": np.asarray(getattr(rms, moment), np.float64) for moment in _MOMENTS}
    np.savez(path, allow_pickle=False, **arrays)


def load_statistics(model: BaseAlgorithm, path: Path) -> None:
    """Restore what :func:`save_statistics` wrote.

    Raises:
        CheckpointError: It is no such file.
    """
    norm = model.get_vec_normalize_env()
    if norm is None:
        return
    try:
        with np.load(path, allow_pickle=False) as arrays:
            for kind in ("obs", "ret"):
                rms: Any = getattr(norm, f"{kind}_rms")
                mean = arrays[f"{kind}_mean"]
                if mean.shape != np.shape(rms.mean):
                    raise ValueError(f"{kind} has shape {mean.shape} instead of {np.shape(rms.mean)}")
                rms.mean, rms.var = mean, arrays[f"{kind}_var"]
                rms.count = float(arrays[f"{kind}_count"])
    except (OSError, ValueError, KeyError) as error:
        raise CheckpointError(f"{path} does not hold this training's statistics: {error}") from error


_COLUMNS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_buffer(model: OffPolicyAlgorithm, path: Path) -> None:
    """The filled part of the replay buffer."""
    buffer = model.replay_buffer
    assert buffer is not None
    filled = buffer.size()
    columns = {name: getattr(buffer, name)[:filled] for name in _COLUMNS}
    np.savez(path, allow_pickle=False, **columns, cursor=np.array([buffer.pos, buffer.full], np.int64))


def load_buffer(model: OffPolicyAlgorithm, path: Path) -> None:
    """Restore what :func:`save_buffer` wrote.

    Raises:
        CheckpointError: It is no such file.
    """
    buffer = model.replay_buffer
    assert buffer is not None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            pos, full = (int(x) for x in arrays["cursor"])
            filled = buffer.buffer_size if full else pos
            for name in _COLUMNS:
                getattr(buffer, name)[:filled] = arrays[name]
        buffer.pos, buffer.full = pos, bool(full)
    except (OSError, ValueError, KeyError) as error:
        raise CheckpointError(f"{path} does not hold this training's replay buffer: {error}") from error
