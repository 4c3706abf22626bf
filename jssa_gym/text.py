"""Text that others made, such as names in files: shown as it is read, never obeyed."""

import logging
import re
import warnings
from typing import Any

_MARKS = "\n\t"
"""What texts of several lines, such as tracebacks, are laid out with."""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def printable(text: str, keep: str = "") -> str:
    r"""A text in which all is seen: what steers a terminal, turns the direction of writing or shows nothing is escaped.

    Args:
        text: Any.
        keep: Characters that stay, such as ends of lines.

    Returns:
        The text, ``\\\\x1b`` for an escape character, ``\\\\n`` for an end of line, ``\\\\u202e`` for an override.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)


class _Shown(logging.Formatter):
    """Log lines in which all is seen."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), keep=_MARKS)


def show_messages() -> None:
    """Show all of this process's warnings, and of log lines that no handler of a user's own takes, from now on."""
    formatwarning = warnings.formatwarning

    def shown(*arguments: Any, **options: Any) -> str:
        return printable(formatwarning(*arguments, **options), keep=_MARKS)

    warnings.formatwarning = shown  # ty: ignore[invalid-assignment]
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(_Shown())


def words(name: str) -> list[str]:
    """Words and numbers of a name, in small letters: ``left``, ``up``, ``leg`` of ``LeftUpLeg``, ``left_up.leg``."""
    return [word.casefold() for word in _WORD.findall(name)]


def counted(count: int, noun: str) -> str:
    """``1 episode``, ``2,000 episodes``.

    Args:
        count: How many.
        noun: Of one; those of more end in s.
    """
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
