"""The command line itself: every option once, and errors that repeat arguments without obeying them."""

import contextlib
import io
import sys
from collections.abc import Callable, Sequence
from typing import TypeVar

from jssa_gym.exceptions import ParameterError
from jssa_gym.text import printable

Result = TypeVar("Result")


def given_once(arguments: Sequence[str]) -> None:
    """Whether every option is there once: of several only the last would count, and nobody would know.

    Raises:
        ParameterError: One is given twice, or both with and without ``no-``.
    """
    seen: set[str] = set()
    for argument in arguments:
        if not argument.startswith("--"):
            continue
        name = argument[2:].partition("=")[0].replace("_", "-").removeprefix("no-")
        if name in seen:
            raise ParameterError(
                f"--{name} is given twice, and only the last would count; give it once, with all its values behind it"
            )
        seen.add(name)


def distinct(name: str, values: Sequence[str]) -> tuple[str, ...]:
    """The values of an option that takes several, each of them once.

    Raises:
        ParameterError: One is there twice: it would be played once, and nobody would know.
    """
    for value in values:
        if values.count(value) > 1:
            raise ParameterError(f"--{name} has {value!r} twice; give each once")
    return tuple(values)


def parsed(parse: Callable[[Sequence[str]], Result], arguments: Sequence[str]) -> Result:
    """What a parser makes of arguments; if it refuses them it says so, and repeats them, on the standard error.

    Args:
        parse: Ends with SystemExit if it refuses them.
        arguments: Of the command line.
    """
    if all(argument.isprintable() for argument in arguments):
        return parse(arguments)  # in colours
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return parse(arguments)
    finally:
        sys.stderr.write(printable(said.getvalue(), keep="\n"))
