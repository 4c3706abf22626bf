"""Progress of episodes on the terminal."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from jssa_gym.cli.terminal import Terminal
from jssa_gym.text import counted


def transient(console: Terminal, *columns: Any) -> Progress:
    """A bar that is gone at the end; where nobody can see it nothing is written, empty lines included."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_interactive)


@contextmanager
def episodes_bar(console: Terminal, out: Path) -> Generator[Callable[..., None]]:
    """A bar with how many of how many, time gone and time left; an interrupt says how to go on.

    Args:
        console: Where it is drawn.
        out: Folder that the same command goes on from.

    Yields:
        What is called with the number of episodes played so far and of all, and with what to say instead of
        "episodes".
    """
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        *(TimeElapsedColumn(), TimeRemainingColumn()),
    )
    played = 0
    with transient(console, *columns) as progress:
        task = progress.add_task("episodes", total=None)

        def show(done: int, total: int, description: str = "episodes") -> None:
            nonlocal played
            played = done
            progress.update(task, completed=done, total=total, description=description)

        try:
            yield show
        except KeyboardInterrupt:
            console.say(f"stopped; the same command goes on from {counted(played, 'episode')} in {out}")
            raise SystemExit(130) from None
