"""A second process that compiles parts of a large kernel while this one compiles the rest, into the same cache.

It is of no consequence but for time: what it has not compiled, for whatever reason, is compiled here. It ends with the
process that started it, and as soon as the large kernel is compiled.
"""

import atexit
import contextlib
import importlib
import os
import pickle
import queue
import selectors
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

LONGEST = 60.0
"""How long this process waits for a part that the other one has begun [s]."""

_IDLE = 30.0
"""After so long without a part to compile the other one ends [s]."""

Part = tuple[str, tuple[Any, ...]]
"""A kernel's full name, and the types of its arguments."""


def full_name(function: Any) -> str:
    """A name by which another process finds a kernel's Python function."""
    return f"{function.__module__}:{function.__qualname__}"


class SecondCompiler:
    """The second process.

    Args:
        cache: Where the folders of all versions of the kernels are.
    """

    def __init__(self, cache: Path) -> None:
        self._owner, self._whole, self._numbers, self._said = os.getpid(), set[Part](), dict[Part, int](), b""
        paths = [folder or str(Path.cwd()) for folder in sys.path]  # what is imported here is imported there
        alike = ["-s"] if sys.flags.no_user_site else []
        self._process = subprocess.Popen(
            [sys.executable, *alike, "-P", "-W", "ignore", "-m", "jssa_gym.kernels.second_compiler"],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": os.pathsep.join(paths)},
        )
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)  # one that reads nothing is not waited for
        atexit.register(self.close)

    @property
    def runs(self) -> bool:
        """Whether it can be asked for more."""
        return self._owner == os.getpid() and self._process.poll() is None

    def ask(self, wholes: Sequence[Part], parts: Sequence[Part]) -> None:
        """Let it compile parts, in this order, while this process compiles the wholes, or what else it has to."""
        new = [part for part in parts if part not in self._numbers]
        numbers = dict(zip(new, range(len(self._numbers), len(self._numbers) + len(new)), strict=True))
        self._whole.update(wholes)
        self._numbers |= numbers
        # types repeat themselves: what is asked for has to fit into a pipe that nobody reads yet
        self._write(f"compile {zlib.compress(pickle.dumps(numbers)).hex()}")

    def has_compiled(self, part: Part) -> bool:
        """Whether a part is compiled there; if that has begun, it is waited for, else it is left to this process."""
        if self._owner != os.getpid() or part not in self._numbers:
            return False
        number = self._numbers[part]
        self._read(0.0)
        if not self._has_said("begun", number):
            self._write(f"leave {number}")
            return False
        deadline = time.monotonic() + LONGEST
        while not self._has_said("done", number) and (left := deadline - time.monotonic()) > 0.0 and self._read(left):
            pass
        return self._has_said("done", number)

    def tell_of(self, kernel: Part) -> None:
        """Tell it that this process has compiled something; after the last whole it ends."""
        if kernel in self._whole:
            self._whole.discard(kernel)
            if not self._whole:
                self.close()

    def close(self) -> None:
        """End it, if it has not ended."""
        if self._owner != os.getpid():  # a fork's copy
            return
        atexit.unregister(self.close)
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _has_said(self, what: str, number: int) -> bool:
        return f"{what} {number}\n".encode() in self._said

    def _write(self, line: str) -> None:
        pipe, text, sent = self._process.stdin, f"{line}\n".encode(), None
        if pipe is not None and not pipe.closed:
            with contextlib.suppress(OSError):  # it has ended
                sent = pipe.write(text)
            if sent != len(text):
                self.close()

    def _read(self, seconds: float) -> bool:
        """Take down what it says within so many seconds; False once it has ended."""
        pipe = self._process.stdout
        if pipe is None or pipe.closed:
            return False
        said = b""
        with contextlib.suppress(OSError), selectors.DefaultSelector() as selector:
            selector.register(pipe, selectors.EVENT_READ)
            if not selector.select(seconds):
                return True
            said = os.read(pipe.fileno(), 65536)
        self._said += said
        if not said:
            self.close()
        return bool(said)


running: list[SecondCompiler] = []
"""The one that was started last, if any."""


# ---- the other side ----------------------------------------------------------------------------------


def _listen(asked: queue.Queue[bytes], left: set[int]) -> None:
    for line in sys.stdin:
        what, value = line.split()
        if what == "leave":
            left.add(int(value))
        else:
            asked.put(bytes.fromhex(value))
    os._exit(0)  # whoever has started this has ended


def main() -> None:
    """Compile what is asked for, and say so."""
    answers = os.dup(1)
    os.dup2(2, 1)  # whatever else is written belongs to nobody
    asked: queue.Queue[bytes] = queue.Queue()
    left: set[int] = set()
    threading.Thread(target=_listen, args=(asked, left), daemon=True).start()
    with contextlib.suppress(queue.Empty):
        while True:
            for (name, types), number in pickle.loads(zlib.decompress(asked.get(timeout=_IDLE))).items():
                if number not in left:
                    os.write(answers, f"begun {number}\n".encode())
                    module, _, kernel = name.partition(":")
                    getattr(importlib.import_module(module), kernel).compile(types)
                    os.write(answers, f"done {number}\n".encode())


if __name__ == "__main__":
    main()
