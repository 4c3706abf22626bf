"""All that the commands say: names from files are shown and never obeyed, in what the terminal can write."""

import codecs
import contextlib
import io
import logging
import os
import sys
import threading
import unicodedata
import warnings
from collections.abc import Generator
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from jssa_gym.exceptions import JSSAGymError
from jssa_gym.text import printable, show_messages

_ALIKE = "jssa_gym.alike"
"""Name of the way to write what a stream's encoding does not have."""

_LOOK_ALIKES = {
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "±": "+/-",
    "×": "x",
    "·": "*",
    "√": "sqrt",
    "∞": "inf",
    "→": "->",
    "–": "-",
    "—": "-",
    "−": "-",
    "“": '"',
    "”": '"',
    "„": '"',
    "‘": "'",
    "’": "'",
    "µ": "u",
    "μ": "u",
    "φ": "phi",
    "λ": "lambda",
    "ℓ": "l",
    "°": "deg",
    "§": "section ",
}


class Terminal(Console):
    """Rich's console, for texts that others have written: no markup, no emoji, every control character escaped.

    Args:
        stderr: Whether it is the standard error.
        width: Of tables where nobody looks at a terminal [characters].
    """

    def __init__(self, *, stderr: bool = False, width: int | None = None) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)
        if width is not None and not self.is_terminal:
            self.width = width

    def render_str(self, text: str, **options: Any) -> Text:
        """All texts and cells of tables come by here."""
        seen = printable(text)
        with contextlib.suppress(LookupError):  # an encoding that nobody knows is not for us to judge
            seen = seen.encode(self.encoding, _ALIKE).decode(self.encoding)
        return super().render_str(seen, **options)

    def say(self, text: str = "") -> None:
        """Print one line, however long, that can be pasted."""
        self.print(text, soft_wrap=True)


def table_of(*titles: str, left: int = 1, title: str | None = None) -> Table:
    """A table whose first columns are text; what follows are numbers, to the right."""
    table = Table(title=title)
    for k, of in enumerate(titles):
        table.add_column(of, justify="left" if k < left else "right")
    return table


def alike(error: UnicodeError) -> tuple[str, int]:
    """What looks like the characters that an encoding does not have, in ASCII, for ``codecs.register_error``."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_in_ascii, error.object[error.start : error.end])), error.end


def _in_ascii(character: str) -> str:
    if character in _LOOK_ALIKES:
        return _LOOK_ALIKES[character]
    name = unicodedata.name(character, "")
    if name.startswith("BOX DRAWINGS"):
        return "+" if "AND" in name or "ARC" in name else "|" if "VERTICAL" in name else "-"
    return unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode() or "?"


@contextlib.contextmanager
def prepared() -> Generator[None]:
    """Streams that can write everything somehow; warnings and log lines in which all is seen; errors told once."""
    codecs.register_error(_ALIKE, alike)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_ALIKE)
    formatwarning, last = warnings.formatwarning, logging.lastResort
    formatter, of_thread = last.formatter if last is not None else None, threading.excepthook

    def without_twice(error: threading.ExceptHookArgs) -> None:
        if not isinstance(error.exc_value, OSError):  # whoever waits for the thread raises it again
            of_thread(error)

    threading.excepthook = without_twice
    show_messages()
    try:
        yield
    finally:
        warnings.formatwarning, threading.excepthook = formatwarning, of_thread
        if last is not None:
            last.setFormatter(formatter)


def complain(error: Exception | str) -> None:
    """Say in one line what was wrong."""
    text = str(error)
    if isinstance(error, OSError) and not isinstance(error, JSSAGymError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename is not None else error.strerror
    print(f"jssa-gym: {printable(text)}", file=sys.stderr)


def abandon_output() -> None:
    """If nothing can be written to the standard output, keep the interpreter from trying once more at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError, ValueError):  # a stream without a file
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
