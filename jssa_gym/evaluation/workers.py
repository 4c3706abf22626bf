"""Work in as many processes as wanted; what is finished is handed over, however the rest ends."""

import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any, Self, TypeVar

from jssa_gym.exceptions import WorkerError
from jssa_gym.text import show_messages

Work = TypeVar("Work")
Result = TypeVar("Result")
Play = Callable[[Work], Iterable[Result]]
"""Plays a chunk, result by result."""

_READY, _RESULT, _END, _ERROR = "ready", "result", "end", "error"
"""What a worker says: that it waits for a chunk, a result of it, that it was the last one, what went wrong."""

_GOES_ON = "what had ended by then is kept, and the same call goes on from there"

UNABLE = (
    "a worker process ended before it began; what it says is above. It imports the script that is run, whose calls "
    'have to stand under `if __name__ == "__main__":`, and cannot import what was read from standard input'
)
"""Why a process that was to be spawned ends at once."""

_KNOWN = "functions and classes of a script or notebook belong into a module that can be imported; or use jobs=1"

_LAST_BREATH = 2.0
"""How long a worker without work may take to end [s]."""


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
            _tell(link, _ERROR, _portable(error))
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


def _portable(error: Exception) -> Exception:
    """An exception as another process can have it, with where it happened."""
    where = "".join(traceback.format_exception(error))
    try:
        error = pickle.loads(pickle.dumps(error))
    except Exception:  # some take more arguments than they keep
        error = WorkerError(f"{type(error).__name__}: {error}")
    error.add_note(f"in a worker process:\n{where}")
    return error


# ---- in the parent -------------------------------------------------------------------------------------


class _Interrupts:
    """Ctrl-C while work is done: answered where that plays or waits, and nowhere else, least of all while it ends."""

    def __init__(self) -> None:
        self._before: Any = signal.getsignal(signal.SIGINT)
        # only the main thread is told, and may say who is
        self._ours = callable(self._before) and threading.current_thread() is threading.main_thread()
        self._answering, self._pressed = False, False

    def __enter__(self) -> Self:
        if self._ours:
            signal.signal(signal.SIGINT, self._pressed_now)
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self._ours:
            signal.signal(signal.SIGINT, self._before)
            if self._pressed and kind is None:
                self._before(signal.SIGINT, None)

    def _pressed_now(self, *told: Any) -> None:
        if self._answering:  # whoever swallows it is asked again: nothing is remembered
            self._before(*told)
        else:
            self._pressed = True

    @contextmanager
    def answered(self) -> Generator[None]:
        """Nothing is half written meanwhile: it may end here, at once if it was pressed before."""
        self._answering = True
        try:
            if self._pressed:
                self._pressed = False
                self._before(signal.SIGINT, None)
            yield
        finally:
            self._answering = False

    @contextmanager
    def unheard(self) -> Generator[None]:
        """Processes that start meanwhile never hear of it."""
        if self._ours:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            yield
        finally:
            self.__enter__()


class _Worker:
    """A process of its own, with what it has said of the chunk at hand."""

    def __init__(self, play: Play[Any, Any], interrupts: _Interrupts) -> None:
        context = multiprocessing.get_context("spawn")
        self.link, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(play, theirs))
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
        self._begun = True
        return kind != _RESULT

    def give(self, chunk: Any) -> None:
        try:
            self.link.send(chunk)
        except OSError:
            raise self._gone() from None

    def taken(self) -> list[Any]:
        """All that it has finished and nobody took yet."""
        results, self.results = self.results, []
        return results

    def _gone(self) -> WorkerError:
        self.process.join(_LAST_BREATH)
        code = self.process.exitcode
        if code is not None and code >= 0:
            return WorkerError(
                f"a worker process ended by itself; {_GOES_ON}" if self._begun else f"{UNABLE}; or use jobs=1"
            )
        return WorkerError(f"a worker process was killed, most likely for want of memory; {_GOES_ON}; use fewer jobs")

    def drain(self) -> None:
        """Take in what it had sent before it ended."""
        with suppress(Exception):  # an error of its own comes too late, and so does half a message
            while not self._torn and self.link.poll():
                self.hear()
        self.link.close()


def _end(workers: Sequence[_Worker], patience: float) -> None:
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


def run(play: Play[Work, Result], chunks: Iterable[Work], jobs: int, done: Callable[[list[Result]], Any]) -> None:
    """Play chunks, in other processes if there is more than one job.

    Ctrl-C, or an error, ends it within moments: chunks under way are given up, and ``done`` gets what was finished of
    them.

    Args:
        play: Plays one, result by result; with several jobs it and the chunks have to be picklable, since processes are
            spawned.
        chunks: What to play.
        jobs: How many processes.
        done: Called with every chunk's results as it ends, in this process; Ctrl-C waits for it.

    Raises:
        WorkerError: A process was killed, by the system or by somebody, or could not begin.
    """

    def hand_over(results: list[Result]) -> None:
        if results:
            done(results)

    with _Interrupts() as interrupts:
        if jobs == 1:
            for chunk in chunks:
                results: list[Result] = []
                try:
                    with interrupts.answered():
                        for result in play(chunk):
                            results.append(result)  # counts, however the next one ends
                finally:
                    hand_over(results)
        else:
            _share_out(play, deque(chunks), jobs, hand_over, interrupts)


def _share_out(
    play: Play[Work, Result],
    todo: deque[Work],
    jobs: int,
    hand_over: Callable[[list[Result]], None],
    interrupts: _Interrupts,
) -> None:
    # workers inherit it: threads of theirs would only fight each other
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    workers, patience = list[_Worker](), 0.0
    try:
        for _ in range(min(jobs, len(todo))):
            workers.append(_Worker(play, interrupts))
        busy: dict[Any, _Worker] = {worker.link: worker for worker in workers}
        while busy:
            with interrupts.answered():
                links = connection.wait(list(busy))
            for link in links:
                with interrupts.answered():
                    waits = (worker := busy[link]).hear()
                if not waits:
                    continue
                results = worker.taken()
                try:
                    if todo:
                        worker.give(todo.popleft())
                    else:
                        del busy[link]
                finally:
                    hand_over(results)
        patience = _LAST_BREATH
    finally:
        _end(workers, patience)
        for worker in workers:
            hand_over(worker.taken())
