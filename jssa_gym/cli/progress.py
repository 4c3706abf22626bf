"""Progress of episodes on the terminal."""

from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


def transient(console: Console, *columns: Any) -> Progress:
    """A bar that is gone at the end; where nobody can see it nothing is written, empty lines included."""
    return Progress(*columns, console=console, transient=True, disable=not console.is_interactive)


def episodes_bar(console: Console) -> Progress:
    """A bar with how many of how many, time gone and time left."""
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        *(TimeElapsedColumn(), TimeRemainingColumn()),
    )
    return transient(console, *columns)
