"""Where everybody is seen: what takes the place of "nobody comes or goes"."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.records import FACE, records
from jssa_gym.validation import known_name, positive_integer, positive_number, real_array

SIDES = ("left", "right", "back", "front", "bottom", "top")
"""Faces of a box: towards lower and higher x, y and z."""

_UNIT = 1e-6
"""How far the square of a normal's length may be from 1."""


@dataclass(frozen=True, slots=True)
class ConvexPiece:
    """What its faces leave: each is the half-space beyond it, ``normal · x <= offset``.

    Args:
        normal: Unit normals, pointing into the piece, shape (f, 3); kept as tuples.
        offset: Shape (f,) [m].
        closed: Whether nobody comes through a face, a floor or a wall, nor touches the arm beyond it, shape (f,); None:
            all are open.

    Raises:
        ParameterError: They do not fit together, or a normal is no unit vector.
    """

    normal: Sequence[Sequence[float]]
    """Shape (f, 3)."""
    offset: Sequence[float]
    """Shape (f,) [m]."""
    closed: Sequence[bool] | None = None
    """Shape (f,)."""

    def __post_init__(self) -> None:
        count = len(self.offset) if isinstance(self.offset, Sequence | np.ndarray) else 0
        if not count:
            raise ParameterError(f"a piece needs faces: offset has to be one number each, got {self.offset!r}")
        normal = real_array("normal", self.normal, (count, 3), "a unit vector for each offset")
        offset = real_array("offset", self.offset, (count,), "a number for each face [m]")
        if not np.all(np.abs((normal**2).sum(axis=1) - 1.0) < _UNIT):
            raise ParameterError(f"normals have to be unit vectors, got {normal.tolist()}")
        closed = [False] * count if self.closed is None else list(self.closed)
        if len(closed) != count or not all(isinstance(one, bool | np.bool_) for one in closed):
            raise ParameterError(f"closed has to be True or False for each of {count} faces, got {self.closed!r}")
        object.__setattr__(self, "normal", tuple(map(tuple, normal.tolist())))
        object.__setattr__(self, "offset", tuple(offset.tolist()))
        object.__setattr__(self, "closed", tuple(map(bool, closed)))

    @classmethod
    def box(cls, low: Sequence[float], high: Sequence[float], closed: Iterable[str] = ()) -> Self:
        """A box along the axes of the world.

        Args:
            low, high: Its corners, shape (3,) [m].
            closed: Its closed faces, of :data:`SIDES`: ``left`` and ``right`` are towards lower and higher x, ``back``
                and ``front`` of y, ``bottom`` and ``top`` of z.

        Raises:
            ParameterError: A side is unknown, or a corner no point or not below the other one.
        """
        least, most = (real_array(name, at, (3,), "a point [m]") for name, at in (("low", low), ("high", high)))
        if not np.all(least < most):
            raise ParameterError(f"low has to be below high, got {least.tolist()} and {most.tolist()}")
        shut = {known_name("side", side, SIDES) for side in ([closed] if isinstance(closed, str) else closed)}
        axes = np.repeat(np.eye(3), 2, axis=0) * np.tile([[1.0], [-1.0]], (3, 1))
        offset = np.stack([least, -most], axis=1).ravel()
        return cls(axes.tolist(), offset.tolist(), [side in shut for side in SIDES])


@dataclass(frozen=True, slots=True)
class WatchedRegion:
    """Everything of people inside of it is measured; people may come and go, number, order and ids of people change.

    Whoever is not measured is assumed to be outside, to stand at its edge, and to come in at ``entry_speed``: an arm
    keeps off where they can be before it rests. So a region has to be larger than where the arm moves. It has to be
    smaller than what is seen, by what somebody walks between two frames: who leaves it is forgotten only once they were
    measured, wholly, outside.

    Args:
        pieces: Convex pieces, as :class:`ConvexPiece` or mappings of its fields; the region is their union. Where two
            meet they should overlap: by less than an arm's part is thick there is no way between them.
        entry_speed: Nobody comes in faster [m/s]; None for the fastest of the assumptions about people, a foot's.
        capacity: As many body parts may be there at once, those that are lost included; more are a fault.

    Raises:
        ParameterError: There is no piece, or a number is out of range.
    """

    pieces: Sequence[ConvexPiece | Mapping[str, Any]]
    """The region is their union; kept as a tuple."""
    entry_speed: float | None = None
    """Nobody comes in faster [m/s]."""
    capacity: int = 60
    """As many body parts may be there at once."""

    def __post_init__(self) -> None:
        if isinstance(self.pieces, ConvexPiece) or not isinstance(self.pieces, Sequence) or not self.pieces:
            raise ParameterError(f"pieces have to be a sequence of at least one ConvexPiece, got {self.pieces!r}")
        object.__setattr__(self, "pieces", tuple(_piece(one) for one in self.pieces))
        if self.entry_speed is not None:
            object.__setattr__(self, "entry_speed", positive_number("entry_speed", self.entry_speed))
        object.__setattr__(self, "capacity", positive_integer("capacity", self.capacity))

    @classmethod
    def box(
        cls, low: Sequence[float], high: Sequence[float], closed: Iterable[str] = (), entry_speed: float | None = None
    ) -> Self:
        """A single box; arguments as of :meth:`ConvexPiece.box`."""
        return cls((ConvexPiece.box(low, high, closed),), entry_speed)

    @classmethod
    def of(cls, value: Any) -> Self:
        """A region, given as such or as a mapping of its fields, such as a JSON object holds.

        Raises:
            ParameterError: It is something else, or a field is unknown or out of range.
        """
        if isinstance(value, cls):
            return value
        if not isinstance(value, Mapping):
            raise ParameterError(
                f"a watched region has to be a WatchedRegion or a mapping of its fields, got {value!r}"
            )
        return _made(cls, "a watched region", value)

    def faces(self) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Faces of all pieces, shape (f,) of ``FACE``, and where those of each piece begin, shape (pieces + 1,)."""
        pieces: Any = self.pieces
        first = np.cumsum([0, *(len(piece.offset) for piece in pieces)]).astype(np.int64)
        faces = records(int(first[-1]), FACE)
        for name in ("normal", "offset", "closed"):
            faces[name] = np.concatenate([np.array(getattr(piece, name)) for piece in pieces])
        return faces, first


def _piece(value: Any) -> ConvexPiece:
    if isinstance(value, ConvexPiece):
        return value
    if not isinstance(value, Mapping):
        raise ParameterError(f"a piece has to be a ConvexPiece or a mapping of its fields, got {value!r}")
    return _made(ConvexPiece, "a piece", value)


def _made(kind: Any, what: str, value: Mapping[str, Any]) -> Any:
    """A dataclass of a mapping of its fields."""
    for name in value:
        known_name(f"field of {what}", name, [field.name for field in fields(kind)])
    if missing := [field.name for field in fields(kind) if field.default is MISSING and field.name not in value]:
        raise ParameterError(f"{what} needs {', '.join(missing)}, got {value!r}")
    return kind(**value)
