"""Time to the goal beside people over that alone, on reports whose times are written by hand."""

import csv
import json
from dataclasses import replace

import pytest

import jssa_gym
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.evaluation import Report, slowdown
from jssa_gym.exceptions import ParameterError


@pytest.fixture(scope="module")
def episode():
    """Any episode; what is asked of it is written over."""
    return jssa_gym.evaluate("jssa_gym/Reach-v0", "hold", 1, env_kwargs={"human": "none"}, steps=5).episodes[0]


def report(episode, times, seed=0, success=None):
    """Times to the goal, None for never, from a seed on."""
    reached = [time is not None for time in times] if success is None else success
    return Report.of(
        [
            replace(episode, seed=seed + k, summary=replace(episode.summary, time_to_goal=time, success=done))
            for k, (time, done) in enumerate(zip(times, reached, strict=True))
        ]
    )


def test_the_ratio_is_over_goals_reached_both_ways_and_the_others_are_counted(episode):
    alone = report(episode, [1.0, 2.0, 1.0, None, 4.0])
    found = slowdown(report(episode, [2.0, 3.0, None, 5.0, 4.0]), alone)
    assert found.ratio.n == 3
    assert found.ratio.value == pytest.approx((2.0 + 1.5 + 1.0) / 3)
    assert found.ratio.low >= 1.0
    assert (found.lost.k, found.lost.n) == (1, 4)
    assert "not reached of those reached alone: 1 / 4" in str(found)


def test_a_goal_that_was_left_again_was_not_reached(episode):
    found = slowdown(report(episode, [1.0, 1.0], success=[False, True]), report(episode, [1.0, 1.0]))
    assert (found.ratio.n, found.lost.k) == (1, 1)
    found = slowdown(report(episode, [1.0, 1.0]), report(episode, [1.0, 1.0], success=[False, True]))
    assert (found.ratio.n, found.lost.k, found.lost.n) == (1, 0, 1)


def test_nothing_is_said_where_there_is_nothing_to_compare(episode):
    assert slowdown(report(episode, [1.0, 2.0]), report(episode, [None, None])) is None
    found = slowdown(report(episode, [None, None]), report(episode, [1.0, 2.0]))
    assert found.ratio is None
    assert found.lost.k == 2
    assert str(found).startswith("no goal was reached both ways")
    for other in ({"seed": 1}, {"policy": "another"}):
        with pytest.raises(ParameterError, match="the same policy and seeds"):
            slowdown(report(episode, [1.0]), Report.of([replace(episode, **({"seed": 0} | other))]))


def test_the_command_plays_the_same_goals_alone(tmp_path, capsys):
    command = Evaluate("reach", "stop", "random", episodes=2, seconds=4.0, out=tmp_path, keep=0, slowdown=True)
    replace(command, json=True).run()
    told = json.loads(capsys.readouterr().out)["slowdown"]
    assert told == json.loads((tmp_path / "slowdown.json").read_text())
    assert told["lost"]["n"] == 2
    assert told["ratio"]["n"] + told["lost"]["k"] == 2
    assert told["ratio"]["value"] >= 0.9
    command.run()
    assert "time to the goal over that without filter and people" in capsys.readouterr().out
    with (tmp_path / "alone" / "episodes.csv").open(newline="") as file:
        assert {(row["filter"], row["human"]) for row in csv.DictReader(file)} == {("none", "none")}
