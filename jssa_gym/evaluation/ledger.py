"""Results on disk: appended as they come, continued after a crash."""

import csv
import functools
import io
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, NamedTuple, get_args, get_type_hints

from jssa_gym.engine.source import package_version, source_hash
from jssa_gym.evaluation.plan import AnyRow, EpisodePlan
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import append_whole, read_text, refused, whole_lines, write_whole

CONFIG = "campaign.json"
"""File of a folder that says what is tried: the first that is there."""


class Chunk(NamedTuple, Generic[AnyRow]):
    """Episodes of one cell that are played together."""

    plan: EpisodePlan[AnyRow]
    cell: Any
    seeds: Sequence[int]
    traces: Path
    """Folder for recordings."""


def _differs(name: str, known: Any, asked: Any) -> str:
    """What is other, and by how much if that is short."""
    short = isinstance(known, int | float | str) and isinstance(asked, int | float | str)
    return f"{name}: {known} there, {asked} asked for" if short else name


class Results(Generic[AnyRow]):
    """Episodes of a plan as they come, and what is left to play.

    Args:
        plan: What is played.
    """

    def __init__(self, plan: EpisodePlan[AnyRow]) -> None:
        self.plan = plan
        self.episodes: list[AnyRow] = []
        self.traces = Path()
        """Folder for recordings."""

    def append(self, episodes: Sequence[AnyRow]) -> None:
        """Add episodes."""
        self.episodes += episodes

    def by_cell(self) -> dict[Any, list[AnyRow]]:
        """All episodes in the order of the plan, whoever finished first."""
        found: dict[Any, list[AnyRow]] = {cell: [] for cell in self.plan.seeds()}
        for episode in sorted(self.episodes, key=lambda episode: episode.seed):
            found[episode.cell].append(episode)
        return found

    def chunks(self, size: int | Callable[[Any], int]) -> list[Chunk[AnyRow]]:
        """What is left to play, at most so many episodes of one cell together; ``size`` may depend on the cell."""
        done = {(episode.cell, episode.seed) for episode in self.episodes}
        chunks = []
        for cell, seeds in self.plan.seeds().items():
            left = [seed for seed in seeds if (cell, seed) not in done]
            parts = -(-len(left) // (size if isinstance(size, int) else size(cell)))
            bounds = [k * len(left) // parts for k in range(parts + 1)] if parts else []
            chunks += [Chunk(self.plan, cell, left[a:b], self.traces) for a, b in pairwise(bounds)]
        return chunks


_OPTIONAL = ("people", "pair_policies", "robot", "sensor", "ticks", "normalise")
"""What a configuration says only where it is not as it was before there was a choice."""


class Ledger(Results[AnyRow]):
    """Configuration and episodes of a campaign in a folder.

    ``campaign.json`` says what is tried and with which code; ``episodes.csv`` grows by a whole chunk at a time.
    A folder that holds the same campaign is continued: a line that a crash cut off is dropped. One without any episode
    is anybody's. Two processes must not fill the same folder: whoever finds lines that it did not write stops.

    Args:
        folder: It is made if there is none.
        plan: What is tried.

    Raises:
        ParameterError: The folder cannot be used, or holds another campaign or one of other code.
    """

    def __init__(self, folder: Path, plan: EpisodePlan[AnyRow]) -> None:
        super().__init__(plan)
        self.folder, self.table, self.traces = folder, folder / "episodes.csv", folder / "traces"
        self._names = _columns(plan.row)
        self._size = 0
        config = {**json.loads(json.dumps(plan.config())), "version": package_version(), "source": source_hash()}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._settle(config)
            self._read()
        except OSError as error:
            raise ParameterError(f"cannot use {folder}: {error.strerror or error}") from error

    def _settle(self, config: dict[str, Any]) -> None:
        path = self.folder / CONFIG
        empty = not self.table.exists() or self.table.stat().st_size == 0
        if path.exists() and not empty:
            with refused(ParameterError, f"{path} is no campaign's configuration"):
                known = json.loads(read_text(path, ParameterError))
                known = dict.fromkeys(_OPTIONAL) | known
                wanted = dict.fromkeys(_OPTIONAL) | config
                other = [_differs(name, known[name], wanted[name]) for name in wanted if known[name] != wanted[name]]
            if other:
                raise ParameterError(
                    f"{self.folder} holds another campaign (other {'; '.join(other)}); choose another folder (--out)"
                )
            return
        if not (path.exists() or empty):
            raise ParameterError(f"{self.table} belongs to no campaign; choose another folder")
        write_whole(path, json.dumps(config, indent=2) + "\n")

    def _read(self) -> None:
        whole, cut = whole_lines(self.table, ParameterError)
        told = f"{self.table} holds a line that is no episode"
        if not (whole or ",".join(self._names).encode().startswith(cut)):
            raise ParameterError(f"{told}; choose another folder")
        if cut:  # by a crash; it is played again
            os.truncate(self.table, len(whole))
        self._size = len(whole)
        with refused(ParameterError, told):
            rows = csv.reader(io.StringIO(whole.decode(), newline=""))
            if whole and next(rows) != self._names:
                raise ParameterError(f"{self.table} has other columns than this version writes")
            self.episodes = [_parse(self.plan.row, iter(_fitting(row, self._names))) for row in rows]
        planned = {(cell, seed) for cell, seeds in self.plan.seeds().items() for seed in seeds}
        for episode in self.episodes:
            if (episode.cell, episode.seed) not in planned:
                raise ParameterError(
                    f"{self.table} holds an episode twice, or one that was not planned: {', '.join(episode.cell)}, "
                    f"seed {episode.seed}"
                )
            planned.remove((episode.cell, episode.seed))

    def append(self, episodes: Sequence[AnyRow]) -> None:
        """Add episodes, in one piece.

        Raises:
            ParameterError: Somebody else has written to the table.
            StorageError: It cannot be written; nothing was added.
        """
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        if self._size == 0:
            writer.writerow(self._names)
        for episode in episodes:
            writer.writerow(_written(episode))
        size = append_whole(self.table, text.getvalue().encode(), self._size)
        if size is None:
            raise ParameterError(f"another process writes to {self.table}; choose another folder")
        self._size = size
        super().append(episodes)

    def keep_worst(self, recorded: Sequence[AnyRow], count: int) -> None:
        """Delete all recordings but those of the worst of some episodes."""
        for episode in worst(recorded, len(recorded))[count:]:
            (self.traces / episode.trace_name).unlink(missing_ok=True)


def worst(episodes: Sequence[AnyRow], count: int) -> list[AnyRow]:
    """The worst episodes, the worst first."""
    return sorted(episodes, key=lambda episode: episode.severity, reverse=True)[:count]


_kinds = functools.cache(get_type_hints)


def _columns(row: type[Any]) -> list[str]:
    hints, names = _kinds(row), []
    for field in fields(row):
        kind = hints[field.name]
        names += _columns(kind) if is_dataclass(kind) else [field.name]
    return names


def _written(row: Any) -> list[Any]:
    cells: list[Any] = []
    for field in fields(row):
        value = getattr(row, field.name)
        # of numbers and None the table's writer makes what can be read again to the bit, but of yes and no
        cells += _written(value) if is_dataclass(value) else [int(value) if isinstance(value, bool) else value]
    return cells


def _fitting(cells: Sequence[str], names: Sequence[str]) -> Sequence[str]:
    if len(cells) != len(names):
        raise ValueError(f"{len(cells)} cells for {len(names)} columns")
    return cells


def _parse(row: type[Any], cells: Any) -> Any:
    hints, values = _kinds(row), {}
    for field in fields(row):
        kind = hints[field.name]
        if is_dataclass(kind):
            values[field.name] = _parse(kind, cells)
            continue
        text, kinds = next(cells), get_args(kind) or (kind,)
        if text == "" and type(None) in kinds:
            values[field.name] = None
        else:
            values[field.name] = kinds[0](int(text)) if kinds[0] is bool else kinds[0](text)
    return row(**values)
