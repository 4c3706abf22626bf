"""Switches of the JSSA shield that are hardly ever turned."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from jssa_gym.exceptions import ParameterError
from jssa_gym.validation import known_name


@dataclass(frozen=True, slots=True)
class JSSAOptions:
    """How :class:`~jssa_gym.shields.JSSAShield` makes its rows and projects; the shield says what it does not take."""

    gradient: Literal["exact", "printed"] = "exact"
    """Gradient of the rows: exact, or Eq. (11)-(13) to the letter."""
    projector: Literal["exact", "osqp"] = "exact"
    """What finds the nearest jerk; see :mod:`jssa_gym.safety.projectors`."""
    weight: ArrayLike | Sequence[float] | None = None
    """V of Eq. (14): None for the identity, a diagonal (n,), or a full (n, n); kept as tuples."""
    static_rows: bool = False
    """Whether table, floor and static capsules make rows too."""
    sliding: bool = False
    """See :class:`~jssa_gym.safety.index.IndexParams`."""

    def __post_init__(self) -> None:
        if self.weight is not None:
            object.__setattr__(self, "weight", _tuples(np.asarray(self.weight, object).tolist()))

    @classmethod
    def of(cls, options: Self | Mapping[str, Any] | None, **beside: Any) -> Self:
        """The options, given as such, as a mapping of them (which JSON can hold), or one by one ``beside`` them.

        Raises:
            ParameterError: An option is unknown, or given twice: in ``options``, which are all there are, and beside
                them.
        """
        given = {name: value for name, value in beside.items() if value is not None}
        if options is None:
            return cls(**given)
        for name in given:
            raise ParameterError(f"{name} is one of the options: give it in options or alone, not both")
        if isinstance(options, Mapping):
            for name in options:
                known_name("option", name, [field.name for field in fields(cls)])
            return cls(**options)
        if not isinstance(options, cls):
            raise ParameterError(f"options have to be {cls.__name__} or a mapping of its fields, got {options!r}")
        return options


def _tuples(value: Any) -> Any:
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value
