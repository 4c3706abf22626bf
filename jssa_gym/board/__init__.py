"""The leaderboard: every episode of it as one compressed table, its tables, and whoever wants to be on it.

``episodes`` reads folders of comparisons and the stored table, ``tables`` makes Markdown of them, and a ``Submission``
plays somebody's own filter or policy on the seeds that are on the board.
"""

from jssa_gym.board.episodes import STORED, Board, Episodes, read_board, read_folders, store_board
from jssa_gym.board.submission import Submission, filter_factory
from jssa_gym.board.tables import all_tables

__all__ = [
    "STORED",
    "Board",
    "Episodes",
    "Submission",
    "all_tables",
    "filter_factory",
    "read_board",
    "read_folders",
    "store_board",
]
