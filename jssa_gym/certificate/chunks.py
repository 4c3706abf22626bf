"""Boundary states counted in chunks: by as many threads as wanted, kept on disk, continued after a crash."""

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jssa_gym.certificate.boundary import Boundary
from jssa_gym.certificate.census import Census
from jssa_gym.engine.cluster import Cluster
from jssa_gym.exceptions import ParameterError
from jssa_gym.kernels.jit import source_hash
from jssa_gym.storage import append_whole, refused, whole_lines, write_whole

Key = tuple[str, int, int]
"""Capsule, number of the chunk, and its states."""


def generator(seed: int, *key: int) -> np.random.Generator:
    """One of many that have nothing in common, by counters."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


class StateChunk(NamedTuple):
    """States that are drawn from one generator: who counts them, and when, makes no difference."""

    boundary: Boundary
    number: int
    states: int
    seed: int

    @property
    def key(self) -> Key:
        """What tells it from the others of a certificate."""
        return self.boundary.capsule, self.number, self.states

    def census(self) -> Census:
        """Draw and count.

        Raises:
            ParameterError: Hardly any state of the domain has an index of 0.
        """
        looks, draws = self.boundary.sample(self.states, generator(self.seed, 0, self.boundary.row, self.number))
        return Census.of(self.boundary, looks, draws)


Count = Callable[[StateChunk], Any]
"""What is made of a chunk; a function of a module, for other machines to find."""


def _counted(count: Count, chunk: StateChunk) -> Iterator[tuple[StateChunk, Any]]:
    yield chunk, count(chunk)


def run(
    chunks: Sequence[StateChunk], jobs: int | Cluster, count: Count = StateChunk.census
) -> Iterator[tuple[StateChunk, Any]]:
    """Chunks with their censuses, as they end.

    Args:
        chunks: What to count.
        jobs: How many threads, since kernel and generators let each other run; or the cluster.
        count: What is made of each.
    """
    if isinstance(jobs, Cluster):
        for counted in jobs.play(partial(_counted, count), chunks):
            yield from counted
        return
    if jobs == 1:
        yield from ((chunk, count(chunk)) for chunk in chunks)
        return
    with ThreadPoolExecutor(jobs) as pool:
        waiting: dict[Future[Any], StateChunk] = {}
        try:
            todo = iter(chunks)
            while True:
                # few at a time, so that an interrupt need not undo a long queue
                while len(waiting) < 2 * jobs and (chunk := next(todo, None)) is not None:
                    waiting[pool.submit(count, chunk)] = chunk
                if not waiting:
                    return
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(future), future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class ChunkFile:
    """Censuses in a file of a folder, one a line; the first says what they are about.

    Args:
        folder: It is made if there is none.
        setting: What the censuses depend on, as JSON can hold it.

    Raises:
        ParameterError: The folder cannot be used, or holds censuses of another setting or of other kernels.
    """

    def __init__(self, folder: Path, setting: dict[str, Any]) -> None:
        self.path = folder / "chunks.jsonl"
        first = json.loads(json.dumps({**setting, "kernels": source_hash()}))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ParameterError(f"cannot use {folder}: {error.strerror or error}") from error
        whole, cut = whole_lines(self.path, ParameterError)
        # a crash may have cut the first line off; anything else without an end of line is somebody else's
        if not whole and json.dumps(first).encode().startswith(cut):
            write_whole(self.path, json.dumps(first) + "\n")
            return
        with refused(ParameterError, f"{self.path} is no file of counts; choose another folder"):
            known = json.loads(whole.partition(b"\n")[0])
            other = [name for name in first if known.get(name) != first[name]]
        if other:
            raise ParameterError(
                f"{folder} holds another certificate (other {', '.join(other)}); choose another folder"
            )
        if cut:  # by a crash; it is counted again
            os.truncate(self.path, len(whole))

    def read(self) -> dict[Key, Census]:
        """All censuses that are there.

        Raises:
            ParameterError: A line is no census.
        """
        found: dict[Key, Census] = {}
        whole, _ = whole_lines(self.path, ParameterError)
        with refused(ParameterError, f"{self.path} holds a line that is no count"):
            for line in whole.splitlines()[1:]:
                (capsule, number, states), plain = json.loads(line)
                found[capsule, number, states] = Census.read(plain)
        return found

    def append(self, key: Key, census: Census) -> None:
        """Add one.

        Raises:
            StorageError: It cannot be written; nothing was added.
        """
        append_whole(self.path, (json.dumps([key, census.as_json()]) + "\n").encode())
