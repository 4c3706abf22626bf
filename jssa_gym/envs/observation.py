"""The observation as a table: what is in it, how it is scaled, within which bounds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Array

FAR = 2.0
"""Distances and positions beyond this are observed as this [m]."""


@dataclass(frozen=True, slots=True)
class Feature:
    """Some consecutive numbers of the observation: raw value divided by ``scale``, clipped to ``bound``."""

    name: str
    size: int
    scale: tuple[float, ...]
    """Divisor of each number, in the unit of the raw value; one number serves all."""
    low: float
    high: float
    text: str

    def __post_init__(self) -> None:
        if self.size < 1 or len(self.scale) not in (1, self.size):
            raise ParameterError(f"feature {self.name}: {len(self.scale)} scales for {self.size} numbers")


class Observation:
    """Assembles observations from a table of features.

    Args:
        features: The table; raw values are given to :meth:`assemble` in its order.
    """

    def __init__(self, features: Sequence[Feature]) -> None:
        self.features = tuple(features)
        self.size = sum(feature.size for feature in features)
        self._raw = np.zeros(self.size)
        self._gain = np.concatenate([np.full(f.size, 1.0) / np.array(f.scale) for f in features])
        self._low = np.concatenate([np.full(f.size, f.low) for f in features])
        self._high = np.concatenate([np.full(f.size, f.high) for f in features])
        self.slices: dict[str, slice] = {}
        begin = 0
        for feature in self.features:
            self.slices[feature.name] = slice(begin, begin + feature.size)
            begin += feature.size
        self._order = tuple(self.slices.values())

    @property
    def space(self) -> spaces.Box:
        """Its bounds, float32."""
        return spaces.Box(self._low.astype(np.float32), self._high.astype(np.float32))

    def assemble(self, values: Sequence[Array | float]) -> NDArray[np.float32]:
        """The observation from the raw values of all features, in the table's order."""
        raw = self._raw
        for where, value in zip(self._order, values, strict=True):
            raw[where] = value
        scaled = raw * self._gain
        np.maximum(scaled, self._low, out=scaled)
        np.minimum(scaled, self._high, out=scaled)
        return scaled.astype(np.float32)

    def table(self) -> str:
        """The table in reStructuredText, for docstrings and docs."""
        return feature_table(self.features)


def feature_table(features: Sequence[Feature]) -> str:
    """Features as a reStructuredText list table."""
    lines = []
    begin = 0
    for f in features:
        index = str(begin) if f.size == 1 else f"{begin}-{begin + f.size - 1}"
        lines.append(f"{index:<7} {f.name:<18} [{f.low:g}, {f.high:g}]{'':<3} {f.text}")
        begin += f.size
    return "\n".join(lines)
