"""Processes that are interrupted, and leave nobody behind."""

import os
import signal
import subprocess
import sys

from places import PATIENCE, environment


def start(*command, stdin=None):
    """A Python process of its own group."""
    return subprocess.Popen(
        [sys.executable, *command],
        env=environment() | {"PYTHONUNBUFFERED": "1"},
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # whoever runs the tests in the background may have it ignored, which children inherit
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def ended(process):
    """What it said; it and all that it started are gone."""
    try:
        # workers hold the pipes' other ends: they are closed when the last one is gone
        return process.communicate(timeout=PATIENCE)
    finally:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        else:
            process.communicate()


def interrupt(process, times):
    """Press Ctrl-C in a process's group."""
    for _ in range(times):
        os.killpg(process.pid, signal.SIGINT)
