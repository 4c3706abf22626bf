"""Progress on the terminal, and in what is not one."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from jssa_gym.cli.terminal import Terminal
from jssa_gym.text import counted

PERIOD = 5.0
"""Where nobody looks at a terminal, a line is written about so often [s]."""


class Bar(Progress):
    """A bar that is gone at the end; in a file or a pipe a line every few seconds instead.

    Args:
        console: Where it is drawn.
        columns: As rich's; its own without any.
    """

    def __init__(self, console: Terminal, *columns: Any) -> None:
        super().__init__(*columns, console=console, transient=True, disable=not console.is_interactive)
        self._say = console.say
        self._told = monotonic()

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Change what is shown of a task."""
        super().update(task_id, **changes)
        self._tell(task_id)

    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        """Count what a task has done."""
        super().advance(task_id, advance)
        self._tell(task_id)

    def _tell(self, task_id: TaskID) -> None:
        if not self.disable or (now := monotonic()) < self._told + PERIOD:
            return
        self._told = now
        task = self._tasks[task_id]
        of = "" if task.total is None else f" of {task.total:,.0f}"
        left = task.time_remaining
        later = "" if left is None else f", {left:.0f} s left"
        gone = f"{task.elapsed or 0.0:.0f} s gone"
        self._say(f"{task.description or 'working'}: {task.completed:,.0f}{of}, {gone}{later}")


def counting() -> tuple[ProgressColumn, ...]:
    """Columns of a bar with how many of how many, time gone and time left."""
    text = TextColumn("{task.description}")
    return text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()


@contextmanager
def episodes_bar(console: Terminal, out: Path) -> Generator[Callable[..., None]]:
    """A bar of episodes; an interrupt says how to go on.

    Args:
        console: Where it is drawn.
        out: Folder that the same command goes on from.

    Yields:
        What is called with the number of episodes played so far and of all, and with what to say instead of
        "episodes".
    """
    played = 0
    with Bar(console, *counting()) as progress:
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
