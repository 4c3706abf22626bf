"""Results as JSON can hold them."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.storage.files import write_whole


def as_json(value: Any) -> Any:
    """A value as JSON can hold it: dataclasses and named tuples by field, arrays as lists; what is not finite is null.

    Properties are not said, and what is of no such kind stays as it is.
    """
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    elif isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): as_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(entry) for entry in value]
    if isinstance(value, Path):
        return str(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: Path, data: Any) -> None:
    """Write JSON into a file that is complete or not there.

    Raises:
        StorageError: The file cannot be written.
        ValueError, TypeError: JSON cannot hold it; nothing was written.
    """
    write_whole(path, json.dumps(data, indent=2, allow_nan=False) + "\n")
