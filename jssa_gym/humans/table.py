"""Recorded motion as a table: text with a header and a row a sample, as spreadsheets and cameras' programs write it.

Values are set apart by commas, semicolons or tabs, as most of the header is, or as a first line ``sep=;`` says; where
they are not set apart by commas, a comma may stand for the decimal point. Empty lines and lines that begin with ``#``,
``%`` or ``//`` are left out, and so is a column without a name or of the name of an index. A unit behind a column's
name, as in ``time [ms]``, ``time_ms`` or ``head.radius [mm]``, is converted.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jssa_gym.exceptions import RecordingError
from jssa_gym.storage import read_text
from jssa_gym.storage.tables import INDEX, as_numbers, check_lengths, check_times, table_lines
from jssa_gym.types import Array

_ENDS = tuple(f"{end}.{axis}" for end in ("start", "end") for axis in "xyz")
_FIELDS = (*_ENDS, "radius")

_UNIT = re.compile(r"^(.*?)(?:\s*[\[(]\s*(\w+)\s*[\])]|_(ms|us|mm|cm|s|m))$")
"""A column and the unit behind it."""

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """What is in a table, in metres and seconds."""

    values: dict[str, Any]
    """Arguments of a :class:`~jssa_gym.humans.Recording`."""
    rows: tuple[int, ...]
    """Line of every sample in the file, from 1."""


def read_table(path: Path, largest: int) -> Table:
    """Read a table.

    Args:
        path: Of the file, text in UTF-8.
        largest: Size from which it is not read [bytes].

    Raises:
        RecordingError: It is none, a column is missing or unknown, or a field is no number, is empty or does not fit;
            the message names row and column.
    """
    header, rows, comma = table_lines(read_text(path, RecordingError, largest), RecordingError)
    columns, factors, names, keep = _columns(header)
    check_lengths(header, rows, RecordingError)
    numbers = tuple(number for number, _ in rows)
    cells = [[row[k].strip() for k in keep] for _, row in rows]
    table = as_numbers(cells, numbers, columns, comma, RecordingError) * 1.0
    for k, factor in enumerate(factors):
        if factor != 1.0:
            table[:, k] *= factor
    column = {name: table[:, i] for i, name in enumerate(columns)}
    check_times(column["time"], numbers, RecordingError)
    ends = np.stack([column[f"{name}.{field}"] for name in names for field in _ENDS], axis=1)
    ends = ends.reshape(len(rows), len(names), 2, 3)
    radius = np.stack([column[f"{name}.radius"] for name in names], axis=1)
    _check_radius(radius, numbers, names)
    values = {
        "time": column["time"],
        "start": ends[:, :, 0],
        "end": ends[:, :, 1],
        "radius": radius[0] if len(rows) else np.ones(len(names)),
        "names": names,
    }
    return Table(values, numbers)


def _columns(header: Sequence[str]) -> tuple[list[str], list[float], tuple[str, ...], list[int]]:
    """Columns without their units; what a unit is in metres or seconds; names of the capsules; which columns count."""
    keep = [k for k, column in enumerate(header) if column.casefold() not in INDEX]
    columns, factors = [], []
    for k in keep:
        column, factor = _without_unit(header[k])
        columns.append("time" if column.casefold() == "time" else column)
        factors.append(factor)
    known = ((column, field) for column in columns for field in _FIELDS if column.endswith(f".{field}"))
    names = tuple(dict.fromkeys(column.removesuffix(f".{field}") for column, field in known))
    wanted = ["time", *(f"{name}.{field}" for name in names for field in _FIELDS)]
    if sorted(columns) != sorted(wanted) or not names:
        missing, unknown = (sorted(set(a) - set(b))[:4] for a, b in ((wanted, columns), (columns, wanted)))
        twice = sorted({column for column in columns if columns.count(column) > 1})[:4]
        raise RecordingError(
            "columns have to be time and <name>.start.x ... <name>.radius, each once; "
            f"missing: {missing or 'none'}, unknown: {unknown or 'none'}" + (f", twice: {twice}" if twice else "")
        )
    return columns, factors, names, keep


def _without_unit(column: str) -> tuple[str, float]:
    match = _UNIT.match(column)
    if match is None:
        return column, 1.0
    name, unit = match[1].strip(), match[2] or match[3]
    units = _SECONDS if name.casefold() == "time" else _METRES
    if not (name.casefold() == "time" or name.endswith(tuple(f".{field}" for field in _FIELDS))):
        return column, 1.0
    if unit not in units:
        raise RecordingError(f"column {column}: unknown unit {unit!r}; valid: {', '.join(units)}")
    return name, units[unit]


def _check_radius(radius: Array, rows: Sequence[int], names: Sequence[str]) -> None:
    other = np.argwhere(radius != radius[:1])
    if len(other):
        k, i = other[0]
        raise RecordingError(
            f"row {rows[k]}, column {names[i]}.radius: a radius has to be the same in every row, {radius[k, i]:g} m is "
            f"not {radius[0, i]:g} m"
        )
