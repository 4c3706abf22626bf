"""Verdicts of ``benchmarks/leaderboard.py`` on comparisons that were written by hand."""

import csv
import runpy
import sys

import pytest
from places import ROOT

PATH = ROOT / "benchmarks" / "leaderboard.py"


def comparison(folder, outcomes, task="home", seeds=range(40)):
    """Episodes by filter: a filter's success and moving contact are functions of the seed."""
    folder.mkdir()
    with (folder / "episodes.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        names = ("task", "filter", "human", "policy", "seed", "collision", "success", "moving_contact")
        writer.writerow((*names, "limit_violation_rate", "contact_speed"))
        for name, (success, moving) in outcomes.items():
            for seed in seeds:
                hit = moving(seed)
                writer.writerow((task, name, "walk_by", "jpc", seed, hit, success(seed), hit, 0.0, 2.5 * hit))
    return folder


def always(seed):
    return True


def never(seed):
    return False


def seldom(seed):
    return seed % 10 == 0


def verdict(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["leaderboard.py", *map(str, arguments)])
    runpy.run_path(str(PATH), run_name="__main__")
    return capsys.readouterr().out


def test_who_does_worse_is_behind_and_who_does_as_well_is_tied(tmp_path, monkeypatch, capsys):
    folder = comparison(tmp_path / "a", {"ours": (seldom, always), "rival": (always, never), "third": (seldom, always)})
    told = verdict(monkeypatch, capsys, folder, "--ours", "ours", "rival")
    assert "`ours` on moving contact: first or tied in 0 of 1 cells" in told
    assert "`ours` on success without contact: first or tied in 0 of 1 cells" in told
    assert "behind `rival` by 100 (per cent)" in told
    assert "`rival` on moving contact: first or tied in 1 of 1 cells" in told
    assert "| `ours` | 40 / 40 | 2.5, 2.5 | 0 | 0 |" in told
    assert "| `rival` | 0 / 40" in told  # nowhere but in the overview
    assert "| `rival` | 0 / 40 |  |" not in told
    assert "- over all, `rival` minus it: +100.0 of 100" in told
    told = verdict(monkeypatch, capsys, folder, "--ours", "ours", "--rivals", "third")
    assert "`ours` on moving contact: first or tied in 1 of 1 cells" in told


def with_motion(folder, told):
    """The same episodes with the columns of motion and time, by filter and seed."""
    path = folder / "episodes.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0], *told("ours", 0)])
        writer.writeheader()
        writer.writerows(row | told(row["filter"], int(row["seed"])) for row in rows)


def test_motion_and_times_are_told_and_old_folders_have_none(tmp_path, monkeypatch, capsys):
    outcomes = {"ours": (lambda seed: seed < 30, never), "none": (always, never)}
    folder = comparison(tmp_path / "a", outcomes, task="reach")
    told = verdict(monkeypatch, capsys, folder)
    assert "| `ours` | - | - | - | - | - | -, lost 10 of 40 |" in told
    assert "| `none` | - | - | - | - | - | - |" in told

    def motion(name, seed):
        """The median of ours is that of 3 and 1 s, of which there are as many; each as long again as without."""
        time = (3.0 if seed % 2 else 1.0) / (1.0 if name == "ours" else 2.0)
        reached = name == "none" or seed < 30
        return {
            "jerk_jumps_shield": 0.02 if name == "ours" else 0.0,
            "jerk_jumps_nominal": 0.01 * (seed % 2),
            "status_switches": 3.5,
            "jerk_rms": 0.25,
            "time_to_goal": time if reached else "",
        }

    with_motion(folder, motion)
    told = verdict(monkeypatch, capsys, folder)
    assert "| `ours` | 2 % | 0.5 % | 3.5 /s | 25 % | 2 s | 2 (2 to 2), lost 10 of 40 |" in told
    assert "| `none` | 0 % | 0.5 % | 3.5 /s | 25 % | 1 s | - |" in told
    held = comparison(tmp_path / "b", outcomes)  # at home, of an older version
    told = verdict(monkeypatch, capsys, folder, held)
    assert "| `ours` | 2 % | 0.5 % | 3.5 /s | 25 % | 2 s | 2 (2 to 2), lost 10 of 40 |" in told


def test_a_cell_in_which_somebody_misses_seeds_counts_for_nobody(tmp_path, monkeypatch, capsys):
    outcomes = {"ours": (always, never), "rival": (always, never)}
    one, other = comparison(tmp_path / "a", outcomes), comparison(tmp_path / "b", outcomes, task="reach")
    text = (one / "episodes.csv").read_text().splitlines()
    (one / "episodes.csv").write_text("\n".join(text[:-1]) + "\n")
    told = verdict(monkeypatch, capsys, one, other)
    assert "incomplete, and so left out: home, walk_by, jpc" in told
    assert "first or tied in 1 of 1 cells" in told
    assert "| `ours` | 0 / 40 " in told
    with pytest.raises(SystemExit):
        verdict(monkeypatch, capsys, one)


def test_what_is_neither_yes_nor_no_is_an_error(tmp_path, monkeypatch, capsys):
    folder = comparison(tmp_path / "a", {"ours": (always, never), "rival": (always, never)})
    path = folder / "episodes.csv"
    path.write_text(path.read_text().replace("True", "1.0"))
    with pytest.raises(KeyError, match=r"1\.0"):
        verdict(monkeypatch, capsys, folder)


def test_several_folders_are_one_table_but_no_cell_is_counted_twice(tmp_path, monkeypatch, capsys):
    outcomes = {"ours": (always, never), "rival": (always, never)}
    one = comparison(tmp_path / "a", outcomes)
    other = comparison(tmp_path / "b", outcomes, task="reach", seeds=range(100, 140))
    told = verdict(monkeypatch, capsys, one, other)
    assert "success without contact: first or tied in 2 of 2 cells, in 0 of which there is none by any filter" in told
    assert "moving contact: first or tied in 2 of 2 cells, in 2 of which there is none by any filter" in told
    with pytest.raises(SystemExit, match="repeats the cell home, walk_by, jpc"):
        verdict(monkeypatch, capsys, one, one)


@pytest.mark.parametrize("option", ["--ours", "--rivals", "--purposeful"])
def test_a_misspelt_name_is_refused(tmp_path, monkeypatch, capsys, option):
    folder = comparison(tmp_path / "a", {"ours": (always, never), "rival": (always, never)})
    with pytest.raises(SystemExit):
        verdict(monkeypatch, capsys, folder, option, "misspelt")
    assert f"{option}: nothing of misspelt in there" in capsys.readouterr().err


def test_safety_against_success_is_drawn(tmp_path, monkeypatch, capsys):
    folder = comparison(tmp_path / "a", {"ours": (always, never), "rival": (seldom, seldom)})
    verdict(monkeypatch, capsys, folder, "--figure", tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 5000
