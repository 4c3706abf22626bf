"""Statistics of a ``VecNormalize`` from the file that its ``save`` wrote, without running what is in it."""

import io
import pickle
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError, PolicyFileError
from jssa_gym.storage import read_whole
from jssa_gym.types import Array
from jssa_gym.validation import positive_number, real_array

_LARGEST = 64 * 2**20
"""Largest size of a file [bytes]."""


class Normalisation(NamedTuple):
    """How observations are normalised before a policy gets them."""

    mean: Array
    """Shape (n_obs,)."""
    std: Array
    """What is divided by, shape (n_obs,)."""
    clip: float
    """Largest absolute value afterwards."""

    def __call__(self, observation: Any) -> Array:
        """The observation as it was in training, shape (n_obs,).

        Raises:
            ParameterError: It has another shape.
        """
        raw = np.asarray(observation, np.float64)
        if raw.shape != self.mean.shape:
            raise ParameterError(
                f"the statistics are of observations of shape {self.mean.shape}, the environment's have {raw.shape}"
            )
        return np.clip((raw - self.mean) / self.std, -self.clip, self.clip)


class _Inert:
    """Stands for whatever a file names: it remembers what it is given, and does nothing."""

    def __new__(cls, *_: Any, **__: Any) -> "_Inert":
        return object.__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.__dict__.update({name: value for name, value in state.items() if isinstance(name, str)})

    def __setitem__(self, key: Any, value: Any) -> None:
        pass

    def append(self, value: Any) -> None:
        """Forget it."""

    def extend(self, values: Any) -> None:
        """Forget them."""


def _empty(*_: Any) -> Array:
    """An array whose content follows."""
    return np.empty(0)


def _from_buffer(content: Any, kind: np.dtype, shape: tuple[int, ...], order: Literal["C", "F"]) -> NDArray[Any]:
    return np.frombuffer(content, kind).reshape(shape, order=order)


def _bytes(text: str, _: str = "") -> bytes:
    """What older pickles make of bytes."""
    return text.encode("latin1")


def _scalar(kind: np.dtype, content: bytes = b"") -> Any:
    return np.frombuffer(content, kind)[0]


_LOOKED_UP: dict[str, Any] = {
    "_reconstruct": _empty, "_frombuffer": _from_buffer, "scalar": _scalar, "ndarray": np.ndarray, "dtype": np.dtype,
}  # fmt: skip
"""What arrays and their types are made of in pickles, by its name in numpy: all else but bytes is inert."""


class _Unpickler(pickle.Unpickler):
    """Reads numbers, texts, containers and arrays; everything else is inert."""

    def find_class(self, module: str, name: str, /) -> Any:
        if (module, name) == ("_codecs", "encode"):
            return _bytes
        return _LOOKED_UP.get(name, _Inert) if module.split(".")[0] == "numpy" else _Inert


def read_normalisation(path: str | Path) -> Normalisation:
    """The statistics of observations in a file of ``VecNormalize.save``.

    The file is a pickle; it is read with arrays and plain values as they are, and inert stand-ins for everything else
    that it names, so that nothing in it is ever run.

    Args:
        path: Such as ``"vecnormalize.pkl"``.

    Raises:
        PolicyFileError: It is none, is damaged, or normalises no observations, or a dictionary of them.
    """
    content = read_whole(Path(path), PolicyFileError, _LARGEST)
    try:
        found = _Unpickler(io.BytesIO(content)).load()
    except Exception as error:  # what a damaged pickle raises is up to the damage
        raise PolicyFileError(f"{path} is no file of VecNormalize.save, or damaged: {error}") from error
    told = vars(found) if isinstance(found, _Inert) else {}
    if isinstance(told.get("obs_rms"), dict):
        raise PolicyFileError(f"{path} has statistics of dictionaries: policies of vectors are what can be evaluated")
    if told.get("norm_obs") is not True or not isinstance(told.get("obs_rms"), _Inert):
        raise PolicyFileError(f"{path} holds no VecNormalize that normalises observations")
    running = vars(told["obs_rms"])
    try:
        mean = np.asarray(running["mean"], np.float64)
        mean = real_array("mean", mean, (mean.size,), "a vector")
        var = real_array("var", running["var"], mean.shape, "a vector")
        std = np.sqrt(var + positive_number("epsilon", told["epsilon"]))
        clip = positive_number("clip_obs", told["clip_obs"])
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(f"the statistics in {path} are not sound: {error}") from error
    if not np.all(np.isfinite(std) & (std > 0.0)):
        raise PolicyFileError(f"the statistics in {path} are not sound: a variance is negative")
    return Normalisation(mean, std, clip)
