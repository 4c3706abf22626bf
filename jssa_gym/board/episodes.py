"""Episodes of a comparison, as its folders have them, and as one compressed table that holds what tables need."""

import csv
import io
import json
import lzma
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jssa_gym.evaluation.ledger import CONFIG
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import read_text, read_whole, refused, sha256, write_whole

STORED = Path(__file__).parent / "episodes.csv.xz"
"""The leaderboard of docs/leaderboard.md."""

BoardCell = tuple[str, str, str]
"""Task, people and policy."""

Episodes = dict[BoardCell, dict[str, dict[int, dict[str, float]]]]
"""By cell, filter and seed."""

MOTION = ("jerk_jumps_shield", "jerk_jumps_nominal", "status_switches", "jerk_rms")
"""Columns of how an arm moves."""

_NAMES = ("task", "filter", "human", "policy", "seed")
_PLURALS = {"tasks": "task", "humans": "human", "policies": "policy", "filters": "filter"}
"""In which order rows stand: what a comparison was asked for, and the column."""
_OUTCOMES = ("collision", "success", "moving_contact")
_NUMBERS = (
    *("limit_violation_rate", "contact_speed", "min_distance_arm", "intervention_rate", "ep_return", "path_length"),
    *(*MOTION, "time_to_goal"),
)
_DIGITS, _OF_DIGEST = 5, 8
"""Significant digits of the numbers that are stored; so many hexadecimal digits of an episode's digest."""

_YES_OR_NO = {"1": True, "True": True, "0": False, "False": False}
"""What else stands in a file is an error, not a no."""

_KIND = ("steps", "v_safe", "separation")
"""What all comparisons of a board have in common."""
_OTHERWISE = ("robot", "sensor")
"""What only comparisons that are not with the default have in their configuration."""

_LARGEST = 2**28
"""Size from which no table is unpacked [bytes]."""


def read_folders(folders: Sequence[Path]) -> Episodes:
    """The episodes of comparisons' folders, or of one folder's ``episodes.csv``, together.

    Raises:
        ParameterError: A folder holds no comparison, or a cell of another one.
        KeyError: What should be a yes or a no is neither.
    """
    found: Episodes = defaultdict(lambda: defaultdict(dict))
    for folder in folders:
        before = set(found)
        for row in _rows(folder):
            cell = (row["task"], row["human"], row["policy"])
            if cell in before:
                raise ParameterError(f"{folder} repeats the cell {', '.join(cell)}")
            found[cell][row["filter"]][int(row["seed"])] = _episode(row)
    return found


class Board(NamedTuple):
    """A stored leaderboard."""

    episodes: Episodes
    asked: list[dict[str, Any]]
    """What each of its comparisons was asked for."""
    digest: str
    """SHA-256 of the table as it is unpacked."""


def store_board(folders: Sequence[Path], path: Path) -> str:
    """Write the episodes of comparisons' folders as one compressed table; the same episodes, the same bytes.

    Numbers are rounded to five digits, an episode's digest to its first eight. Lines that begin with ``#`` hold what
    each folder was asked for, as JSON.

    Args:
        folders: Of finished comparisons.
        path: Of the table, which is replaced.

    Returns:
        SHA-256 of the table as it is unpacked.

    Raises:
        ParameterError: As of :func:`read_folders`; or their episodes are of different kinds.
    """
    read_folders(folders)
    asked = [_asked(folder) for folder in folders]
    for folder, one in zip(folders, asked, strict=True):
        if other := [name for name in _KIND if one[name] != asked[0][name]]:
            raise ParameterError(f"{folder} has other {', '.join(other)} than {folders[0]}")
    text = io.StringIO(newline="")
    text.writelines(f"# {json.dumps(one, sort_keys=True)}\n" for one in asked)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_NAMES, *_OUTCOMES, *_NUMBERS, "digest"))
    for folder, one in zip(folders, asked, strict=True):
        # whichever came first where several processes played
        order = {plural: {name: k for k, name in enumerate(one[plural])} for plural in _PLURALS}
        rows = list(_rows(folder))
        rows.sort(key=lambda row, by=order: (*(by[x][row[name]] for x, name in _PLURALS.items()), int(row["seed"])))
        for row in rows:
            outcomes = (str(int(_YES_OR_NO[row[name]])) for name in _OUTCOMES)
            numbers = (_short(row.get(name, "")) for name in _NUMBERS)
            names = (row[name] for name in _NAMES)
            writer.writerow((*names, *outcomes, *numbers, row.get("digest", "")[:_OF_DIGEST]))
    content = text.getvalue().encode()
    write_whole(path, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))
    return sha256(content)


def read_board(path: Path = STORED) -> Board:
    """The leaderboard in a table that :func:`store_board` wrote.

    Raises:
        ParameterError: There is none, or it is damaged.
    """
    if path == STORED and not path.exists():
        raise ParameterError("this installation has no stored leaderboard: give --board, a file of one")
    content = read_whole(path, ParameterError)
    with refused(ParameterError, f"{path} holds no leaderboard"):
        archive = lzma.LZMADecompressor()
        try:
            unpacked = archive.decompress(content, _LARGEST)
        except lzma.LZMAError as error:
            raise ParameterError(f"{path} holds no leaderboard: {error}") from error
        if not archive.eof:
            raise ValueError("it ends too early, or is too large")
        lines = unpacked.decode().splitlines()
        asked = [json.loads(line[1:]) for line in lines if line.startswith("#")]
        found: Episodes = defaultdict(lambda: defaultdict(dict))
        for row in csv.DictReader(line for line in lines if not line.startswith("#")):
            found[row["task"], row["human"], row["policy"]][row["filter"]][int(row["seed"])] = _episode(row)
    if not (found and asked):
        raise ParameterError(f"{path} holds no leaderboard: there are no episodes in it")
    return Board(found, asked, sha256(unpacked))


def _asked(folder: Path) -> dict[str, Any]:
    """What a comparison was asked for, if it is of a board's kind."""
    with refused(ParameterError, f"{folder / CONFIG} is no comparison's"):
        asked = json.loads(read_text(folder / CONFIG, ParameterError))
        if missing := [name for name in (*_PLURALS, *_KIND) if name not in asked]:
            raise ValueError(f"{', '.join(missing)}: not told")
    if other := [name for name in _OTHERWISE if name in asked]:
        raise ParameterError(f"{folder} is of another {' and '.join(other)} than a board's")
    return asked


def _rows(folder: Path) -> Iterable[dict[str, str]]:
    try:
        with (folder / "episodes.csv").open(newline="") as file:
            yield from csv.DictReader(file)
    except OSError as error:
        raise ParameterError(f"{folder} holds no comparison: {error}") from error


def _episode(row: Mapping[str, str]) -> dict[str, float]:
    """What the tables need of one; folders of older versions lack some of it."""
    contact, success, moving = (_YES_OR_NO[row[name]] for name in _OUTCOMES)
    return {
        "contact": contact,
        "moving contact": moving,
        "success": success,
        "success without contact": success and not contact,
        "limit violation": not float(row["limit_violation_rate"]) <= 0.0,
        "contact speed": float(row["contact_speed"]),
        **{name: float(row.get(name) or "nan") for name in (*MOTION, "time_to_goal")},
    }


def _short(cell: str) -> str:
    return f"{float(cell):.{_DIGITS}g}" if cell else ""
