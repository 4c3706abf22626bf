"""How work ends before its time: by Ctrl-C, heard only where nothing is half done, or by an error elsewhere."""

import pickle
import signal
import threading
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, Self

from jssa_gym.exceptions import WorkerError

GOES_ON = "what had ended by then is kept, and the same call goes on from there"
"""What whoever lost a worker may do."""


class Interrupts:
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


def portable(error: Exception) -> Exception:
    """An exception as another process can have it, with where it happened."""
    where = "".join(traceback.format_exception(error))
    try:
        error = pickle.loads(pickle.dumps(error))
    except Exception:  # some take more arguments than they keep
        error = WorkerError(f"{type(error).__name__}: {error}")
    error.add_note(f"in a worker process:\n{where}")
    return error
