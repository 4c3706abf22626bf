"""What a training needs to go on: networks, optimisers, statistics, replay buffer; arrays and tensors, no pickles."""

import io
from collections.abc import Collection, Mapping
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from jssa_gym.exceptions import CheckpointError
from jssa_gym.storage import open_archive, open_whole, read_array, refused, write_archive
from jssa_gym.train.checkpoint import LARGEST
from jssa_gym.train.lagrangian import CostBuffer

PARAMETERS, STATISTICS, BUFFER = "parameters.pt", "statistics.npz", "buffer.npz"
"""Files of a checkpoint."""


def save_parameters(model: BaseAlgorithm, file: IO[bytes]) -> None:
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
    file.write(content.getvalue())


def load_parameters(model: BaseAlgorithm, path: Path) -> None:
    """Restore what :func:`save_parameters` wrote, without unpickling objects.

    Raises:
        CheckpointError: It is for another network, or no such file.
    """
    try:
        with open_whole(path, CheckpointError, LARGEST) as file, open_archive(file):
            file.seek(0)
            state = torch.load(file, map_location=model.device, weights_only=True)
        _check_parameters(model, state)
        model.set_parameters(state["parameters"], exact_match=True, device=model.device)
        with torch.no_grad():
            for name, tensor in state["tensors"].items():
                getattr(model, name).copy_(tensor)
        model._n_updates = int(state["counters"]["updates"])
        model._episode_num = int(state["counters"]["episodes"])
    except Exception as error:  # whatever torch thinks of a file that somebody changed
        raise CheckpointError(f"{path} does not hold this training's parameters: {error}") from error


def _check_parameters(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Whether everything has the names and shapes of the model's own; torch would broadcast some, and fail later."""
    own, found = model.get_parameters(), state["parameters"]
    tensors = {name: getattr(model, name) for name in model._get_torch_save_params()[1]}
    _same_tensors(tensors, state["tensors"])
    if set(found) != set(own):
        raise ValueError(f"it holds {sorted(found)} instead of {sorted(own)}")
    for name, part in own.items():
        if "param_groups" not in part:
            _same_tensors(part, found[name])
            continue
        if [{**g, "lr": 0.0} for g in found[name]["param_groups"]] != [{**g, "lr": 0.0} for g in part["param_groups"]]:
            raise ValueError(f"{name} has other options")
        weights = [x for g in attrgetter(name)(model).param_groups for x in g["params"]]
        for k, moments in found[name]["state"].items():
            for moment in moments.values():
                if moment.shape not in (weights[k].shape, torch.Size([])):
                    raise ValueError(f"{name} has moments of another shape")


def _same_tensors(own: Mapping[str, torch.Tensor], found: Mapping[str, torch.Tensor]) -> None:
    if set(own) != set(found):
        raise ValueError(f"it holds {sorted(found)} instead of {sorted(own)}")
    for name, tensor in own.items():
        if (found[name].shape, found[name].dtype) != (tensor.shape, tensor.dtype):
            raise ValueError(f"{name} has another shape or type")


_MOMENTS = ("mean", "var", "count")


def save_statistics(model: BaseAlgorithm, file: IO[bytes]) -> None:
    """Running statistics of observations and rewards."""
    arrays: dict[str, NDArray[Any]] = {}
    norm = model.get_vec_normalize_env()
    if norm is not None:
        for kind in ("obs", "ret"):
            rms: Any = getattr(norm, f"{kind}_rms")
            arrays |= {f"{kind}_{moment}": np.asarray(getattr(rms, moment), np.float64) for moment in _MOMENTS}
    write_archive(file, arrays)


def load_statistics(model: BaseAlgorithm, path: Path) -> None:
    """Restore what :func:`save_statistics` wrote.

    Raises:
        CheckpointError: It is no such file.
    """
    norm = model.get_vec_normalize_env()
    if norm is None:
        return
    running = {kind: getattr(norm, f"{kind}_rms") for kind in ("obs", "ret")}
    arrays = _read(
        path,
        {
            f"{kind}_{moment}": np.asarray(getattr(rms, moment), np.float64)
            for kind, rms in running.items()
            for moment in _MOMENTS
        },
    )
    for name, array in arrays.items():
        if not np.all(np.isfinite(array)) or (not name.endswith("_mean") and np.any(array < 0.0)):
            raise CheckpointError(f"{path} does not hold this training's statistics: {name} is out of range")
    for kind, rms in running.items():
        rms.mean, rms.var, rms.count = (arrays[f"{kind}_{moment}"] for moment in _MOMENTS)
        rms.count = float(rms.count)


_COLUMNS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def _columns(buffer: ReplayBuffer) -> tuple[str, ...]:
    return (*_COLUMNS, "costs") if isinstance(buffer, CostBuffer) else _COLUMNS


def save_buffer(model: OffPolicyAlgorithm, file: IO[bytes]) -> None:
    """The filled part of the replay buffer."""
    buffer = model.replay_buffer
    assert buffer is not None
    filled = buffer.size()
    columns = {name: getattr(buffer, name)[:filled] for name in _columns(buffer)}
    write_archive(file, {**columns, "cursor": np.array([buffer.pos, buffer.full], np.int64)})


def load_buffer(model: OffPolicyAlgorithm, path: Path) -> None:
    """Restore what :func:`save_buffer` wrote.

    Raises:
        CheckpointError: It is no such file.
    """
    buffer = model.replay_buffer
    assert buffer is not None
    whole = {name: getattr(buffer, name) for name in _columns(buffer)}
    (cursor,) = _read(path, {"cursor": np.zeros(2, np.int64)}, among=whole).values()
    pos, full = (int(x) for x in cursor)
    if full not in (0, 1) or not 0 <= pos < buffer.buffer_size:
        raise CheckpointError(f"{path} does not hold this training's replay buffer: its cursor is {pos}, {full}")
    filled = buffer.buffer_size if full else pos
    arrays = _read(path, {name: column[:filled] for name, column in whole.items()}, among=("cursor",))
    for name, column in whole.items():
        column[:filled] = arrays[name]
    buffer.pos, buffer.full = pos, bool(full)


def _read(path: Path, like: Mapping[str, NDArray[Any]], among: Collection[str] = ()) -> dict[str, NDArray[Any]]:
    """Arrays of a file, each of the shape and type of its like; ``among`` are others that have to be there."""
    with (
        open_whole(path, CheckpointError, LARGEST) as file,
        refused(CheckpointError, f"{path} does not hold what belongs to this training"),
        open_archive(file) as archive,
    ):
        wanted, names = {f"{name}.npy" for name in (*like, *among)}, archive.namelist()
        if set(names) != wanted:
            raise ValueError(f"it holds {', '.join(sorted(names))[:300]} instead of {', '.join(sorted(wanted))}")
        arrays = {name: read_array(archive, name) for name in like}
        for name, expected in like.items():
            if (found := (arrays[name].shape, arrays[name].dtype)) != (expected.shape, expected.dtype):
                raise ValueError(f"{name} has {found} instead of {expected.shape}, {expected.dtype}")
        return arrays
