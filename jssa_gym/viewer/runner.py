"""Keeps a session at the pace of the clock, in a thread of its own; takes commands and shows what is."""

import contextlib
import logging
import queue
import threading
import time
from collections import deque
from typing import NamedTuple

import numpy as np

from jssa_gym.envs.arm import DT
from jssa_gym.exceptions import JSSAGymError
from jssa_gym.viewer.session import Command, Session
from jssa_gym.viewer.snapshot import Snapshot

_logger = logging.getLogger("jssa_gym")

SHOWN = 0.03
"""A snapshot at least this often [s]; the page is sent about 30 a second."""

_BEHIND = 0.25
"""What is later than this is not caught up with [s]: the simulation is then slower than the clock, and says so."""

_QUEUE = 1000
"""More commands than this do not wait: a page that floods loses its own."""


class Punctuality(NamedTuple):
    """How well control steps came on time, over the last ones."""

    steps: int
    rate: float
    """Simulated time over the clock's, as a share of what was asked for."""
    late_median: float
    """How much later than due a step began [s]."""
    late_p99: float
    """[s]."""
    late_most: float
    """[s]."""
    busy: float
    """Share of the time that steps took."""


class Runner:
    """Steps a session at the pace of the clock.

    Args:
        session: Touched by this runner's thread only, from :meth:`start` to :meth:`close`.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._commands: queue.Queue[Command] = queue.Queue(_QUEUE)
        self._over = threading.Event()
        self._late: deque[tuple[float, float, float]] = deque(maxlen=1250)
        self._counting, self._asked, self._answered = threading.Lock(), 0, 0
        self._message = ""
        self.snapshot: Snapshot = session.snapshot()
        """The last one; replaced as a whole."""
        self.failure: Exception | None = None
        """What ended the thread, if not :meth:`close`."""
        self._thread = threading.Thread(target=self._run, name="jssa-gym session", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def submit(self, command: Command) -> int:
        """Have the session do something before its next step; returns at once.

        Returns:
            How many commands there were until now; what is asked while too many wait is forgotten. A snapshot whose
            ``answered`` is as large shows what became of it.
        """
        with self._counting, contextlib.suppress(queue.Full):
            self._commands.put_nowait(command)
            self._asked += 1
        return self._asked

    def close(self) -> None:
        """End the thread, and free what the session holds."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)
        self._session.close()

    def punctuality(self) -> Punctuality:
        """How well the last ten seconds' steps came on time."""
        late = np.array(list(self._late), np.float64).reshape(-1, 3)
        if len(late) < 2:
            return Punctuality(len(late), 1.0, 0.0, 0.0, 0.0, 0.0)
        began, delay, took = late.T
        clock = began[-1] - began[0]
        asked = DT / self._session.factor
        return Punctuality(
            len(late),
            float((len(late) - 1) * asked / clock) if clock > 0.0 else 1.0,
            float(np.median(delay)),
            float(np.quantile(delay, 0.99)),
            float(delay.max()),
            float(took[:-1].sum() / clock) if clock > 0.0 else 0.0,
        )

    # ---- the thread ------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._keep_pace()
        except Exception as error:  # the page has to say so: nobody waits for this thread
            _logger.exception("the session ended")
            self.failure = error
            self._message = f"the session ended: {error}"
            self.snapshot = self.snapshot._replace(message=self._message, paused=True)

    def _keep_pace(self) -> None:
        due = shown = time.perf_counter()
        while not self._over.is_set():
            if self._obey():
                due = max(due, time.perf_counter())
                shown = 0.0
            now = time.perf_counter()
            if self._session.paused:
                due = now + DT
            elif now >= due:
                self._step()
                self._late.append((now, now - due, time.perf_counter() - now))
                due += DT / self._session.factor
                if now - due > _BEHIND:
                    due = now
            now = time.perf_counter()
            if now - shown >= SHOWN:
                self.snapshot = self._session.snapshot(self._answered, self._message)
                shown = now
            self._over.wait(max(0.0, min(due, shown + SHOWN) - time.perf_counter()))

    def _step(self) -> None:
        """A control step; one that cannot be, such as the first of an episode without a goal, is told."""
        try:
            self._session.step()
        except JSSAGymError as error:
            self._session.paused, self._message = True, str(error)

    def _obey(self) -> bool:
        """Do what was asked for; whether there was anything."""
        done = False
        while True:
            try:
                command = self._commands.get_nowait()
            except queue.Empty:
                return done
            done = True
            try:
                command(self._session)
                self._message = ""
            except JSSAGymError as error:
                self._message = str(error)
            self._answered += 1
