"""A campaign's results on disk: appended as they come, continued after a crash."""

import csv
import hashlib
import io
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_type_hints

from jssa_gym.evaluation.campaign import Campaign, Cell
from jssa_gym.evaluation.episodes import Chunk, Episode
from jssa_gym.exceptions import ParameterError

_KINDS = get_type_hints(Episode)
_NAMES = [field.name for field in fields(Episode)]
_TELLING = (
    "cli",
    "plots",
    "viewer",
    "train",
    "evaluation/benchmark.py",
    "evaluation/claims.py",
    "evaluation/handover.py",
    "evaluation/index_claims.py",
    "evaluation/paper.py",
    "evaluation/reproduction.py",
    "evaluation/statistics.py",
    "evaluation/tally.py",
)
"""Parts of the package that only tell of episodes; all others decide how one goes or how it is judged."""


def source_hash() -> str:
    """Hash of all files that decide how an episode goes and how it is judged, models included."""
    package, text = Path(__file__).parents[1], hashlib.sha256()
    for file in sorted(package.rglob("*")):
        name = file.relative_to(package).as_posix()
        if file.suffix in (".py", ".xml", ".toml", ".npz") and not name.startswith(_TELLING):
            text.update(name.encode())
            text.update(file.read_bytes())
    return text.hexdigest()[:16]


class Ledger:
    """Configuration and episodes of a campaign in a folder.

    ``campaign.json`` says what is tried and with which code; ``episodes.csv`` grows by a whole chunk at a time.
    A folder that holds the same campaign is continued: a line that a crash cut off is dropped.

    Args:
        folder: It is made if there is none.
        campaign: What is tried.
        version: Of the package.

    Raises:
        ParameterError: The folder cannot be used, or holds another campaign or one of other code.
    """

    def __init__(self, folder: Path, campaign: Campaign, version: str) -> None:
        self.folder, self.campaign = folder, campaign
        self.table, self.traces = folder / "episodes.csv", folder / "traces"
        self.episodes: list[Episode] = []
        config = {**json.loads(json.dumps(asdict(campaign))), "version": version, "source": source_hash()}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._settle(config)
            self._read()
        except OSError as error:
            raise ParameterError(f"cannot use {folder}: {error.strerror}") from error

    def _settle(self, config: dict[str, Any]) -> None:
        path = self.folder / "campaign.json"
        if path.exists():
            try:
                known = json.loads(path.read_text())
                other = [name for name in config if known[name] != config[name]]
            except (ValueError, KeyError, TypeError) as error:
                raise ParameterError(f"{path} is no campaign's configuration") from error
            if other:
                raise ParameterError(
                    f"{self.folder} holds another campaign (other {', '.join(other)}); choose another folder"
                )
            return
        if self.table.exists():
            raise ParameterError(f"{self.table} belongs to no campaign; choose another folder")
        unfinished = path.with_suffix(".part")
        unfinished.write_text(json.dumps(config, indent=2) + "\n")
        unfinished.replace(path)

    def _read(self) -> None:
        if not self.table.exists():
            return
        content = self.table.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            # what a crash cut off is played again
            os.truncate(self.table, len(whole))
        rows = csv.reader(io.StringIO(whole.decode(), newline=""))
        if whole and next(rows) != _NAMES:
            raise ParameterError(f"{self.table} has other columns than this version writes")
        try:
            self.episodes = [_parse(row) for row in rows]
        except (ValueError, KeyError) as error:
            raise ParameterError(f"{self.table} holds a line that is no episode: {error}") from error

    def append(self, episodes: Sequence[Episode]) -> None:
        """Add episodes, in one piece."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        if not self.table.exists() or self.table.stat().st_size == 0:
            writer.writerow(_NAMES)
        for episode in episodes:
            writer.writerow([_written(getattr(episode, name)) for name in _NAMES])
        with self.table.open("ab") as file:
            file.write(text.getvalue().encode())
            file.flush()
            os.fsync(file.fileno())
        self.episodes += episodes

    def ordered(self) -> list[Episode]:
        """All episodes in the order of the campaign, whoever finished first."""
        place = {cell: k for k, cell in enumerate(self.campaign.seeds())}
        return sorted(self.episodes, key=lambda episode: (place[episode.cell], episode.seed))

    def keep_worst(self, count: int) -> None:
        """Delete all recordings but those of the worst episodes."""
        broken = sorted((e for e in self.episodes if e.broken and e.judged), key=lambda e: -e.severity)
        for episode in broken[count:]:
            (self.traces / episode.trace_name).unlink(missing_ok=True)

    def chunks(self, size: int) -> list[Chunk]:
        """What is left to play, at most ``size`` episodes of one cell together."""
        done: dict[Cell, set[int]] = {}
        for episode in self.episodes:
            done.setdefault(episode.cell, set()).add(episode.seed)
        chunks = []
        for cell, seeds in self.campaign.seeds().items():
            left = [seed for seed in seeds if seed not in done.get(cell, ())]
            for k in range(0, len(left), size):
                chunks.append(Chunk(self.campaign, cell, left[k : k + size], self.traces))
        return chunks


def _written(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else repr(value) if isinstance(value, float) else str(value)


def _parse(row: Sequence[str]) -> Episode:
    values = dict(zip(_NAMES, row, strict=True))
    return Episode(**{name: _KINDS[name](int(text) if _KINDS[name] is bool else text) for name, text in values.items()})
