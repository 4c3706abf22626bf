"""How smoothly an arm moves and how long it takes: by definition, by hand, and wherever it is told."""

import csv
import dataclasses
import json
import statistics
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jssa_gym
from jssa_gym.cli.compare import Compare
from jssa_gym.evaluation import Report, rollout, summarise
from jssa_gym.evaluation.comparison_page import page
from jssa_gym.evaluation.motion import jerk_jumps
from jssa_gym.evaluation.standings import median_time_to_goal, standings
from jssa_gym.evaluation.steps import Steps, summarise_steps
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import ParameterError
from jssa_gym.types import Status

BOUND = np.array([10.0, 20.0])


def trial(applied, nominal=None, bound=BOUND):
    """Jerks of an episode in jerk bounds, a row a step."""
    applied = np.reshape(np.array(applied, float), (-1, len(bound)))
    nominal = applied if nominal is None else np.reshape(np.array(nominal, float), (-1, len(bound)))
    return jerk_jumps(applied * bound, nominal * bound, bound)


# ---- jumps -------------------------------------------------------------------------------------------

SHARES = st.lists(st.integers(-8, 8).map(lambda k: k / 4), min_size=2, max_size=2)
"""Of two joints' bounds; also beyond them, and changes by the bound itself."""


@pytest.mark.long
@given(st.lists(st.tuples(SHARES, SHARES), max_size=8))
def test_jumps_are_counted_step_by_step(rows):
    applied, nominal = ([row[k] for row in rows] for k in (0, 1))
    policy = shield = 0
    for k in range(1, len(rows)):
        jumped = wanted = False
        for j in range(2):
            jumped = jumped or abs(applied[k][j] - applied[k - 1][j]) > 1.0
            now, before = (min(max(nominal[i][j], -1.0), 1.0) for i in (k, k - 1))
            wanted = wanted or abs(now - before) > 1.0
        policy += jumped and wanted
        shield += jumped and not wanted
    steps = max(len(rows) - 1, 1)
    found = trial(applied, nominal)
    assert found == pytest.approx(((policy + shield) / steps, policy / steps, shield / steps))


def test_a_jerk_that_chatters_jumps_at_every_step_and_a_smooth_one_at_none():
    k = np.arange(200)
    chatter, smooth = np.where(k % 2, 0.9, -0.9), 0.9 * np.sin(0.05 * k)
    both = [np.stack([x, np.zeros(200)], axis=1) for x in (chatter, smooth)]
    assert trial(both[0]) == (1.0, 1.0, 0.0)
    assert trial(both[1]) == (0.0, 0.0, 0.0)
    # the shield makes one of the other, and the other of the one
    assert trial(both[0], both[1]) == (1.0, 0.0, 1.0)
    assert trial(both[1], both[0]) == (0.0, 0.0, 0.0)


def test_a_jump_is_more_than_the_joints_own_bound():
    assert trial([[0.0, 0.0], [1.0, -1.0]]).applied == 0.0
    assert trial([[-0.2, 0.0], [0.8, 0.0]], bound=np.array([0.1, 0.1])).applied == 0.0  # more by rounding alone
    assert trial([[0.0, -0.51], [0.0, 0.5]]).applied == 1.0
    assert jerk_jumps(*2 * [np.array([[0.0, 0.0], [15.0, 0.0]])], BOUND).applied == 1.0
    assert jerk_jumps(*2 * [np.array([[0.0, 0.0], [0.0, 15.0]])], BOUND).applied == 0.0


def test_what_is_beyond_the_bounds_does_not_jump_there():
    """A policy that asks for too much, and for still more, is clipped to the same: no jump is its own."""
    applied, nominal = [[1.0, 0.0], [-1.0, 0.0]], [[1.5, 0.0], [5.0, 0.0]]
    assert trial(applied, nominal) == (1.0, 0.0, 1.0)
    assert trial(applied, [[5.0, 0.0], [-5.0, 0.0]]) == (1.0, 1.0, 0.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_no_number_asked_for_is_no_jump_of_the_policys(bad):
    nominal = [[bad, 0.0]] * 3
    assert trial([[1.0, 0.0], [-1.0, 0.0], [-1.0, 0.0]], nominal) == (0.5, 0.0, 0.5)


@pytest.mark.parametrize("steps", [0, 1])
def test_an_episode_that_has_no_second_step_has_no_jump(steps):
    assert trial(np.ones((steps, 2))) == (0.0, 0.0, 0.0)


def test_jumps_of_an_episode_are_of_what_was_applied_and_what_was_asked_for():
    """Against a policy that holds still a shield's evasions are its own; without a shield all is the policy's."""
    hold, flip = (lambda _: np.zeros(6)), iter(range(1000))
    chased = rollout(jssa_gym.Shield(jssa_gym.ArmEnv("home", human="pursuit"), "cbf"), hold, seed=3, steps=1000)
    bare = rollout(
        jssa_gym.ArmEnv("home", human="none"), lambda _: np.full(6, 0.6 if next(flip) % 2 else -0.6), seed=0, steps=20
    )
    limits = jssa_gym.ArmEnv("home").robot.limits
    shielded, alone = summarise(chased, limits), summarise(bare, limits)
    assert shielded.jerk_jumps_shield == shielded.jerk_jumps > 0.0
    assert shielded.jerk_jumps_nominal == 0.0
    assert (alone.jerk_jumps, alone.jerk_jumps_nominal, alone.jerk_jumps_shield) == (1.0, 1.0, 0.0)
    assert alone.jerk_rms == pytest.approx(0.6)


# ---- switches ----------------------------------------------------------------------------------------


def steps_of(status, dt=0.5) -> Steps:
    none = np.zeros(len(status))
    no = np.zeros(len(status), bool)
    return Steps(
        *(dt, 0.05, False, "running", none, no, none + 1.0, no, none, no, np.array(status, np.int64), no, no),
        *(none, none, none),
    )


@given(st.lists(st.sampled_from(list(Status)), max_size=10), st.sampled_from([0.008, 0.5]))
def test_switches_are_counted_step_by_step(status, dt):
    count = sum(one != other for one, other in pairwise(status))
    expected = count / (len(status) * dt) if status else 0.0
    assert summarise_steps(steps_of(status, dt)).status_switches == pytest.approx(expected)


def test_status_may_switch_while_the_shield_intervenes_throughout():
    """Chatter is of interventions; a shield that is at work all the time may still change its mind at every step."""
    steps = steps_of([Status.PROJECTED, Status.FAILSAFE] * 4)._replace(intervened=np.ones(8, bool))
    summary = summarise_steps(steps)
    assert summary.chatter == 0.0
    assert summary.status_switches == pytest.approx(7 / 4.0)


# ---- tables ------------------------------------------------------------------------------------------

STUDY = Study(("reach", "home"), ("jssa+stop", "none"), ("walk_by",), ("jpc",), episodes=3, seed=5, steps=2)


@pytest.fixture(scope="module")
def episode():
    """Any episode; what is asked of it is written over."""
    return jssa_gym.evaluate("jssa_gym/Reach-v0", "hold", 1, env_kwargs={"human": "none"}, steps=5).episodes[0]


def report(episode, name, times, task="reach", **changes) -> Report:
    """Times to the goal, None for never."""
    rows = []
    for seed, time in enumerate(times):
        summary = dataclasses.replace(episode.summary, time_to_goal=time, success=time is not None, **changes)
        rows.append(dataclasses.replace(episode, task=task, filter=name, seed=seed, summary=summary))
    return Report.of(rows)


@pytest.mark.long
@settings(max_examples=30)
@given(st.lists(st.tuples(*2 * [st.none() | st.integers(1, 40).map(float)]), min_size=1, max_size=6))
def test_times_are_compared_goal_by_goal_with_no_filter(episode, times):
    here, there = zip(*times, strict=True)
    known = [time for time in here if time is not None]
    found = {one.filter: one for one in standings([report(episode, "stop", here), report(episode, "none", there)])}
    assert median_time_to_goal(found["stop"].pooled) == (statistics.median(known) if known else None)
    assert found["none"].slowdown is None
    lost = sum(one is None for one, other in times if other is not None)
    ratios = [one / other for one, other in times if one is not None and other is not None]
    slowdown = found["stop"].slowdown
    if all(time is None for time in there):
        assert slowdown is None
        return
    assert (slowdown.lost.k, slowdown.lost.n) == (lost, sum(time is not None for time in there))
    assert (slowdown.ratio is None) == (not ratios)
    if ratios:
        assert slowdown.ratio.value == pytest.approx(np.mean(ratios))


def test_a_goal_that_is_held_from_the_beginning_says_nothing_of_time(episode):
    both = [
        report(episode, name, times, task)
        for name, far in (("stop", [4.0, 6.0, None]), ("none", [2.0, 3.0, 5.0]))
        for task, times in (("reach", far), ("home", [0.02, 0.02, 0.02]))
    ]
    stop = next(one for one in standings(both) if one.filter == "stop")
    assert median_time_to_goal(stop.pooled) == 5.0
    assert stop.slowdown.ratio.value == pytest.approx(2.0)
    assert stop.slowdown.brief.endswith("lost 1 of 3")


def test_without_no_filter_there_is_nothing_to_compare_with(episode):
    reports = [report(episode, name, [1.0, None]) for name in ("stop", "jssa+stop")]
    assert all(one.slowdown is None for one in standings(reports))
    with pytest.raises(ParameterError, match="same episodes"):
        standings([report(episode, "stop", [1.0, 2.0]), report(episode, "none", [1.0])])


def test_the_page_tells_motion_and_time(episode, tmp_path):
    changes = {"jerk_jumps_shield": 0.0421, "jerk_jumps_nominal": 0.0137, "status_switches": 7.53, "jerk_rms": 0.319}
    reports = [report(episode, "jssa+stop", [4.0, 6.0, None], **changes), report(episode, "none", [2.0, 3.0, 5.0])]
    html = page(STUDY, reports, "x", tmp_path)
    for section in ("Over everything", "Setting by setting"):
        inside = html.split(f"<h2>{section}</h2>")[1].split("<h3>How near, how smoothly, how fast</h3>")[1]
        table = inside.split("<tbody>")
        titled = [cell.split("</th>")[0].split(">", 1)[1] for cell in table[0].split("<th")[2:]]
        shown = [
            [cell.split("</td>")[0].split(">", 1)[1] for cell in row.split("<td")[1:]]
            for row in table[1].split("</tbody>")[0].split("<tr>")[1:]
        ]
        row = next(row for row in shown if "jssa+stop" in row)
        cells = dict(zip(titled, row, strict=True))
        assert cells["jumps of the jerk by the filter"].startswith("0.0421 ")
        assert cells["jumps of the jerk by the policy"].startswith("0.0137 ")
        assert cells["switches of status [1/s]"].startswith("7.53 ")
        assert cells["RMS jerk [jerk bounds]"].startswith("0.319 ")
        assert cells["median time to the goal [s]"] == "5"
        assert cells["its ratio to none"] == "2 (2 to 2), lost 1 of 3"
        assert next(row for row in shown if "none" in row and "jssa+stop" not in row)[-1] == "-"


@pytest.mark.long
def test_from_episodes_to_rows_report_and_comparison(tmp_path, capsys):
    """What was counted in an episode is what stands in the table, in the summary and in what is printed."""
    command = Compare(filters=("stop", "none"), humans=("pursuit",), policies=("random",), episodes=2, seconds=2.0)
    command = dataclasses.replace(command, out=tmp_path / "compared", json=True)
    command.run()
    told = {one["filter"]: one for one in json.loads(capsys.readouterr().out)}
    settings = {one["filter"]: one for one in json.loads((tmp_path / "compared" / "summary.json").read_text())}
    with (tmp_path / "compared" / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in ("stop", "none"):
        for metric in ("jerk_jumps", "jerk_jumps_nominal", "jerk_jumps_shield", "status_switches", "jerk_rms"):
            values = [float(row[metric]) for row in rows if row["filter"] == name]
            assert len(values) == 2
            for place in (told, settings):
                assert place[name]["means"][metric]["value"] == pytest.approx(np.mean(values))
    # random jerks jump by themselves; only a shield switches, and makes jumps
    assert told["none"]["means"]["jerk_jumps_nominal"]["value"] > 0.2
    assert told["none"]["means"]["jerk_jumps_shield"]["value"] == told["none"]["means"]["status_switches"]["value"] == 0
    assert told["stop"]["means"]["status_switches"]["value"] > 0.0
    assert set(told["none"]["mean_differences"]) >= {"jerk_jumps_shield", "status_switches", "jerk_rms"}
    dataclasses.replace(command, json=False).run()
    text = capsys.readouterr().out
    for word in ("jumps by shield", "by policy", "status switches", "RMS jerk", "median time", "ratio to none"):
        assert word in text
