"""Data sets in the format of Minari 0.5: ``main_data.hdf5`` and ``metadata.json``, without Minari.

Its own writer needs JAX, its reader h5py alone. What is written can be told again: the same recipe gives the same
digest of all arrays, whatever HDF5 makes of them on the disk.
"""

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jssa_gym.datasets.episode import EpisodeData, collect
from jssa_gym.datasets.recipe import Recipe
from jssa_gym.evaluation.identity import code_version
from jssa_gym.exceptions import MissingExtraError, ParameterError, StorageError, how_to_install
from jssa_gym.storage import read_text, refused, whole_file, write_json

DATA, METADATA = "main_data.hdf5", "metadata.json"
"""Minari's names of the two files."""

FORMAT = "0.5.0"
"""The first version of Minari with this format; later ones read it."""

_KEY = "jssa_gym"
"""Our part of the metadata."""


@dataclass(frozen=True, slots=True)
class DatasetSummary:
    """What was written."""

    name: str
    """With namespace and version, such as ``jssa_gym/reach-jpc-v0``."""
    path: Path
    """Folder of the two files."""
    episodes: int
    steps: int
    """Steps of all episodes together."""
    size: int
    """Size of the files [bytes]."""
    digest: str
    """SHA-256 of all episodes' seeds and arrays."""


def write_dataset(
    root: Path, recipe: Recipe, name: str | None = None, progress: Callable[[int, int], Any] | None = None
) -> DatasetSummary:
    """Play a data set's episodes and write them where Minari looks for it.

    Args:
        root: Minari's folder of data sets, its ``MINARI_DATASETS_PATH``; the two files go to ``root/name/data``.
        recipe: What is played.
        name: Of the data set; by default the recipe's own.
        progress: Called after every episode with how many there are and how many there will be.

    Raises:
        MissingExtraError: h5py is not installed.
        ParameterError: There is a data set already, the name is none of Minari's, or its people come and go.
        StorageError: It cannot be written.
    """
    h5py = _h5py()
    name = recipe.name if name is None else name
    folder = _new_folder(root, name)
    digest, steps, count = hashlib.sha256(), 0, 0
    with closing(recipe.make_env()) as env:
        described = _described(env, recipe, name)
        with whole_file(folder / DATA) as file, h5py.File(file, "w", track_order=True) as archive:
            for count, seed in enumerate(range(recipe.seed, recipe.seed + recipe.episodes), 1):
                episode = collect(env, recipe.make_policy(env, seed), seed)
                _write(archive.create_group(f"episode_{count - 1}"), count - 1, episode)
                _digest(digest, episode.seed, episode.arrays)
                steps += len(episode.arrays["rewards"])
                if progress is not None:
                    progress(count, recipe.episodes)
    size = (folder / DATA).stat().st_size
    told = {
        **described,
        "total_episodes": count,
        "total_steps": steps,
        "dataset_size": round(size / 1e6, 1),
        _KEY: {**described[_KEY], "sha256": digest.hexdigest()},
    }
    write_json(folder / METADATA, told)
    size += (folder / METADATA).stat().st_size
    return DatasetSummary(name, folder, count, steps, size, digest.hexdigest())


def read_digest(folder: Path) -> tuple[str, str]:
    """The digest of what a data set's file holds, and what its metadata say that it is.

    Args:
        folder: Of the two files, or the one around it.

    Raises:
        MissingExtraError: h5py is not installed.
        ParameterError: There is no data set of this package, or its file is damaged.
    """
    h5py = _h5py()
    place = folder if (folder / METADATA).exists() else folder / "data"
    if not (place / METADATA).exists():
        message = f"there is no data set in {folder}: name the folder of one, such as datasets/mine/reach-v0"
        raise ParameterError(message)
    with refused(ParameterError, f"{place / METADATA} is no metadata of a data set of this package"):
        said = str(json.loads(read_text(place / METADATA, ParameterError))[_KEY]["sha256"])
    digest = hashlib.sha256()
    with refused(ParameterError, f"{place / DATA} holds no data set"), h5py.File(place / DATA, "r") as archive:
        for k in range(len(archive)):
            group = archive[f"episode_{k}"]
            _digest(digest, int(group.attrs["seed"]), dict(_arrays(group)))
    return digest.hexdigest(), said


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError(f"data sets need the extra 'data': {how_to_install('data')}") from error
    return h5py


def _arrays(group: Any, path: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """All arrays in a group and its groups, by their whole names."""
    for name, item in group.items():
        if hasattr(item, "items"):
            yield from _arrays(item, f"{path}{name}/")
        else:
            yield path + name, item[()]


def _new_folder(root: Path, name: str) -> Path:
    """The folder of a data set that is not there yet."""
    space, _, own = name.rpartition("/")
    stem, _, version = own.rpartition("-v")
    if not (stem and version.isdecimal() and all(part.replace("-", "_").isidentifier() for part in space.split("/"))):
        raise ParameterError(f"the name of a data set is namespace/name-vNUMBER, such as mine/reach-v0, got {name!r}")
    folder = root / name / "data"
    if (folder / METADATA).exists():
        raise ParameterError(f"{folder} holds a data set already; give another --name or another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"cannot write to {folder}: {error.strerror}") from error
    return folder


def _write(group: Any, number: int, episode: EpisodeData) -> None:
    """An episode, each of its arrays as one compressed chunk that can grow."""
    people = episode.people
    group.attrs.update({"id": number, "seed": episode.seed, "total_steps": len(episode.arrays["rewards"])})
    if len(people.names):
        told = {"names": [str(name) for name in people.names], "radius": people.radius, "person": people.person}
        group.attrs.update({f"people/{key}": value for key, value in told.items()})
    for name, array in episode.arrays.items():
        options = {"chunks": array.shape, "maxshape": (None, *array.shape[1:])}
        group.create_dataset(name, data=array, compression="gzip", shuffle=True, **options)


def _digest(digest: Any, seed: int, arrays: dict[str, NDArray[Any]]) -> None:
    digest.update(f"episode {seed}\n".encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())


def _described(env: gym.Env, recipe: Recipe, name: str) -> dict[str, Any]:
    """The metadata, but for what only the episodes tell."""
    base: Any = env.unwrapped
    own = {
        **asdict(recipe),
        "policy_sha256": dict(recipe.study().code).get(recipe.policy, ""),
        "dt": base.dt,
        "jerk_bounds": base.robot.limits.jerk.tolist(),
        "uncovered": list(base.robot.uncovered),
        **code_version(),
    }
    described: dict[str, Any] = {
        "dataset_id": name,
        "minari_version": FORMAT,
        "data_format": "hdf5",
        "observation_space": _space(env.observation_space),
        "action_space": _space(env.action_space),
        "algorithm_name": recipe.policy,
        "description": (
            f"{recipe.task}: policy {recipe.policy}, shield {recipe.shield}, people {recipe.human}; seeds "
            f"{recipe.seed} to {recipe.seed + recipe.episodes - 1}"
        ),
        "requirements": ["jssa-gym"],
        _KEY: own,
    }
    spec = env.spec
    if spec is not None:
        with contextlib.suppress(TypeError):  # people who are no name cannot be written down; the spaces are
            described["env_spec"] = spec.to_json()
    return described


def _space(space: gym.Space) -> str:
    """A space as Minari writes it.

    Raises:
        ParameterError: It is no box.
    """
    if not isinstance(space, spaces.Box):
        raise ParameterError(f"data sets hold observations and actions that are boxes, not {space}")
    return json.dumps(
        {
            "type": "Box",
            "dtype": str(space.dtype),
            "shape": list(space.shape),
            "low": space.low.tolist(),
            "high": space.high.tolist(),
        }
    )
