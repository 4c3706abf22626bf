"""The stored leaderboard, and what somebody else plays on its seeds."""

import hashlib
import lzma
import shutil
import sys

import numpy as np
import pytest

import jssa_gym
from jssa_gym.board import STORED, Submission, filter_factory, read_board, read_folders, store_board
from jssa_gym.board.tables import all_tables, complete_cells, filters_of
from jssa_gym.cli.compare import Compare
from jssa_gym.evaluation.runner import complete
from jssa_gym.exceptions import ParameterError

SECONDS, STEPS = 0.8, 100
MINE = """
from dataclasses import dataclass
from jssa_gym.shields import NoFilter, StopFilter

asked = []

def stop(robot, dt, *, viability=True, failsafe=None):
    asked.append((viability, failsafe))
    return StopFilter(robot, dt, viability=viability, failsafe=failsafe)

def nothing(robot, dt):
    return NoFilter(robot, dt)

def wrong(robot, dt):
    return "a filter"

number = 3

def hold(env, seed):
    import jssa_gym
    return jssa_gym.HoldPolicy(env)
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A little board: two comparisons that share no cell."""
    root = tmp_path_factory.mktemp("boards")
    wanted = {
        "home": (("home",), ("pursuit", "hand"), ("jpc", "random"), 3),
        "reach": (("reach",), ("hand",), ("jpc",), 9),
    }
    for name, (tasks, humans, policies, seed) in wanted.items():
        Compare(tasks, ("stop", "none"), humans, policies, 3, seed, SECONDS, root / name, keep=0).run()
    return [root / name for name in wanted]


@pytest.fixture(scope="module")
def board(folders, tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "board.csv.xz"
    store_board(folders, path)
    return path


@pytest.fixture
def mine(tmp_path, monkeypatch):
    (tmp_path / "my_filters.py").write_text(MINE)
    monkeypatch.syspath_prepend(tmp_path)
    sys.modules.pop("my_filters", None)  # of another test's file
    yield "my_filters"
    sys.modules.pop("my_filters", None)


# ---- stored ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_what_is_stored_makes_the_tables_of_the_folders(folders, board):
    kept, asked, digest = read_board(board)
    assert [one["tasks"] for one in asked] == [["home"], ["reach"]]
    assert digest == hashlib.sha256(lzma.decompress(board.read_bytes())).hexdigest()
    whole = read_folders(folders)
    assert list(kept) == list(whole)
    for cell, filters in whole.items():
        assert list(kept[cell]) == ["stop", "none"]
        for name, episodes in filters.items():
            assert kept[cell][name].keys() == episodes.keys()
            for seed, one in episodes.items():
                assert list(kept[cell][name][seed]) == list(one)
                np.testing.assert_allclose(list(kept[cell][name][seed].values()), list(one.values()), rtol=1e-4)
    tables = [list(all_tables(found, ["stop"])) for found in (kept, whole)]
    assert tables[0] == tables[1]
    assert any("first or tied in" in line for line in tables[0])


@pytest.mark.long
def test_the_same_episodes_are_the_same_bytes_whoever_was_first(folders, board, tmp_path):
    shutil.copytree(folders[0], tmp_path / "home")
    path = tmp_path / "home" / "episodes.csv"
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *rows[:6][::-1], *rows[6:]]) + "\n")
    digest = store_board([tmp_path / "home", folders[1]], tmp_path / "again.csv.xz")
    assert (digest, (tmp_path / "again.csv.xz").read_bytes()) == (read_board(board).digest, board.read_bytes())


def test_it_says_what_was_asked_for(board):
    text = lzma.decompress(board.read_bytes()).decode()
    asked = [line for line in text.splitlines() if line.startswith("# ")]
    assert len(asked) == 2
    assert all('"source": ' in line and '"seed": ' in line for line in asked)
    assert text.splitlines()[2].startswith("task,filter,human,policy,seed,collision,success,moving_contact,")


def test_what_is_no_board_is_refused(folders, board, tmp_path):
    for content, message in (
        (b"a,b\n", "holds no leaderboard"),
        (board.read_bytes()[:-5], "ends too early"),
        (lzma.compress(b"# {}\ntask,filter\n"), "no episodes"),
        (lzma.compress(b"task,filter\nreach,none\n"), "is missing"),
    ):
        (tmp_path / "board.csv.xz").write_bytes(content)
        with pytest.raises(ParameterError, match=message):
            read_board(tmp_path / "board.csv.xz")
    with pytest.raises(ParameterError, match="cannot read"):
        read_board(tmp_path / "none.csv.xz")
    with pytest.raises(ParameterError, match="holds no comparison"):
        store_board([tmp_path], tmp_path / "board.csv.xz")
    (tmp_path / "short").mkdir()
    shutil.copy(folders[1] / "episodes.csv", tmp_path / "short")
    config = (folders[1] / "campaign.json").read_text()
    for old, new, message in (
        ('"steps": 100', '"steps": 50', "has other steps than"),
        ('"steps": 100', '"robot": "ur5e", "steps": 100', "is of another robot"),
        ('"humans"', '"people"', "humans: not told"),
    ):
        assert old in config
        (tmp_path / "short" / "campaign.json").write_text(config.replace(old, new))
        with pytest.raises(ParameterError, match=message):
            store_board([folders[0], tmp_path / "short"], tmp_path / "board.csv.xz")
    with pytest.raises(ParameterError, match="repeats the cell"):
        store_board([folders[0], folders[0]], tmp_path / "board.csv.xz")


def test_the_packages_own_is_small_and_complete():
    assert STORED.stat().st_size < 1_500_000
    whole, missing = complete_cells(read_board().episodes)
    assert missing == []
    assert {"work", "yield", "jssa+stop", "stop", "none"} <= set(filters_of(whole))


# ---- submitted ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["stop", "nothing"])
def test_a_filter_plays_on_the_boards_seeds_and_is_there_what_it_is_here(name, board, mine, tmp_path):
    stored = read_board(board)
    submission = Submission.of(stored, f"{mine}:{name}")
    assert (submission.total(), submission.steps, submission.v_safe) == (15, STEPS, 1e-3)
    complete(submission, tmp_path, keep=0)
    both = submission.beside(stored, read_folders([tmp_path]))
    assert filters_of(both) == ["stop", "none", f"{mine}:{name}"]
    # they are the package's own by another name
    for cell in both.values():
        theirs, ours = cell["none" if name == "nothing" else name], cell[f"{mine}:{name}"]
        assert theirs.keys() == ours.keys()
        for seed, one in theirs.items():
            np.testing.assert_allclose(list(ours[seed].values()), list(one.values()), rtol=1e-4)


def test_a_policy_plays_in_the_place_of_jpc_on_its_seeds(board, mine, tmp_path):
    stored = read_board(board)
    submission = Submission.of(stored, "none", f"{mine}:hold", humans=["hand"], episodes=2)
    assert [cell[0] for cell in submission.cells] == [("home", "hand", "jpc"), ("reach", "hand", "jpc")]
    complete(submission, tmp_path, keep=0)
    both = submission.beside(stored, read_folders([tmp_path]))
    assert filters_of(both) == ["stop", "none", f"{mine}:hold in none"]
    for (task, human, policy), cell in both.items():
        everybody = sorted(stored.episodes[task, human, policy]["stop"])
        assert all(sorted(one) == everybody[:2] for one in cell.values())
    assert complete_cells(both)[1] == []


def test_submissions_are_told_from_each_other(board, mine):
    stored = read_board(board)
    one, other = (Submission.of(stored, f"{mine}:{name}").config() for name in ("stop", "nothing"))
    assert one != other
    assert one["code"] == other["code"]
    assert len(one["code"][0]) == 16
    assert Submission.of(stored, f"{mine}:stop", episodes=2).config() != one


@pytest.mark.parametrize(
    ("words", "options", "message"),
    [
        (("my_filters:missing",), {}, "cannot load the filter 'my_filters:missing'"),
        (("no_such_module:x",), {}, "working directory or installed"),
        (("my_filters:number",), {}, "no factory"),
        (("swim",), {}, "unknown filter 'swim'"),
        (("stop", "swim"), {}, "unknown policy 'swim'"),
        (("stop",), {"tasks": ("track",)}, "unknown task 'track'"),
    ],
)
def test_what_cannot_be_submitted_is_refused(words, options, message, board, mine):
    with pytest.raises(ParameterError, match=message):
        Submission.of(read_board(board), *words, **options)


def test_a_factory_has_to_make_a_filter(board, mine):
    submission = Submission.of(read_board(board), f"{mine}:wrong")
    with pytest.raises(ParameterError, match="has to make a SafetyFilter, got str"):
        submission.make_env(next(iter(submission.seeds())))
    env = Submission.of(read_board(board), f"{mine}:stop+stop").make_env(next(iter(submission.seeds())))
    assert isinstance(env, jssa_gym.Shield)
    asked = sys.modules[mine].asked[-1]
    assert asked == (True, jssa_gym.FailsafeParams())
    assert filter_factory(f"{mine}:stop+stop") is sys.modules[mine].stop
