"""``jssa-gym leaderboard``: a filter or policy of one's own on the leaderboard's seeds."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from jssa_gym.board import STORED, Submission, all_tables, read_board, read_folders
from jssa_gym.board.submission import PURPOSEFUL
from jssa_gym.board.tables import complete_cells, filters_of, overview, verdicts
from jssa_gym.cli.engine import Engine
from jssa_gym.cli.evaluate import find_policies_here, play
from jssa_gym.cli.names import SOME_TASKS, TRUST
from jssa_gym.cli.terminal import Terminal
from jssa_gym.evaluation.identity import made_with
from jssa_gym.exceptions import ParameterError
from jssa_gym.storage import write_whole
from jssa_gym.text import counted
from jssa_gym.validation import known_name


@dataclass(frozen=True)
class Submit:
    """Play a filter or a policy on the leaderboard's seeds, and write its tables with one row more.

    Nothing is sent anywhere: the folder gets tables.md and episodes.csv. What was interrupted goes on where it stopped
    when the same command is given again. The whole board takes about six minutes of one core with a filter of this
    package, the first two --episodes of every cell about half a minute.
    """

    filter: str | None = None
    """MODULE:FACTORY, called with the robot and the control step, +stop behind it for box and verified stop as well; or
    a filter's name. Beside a --policy, jssa_near+stop by default."""
    policy: str | None = None
    """File, name or MODULE:FACTORY, in the place of jpc; without it the board's own policies act."""
    tasks: Annotated[tuple[str, ...], SOME_TASKS] = ()
    humans: tuple[str, ...] = ()
    """People by name; without any all of the board."""
    episodes: int | None = None
    """At most so many of every cell; None for all."""
    out: Path = Path("submission")
    """Folder for tables.md and episodes.csv."""
    board: Path = STORED
    """Another stored board than that of this version."""
    workers: Annotated[Engine, tyro.conf.arg(name="")] = field(default_factory=Engine)
    trust_pickle: Annotated[bool, TRUST] = False

    def run(self) -> None:
        """Play, compare, write."""
        if self.filter is None and self.policy is None:
            raise ParameterError("give a --filter, a --policy, or both")
        if self.episodes is not None and self.episodes < 1:
            raise ParameterError(f"episodes has to be a positive integer, got {self.episodes}")
        find_policies_here([self.filter or "", self.policy or ""])
        board = read_board(self.board)
        submission = Submission.of(
            board,
            self.filter or "jssa_near+stop",
            self.policy or "",
            tasks=self.tasks,
            humans=self.humans,
            episodes=self.episodes or 0,
            trust_pickle=self.trust_pickle,
        )
        play(submission, self.out, self.workers.chosen(), 0)
        both, missing = complete_cells(submission.beside(board, read_folders([self.out])))
        if not both:
            raise ParameterError(f"{self.board} has no cell in which all filters have the same seeds")
        label, count = submission.label, submission.total()
        text = f"{counted(count, 'episode')} of {label} on the board {board.digest[:16]}; {made_with()}\n\n"
        write_whole(self.out / "tables.md", text + "\n".join(all_tables(both, [label])) + "\n")
        out, console = Terminal(), Terminal(stderr=True)
        rivals = [name for name in filters_of(both) if name != label]
        _say(out, [*overview(both, [*rivals, label], [PURPOSEFUL]), *verdicts(both, label, rivals, [PURPOSEFUL])])
        if missing:
            console.say(f"incomplete on the board, and so left out: {'; '.join(map(', '.join, missing))}")
        console.say(f"wrote {self.out / 'tables.md'}")


def _say(out: Terminal, lines: list[str]) -> None:
    for line in "\n".join(lines).split("\n"):  # some begin a table with an empty one
        out.say(line)


@dataclass(frozen=True)
class Show:
    """Print the tables of the stored leaderboard. It takes some seconds."""

    ours: tuple[str, ...] = ()
    """Filters that are compared with the others; the first without any."""
    board: Path = STORED
    """Another stored board than that of this version."""

    def run(self) -> None:
        """Read, print."""
        board = read_board(self.board)
        found, _ = complete_cells(board.episodes)
        names = filters_of(found)
        for name in self.ours:
            known_name("filter of the board", name, names)
        _say(Terminal(), [f"SHA-256 of the table {board.digest}\n", *all_tables(found, self.ours or names[:1])])


@dataclass(frozen=True)
class LeaderboardCommand:
    """The leaderboard: its tables, and a filter or policy of one's own on it.

    A submission takes about six minutes of one core, or as long as its filter's decisions take.
    """

    action: Annotated[
        Annotated[Submit, tyro.conf.subcommand("submit")] | Annotated[Show, tyro.conf.subcommand("show")],
        tyro.conf.arg(name=""),
    ]

    def run(self) -> None:
        """Run the chosen action."""
        self.action.run()
