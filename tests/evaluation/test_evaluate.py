"""Evaluations: paired, resumable, the same however they are run; and what a report says is what was counted."""

import csv
import dataclasses
import json
import os
import runpy
import signal
import subprocess
import sys
import time
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import gymnasium as gym
import numpy as np
import picklable
import pytest
from picklable import TINY
from places import DOCS, PATIENCE, environment
from scipy import stats

import jssa_gym
from jssa_gym.engine.workers import run
from jssa_gym.evaluation import (
    Rate,
    RecordSafety,
    Report,
    Study,
    bootstrap_interval,
    load_trace,
    make_policy,
    mean_difference,
    means,
    put_filter,
    read_meta,
    rollout,
    summarise,
)
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.evaluation.comparison_page import legend, page
from jssa_gym.evaluation.ledger import Ledger, Results
from jssa_gym.evaluation.plan import SPACING
from jssa_gym.evaluation.play import Player, play, played_again
from jssa_gym.evaluation.report import METRICS, column
from jssa_gym.evaluation.rows import EvaluationRow, Setting, digest_of
from jssa_gym.evaluation.runner import complete
from jssa_gym.evaluation.spans import longest, spans
from jssa_gym.evaluation.standings import PAIRED_RATES, profile, standings
from jssa_gym.evaluation.study import Single
from jssa_gym.evaluation.svg import Panel, colour, dashes, marker, ticks
from jssa_gym.evaluation.trace import save_trace
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.shields import FILTERS, JSSAFilter

TIMED = {"shield_p50", "shield_p95", "shield_p99", "shield_max", "deadline_miss_rate"}


def kept(episode: EvaluationRow) -> dict:
    """What must not depend on time or process."""
    values = {name: value for name, value in dataclasses.asdict(episode.summary).items() if name not in TIMED}
    return {**episode.cell._asdict(), "seed": episode.seed, "digest": episode.digest, **values}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished comparison: its folder and its reports."""
    folder = tmp_path_factory.mktemp("study") / "tiny"
    return folder, complete(TINY, folder, keep=2)


# ---- spans, means, profiles --------------------------------------------------------------------------


def test_spans_join_over_short_gaps():
    holds = np.array([1, 0, 1, 1, 0, 0, 1, 0], bool)
    assert spans(holds) == [(0, 1), (2, 4), (6, 7)]
    assert spans(holds, 1) == [(0, 4), (6, 7)]
    assert spans(holds, 2) == [(0, 7)]
    assert (longest(holds), longest(np.zeros(3, bool)), spans(np.zeros(0, bool))) == (2, 0, [])


def test_intervals_of_means_are_scipys():
    rng = np.random.default_rng(0)
    values = np.stack([rng.normal(2.0, 1.0, 80), rng.exponential(3.0, 80)], axis=1)
    for mean, x in zip(means(values, 1, resamples=20_000), values.T, strict=True):
        theirs = stats.bootstrap((x,), np.mean, method="percentile", n_resamples=20_000, rng=2).confidence_interval
        width = theirs.high - theirs.low
        assert mean.value == pytest.approx(x.mean())
        assert (mean.low, mean.high) == pytest.approx((theirs.low, theirs.high), abs=0.03 * width)
        assert (mean.n, mean.least, mean.most, mean.p05) == (80, x.min(), x.max(), pytest.approx(np.quantile(x, 0.05)))
    assert means(values, 1) == means(values, 1)
    assert means(values, 1) != means(values, 2)


def test_episodes_without_a_value_are_left_out_of_a_mean():
    values = np.array([[1.0, np.nan, np.inf], [2.0, np.nan, 4.0], [6.0, np.nan, 4.0]])
    one, none, other = means(values)
    assert (one.n, one.value, none, other.n, other.value, other.low, other.high) == (3, 3.0, None, 2, 4.0, 4.0, 4.0)
    for wrong in ([], [1.0, 2.0], np.zeros((0, 3))):
        with pytest.raises(ParameterError, match="shape"):
            means(wrong)


def test_a_large_sample_is_resampled_in_parts(monkeypatch):
    values = np.random.default_rng(0).normal(size=(50, 2))
    whole = means(values, 3)
    monkeypatch.setattr("jssa_gym.evaluation.statistics._LARGEST", 50 * 7)
    assert [dataclasses.astuple(one) for one in means(values, 3)] == [
        pytest.approx(dataclasses.astuple(one), rel=1e-12) for one in whole
    ]
    for function in (means, lambda x, **k: bootstrap_interval(x, np.mean, 0, **k)):
        with pytest.raises(ParameterError, match="resamples"):
            function(values, resamples=0)


def test_differences_are_paired():
    rng = np.random.default_rng(0)
    hard = rng.normal(0.0, 10.0, 50)
    first, second = hard + 1.0 + rng.normal(0.0, 0.1, 50), hard
    difference = mean_difference(first, second)
    assert 0.9 < difference.low < difference.value < difference.high < 1.1
    unpaired = means(np.stack([first, second], axis=1))
    assert unpaired[0].low < unpaired[1].high
    assert mean_difference([np.inf, 1.0], [np.inf, 0.5]).n == 1
    with pytest.raises(ParameterError, match="paired"):
        mean_difference([1.0], [1.0, 2.0])


def test_a_profile_counts():
    values = np.array([0.0, 1.0, 1.0, 3.0, np.nan])
    np.testing.assert_allclose(profile(values, np.array([-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0])),
                               [1.0, 1.0, 0.75, 0.75, 0.25, 0.25, 0.0])  # fmt: skip


# ---- what is played ----------------------------------------------------------------------------------


def test_seeds_are_shared_by_the_filters_alone():
    study = dataclasses.replace(TINY, humans=("pursuit", "hand"), policies=("hold", "wander"))
    seeds = study.seeds()
    assert len(seeds) == 16
    firsts: dict = {}
    for setting, some in seeds.items():
        assert some == list(range(some[0], some[0] + 3))
        firsts.setdefault((setting.task, setting.human, setting.policy), set()).add(some[0])
    assert sorted(first for (first,) in firsts.values()) == [5 + SPACING * k for k in range(8)]


@pytest.mark.parametrize("task", ["reach", "handover"])
def test_the_shield_of_the_shielded_id_by_name(task):
    named = put_filter(jssa_gym.ArmEnv(task, terminate_on=()), "shielded")
    ready = gym.make(f"jssa_gym/{task.capitalize()}Shielded-v0", terminate_on=())
    rng, ended = np.random.default_rng(0), []
    for env in (named, ready):
        env.reset(seed=3)
        rng = np.random.default_rng(0)
        for _ in range(150):
            env.step(rng.uniform(-1.0, 1.0, 6))
        ended.append(env.unwrapped.scene.robot.position)
    np.testing.assert_array_equal(*ended)
    assert (named.filter.index.lambda1 == 1.0) == (task == "handover")
    (report,) = complete(Study((task,), ("shielded",), ("receive",), ("hold",), episodes=1, steps=20), None)
    assert report.setting.filter == "shielded"


def test_one_shield_inside_another_is_refused():
    with pytest.raises(ParameterError, match="has a shield already"):
        jssa_gym.evaluate("jssa_gym/ReachShielded-v0", "hold", 1, filter="jssa+stop", steps=5)


@pytest.mark.long
def test_filters_meet_the_same_people(finished):
    folder, reports = finished
    one, other = (next(r for r in reports if r.setting[:2] == ("reach", name)) for name in ("jssa+stop", "none"))
    assert [e.seed for e in one.episodes] == [e.seed for e in other.episodes] == [5, 6, 7]
    stages = [load_trace(folder / "traces" / f"reach-{name}-pursuit-wander-{seed}.npz")
              for name in ("jssa+stop", "none") for seed in (5, 6, 7)
              if (folder / "traces" / f"reach-{name}-pursuit-wander-{seed}.npz").exists()]  # fmt: skip
    assert len(stages) == 4
    by_seed: dict = {}
    for trace in stages:
        by_seed.setdefault(trace.name.split()[-1], []).append(trace)
    pairs = [traces for traces in by_seed.values() if len(traces) == 2]
    assert pairs
    for first, second in pairs:
        np.testing.assert_array_equal(first.initial_human, second.initial_human)
        np.testing.assert_array_equal(first.goal, second.goal)
        np.testing.assert_array_equal(first.nominal[0], second.nominal[0])


@pytest.mark.long
def test_the_shield_shows_in_the_numbers(finished):
    _, reports = finished
    for report in reports:
        moving = report.rates["moving_contact_rate"]
        assert moving.k == (0 if report.setting.filter == "jssa+stop" else 3)
        assert moving == Rate.of(moving.k, 3)
        low, high = stats.binomtest(moving.k, 3).proportion_ci(method="exact")
        assert (moving.low, moving.high) == pytest.approx((low, high), abs=1e-12)
        assert report.means["intervention_rate"].value > 0.1 or report.setting.filter == "none"
        assert report.unlike == ()


@pytest.mark.long
def test_a_metric_is_a_mean_or_a_rate_of_every_episode(finished):
    _, reports = finished
    for report in reports:
        for metric in METRICS:
            values = column(report.episodes, metric.name)
            if metric.yes_or_no:
                assert report.rates[metric.over_episodes].k == values.sum()
            elif np.isfinite(values).any():
                mean = report.means[metric.over_episodes]
                assert mean.value == pytest.approx(values[np.isfinite(values)].mean())
                assert mean.low <= mean.value * (1 + 1e-12) or mean.low <= mean.value + 1e-12
            else:
                assert metric.over_episodes not in report.means
    assert {"collision_rate", "success_rate", "success_and_safe_rate", "timeout_rate"} <= set(reports[0].rates)
    assert "emcc" in reports[0].means


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", [*FILTERS, *(f"{name}+stop" for name in FILTERS)])
def test_every_filter_can_be_put_around_an_environment(name):
    env = put_filter(picklable.environment(), name)
    # the filter "stop" is nothing without the two layers
    layered = name == "stop" or name.endswith("+stop")
    assert (env.filter.failsafe is not None) == env.filter.viability == layered
    env.reset(seed=0)
    env.step(np.zeros(6))


def test_jssa_with_the_stop_is_the_default_shield():
    mine = put_filter(picklable.environment(), "jssa+stop")
    default = jssa_gym.JSSAShield(picklable.environment())
    assert isinstance(mine.filter, JSSAFilter)
    traces = [rollout(env, picklable.push, seed=1, steps=200) for env in (mine, default)]
    assert digest_of(traces[0]) == digest_of(traces[1])
    assert traces[0].intervened.any()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"tasks": ("swim",)}, "unknown task"),
        ({"filters": ("cdf+stop",)}, "unknown filter 'cdf"),
        ({"filters": ()}, "no filters"),
        ({"humans": ("martian",)}, "unknown human"),
        ({"policies": ("wonder",)}, "unknown policy"),
        ({"policies": ("picklable:nothing",)}, "cannot load"),
        ({"policies": ("picklable:__name__",)}, "no factory"),
        ({"policies": ("picklable:push",)}, "called with an environment and a seed: too many positional arguments"),
        ({"episodes": 0}, "episodes"),
        ({"episodes": SPACING + 1}, "episodes"),
        ({"steps": 0}, "steps"),
        ({"seed": -1}, "seed"),
        ({"v_safe": np.nan}, "v_safe"),
    ],
)
def test_a_study_that_cannot_be(change, word):
    with pytest.raises(ParameterError, match=word):
        dataclasses.replace(TINY, **change)


# ---- policies and environments of one's own ----------------------------------------------------------


def test_policies_in_all_their_forms():
    env = picklable.environment()
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(make_policy(picklable.push, env, 0)(observation), np.full(6, 0.3))
    np.testing.assert_array_equal(make_policy(picklable.Model(), env, 0)(observation), np.full(6, 0.3))
    one, two, same = (make_policy("picklable:pushes", env, seed)(observation) for seed in (1, 2, 1))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, two)
    assert make_policy("random", env, 0)(observation).shape == (6,)
    with pytest.raises(ParameterError, match="a policy is"):
        make_policy(3, env, 0)


@pytest.mark.long
def test_a_model_of_stable_baselines_is_a_policy():
    library = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    model = library.PPO("MlpPolicy", picklable.environment(), n_steps=8, batch_size=8, seed=0, device="cpu")
    one, two = (jssa_gym.evaluate(picklable.environment, model, 2, steps=20) for _ in range(2))
    assert [e.digest for e in one.episodes] == [e.digest for e in two.episodes]
    assert one.setting.policy == "PPO"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("env", ["jssa_gym/Reach-v0", picklable.environment, picklable.environment()])
def test_environments_in_all_their_forms(env):
    kwargs = {"human": "walk_by"} if isinstance(env, str) else None
    report = jssa_gym.evaluate(env, picklable.push, 2, 7, env_kwargs=kwargs, filter="jssa+stop", steps=120)
    assert isinstance(report, Report)
    assert [e.seed for e in report.episodes] == [7, 8]
    assert all(e.summary.ep_len == 120 for e in report.episodes)
    assert report.means["intervention_rate"].value > 0.0
    again = jssa_gym.evaluate(picklable.environment, picklable.push, 2, 7, filter="jssa+stop", steps=120)
    assert [e.digest for e in again.episodes] == [e.digest for e in report.episodes]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("jssa_gym/Nope-v0", "hold"), "unknown environment"),
        ((3, "hold"), "env has to be"),
        ((picklable.environment, "x"), "unknown policy"),
        ((picklable.environment, 3), "a policy is"),
        ((picklable.environment, "hold", 0), "episodes"),
        ((picklable.environment, "hold", 1, -1), "seed"),
        ((picklable.environment, "hold", 1, 0, {"filter": "nope"}), "unknown filter 'nope'"),
        ((picklable.environment, "hold", 1, 0, {"separation": 1.6}), "separation"),
        ((picklable.environment, "hold", 1, 0, {"keep": -1}), "keep"),
        (("jssa_gym/Reach-v0", "hold", 1, 0, {"env_kwargs": ["human"]}), "env_kwargs"),
    ],
)
def test_an_evaluation_that_cannot_be(tmp_path, arguments, word):
    *arguments, options = arguments if isinstance(arguments[-1], dict) else (*arguments, {})
    with pytest.raises(ParameterError, match=word):
        jssa_gym.evaluate(*arguments, **options, out=tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_sent_or_told_again_is_refused_before_anything_is_played(tmp_path):
    def local(observation):
        raise AssertionError("played")

    with pytest.raises(ParameterError, match="picklable"):
        jssa_gym.evaluate(picklable.environment, local, 2, jobs=2)
    with pytest.raises(ParameterError, match="shared between processes"):
        jssa_gym.evaluate(picklable.environment(), "hold", 2, jobs=2)
    with pytest.raises(ParameterError, match="told again"):
        jssa_gym.evaluate(picklable.environment, local, 2, out=tmp_path / "x")
    with pytest.raises(ParameterError, match="env_kwargs"):
        jssa_gym.evaluate(picklable.environment, "hold", 2, env_kwargs={"human": "none"})
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InterfaceError, match="ArmEnv"):
        jssa_gym.evaluate("CartPole-v1", picklable.push, 1)


def test_another_policy_does_not_continue_a_folder(tmp_path):
    arguments = {"steps": 10, "out": tmp_path}
    jssa_gym.evaluate(picklable.environment, picklable.push, 2, **arguments)
    jssa_gym.evaluate(picklable.environment, picklable.push, 2, **arguments)
    with pytest.raises(ParameterError, match="other policy"):
        jssa_gym.evaluate(picklable.environment, picklable.Model(), 2, **arguments)


def test_an_episode_that_cannot_be_played_again_is_told(tmp_path):
    report = jssa_gym.evaluate(picklable.environment, picklable.Drifting(), 2, steps=10, out=tmp_path, keep=1)
    assert len(report.unlike) == len(report.traces) == 1


def test_actions_that_are_not_finite_are_counted_apart_from_other_faults():
    report = jssa_gym.evaluate(
        picklable.environment, "picklable:broken_every_third", 2, filter="jssa+stop", steps=10, seed=3
    )
    assert [episode.summary.n_actions_not_finite for episode in report.episodes] == [3, 3]
    assert report.means["fault_rate"].value == pytest.approx(0.3)
    (warning,) = report.warnings
    assert "6 steps of 2 episodes" in warning
    assert warning in str(report)
    assert report.as_dict()["warnings"] == [warning]
    # a fault of the sensor is none of the policy's
    blind = jssa_gym.evaluate(picklable.blind, picklable.push, 1, filter="jssa+stop", steps=300)
    assert blind.means["fault_rate"].value > 0.0
    assert blind.warnings == ()
    assert "warning" not in str(blind)


# ---- resumed, in parallel ----------------------------------------------------------------------------


@pytest.mark.long
def test_two_processes_count_the_same_as_one(finished, tmp_path):
    again = complete(TINY, tmp_path / "two", jobs=2, keep=2)
    for one, other in zip(finished[1], again, strict=True):
        assert one.setting == other.setting
        assert [kept(e) for e in one.episodes] == [kept(e) for e in other.episodes]
        assert [path.name for path in one.traces] == [path.name for path in other.traces]


def test_a_finished_study_is_read_not_played(finished, monkeypatch):
    def fails(*arguments):
        raise AssertionError("played")

    for name in ("record", "measure_all"):
        monkeypatch.setattr(f"jssa_gym.evaluation.play.Player.{name}", fails)
    folder, reports = finished
    seen = []
    assert complete(TINY, folder, keep=2, progress=lambda *count: seen.append(count)) == reports
    assert seen == [(12, 12)]
    told = json.loads((folder / "summary.json").read_text())
    assert [entry["rates"]["collision_rate"]["k"] for entry in told] == [r.rates["collision_rate"].k for r in reports]
    with (folder / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert {metric.name for metric in METRICS} < set(rows[0])
    assert float(rows[0]["min_distance"]) == reports[0].episodes[0].summary.min_distance


KILLED = """
import sys
from pathlib import Path
if __name__ == "__main__":
    from picklable import TINY
    from jssa_gym.evaluation.runner import complete
    complete(TINY, Path(sys.argv[1]))
"""


@pytest.mark.long
def test_a_killed_study_goes_on(finished, tmp_path):
    script, folder = tmp_path / "run.py", tmp_path / "killed"
    script.write_text(KILLED)
    process = subprocess.Popen([sys.executable, str(script), str(folder)], env=environment(), start_new_session=True)
    try:
        table = folder / "episodes.csv"
        deadline = time.monotonic() + PATIENCE
        while not (table.exists() and table.read_bytes().count(b"\n") >= 3):
            assert process.poll() is None, "it ended before it was killed"
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    ledger = Ledger(folder, TINY)
    before = len(ledger.episodes)
    assert 2 <= before < 12
    counts = []
    reports = complete(TINY, folder, keep=2, progress=lambda done, total: counts.append(done))
    assert counts[0] == before
    assert counts[-1] == 12
    for one, other in zip(finished[1], reports, strict=True):
        assert [kept(e) for e in one.episodes] == [kept(e) for e in other.episodes]


def test_a_table_holds_every_kind_of_value(finished, tmp_path):
    episode = finished[1][0].episodes[0]
    summary = dataclasses.replace(episode.summary, time_to_goal=None, min_distance=np.inf, name='a, "b"', success=True)
    odd = dataclasses.replace(episode, summary=summary, seed=7)
    ledger = Ledger(tmp_path, TINY)
    ledger.append([odd, episode])
    assert Ledger(tmp_path, TINY).episodes == [odd, episode]
    with ledger.table.open("a") as file:
        file.write("reach,none\n")
    with pytest.raises(ParameterError, match="cells for"):
        Ledger(tmp_path, TINY)


def test_two_writers_are_told_and_nothing_is_counted_twice(finished, tmp_path):
    first, second = finished[1][0].episodes[:2]
    one, other = (Ledger(tmp_path, TINY) for _ in range(2))
    one.append([first])
    with pytest.raises(ParameterError, match="another process"):
        other.append([first])
    one.append([second])
    assert Ledger(tmp_path, TINY).episodes == [first, second]
    # as an earlier version let two processes leave it
    lines = one.table.read_bytes().splitlines(keepends=True)
    one.table.write_bytes(b"".join([*lines, lines[-1]]))
    with pytest.raises(ParameterError, match="twice"):
        Ledger(tmp_path, TINY)
    one.table.write_bytes(lines[0])
    stranger = Ledger(tmp_path, TINY)
    stranger.append([dataclasses.replace(first, seed=99)])
    with pytest.raises(ParameterError, match="not planned"):
        Ledger(tmp_path, TINY)


@pytest.mark.parametrize("line", [b"\xff\xfe,1\n", b"x" * 200_000 + b"\n"])
def test_a_table_that_is_no_text_is_refused(finished, tmp_path, line):
    ledger = Ledger(tmp_path, TINY)
    ledger.append(finished[1][0].episodes[:1])
    with ledger.table.open("ab") as file:
        file.write(line)
    with pytest.raises(ParameterError, match="no episode"):
        Ledger(tmp_path, TINY)


def test_a_folder_without_episodes_is_anybodys(finished, tmp_path):
    Ledger(tmp_path, TINY)
    other = dataclasses.replace(TINY, seed=6)
    ledger = Ledger(tmp_path, other)
    assert json.loads((tmp_path / "campaign.json").read_text())["seed"] == 6
    ledger.append([dataclasses.replace(finished[1][0].episodes[0], seed=6)])
    with pytest.raises(ParameterError, match="other seed"):
        Ledger(tmp_path, TINY)


def test_a_policy_whose_code_changed_does_not_continue_a_folder(tmp_path, monkeypatch):
    module = tmp_path / "changing.py"
    monkeypatch.syspath_prepend(tmp_path)
    source = "def still(env, seed):\n    return act\n\n\ndef act(observation):\n    return [{}] * 6\n"
    study = dataclasses.replace(TINY, policies=("wander",), filters=("none",), tasks=("reach",), episodes=1, steps=5)
    assert study.config()["code"] == {}
    module.write_text(source.format(0.0))
    study = dataclasses.replace(study, policies=("changing:still",))
    complete(study, tmp_path / "study", keep=0)
    complete(study, tmp_path / "study", keep=0)
    act = sys.modules["changing"].act
    for policy in ("changing:still", act):
        jssa_gym.evaluate(picklable.environment, policy, 1, steps=5, out=tmp_path / f"{policy}", keep=0)
    module.write_text(source.format(0.5))
    with pytest.raises(ParameterError, match="other code"):
        complete(study, tmp_path / "study", keep=0)
    for policy in ("changing:still", act):
        with pytest.raises(ParameterError, match="other code"):
            jssa_gym.evaluate(picklable.environment, policy, 1, steps=5, out=tmp_path / f"{policy}", keep=0)


CAMPAIGN = Campaign((Grid(("full",), ("hand",), ("wander",), ("noise",), 2),), steps=20, judge=0.0)


@pytest.mark.parametrize(
    "plan", [dataclasses.replace(TINY, steps=20), Single(picklable.environment, "wander", steps=20), CAMPAIGN]
)
def test_every_plan_is_played_by_the_same_player(tmp_path, plan):
    cell, (seed, *_) = next(iter(plan.seeds().items()))
    player = Player(plan, cell)
    row, trace = player.measure(seed), player.record(seed)
    assert isinstance(row, plan.row)
    assert (row.cell, row.seed, row.digest, row.broken) == (cell, seed, digest_of(trace), False)
    assert row.wall > 0.0
    assert player.save(trace, seed, tmp_path / "traces") == (tmp_path / "traces" / row.trace_name, row.digest)
    assert read_meta(tmp_path / "traces" / row.trace_name)["seed"] == seed
    in_memory, on_disk = Results(plan), Ledger(tmp_path / "folder", plan)
    for results in (in_memory, on_disk):
        assert sum(len(chunk.seeds) for chunk in results.chunks(2)) == plan.total()
        results.append([row])
        assert results.by_cell() == {one: [row] if one == cell else [] for one in plan.seeds()}
    kept, left = ([chunk._replace(traces=None) for chunk in x.chunks(2)] for x in (on_disk, in_memory))
    assert kept == left
    assert sum(len(chunk.seeds) for chunk in left) == plan.total() - 1
    assert Ledger(tmp_path / "folder", plan).episodes == [row]


@pytest.mark.long
def test_a_chunk_is_a_chunk_whoever_plays_it(tmp_path):
    plan, played = Single(picklable.environment, "wander", episodes=2, steps=20), []
    ledger = Ledger(tmp_path, plan)
    run(play, ledger.chunks(1), 2, played.extend)
    assert sorted(e.seed for e in played) == [0, 1]
    assert played[0].cell == Setting("environment", "", "", "wander")


# ---- the worst episodes ------------------------------------------------------------------------------


def test_what_rounding_leaves_of_speed_at_rest_does_not_make_a_contact_worse(finished):
    episode = finished[1][0].episodes[0]

    def touched(speed, **changes):
        told = {"contact_speed": speed, "moving_contact": speed > 1e-3, "limit_violation_rate": 0.0} | changes
        return dataclasses.replace(episode, summary=dataclasses.replace(episode.summary, **told))

    in_order = [
        touched(1e-15, min_distance=0.1),
        touched(1e-17, min_distance=-0.1),
        touched(0.0, limit_violation_rate=0.1),
        touched(0.2),
    ]
    assert sorted((in_order[k] for k in (3, 1, 0, 2)), key=lambda e: e.severity) == in_order


def test_the_worst_are_kept_and_come_again_bit_for_bit(finished):
    folder, reports = finished
    assert len(list((folder / "traces").iterdir())) == 8
    for report in reports:
        kept_seeds = {read_meta(path)["seed"] for path in report.traces}
        by_speed = sorted(report.episodes, key=lambda e: e.severity, reverse=True)
        assert kept_seeds == {e.seed for e in by_speed[:2]}
    worst = max((r for r in reports if r.setting.filter == "none"), key=lambda r: r.means["contact_speed"].most)
    trace, meta = load_trace(worst.traces[0]), read_meta(worst.traces[0])
    assert trace.contact_speed.max() == worst.means["contact_speed"].most
    again = played_again(meta)
    assert digest_of(again) == digest_of(trace) == meta["digest"]
    for field in dataclasses.fields(trace):
        if field.name != "shield_time":
            np.testing.assert_array_equal(getattr(again, field.name), getattr(trace, field.name))
    limits = picklable.environment().robot.limits
    assert summarise(trace, limits).contact_speed == by_digest(worst, meta).contact_speed


def by_digest(report, meta):
    return next(e.summary for e in report.episodes if e.digest == meta["digest"])


@pytest.mark.parametrize("change", [{"named": False}, {"steps": None}, {"task": "swim"}])
def test_a_recording_that_does_not_say_enough_is_not_played_again(finished, change):
    with pytest.raises(ParameterError):
        played_again({**read_meta(finished[1][0].traces[0]), **change})


# ---- the page ----------------------------------------------------------------------------------------


class _Page(HTMLParser):
    """Checks that tags are balanced, and collects text, links and what would be loaded."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        assert tag not in ("script", "link", "iframe", "img", "object")
        assert "src" not in values
        if tag == "a":
            self.links.append(values["href"])
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        assert "src" not in dict(attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def parsed(html: str) -> _Page:
    seen = _Page()
    seen.feed(html)
    seen.close()
    assert seen.open == []
    return seen


def test_the_page_says_every_number(finished):
    folder, reports = finished
    html = page(TINY, reports, "jssa-gym compare <&>", folder)
    seen = parsed(html)
    text = " ".join(seen.text)
    assert "jssa-gym compare <&>" in text
    for report in reports:
        for number in (*report.rates.values(), *report.means.values()):
            assert str(number) in text
    for one in standings(reports):
        for number in (one.pooled.rates["collision_rate"], one.pooled.means["min_distance_arm"]):
            assert str(number) in text
    for metric in METRICS:
        assert metric.text in text
    assert len(seen.links) == 8
    for link in seen.links:
        assert load_trace(folder / unquote(unescape(link))).name
    assert text.count("jssa-gym replay") == 8
    assert "http" not in html.replace("http://www.w3.org/2000/svg", "")
    assert "nan" not in html.lower().replace("maintenance", "")
    for word in ("safe in reality", "guarantee", "certified", "provably"):
        assert word not in text


def test_no_two_of_thirty_filters_look_alike():
    marks = {marker(k, 0.0, 0.0) for k in range(32)}
    lines = {(colour(k), dashes(k)) for k in range(32)}
    assert len(marks) == len(lines) == 32
    assert "<title>a &lt;b&gt;</title>" in marker(9, 1.0, 2.0, "a <b>")


def test_the_page_has_the_key_beside_its_plots(finished):
    html = page(TINY, finished[1], "x", finished[0])
    for title in ("Over everything", "Safety against getting there", "Performance profiles"):
        section = html.split(f"<h2>{title}</h2>")[1].split("<h2>")[0]
        assert section.startswith(legend({name: k for k, name in enumerate(TINY.filters)}))


def test_names_are_escaped(finished):
    report = finished[1][0]
    episodes = tuple(dataclasses.replace(e, policy="<b>&'") for e in report.episodes)
    odd = dataclasses.replace(TINY, tasks=("reach",), filters=("jssa+stop",))
    html = page(odd, [Report.of(episodes)], "x", Path())
    assert "<b>" not in html
    parsed(html)


def test_filters_are_compared_on_the_same_episodes(finished):
    reports = finished[1]
    best, other = standings(reports)
    assert (best.filter, other.filter) == ("jssa+stop", "none")
    assert best.rates == {}
    assert set(other.rates) == set(PAIRED_RATES)
    assert (other.rates["moving_contact"].first_only, other.rates["moving_contact"].n) == (6, 6)
    differences = [
        b.summary.min_distance_arm - a.summary.min_distance_arm
        for a, b in zip(best.pooled.episodes, other.pooled.episodes, strict=True)
    ]
    assert other.means["min_distance_arm"].value == pytest.approx(np.mean(differences))
    with pytest.raises(ParameterError, match="same episodes"):
        standings([reports[0], dataclasses.replace(reports[1], episodes=reports[1].episodes[:2])])


def test_ticks_are_round_and_panels_stand_degenerate_data():
    assert ticks(0.0, 1.0) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks(-0.03, 0.12) == pytest.approx([0.0, 0.05, 0.1])
    for x in ((0.0, 0.0), (1e6, 1e6), (-1e-12, 1e-12)):
        panel = Panel(x, (1.5, -0.5), "x", "<y>", names=("a<", "b"))
        panel.box(0, [x[0]] * 5, 0, "&")
        panel.curve(np.array([x[0]]), np.array([0.0]), 9, "t")
        parsed(panel.drawn())
        assert "nan" not in panel.drawn()


# ---- RecordSafety ------------------------------------------------------------------------------------


def test_saved_recordings_and_records_agree_with_reports(tmp_path):
    env = RecordSafety(put_filter(picklable.environment(), "jssa+stop"))
    trace = rollout(env, picklable.push, seed=0, steps=30)
    save_trace(trace, tmp_path / "x.npz")
    assert load_trace(tmp_path / "x.npz").ended == "running"
    assert len(env.recent) == 0


# ---- documentation -----------------------------------------------------------------------------------


def test_the_tables_of_metrics_are_made_from_the_code():
    make = runpy.run_path(str(DOCS / "make_tables.py"))
    text = (DOCS / "metrics.md").read_text()
    assert make["filled"]("metrics.md", text) == text, "run docs/make_tables.py"
    for metric in METRICS:
        assert f"| `{metric.name}` |" in text


def test_the_numbers_of_the_page_on_intervals_are_right():
    text = (DOCS / "evaluation.md").read_text()
    assert str(Rate.of(3, 200)) in text
    assert str(Rate.of(0, 200)) in text
    assert Rate.of(0, 3700).high < 1e-3 < Rate.of(0, 3600).high
