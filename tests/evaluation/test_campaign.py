"""Campaigns: paired, reproducible, resumable; every weakened shield is broken, and the whole one is not."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from places import PATIENCE, environment

from jssa_gym import plots
from jssa_gym.cli.stress import Stress, curves, unusual_options
from jssa_gym.engine.source import source_hash
from jssa_gym.engine.workers import run
from jssa_gym.envs import ArmEnv
from jssa_gym.envs.arm import MOVING
from jssa_gym.envs.faults import FAULTS as SENSOR_FAULTS
from jssa_gym.evaluation.campaign import PRESETS, Campaign, Grid, drawn
from jssa_gym.evaluation.contenders import (
    CONTENDERS,
    FAULTS,
    JOINTS,
    LATENCIES,
    REPORTED,
    Ageless,
    Late,
    shielded,
    within_assumptions,
)
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.judgement import Excess
from jssa_gym.evaluation.ledger import Ledger
from jssa_gym.evaluation.people import PEOPLE, TOO_FAST
from jssa_gym.evaluation.plan import SPACING
from jssa_gym.evaluation.play import Player, play
from jssa_gym.evaluation.report import tally
from jssa_gym.evaluation.rows import Cell, digest_of
from jssa_gym.evaluation.trace import load_trace, read_meta
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import make_human
from jssa_gym.policies import POLICIES

TINY = Campaign(
    (Grid(("full", "unshielded"), ("pursuit", "hand"), ("wander",), ("none", "latency 100 ms"), 1),),
    steps=350,
    judge=0.3,
)


def kept(episode):
    """What must not depend on time or process."""
    return replace(episode, wall=0.0)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A finished campaign's folder, and its episodes."""
    folder = tmp_path_factory.mktemp("campaign") / "tiny"
    ledger = Ledger(folder, TINY)
    run(play, ledger.chunks(10), 1, ledger.append)
    return folder, ledger.episodes


@pytest.mark.long
def test_a_campaign_plays_every_combination_and_the_unshielded_arm_collides(finished, robot):
    folder, episodes = finished
    assert len({(e.cell, e.seed) for e in episodes}) == len(episodes) == 8
    for e in episodes:
        assert e.steps == 350 == e.nominal + e.projected + e.relaxed + e.failsafe + e.faulty
        assert e.joint_speed > 0.05
    unshielded, full = ([e for e in episodes if e.filter == name] for name in ("unshielded", "full"))
    assert any(e.moving_contact and e.contact_speed > 0.1 for e in unshielded)
    assert not any(e.moving_contact or e.violations or e.broken for e in full)
    assert any(e.contact for e in full)
    assert all(e.nominal == 350 and e.interventions == 0 for e in unshielded)
    assert all(e.interventions > 0 for e in full)
    assert any(e.judged for e in episodes)
    assert all(e.agrees for e in episodes)
    assert all(e.first_fault and e.faulty for e in full if e.fault != "none")
    assert sorted(path.name for path in folder.iterdir()) == ["campaign.json", "episodes.csv"]


def test_what_is_on_disk_is_what_was_played(finished):
    folder, episodes = finished
    again = Ledger(folder, TINY)
    assert again.episodes == episodes
    assert again.chunks(10) == []
    config = json.loads((folder / "campaign.json").read_text())
    assert config["source"] == source_hash()
    assert config["grids"][0]["humans"] == ["pursuit", "hand"]


def test_a_campaign_goes_on_after_a_crash_in_the_middle_of_a_line(finished, tmp_path):
    folder, episodes = finished
    shutil.copytree(folder, tmp_path / "cut")
    table = tmp_path / "cut" / "episodes.csv"
    whole = table.read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    table.write_bytes(whole[: (last + len(whole)) // 2])
    ledger = Ledger(tmp_path / "cut", TINY)
    assert ledger.episodes == episodes[:-1]
    assert table.read_bytes() == whole[:last]
    (chunk,) = ledger.chunks(10)
    assert (chunk.cell, list(chunk.seeds)) == (episodes[-1].cell, [episodes[-1].seed])
    run(play, [chunk], 1, ledger.append)
    assert [kept(e) for e in ledger.episodes] == [kept(e) for e in episodes]
    assert Ledger(tmp_path / "cut", TINY).chunks(10) == []
    # not even the header was finished
    table.write_bytes(whole[:20])
    ledger = Ledger(tmp_path / "cut", TINY)
    assert (ledger.episodes, len(ledger.chunks(1))) == ([], 8)
    ledger.append(episodes)
    assert table.read_bytes() == whole


@pytest.mark.long
def test_two_processes_play_the_same_as_one(finished, tmp_path):
    ledger = Ledger(tmp_path / "two", TINY)
    run(play, ledger.chunks(1), 2, ledger.append)
    assert [kept(e) for some in ledger.by_cell().values() for e in some] == [kept(e) for e in finished[1]]
    assert len({e.digest for e in ledger.episodes}) == 8


@pytest.mark.parametrize("field", ["grids", "steps", "seed", "judge", "task", "version"])
def test_a_folder_of_another_campaign_is_refused(finished, monkeypatch, field):
    other = {
        "grids": (replace(TINY.grids[0], episodes=2),),
        "steps": 351,
        "seed": 1,
        "judge": 0.31,
        "task": "reach",
    }
    campaign = replace(TINY, **{field: other[field]}) if field in other else TINY
    if field == "version":
        monkeypatch.setattr("jssa_gym.evaluation.ledger.package_version", lambda: "other")
    before = (finished[0] / "episodes.csv").read_bytes()
    with pytest.raises(ParameterError, match=f"other {field}"):
        Ledger(finished[0], campaign)
    assert (finished[0] / "episodes.csv").read_bytes() == before


def test_a_broken_episode_s_command_plays_that_episode():
    assert unusual_options(replace(TINY, steps=1000)) == ""
    assert unusual_options(replace(TINY, task="reach", robot="ur5e")) == " --task reach --robot ur5e --seconds 2.8"


@pytest.mark.long
def test_workers_end_with_a_parent_that_was_killed():
    code = "from picklable import lasting; from jssa_gym.engine.workers import run; run(lasting, range(2), 2, id)"
    with subprocess.Popen([sys.executable, "-c", code], env=environment(), stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        try:
            parent.kill()
            # they hold the pipe's other end: it is closed when the last of them is gone
            parent.communicate(timeout=PATIENCE)
        finally:
            for worker in workers:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGKILL)


def test_other_code_is_refused(finished, monkeypatch):
    monkeypatch.setattr("jssa_gym.evaluation.ledger.source_hash", lambda: "other")
    with pytest.raises(ParameterError, match="other source"):
        Ledger(finished[0], TINY)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("campaign.json", "{", "no campaign's"),
        ("campaign.json", "[]", "no campaign's"),
        ("campaign.json", "{}", "no campaign's"),
        ("episodes.csv", "a,b\n", "other columns"),
        ("episodes.csv", "+full,x\n", "no episode"),
    ],
)
def test_a_damaged_folder_is_refused(finished, tmp_path, name, content, message):
    shutil.copytree(finished[0], tmp_path / "bad")
    path = tmp_path / "bad" / name
    text = path.read_text()
    path.write_text(text + content[1:] if content.startswith("+") else content)
    with pytest.raises(ParameterError, match=message):
        Ledger(tmp_path / "bad", TINY)


def test_a_table_without_a_campaign_is_refused(tmp_path):
    (tmp_path / "episodes.csv").write_text("mine\n")
    with pytest.raises(ParameterError, match="belongs to no campaign"):
        Ledger(tmp_path, TINY)
    assert [path.name for path in tmp_path.iterdir()] == ["episodes.csv"]


def test_an_interrupt_leaves_what_was_played(finished, tmp_path):
    ledger, seen = Ledger(tmp_path, TINY), []

    def interrupted(episodes):
        ledger.append(episodes)
        seen.extend(episodes)
        if len(seen) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(play, ledger.chunks(1), 1, interrupted)
    again = Ledger(tmp_path, TINY)
    assert again.episodes == seen
    assert sum(len(chunk.seeds) for chunk in again.chunks(3)) == 6


# ---- seeds -------------------------------------------------------------------------------------------


def test_seeds_are_the_same_for_all_shields_and_others_for_everything_else():
    seeds = Campaign(
        (
            Grid(("full", "unshielded"), ("hand", "pursuit"), ("hold", "wander"), ("none", "noise"), 3),
            Grid(("stop",), ("pursuit",), ("wander",), ("noise",), 5),
        ),
        seed=7,
    ).seeds()
    assert len(seeds) == 17
    firsts = {}
    for cell, drawn_seeds in seeds.items():
        assert drawn_seeds == list(range(drawn_seeds[0], drawn_seeds[0] + len(drawn_seeds)))
        firsts.setdefault(cell[1:], set()).add(drawn_seeds[0])
    assert {len(first) for first in firsts.values()} == {1}
    assert sorted(first for (first,) in firsts.values()) == [7 + SPACING * k for k in range(8)]
    assert len(seeds[Cell("stop", "pursuit", "wander", "noise")]) == 5


def test_shields_meet_the_same_people_and_policies():
    campaign = Campaign(TINY.grids, steps=30)
    one, other = (Player(campaign, Cell(name, "walk_by", "random", "noise")) for name in ("unshielded", "full"))
    first, second, another = one.record(5), other.record(5), one.record(6)
    np.testing.assert_array_equal(first.human_start, second.human_start)
    np.testing.assert_array_equal(first.nominal, second.nominal)
    assert not np.array_equal(first.human_start, another.human_start)
    assert not np.array_equal(first.nominal, another.nominal)
    seen = [shielded(ArmEnv(human="walk_by"), name, "noise") for name in ("stop", "full")]
    for env in seen:
        env.reset(seed=5)
    starts = [env.get_wrapper_attr("scene").human.start for env in seen]
    np.testing.assert_array_equal(*starts)
    assert not np.array_equal(starts[0], seen[0].unwrapped.scene.human.start)


def test_a_share_of_the_episodes_is_drawn_once_and_for_all():
    cell = Cell("full", "hand", "hold", "none")
    chosen = [drawn(cell, seed, 0.1) for seed in range(5000)]
    assert 400 < sum(chosen) < 600
    assert chosen == [drawn(cell, seed, 0.1) for seed in range(5000)]
    assert all(drawn(cell, seed, 0.2) for seed in np.flatnonzero(chosen).tolist())
    assert not any(drawn(cell, seed, 0.0) for seed in range(100))
    assert all(drawn(cell, seed, 1.0) for seed in range(100))


# ---- who takes part ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CONTENDERS)
def test_every_shield_can_be_played(name):
    episode = Player(Campaign(TINY.grids, steps=4), Cell(name, "hand", "random", "noise")).measure(0)
    assert episode.steps == 4


@pytest.mark.sampled(25)
@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_can_be_played(fault):
    episode = Player(Campaign(TINY.grids, steps=4), Cell("full", "two", "hold", fault)).measure(0)
    assert episode.steps == 4


def test_people_are_as_fast_as_their_name_says():
    for name, make in PEOPLE.items():
        bound = make_human(make()).speed_bound
        assert (bound > (2.0 if "hand" in name else 1.6) + 1e-9) == (name in TOO_FAST)
    assert make_human(PEOPLE["two"]()).people == 2
    assert PEOPLE["hand x3"]().speed_bound == 6.0


def test_what_is_within_the_assumptions():
    assert {name for name in SENSOR_FAULTS if SENSOR_FAULTS[name].reported} == set(REPORTED) - {"missed ticks"}
    assert within_assumptions("pursuit x1", "missed ticks")
    assert within_assumptions("two", "unmodelled 0 ms")
    assert not within_assumptions("pursuit x1.25", "none")
    assert not within_assumptions("pursuit", "unmodelled 50 ms")
    assert not within_assumptions("pursuit", "silent freeze")
    assert within_assumptions("hand", "people and joints")
    assert set(JOINTS) == {name for name, faults in SENSOR_FAULTS.items() if faults.joints}
    for name in ("claim", "quick", "joints"):
        for grid in PRESETS[name]:
            assert all(within_assumptions(h, f) for h in grid.humans for f in grid.faults)
    assert sum(len(seeds) for seeds in Campaign(PRESETS["claim"]).seeds().values()) >= 10_000
    baselines = {"jpc", "jpc_paper", "straight"}  # not out for trouble
    assert set(PRESETS["claim"][0].policies) == set(POLICIES) - baselines
    assert {f"unmodelled {ms} ms" for ms in LATENCIES} < set(FAULTS)
    assert {cell.filter for grid in PRESETS["power"] for cell in grid.cells()} >= {
        name for name, contender in CONTENDERS.items() if contender.without
    }


def test_a_late_scene_shows_people_of_the_past_as_present():
    env = Late(ArmEnv(human="walk_by"), 3)
    env.reset(seed=0)
    truth = [env.unwrapped.scene.human.start]
    for k in range(1, 8):
        env.step(np.zeros(6))
        truth.append(env.unwrapped.scene.human.start)
        np.testing.assert_array_equal(env.scene.human.start, truth[max(k - 3, 0)])
        assert env.scene.time == env.unwrapped.scene.time
        assert not env.scene.age.any()
    env.reset(seed=1)
    np.testing.assert_array_equal(env.scene.human.start, env.unwrapped.scene.human.start)


def test_an_ageless_scene_says_that_all_is_fresh():
    env = Ageless(Late(shielded(ArmEnv(human="walk_by"), "none", "latency 100 ms"), 0))
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros(6))
    assert not env.scene.age.any()
    assert env.env.scene.age.min() == pytest.approx(0.096, abs=0.01)


BROKEN = {
    "no_speed": ("pursuit", "wander", "none"),
    "no_age": ("pursuit", "wander", "latency 100 ms"),
    "no_lag": ("pursuit", "wander", "none"),
    "no_joint_check": ("pursuit", "bang_bang", "stale joints"),
    "no_verification": ("pursuit", "wander", "none"),
    "off_by_one": ("pursuit", "wander", "none"),
    "no_limits": ("approach_retreat", "limit_seeking", "none"),
    "no_limit_check": ("approach_retreat", "limit_seeking", "none"),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", BROKEN)
def test_a_missing_guard_shows_and_the_whole_shield_stands_the_same_episode(name):
    def first_broken(shield, seeds):
        player = Player(Campaign(TINY.grids, steps=500), Cell(shield, *BROKEN[name]))
        return next(
            (e for e in map(player.measure, seeds) if (e.violations if "limit" in name else e.moving_contact)), None
        )

    episode = first_broken(name, range(5))
    assert episode is not None
    assert first_broken("lag" if name == "no_lag" else "full", [episode.seed]) is None


@pytest.mark.long
@pytest.mark.parametrize("fault", JOINTS)
def test_wrong_joint_readings_break_a_shield_that_believes_them_and_not_the_whole_one(fault):
    def play(shield):
        # the milder ones need longer
        player = Player(Campaign(TINY.grids, steps=500), Cell(shield, "pursuit", "bang_bang", fault))
        return (player.measure(seed) for seed in range(3))

    whole = list(play("full"))
    assert not any(episode.broken or episode.exceeds for episode in whole)
    weakened = play("no_joint_check")  # up to the first that shows it
    if fault == "rare joint faults":
        assert any(a.digest != b.digest for a, b in zip(whole, weakened, strict=True))
    else:
        assert any(episode.touched_moving or episode.exceeds for episode in weakened)


def test_a_campaign_does_not_say_what_it_expects(tmp_path, caplog):
    def said(fault):
        campaign = Campaign((Grid(("full",), ("hand",), ("wander",), (fault,), 1),), steps=60)
        (chunk,) = Ledger(tmp_path / fault, campaign).chunks(1)
        caplog.clear()
        assert len(list(play(chunk))) == 1
        return [record.message for record in caplog.records]

    assert said("noisy joints") == []
    # elsewhere it is said
    player = Player(Campaign(TINY.grids, steps=60), Cell("full", "hand", "wander", "noisy joints"))
    player.measure(0)
    assert any("not where the applied jerks lead" in record.message for record in caplog.records)


# ---- the second judge --------------------------------------------------------------------------------


def test_a_disagreement_is_counted_and_its_recording_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("jssa_gym.evaluation.campaign.digest_of", lambda trace: str(np.random.default_rng().random()))
    campaign = Campaign((Grid(("full",), ("hand",), ("wander",), episodes=3),), steps=20, judge=1.0)
    ledger = Ledger(tmp_path, campaign)
    run(play, ledger.chunks(5), 1, ledger.append)
    assert all(e.judged and not e.agrees and e.broken for e in ledger.episodes)
    files = {e.trace_name for e in ledger.episodes}
    assert {path.name for path in ledger.traces.iterdir()} == files
    trace = load_trace(ledger.traces / ledger.episodes[0].trace_name)
    assert len(trace.time) == 20
    meta = read_meta(ledger.traces / ledger.episodes[0].trace_name)
    assert meta["seed"] == ledger.episodes[0].seed
    assert meta["source"] == source_hash()
    ledger.keep_worst(ledger.episodes, 1)
    assert len(list(ledger.traces.iterdir())) == 1


def test_what_mujoco_sees_between_ticks_counts():
    episode = Player(Campaign(TINY.grids, steps=5), Cell("full", "hand", "hold", "none")).measure(0)
    assert not episode.broken
    for change in (
        {"judged_speed": 2.0 * MOVING},
        {"judged_excess": 1e-6},
        {"overlaps": 1},
        {"moving_contact": True},
        {"violations": 1},
    ):
        assert replace(episode, **change).broken
        assert not replace(episode, filter="unshielded", **change).broken
        assert not replace(episode, human="pursuit x2", **change).broken
    assert replace(episode, filter="unshielded", agrees=False).broken
    rows = tally([episode, replace(episode, judged=True, judged_speed=0.2, judged_excess=0.1)], ("filter", "human"))
    assert [(row.group, row.moving.k, row.violations.k, row.contact_speed, row.excess) for row in rows] == [
        (("full", "hand"), 1, 1, 0.2, 0.1)
    ]


def test_an_honest_episode_is_judged_alike(robot):
    player = Player(Campaign(TINY.grids, steps=60), Cell("unshielded", "hand", "wander", "noise"))
    episode = player.measure(3)
    trace = player.record(3)
    judged = player.plan.judged(episode, trace, judge(trace, robot))
    assert judged.agrees
    assert judged.judged
    assert episode.digest == digest_of(trace)
    velocity = trace.velocity.copy()
    velocity[30, 2] = np.nextafter(velocity[30, 2], 9.0)
    assert episode.digest != digest_of(replace(trace, velocity=velocity))
    assert episode.min_distance == trace.distance.min()
    limits = robot.limits
    still = np.zeros((3, 3, robot.n))
    assert max(Excess.of(still, still[0], limits)) < 0.0
    low, high = limits.position.T
    for row, value in enumerate((high + 0.5 * (high - low), 1.5 * limits.velocity, 1.5 * limits.acceleration)):
        beyond = still.copy()
        beyond[1, row] = -value if row else value
        assert max(Excess.of(beyond, still[0], limits)) == pytest.approx(0.5)
    assert max(Excess.of(still, still[0] + 1.5 * limits.jerk, limits)) == pytest.approx(0.5)


# ---- bad input, figure -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"filters": ("ful",)}, "unknown filter 'ful'; valid: full"),
        ({"humans": ("martian",)}, "unknown human"),
        ({"policies": ("x",)}, "unknown policy"),
        ({"faults": ()}, "no faults"),
        ({"episodes": 0}, "episodes"),
        ({"episodes": SPACING + 1}, "episodes"),
    ],
)
def test_a_grid_of_what_is_not_there(change, word):
    with pytest.raises(ParameterError, match=word):
        replace(TINY.grids[0], **change)


@pytest.mark.parametrize("change", [{"task": "x"}, {"steps": 0}, {"seed": -1}, {"seed": 0.5}, {"judge": 1.1}])
def test_a_campaign_that_cannot_be(change):
    with pytest.raises(ParameterError, match=next(iter(change))):
        replace(TINY, **change)


def test_unknown_columns_are_refused(finished):
    with pytest.raises(ParameterError, match="column"):
        tally(finished[1], ("colour",))


def test_a_broken_promise_is_exit_code_1_and_an_interrupt_130(tmp_path, monkeypatch, capsys):
    command = Stress(filters=("full",), humans=("hand",), policies=("hold",), faults=("none",), seconds=0.1)
    command = replace(command, out=tmp_path / "a")
    command.run()
    told = capsys.readouterr()
    assert "1 episode of" in told.out
    assert f"wrote episodes.csv to {tmp_path / 'a'}" in told.err
    table = tmp_path / "a" / "episodes.csv"
    header, row = table.read_text().splitlines()
    cells = row.split(",")
    cells[header.split(",").index("moving_contact")] = "1"
    table.write_text(f"{header}\n{','.join(cells)}\n")
    with pytest.raises(SystemExit) as caught:
        command.run()
    assert caught.value.code == 1
    assert "--humans 'hand'" in capsys.readouterr().out

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("jssa_gym.cli.stress.finish", interrupted)
    with pytest.raises(SystemExit) as caught:
        replace(command, out=tmp_path / "b").run()
    assert caught.value.code == 130


def test_a_degradation_has_a_point_a_level(finished):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    episode = replace(finished[1][0], moving_contact=False, contact_speed=0.0, judged_speed=0.0)
    episodes = [
        *(replace(episode, human=f"pursuit x{m:g}", moving_contact=m > 1.5, contact_speed=m) for m in (2.0, 1.0)),
        *(replace(episode, fault=f"unmodelled {ms} ms", moving_contact=ms > 0) for ms in (0, 50, 50)),
    ]
    fast, late = curves(episodes)
    assert (fast.level, fast.rate, fast.speed) == ([1.0, 2.0], [0.0, 1.0], [1.0, 2.0])
    assert (late.level, late.rate) == ([0.0, 50.0], [0.0, 1.0])
    assert all(low <= rate <= high for low, rate, high in zip(late.low, late.rate, late.high, strict=True))
    figure = plots.degradation(fast, late)
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), fast.rate)
    np.testing.assert_array_equal(figure.axes[3].lines[0].get_ydata(), late.speed)


def test_play_keeps_no_recording_of_what_was_right(tmp_path):
    campaign = Campaign((Grid(("full",), ("hand",), ("wander",), episodes=1),), steps=20, judge=1.0)
    (chunk,) = Ledger(tmp_path, campaign).chunks(5)
    (episode,) = play(chunk)
    assert episode.judged
    assert episode.agrees
    assert not chunk.traces.exists()


def test_a_campaign_s_jpc_offers_the_shield_its_path() -> None:
    """It looks at the bare environment; the shield that takes the path is around it."""
    campaign = Campaign((Grid(("stop",), ("none",), ("jpc",)),), task="reach")
    (cell,) = campaign.seeds()
    env = campaign.make_env(cell)
    policy, choices = campaign.make_policy(cell, env, 0), set()
    observation, _ = env.reset(seed=0)
    for _ in range(60):
        observation, *_, info = env.step(policy(observation))
        choices.add(info["shield/choice"])
    assert 0 in choices
