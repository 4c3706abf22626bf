"""People from files, wherever a name will do: ``.npz`` and ``.csv`` are recordings, ``.bvh`` is motion capture."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jssa_gym.exceptions import ParameterError, RecordingError
from jssa_gym.humans.bvh import CaptureOptions, Conversion, convert_told
from jssa_gym.humans.recording import Recording, load_placed
from jssa_gym.humans.survey import Oddity, Source, survey

SUFFIXES = (".npz", ".csv", ".bvh")
"""Endings of files of people, in any case."""


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """What a file holds, and what it took to read it."""

    recording: Recording
    source: Source
    """Where the samples stand in the file."""
    conversion: Conversion | None = None
    """What was made of motion capture."""

    def findings(self) -> list[Oddity]:
        """All that is not as in people."""
        return survey(self.recording, self.source)

    def surprises(self) -> list[str]:
        """What whoever takes the file should know: what had to be guessed and is not the usual, what was found."""
        guessed = [self.conversion.said] if self.conversion is not None and self.conversion.unusual else []
        return [*guessed, *map(str, self.findings())]


def is_file(human: Any) -> bool:
    """Whether somebody is given as a file: a path, or a string that ends in one of :data:`SUFFIXES`."""
    return isinstance(human, os.PathLike) or (isinstance(human, str) and human.casefold().endswith(SUFFIXES))


def load(path: str | os.PathLike[str], options: CaptureOptions | None = None) -> Person:
    """Read somebody from a file.

    Args:
        path: Of the file.
        options: Of motion capture; None for the defaults of :func:`jssa_gym.humans.bvh.convert`.

    Raises:
        RecordingError: There is no such file, or it is not sound.
        ParameterError: Frames are asked for that are not there, or ``options`` are given for what is no motion capture.
    """
    if not isinstance(path, str | os.PathLike) or Path(path).suffix.casefold() not in SUFFIXES:
        raise RecordingError(f"people are read from files {', '.join(SUFFIXES)}, got {str(path)!r}")
    path = Path(path)
    if path.suffix.casefold() != ".bvh":
        if options is not None:
            raise ParameterError(
                f"scale, up, joints, start, frames and body are for motion capture, .bvh; got {path.name}"
            )
        recording, source = load_placed(path)
        return Person(recording, source)
    if not path.is_file():
        raise RecordingError(f"no recording at {path}")
    try:
        made = convert_told(path, CaptureOptions() if options is None else options)
    except RecordingError as error:
        said = str(error)
        raise RecordingError(said if said.startswith(path.name) else f"{path.name}: {said}") from error.__cause__
    return Person(made.recording, Source(noun="frame", first=made.first), made)
