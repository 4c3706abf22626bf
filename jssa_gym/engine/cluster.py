"""Work on a Ray cluster: the same chunks with the same results, wherever they are played and whoever dies meanwhile."""

import functools
import os
import pickle
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from jssa_gym.engine.interrupts import GOES_ON, portable
from jssa_gym.engine.source import source_hash
from jssa_gym.exceptions import MissingExtraError, ParameterError, WorkerError, how_to_install
from jssa_gym.text import show_messages
from jssa_gym.validation import positive_integer

Work = TypeVar("Work")
Result = TypeVar("Result")
Play = Callable[[Work], Iterable[Result]]
"""Plays a chunk, result by result."""

AGAIN = 3
"""How often a chunk is begun anew whose worker died."""

_STARTS = 4
"""How often a cluster of this machine is begun: Ray gives up after 30 s, which a busy machine may need for it."""

_begun: "list[Cluster]" = []
"""The clusters that this process was with, the present one last; one that a user began is none of them."""

_LISTEN = 0.2
"""How long Ctrl-C may go unheard [s]."""


@dataclass(frozen=True, slots=True)
class Cluster:
    """A Ray cluster that does the work: one that runs somewhere, or one of this machine's processes.

    A chunk whose worker or machine dies is played again elsewhere. Results come to this process, which alone writes
    them; recordings of broken promises are written where they happen, so that several machines need a folder that all
    of them see. Every machine needs the same version of this package: another one is refused.

    Args:
        jobs: How many processes, on this machine; of a running cluster all processors count.
        address: Of a running cluster, ``"auto"`` for the one that this machine belongs to; None to start one here,
            which ends with this process.

    Raises:
        ParameterError: ``jobs`` is no positive integer, or ``address`` no text.
    """

    jobs: int = 1
    address: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "jobs", positive_integer("jobs", self.jobs))
        if self.address is not None and not (isinstance(self.address, str) and self.address):
            raise ParameterError(f'address has to be like "auto" or "ray://host:10001", got {self.address!r}')

    def play(
        self,
        play: Play[Work, Result],
        chunks: Iterable[Work],
        answered: Callable[[], AbstractContextManager[Any]] = nullcontext,
    ) -> Generator[list[Result]]:
        """Play chunks; the results of each as it ends.

        Args:
            play: Plays one, result by result; it and the chunks have to be picklable.
            chunks: What to play.
            answered: Around all waiting, where Ctrl-C ends it.

        Raises:
            MissingExtraError: Ray is not installed.
            WorkerError: There is no such cluster, a chunk's workers died again and again, or a machine has another
                version of this package. What a chunk raised comes after what it had finished.
        """
        ray = self._connected()
        todo, under_way = deque(chunks), []
        task = ray.remote(num_cpus=1, max_retries=AGAIN)(_played)
        setting = ray.put((tuple(sys.path), str(Path.cwd()), source_hash()))
        given = ray.put(pickle.dumps(play))
        try:
            while todo or under_way:
                # a few wait, so that nobody waits for us; machines come and go
                places = 2 * max(int(ray.cluster_resources().get("CPU", 1)), 1)
                while todo and len(under_way) < places:
                    under_way.append(task.remote(setting, given, pickle.dumps(todo.popleft())))
                with answered():
                    ended, under_way = ray.wait(under_way, timeout=_LISTEN)
                for one in ended:
                    try:
                        results, error = ray.get(one)
                    except ray.exceptions.RayError as lost:
                        told = str(lost).strip().splitlines()
                        raise WorkerError(
                            f"work on the Ray cluster was lost ({told[-1] if told else type(lost).__name__}); {GOES_ON}"
                        ) from lost
                    yield results
                    if error is not None:
                        raise error
        finally:
            for one in under_way:
                ray.cancel(one, force=True)

    def _connected(self) -> Any:
        """Ray, which from now on runs until this process ends."""
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it would tell its makers
        try:
            import ray
        except ImportError as error:
            raise MissingExtraError(f"Ray is not installed: {how_to_install('ray')}") from error
        if not ray.is_initialized():
            here: dict[str, Any] = {"num_cpus": self.jobs, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
            where: dict[str, Any] = {"address": "local", **here} if self.address is None else {"address": self.address}
            for left in reversed(range(_STARTS)):
                try:
                    ray.init(**where, configure_logging=False, log_to_driver=False)
                    break
                except Exception as error:  # of many kinds, by what is wrong with the cluster
                    ray.shutdown()
                    if left == 0 or "timed out during startup" not in str(error):
                        raise WorkerError(f"no Ray cluster at {self.address or 'this machine'}: {error}") from error
            _begun.append(self)
        elif _begun and _begun[-1] != self:
            raise WorkerError(
                f"this process is with {_begun[-1]} already, and cannot be with {self}: ray.shutdown() first"
            )
        return ray


def whose(jobs: Any) -> int | Cluster:
    """Who is to work: a cluster, or so many processes or threads.

    Raises:
        ParameterError: It is neither.
    """
    return jobs if isinstance(jobs, Cluster) else positive_integer("jobs", jobs)


def _played(setting: tuple[tuple[str, ...], str, str], play: bytes, chunk: bytes) -> tuple[list[Any], Exception | None]:
    """A chunk's results, and what went wrong after them; in a worker."""
    path, folder, version = setting
    results: list[Any] = []
    try:
        _settle(path, folder, version)
        for result in pickle.loads(play)(pickle.loads(chunk)):
            results.append(result)  # counts, however the next one ends
    except Exception as error:  # whatever goes wrong is the caller's to raise
        return results, portable(error)
    return results, None


_version = functools.cache(source_hash)


def _settle(path: tuple[str, ...], folder: str, version: str) -> None:
    """Be where the caller is, as far as this machine has that."""
    if (here := _version()) != version:
        raise WorkerError(
            f"a machine of the Ray cluster has another version of jssa_gym (source {here}, not {version}): install the "
            "same one"
        )
    show_messages()
    os.environ.setdefault("JSSA_GYM_SECOND_COMPILER", "0")  # there are as many workers as cores
    sys.path += [place for place in path if place not in sys.path]
    if Path(folder).is_dir():
        os.chdir(folder)
