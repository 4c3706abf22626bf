"""Checkpoints: complete and unchanged, or not used.

A folder is written under another name and renamed, its files by ``storage/files.py``: atomic as a whole.
"""

import contextlib
import json
import os
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from jssa_gym.exceptions import CheckpointError
from jssa_gym.storage import open_whole, read_text, refused, sha256, whole_file, write_json

MANIFEST = "manifest.json"

LARGEST, LARGEST_MANIFEST = 512 * 2**20, 2**24
"""Most bytes of a checkpoint's file, and of its manifest."""

KEEP = 3
"""Checkpoints that are kept."""

_VERSION = 1

_NAME = re.compile(r"[0-9]{12}")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A checkpoint whose files are those that were written."""

    folder: Path
    steps: int
    """Policy steps when it was written."""
    data: Mapping[str, Any]
    """What the manifest has besides, as it was given to :func:`write_checkpoint`."""
    files: frozenset[str]
    """Names of its files."""

    def file(self, name: str) -> Path:
        """One of its files.

        Raises:
            CheckpointError: It has none of that name: nobody has checked what may lie there.
        """
        if name not in self.files:
            raise CheckpointError(f"{self.folder} has no {name}; it has {', '.join(sorted(self.files)) or 'nothing'}")
        return self.folder / name


def write_checkpoint(
    folder: Path, steps: int, data: Mapping[str, Any], writers: Mapping[str, Callable[[IO[bytes]], Any]]
) -> Checkpoint:
    """Write a checkpoint so that a crash at any moment leaves it complete or not there, and drop the oldest ones.

    All files go to a temporary folder and to the disk, the manifest with their SHA-256 last; then it is renamed.

    Args:
        folder: Where checkpoints are kept.
        steps: Policy steps so far; also the checkpoint's name.
        data: What else belongs to it, as JSON can hold it.
        writers: By name, what fills a file.

    Raises:
        CheckpointError: The disk is full, or a file is larger than may be read again.
    """
    target = folder / f"{steps:012d}"
    unfinished = folder / f"{target.name}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for left in folder.glob("*.part"):  # by a crash
            shutil.rmtree(left, ignore_errors=True)
        unfinished.mkdir()  # nobody's but this process's, or an error
        sums: dict[str, str] = {}
        for name, write in writers.items():
            with whole_file(unfinished / name) as file:
                write(file)
                if (size := file.seek(0, os.SEEK_END)) > LARGEST:
                    raise CheckpointError(f"{name} has {size:,} bytes, more than {LARGEST:,}")
                sums[name] = sha256(file)
        body = {"version": _VERSION, "steps": steps, "files": sums, "data": dict(data)}
        write_json(unfinished / MANIFEST, {**body, "sha256": digest_of(body)})
        _to_disk(unfinished)
        shutil.rmtree(target, ignore_errors=True)  # of the same steps: a bad one that is written anew
        unfinished.replace(target)
        _to_disk(folder)
    except OSError as error:
        raise CheckpointError(f"cannot write the checkpoint {target}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    # newer ones were refused, else the training would have gone on from there: they must not displace good ones
    for old in [one for one in _all(folder) if one.name <= target.name][KEEP:]:
        shutil.rmtree(old, ignore_errors=True)
    return Checkpoint(target, steps, dict(data), frozenset(sums))


def read_checkpoint(folder: Path) -> Checkpoint:
    """A checkpoint, after every byte of it was checked against its manifest.

    Raises:
        CheckpointError: Something is missing, truncated or changed; the message says what.
    """
    path = folder / MANIFEST
    with refused(CheckpointError, f"{path} is no manifest"):
        body = json.loads(read_text(path, CheckpointError, LARGEST_MANIFEST))
        checksum = body.pop("sha256")
        if body["version"] != _VERSION:
            raise CheckpointError(f"{path} is of version {body['version']!r}, this code reads {_VERSION}")
        if checksum != digest_of(body):
            raise CheckpointError(f"{path} was changed: its own checksum differs")
        for name, expected in body["files"].items():
            if (folder / name).parent != folder or name in ("", ".", ".."):
                raise CheckpointError(f"{path} names a file outside its folder: {name!r}")
            with open_whole(folder / name, CheckpointError, LARGEST) as file:
                if sha256(file) != expected:
                    raise CheckpointError(
                        f"{folder / name} was changed or truncated: its SHA-256 differs from the manifest's"
                    )
        if folder.name != f"{body['steps']:012d}":
            raise CheckpointError(f"{path} is of {body['steps']} policy steps, its folder's name says otherwise")
        if not isinstance(body["data"], dict):
            raise CheckpointError(f"{path} is no manifest: its data are no mapping")
        return Checkpoint(folder, int(body["steps"]), body["data"], frozenset(body["files"]))


def latest_checkpoint(folder: Path) -> tuple[Checkpoint | None, list[CheckpointError]]:
    """The newest good checkpoint, and what is wrong with the newer ones.

    Raises:
        CheckpointError: There are checkpoints and not one of them is good: going on would begin anew.
    """
    refused: list[CheckpointError] = []
    for one in _all(folder):
        try:
            return read_checkpoint(one), refused
        except CheckpointError as error:
            refused.append(error)
    if refused:
        raise CheckpointError(
            f"none of the checkpoints in {folder} can be used; delete it to begin anew. The newest: {refused[0]}"
        )
    return None, refused


def _all(folder: Path) -> list[Path]:
    """Folders of checkpoints, the newest first; what a crash left unfinished is none."""
    try:
        return sorted((path for path in folder.iterdir() if _NAME.fullmatch(path.name)), reverse=True)
    except FileNotFoundError:
        return []
    except OSError as error:
        raise CheckpointError(f"cannot read {folder}: {error.strerror}") from error


def digest_of(body: Mapping[str, Any]) -> str:
    """A manifest's own checksum, of all the rest of it."""
    return sha256(json.dumps(body, sort_keys=True).encode())


def _to_disk(path: Path) -> None:
    """Have the system write a folder's entries before anything later."""
    handle = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # not every file system can do it for folders
            os.fsync(handle)
    finally:
        os.close(handle)
