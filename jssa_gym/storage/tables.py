"""Tables as others write them: text with a header and a row a sample, read by one set of rules.

Values are set apart by commas, semicolons or tabs, as most of the header is, or as a first line ``sep=;`` says; where
they are not set apart by commas, a comma may stand for the decimal point. Empty lines and lines that begin with ``#``,
``%`` or ``//`` are left out.
"""

import csv
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jssa_gym.exceptions import JSSAGymError

Array = NDArray[np.float64]

INDEX = ("", "index", "#", "frame", "sample", "row", "unnamed: 0")
"""Names, without case, of columns that number the rows or are empty."""

_COMMENTS = ("#", "%", "//")


def table_lines(text: str, failure: type[JSSAGymError]) -> tuple[list[str], list[tuple[int, list[str]]], bool]:
    """The header, the rows with the numbers of their lines, and whether a comma may be a decimal point."""
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), 1)
        if line.strip() and not line.lstrip().startswith(_COMMENTS)
    ]
    delimiter = None
    if lines and (told := re.fullmatch(r"\"?sep=(.)\"?", lines[0][1].strip() or "", re.IGNORECASE)):
        delimiter, lines = told[1], lines[1:]
    elif lines and lines[0][1].strip().casefold() == "sep=":  # of a tab, which was stripped
        delimiter, lines = "\t", lines[1:]
    if delimiter is None:
        delimiter = max(",;\t", key=lines[0][1].count) if lines else ","
    found = []
    for number, line in lines:
        try:
            cells = next(csv.reader([line], delimiter=delimiter))
        except csv.Error as error:
            raise failure(f"row {number} cannot be read: {error}") from error
        if any(cell.strip() for cell in cells):
            found.append((number, cells))
    header = [column.strip() for column in found[0][1]] if found else []
    return header, found[1:], delimiter != ","


def check_lengths(header: Sequence[str], rows: Sequence[tuple[int, list[str]]], failure: type[JSSAGymError]) -> None:
    """Refuse rows with more or fewer values than there are columns.

    Raises:
        JSSAGymError: ``failure``, which names the row.
    """
    for number, cells in rows:
        if len(cells) != len(header):
            raise failure(f"row {number} has {len(cells)} values for {len(header)} columns")


def as_numbers(
    cells: list[list[str]], rows: Sequence[int], columns: Sequence[str], comma: bool, failure: type[JSSAGymError]
) -> Array:
    """Numbers of a table's cells, shape (rows, columns).

    Args:
        cells: As they are written.
        rows: Line of each in the file.
        columns: Their names.
        comma: Whether a comma may be a decimal point.
        failure: What to raise.

    Raises:
        JSSAGymError: ``failure``: one is empty, no number or not finite; the message names row and column.
    """
    if comma:
        cells = [[_with_point(cell) for cell in row] for row in cells]
    try:
        table = np.array(cells, dtype=np.float64).reshape(len(cells), len(columns))
    except ValueError:
        table = np.array(
            [
                [_number(cell, number, name, failure) for cell, name in zip(row, columns, strict=True)]
                for number, row in zip(rows, cells, strict=True)
            ]
        )
    if not np.all(np.isfinite(table)):
        k, j = np.argwhere(~np.isfinite(table))[0]
        raise failure(f"row {rows[k]}, column {columns[j]}: numbers have to be finite, got {cells[k][j]!r}")
    return table


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if cell.count(",") == 1 and "." not in cell else cell


def _number(cell: str, row: int, column: str, failure: type[JSSAGymError]) -> float:
    try:
        return float(cell)
    except ValueError:
        said = "is empty" if not cell else f"holds {cell[:40]!r}, which is no number"
        raise failure(f"row {row}, column {column} {said}") from None


def check_times(time: Array, rows: Sequence[int], failure: type[JSSAGymError]) -> None:
    """Refuse stamps that do not increase.

    Raises:
        JSSAGymError: ``failure``, which names the row.
    """
    late = np.flatnonzero(~(np.diff(time) > 0.0))
    if len(late):
        k = int(late[0]) + 1
        doubled = time[k] == time[k - 1]
        raise failure(
            f"row {rows[k]}, column time: time has to increase, {time[k]:g} s {'stands' if doubled else 'comes'} after "
            f"{time[k - 1]:g} s of row {rows[k - 1]}; {'leave one of the two out' if doubled else 'sort the rows'}"
        )
