"""Films and episodes of the page, in a folder."""

import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jssa_gym import plots
from jssa_gym.evaluation.identity import code_version
from jssa_gym.evaluation.trace import save_trace
from jssa_gym.robots import RobotModel
from jssa_gym.storage import file_name
from jssa_gym.types import Trace

Film = Callable[[Sequence[Trace], RobotModel], tuple[Iterable[NDArray[np.uint8]], int]]
"""Pictures of episodes of one length, side by side, and how many there are a second."""


class Shelf:
    """A folder, into which nothing is written twice under one name.

    Args:
        folder: Made when something is kept first.
        film: Makes a film's pictures.
    """

    def __init__(self, folder: Path, film: Film) -> None:
        self.folder, self._film = folder, film
        self._writing = threading.Lock()  # from a free name to the file that takes it

    def episodes(self) -> tuple[str, ...]:
        """Names of the saved episodes, the newest first."""
        files = sorted(self.folder.glob("*.npz"), key=lambda path: path.stat().st_mtime, reverse=True)
        return tuple(path.name for path in files)

    def keep_film(self, traces: Sequence[Trace], robot: RobotModel) -> list[Path]:
        """Write a film of episodes of one length, side by side.

        Raises:
            MissingExtraError: PyAV is not installed.
            DisplayError: There is no OpenGL.
            StorageError: The file cannot be written.
        """
        pictures, rate = self._film(traces, robot)
        with self._writing:
            path = self._free("film", "mp4")
            plots.write_film(path, iter(pictures), rate=rate)
        return [path]

    def keep_episodes(self, traces: Sequence[Trace], robot: RobotModel) -> list[Path]:
        """Write episodes, a file each, as `jssa-gym replay` reads them.

        Raises:
            StorageError: A file cannot be written.
        """
        paths = []
        for trace in traces:
            with self._writing:
                path = self._free(f"episode-{file_name(trace.name)}", "npz")
                save_trace(trace, path, {"filter": trace.name, "human": "of a live page", **code_version()})
            paths.append(path)
        return paths

    def _free(self, name: str, ending: str) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        numbers = range(1, 100_000)
        return next(path for k in numbers if not (path := self.folder / f"{name}-{k:03d}.{ending}").exists())
