"""Work in as many processes as wanted."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Any, TypeVar

from jssa_gym.exceptions import WorkerError

Work = TypeVar("Work")
Result = TypeVar("Result")


def _worker() -> None:
    # the parent alone answers Ctrl-C: what a worker has begun, it ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Nobody else ends a worker whose parent was killed: it would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def run(play: Callable[[Work], Result], chunks: Iterable[Work], jobs: int, done: Callable[[Result], Any]) -> None:
    """Play chunks, in other processes if there is more than one job.

    Args:
        play: Plays one; with several jobs it and the chunks have to be picklable, since processes are spawned.
        chunks: What to play.
        jobs: How many processes.
        done: Called with every chunk's result as it ends, in this process.

    Raises:
        WorkerError: A process was killed, by the system or by somebody.
    """
    if jobs == 1:
        for chunk in chunks:
            done(play(chunk))
        return
    # workers inherit it: threads of theirs would only fight each other
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _worker) as pool:
        waiting: set[Future[Result]] = set()
        try:
            todo = iter(chunks)
            while True:
                # few at a time, so that an interrupt need not undo a long queue
                while len(waiting) < 2 * jobs and (chunk := next(todo, None)) is not None:
                    waiting.add(pool.submit(play, chunk))
                if not waiting:
                    return
                ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in ended:
                    done(future.result())
        except BrokenProcessPool as error:
            raise WorkerError(
                "a worker process was killed, most likely for want of memory; what had ended by then is kept, and the "
                "same call goes on from there; use fewer jobs"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
