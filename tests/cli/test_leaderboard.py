"""``jssa-gym leaderboard``: what it prints, writes and refuses."""

import pytest
from commands import one_line

from jssa_gym.board import store_board
from jssa_gym.cli.compare import Compare

MINE = """
from jssa_gym.shields import StopFilter

def careful(robot, dt):
    return StopFilter(robot, dt, viability=True)
"""


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    root = tmp_path_factory.mktemp("board")
    Compare(("home",), ("stop", "none"), ("pursuit", "hand"), ("jpc",), 3, 7, 0.4, root / "played", keep=0).run()
    store_board([root / "played"], root / "board.csv.xz")
    return root / "board.csv.xz"


@pytest.mark.long
def test_a_filter_gets_a_row_and_a_verdict(board, here, tmp_path):
    (tmp_path / "my_filters.py").write_text(MINE)
    words = ("leaderboard", "submit", "--filter", "my_filters:careful", "--board", board, "--out", "mine")
    run = here(*words, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    rows = [line for line in run.stdout.splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == ["stop", "none", "my_filters:careful"]
    assert "`my_filters:careful` on moving contact: first or tied in" in run.stdout
    tables = (tmp_path / "mine" / "tables.md").read_text()
    assert "6 episodes of my_filters:careful" in tables.splitlines()[0]
    assert "| home, `hand` |" in tables
    before = (tmp_path / "mine" / "episodes.csv").read_bytes()
    assert here(*words, cwd=tmp_path).stdout == run.stdout  # goes on where it ended
    assert (tmp_path / "mine" / "episodes.csv").read_bytes() == before
    assert "holds another campaign" in one_line(here(*words, "--episodes", "1", cwd=tmp_path))


@pytest.mark.long
def test_a_policy_takes_the_place_of_jpc(board, here, tmp_path):
    words = ("--policy", "hold", "--humans", "hand", "--tasks", "home", "--episodes", "2", "--jobs", "1")
    run = here("leaderboard", "submit", *words, "--board", board, "--out", tmp_path / "mine")
    assert run.returncode == 0, run.stderr
    assert "| `hold in jssa_near+stop` | " in run.stdout
    assert len((tmp_path / "mine" / "episodes.csv").read_text().splitlines()) == 3


def test_the_stored_tables_are_shown(board, here):
    run = here("leaderboard", "show", "--board", board)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("SHA-256 of the table ")
    assert "| `stop` | 0 / 6 " in run.stdout
    assert "\n\n`stop` on moving contact" in run.stdout
    assert "\\n" not in run.stdout
    assert "`none` on moving contact" in here("leaderboard", "show", "--board", board, "--ours", "none").stdout
    assert "unknown filter of the board 'ssa'" in one_line(
        here("leaderboard", "show", "--board", board, "--ours", "ssa")
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "give a --filter, a --policy, or both"),
        (("--filter", "swim"), "unknown filter 'swim'"),
        (("--filter", "nowhere:at_all"), "cannot load the filter 'nowhere:at_all'"),
        (("--filter", "stop", "--episodes", "0"), "episodes has to be a positive integer"),
        (("--filter", "stop", "--tasks", "track"), "unknown task 'track'"),
        (("--filter", "stop", "--board", "missing.xz"), "cannot read"),
        (("--policy", "random", "--trust-pickle", "--filter", "stop", "--engine", "ray", "--jobs", "0"), "jobs has to"),
    ],
)
def test_wrong_words_are_told_in_one_line(words, message, board, here, tmp_path):
    words = (*words, "--board", board) if "--board" not in words else words
    assert message in one_line(here("leaderboard", "submit", *words, cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []
