"""Work in as many processes as wanted; what is finished is handed over, however the rest ends."""

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from jssa_gym.engine.cluster import AGAIN, Cluster, Play, Result, Work
from jssa_gym.engine.interrupts import GOES_ON, Interrupts, portable
from jssa_gym.exceptions import WorkerError
from jssa_gym.text import show_messages

_READY, _RESULT, _END, _ERROR = "ready", "result", "end", "error"
"""What a worker says: that it waits for a chunk, a result of it, that it was the last one, what went wrong."""

UNABLE = (
    "a worker process ended before it began; what it says is above. It imports the script that is run, whose calls "
    'have to stand under `if __name__ == "__main__":`, and cannot import what was read from standard input'
)
"""Why a process that was to be spawned ends at once."""

_KNOWN = "functions and classes of a script or notebook belong into a module that can be imported; or use jobs=1"

LAST_BREATH = 2.0
"""How long a worker without work may take to end [s]."""


class _DeathError(WorkerError):
    """A process that was at work ended; what it worked on can be begun anew by another."""


# ---- in a worker ---------------------------------------------------------------------------------------


def _work(play: Play[Any, Any], link: Connection) -> None:
    # the parent alone answers Ctrl-C
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    show_messages()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _tell(link, _READY)
    while True:
        try:
            chunk = link.recv()
        except (EOFError, OSError):  # there is no more to do
            return
        except Exception as error:  # what unpickling raises is up to what was sent
            _tell(
                link, _ERROR, WorkerError(f"what is to be played cannot be read in another process: {error}; {_KNOWN}")
            )
            continue
        try:
            for result in play(chunk):
                _tell(link, _RESULT, result)
        except Exception as error:  # whatever goes wrong is the parent's to raise
            _tell(link, _ERROR, portable(error))
        else:
            _tell(link, _END)


def _tell(link: Connection, kind: str, what: Any = None) -> None:
    try:
        link.send((kind, what))
    except OSError:  # nobody listens any more
        os._exit(1)


def _end_with_parent() -> None:
    """Nobody else ends a worker whose parent was killed: it would play on, or wait for work, for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


# ---- in the parent -------------------------------------------------------------------------------------


class _Task(NamedTuple):
    """A chunk, how many processes have died at it, and the most results that one of them had of it."""

    chunk: Any
    deaths: int = 0
    found: Sequence[Any] = ()


class Worker:
    """A process of its own, with what it has said of the task at hand; ``task`` is what it will be given first."""

    def __init__(self, play: Play[Any, Any], interrupts: Interrupts, task: _Task | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self.link, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(play, theirs))
        self.task = task
        self.results: list[Any] = []
        self._begun = False
        self._torn = False  # whether a part of a message may have been read
        try:
            with interrupts.unheard():  # nor must it answer with a page of its own while it begins
                self.process.start()
        except RuntimeError as error:  # this is a worker already, which imports its main module
            raise WorkerError(f"{UNABLE}; or use jobs=1") from error
        finally:
            theirs.close()

    def hear(self) -> bool:
        """Take in what it says; whether it waits for a chunk."""
        self._torn = True
        try:
            kind, said = self.link.recv()
        except (EOFError, OSError):
            raise self._gone() from None
        self._torn = False
        if kind == _ERROR:
            raise said
        if kind == _RESULT:
            self.results.append(said)
        if kind == _END:
            self.task = None
        self._begun = True
        return kind != _RESULT

    def give(self, task: _Task) -> None:
        self.task = task
        try:
            self.link.send(task.chunk)
        except OSError:
            raise self._gone() from None

    def taken(self) -> list[Any]:
        """All that it has finished and nobody took yet."""
        results, self.results = self.results, []
        return results

    def left(self) -> list[Any]:
        """What it leaves behind: all that it has finished of its task, or another before it, if that was more."""
        return max(self.taken(), [] if self.task is None else list(self.task.found), key=len)

    def _gone(self) -> WorkerError:
        self.process.join(LAST_BREATH)
        code = self.process.exitcode
        killed = code is None or code < 0
        if not (self._begun or killed):
            return WorkerError(f"{UNABLE}; or use jobs=1")
        how = "was killed, most likely for want of memory" if killed else "ended by itself"
        error = WorkerError if self.task is None else _DeathError  # one that had no work leaves none behind
        return error(f"a worker process {how}; {GOES_ON}{'; use fewer jobs' if killed else ''}")

    def drain(self) -> None:
        """Take in what it had sent before it ended."""
        with suppress(Exception):  # an error of its own comes too late, and so does half a message
            while not self._torn and self.link.poll():
                self.hear()
        self.link.close()


def end_all(workers: Sequence[Worker], patience: float) -> None:
    """End them, after some time to end by themselves, all together [s]."""
    if patience:
        for worker in workers:
            worker.link.close()  # there is no more to do
    until = time.monotonic() + patience
    for worker in workers:
        worker.process.join(max(until - time.monotonic(), 0.0))
    for worker in workers:
        worker.process.kill()
    for worker in workers:
        worker.process.join()
        worker.drain()


def run(
    play: Play[Work, Result], chunks: Iterable[Work], jobs: int | Cluster, done: Callable[[list[Result]], Any]
) -> None:
    """Play chunks, in other processes if there is more than one job, or on a cluster.

    A chunk whose process dies is begun anew in another. Ctrl-C, or an error, ends it within moments: chunks under way
    are given up, and ``done`` gets what was finished of them.

    Args:
        play: Plays one, result by result; with several jobs it and the chunks have to be picklable, since processes are
            spawned.
        chunks: What to play.
        jobs: How many processes, or the cluster.
        done: Called with every chunk's results as it ends, in this process; Ctrl-C waits for it.

    Raises:
        WorkerError: Processes with one chunk were killed again and again, by the system or by somebody, or could not
            begin.
    """

    def hand_over(results: list[Result]) -> None:
        if results:
            done(results)

    with Interrupts() as interrupts:
        if isinstance(jobs, Cluster):
            with closing(jobs.play(play, chunks, interrupts.answered)) as played:
                for finished in played:
                    hand_over(finished)
        elif jobs == 1:
            for chunk in chunks:
                results: list[Result] = []
                try:
                    with interrupts.answered():
                        for result in play(chunk):
                            results.append(result)  # counts, however the next one ends
                finally:
                    hand_over(results)
        else:
            _share_out(play, chunks, jobs, hand_over, interrupts)


def _share_out(
    play: Play[Work, Result],
    chunks: Iterable[Work],
    jobs: int,
    hand_over: Callable[[list[Result]], None],
    interrupts: Interrupts,
) -> None:
    # workers inherit it: threads of theirs would only fight each other
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    todo, workers, patience = deque(map(_Task, chunks)), list[Worker](), 0.0
    busy: dict[Any, Worker] = {}

    def begin(task: _Task | None = None) -> None:
        workers.append(worker := Worker(play, interrupts, task))
        busy[worker.link] = worker

    def replace(worker: Worker, death: _DeathError) -> None:
        assert worker.task is not None
        chunk, deaths, found = worker.task
        if deaths == AGAIN:
            raise death
        worker.process.kill()  # one that cannot be heard may still play
        begin(_Task(chunk, deaths + 1, max(worker.results, found, key=len)))
        worker.results, worker.task = [], None  # they are found again
        del busy[worker.link]

    try:
        for _ in range(min(jobs, len(todo))):
            begin()
        while busy:
            with interrupts.answered():
                links = connection.wait(list(busy))
            for link in links:
                worker, results = busy[link], list[Result]()
                try:
                    with interrupts.answered():
                        if not worker.hear():
                            continue
                    results = worker.taken()
                    task = worker.task or (todo.popleft() if todo else None)
                    if task is None:
                        del busy[link]
                    else:
                        worker.give(task)
                except _DeathError as death:
                    replace(worker, death)
                finally:
                    hand_over(results)
        patience = LAST_BREATH
    finally:
        end_all(workers, patience)
        for worker in workers:
            hand_over(worker.left())
