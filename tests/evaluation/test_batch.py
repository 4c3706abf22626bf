"""Episodes played many at once come, bit for bit, to what they come to one by one."""

from dataclasses import fields, replace

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym import JSSAShield, Shield
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.envs.sensor import SensorModel
from jssa_gym.evaluation.batch import at_once, vector_like
from jssa_gym.evaluation.campaign import Campaign, Grid
from jssa_gym.evaluation.contenders import JOINTS, NO_SENSOR, REPORTED
from jssa_gym.evaluation.ledger import Chunk, Ledger, Results
from jssa_gym.evaluation.metrics import Summary
from jssa_gym.evaluation.play import Player, play
from jssa_gym.evaluation.rollout_vector import rollouts
from jssa_gym.evaluation.runner import finish
from jssa_gym.evaluation.study import Single, Study
from jssa_gym.humans import Nobody
from jssa_gym.policies import shipped_policies
from jssa_gym.policies.vector import VECTOR_POLICIES, VectorRandom, make_vector_policy
from jssa_gym.shields import SafetyFilter

TIMED = ("shield_p50", "shield_p95", "shield_p99", "shield_max", "deadline_miss_rate")
"""What depends on how fast this machine is just now."""

SEEDS = range(5, 9)

CELLS = [
    ("reach", "none", "walk_by", "random", 60),
    ("reach", "jssa+stop", "pursuit", "random", 250),
    ("home", "work", "hand", "random", 150),
    ("track", "cbf", "two", "random", 60),
    ("handover", "stop", "receive", "straight", 60),
    ("reach", "jssa_published", "recorded", "random", 40),
    ("track", "stop", "none", "straight", 40),
    *(("reach", "jssa+stop", "walk_by", policy, 120) for policy in VECTOR_POLICIES),
    *((name.partition("-")[0], "stop", "random", name, 60) for name in shipped_policies()),
]


def timeless(row):
    """A row without what depends on how fast this machine is just now."""
    if isinstance(getattr(row, "summary", None), Summary):
        row = replace(row, summary=replace(row.summary, **dict.fromkeys(TIMED, 0.0)))
    return replace(row, wall=0.0)


def study(task, name, human, policy, steps, **more):
    return Study((task,), (name,), (human,), (policy,), steps=steps, episodes=len(SEEDS), seed=SEEDS[0], **more)


def played(plan):
    """The rows of a plan's only cell as they are played, and as each episode comes to by itself."""
    ((cell, seeds),) = plan.seeds().items()
    player = Player(plan, cell)
    return list(play(Chunk(plan, cell, seeds, None))), [player.measure(seed) for seed in seeds]


@pytest.fixture
def never_alone(monkeypatch):
    """Says when episodes begin to be played one by one."""
    alone, single = [], Player.record

    def record(self, seed):
        alone.append(seed)
        return single(self, seed)

    monkeypatch.setattr(Player, "record", record)
    return alone


# ---- the same ----------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("task", "name", "human", "policy", "steps"), CELLS)
def test_recordings_are_those_of_single_episodes(task, name, human, policy, steps):
    plan = study(task, name, human, policy, steps)
    ((cell, seeds),) = plan.seeds().items()
    player = Player(plan, cell)
    envs = vector_like(player.env, len(seeds))
    driven = policy if policy in VECTOR_POLICIES else plan.make_policy(cell, player.env, 0)
    draws = [10**9 + seed for seed in seeds]
    traces = rollouts(envs, make_vector_policy(driven, envs), seeds, draws, [""] * len(seeds), steps=steps)
    intervened = touched = False
    for seed, (trace, took) in zip(seeds, traces, strict=True):
        single = player.record(seed)
        for field in fields(trace):
            one, other = getattr(trace, field.name), getattr(single, field.name)
            if field.name == "shield_time":
                assert (one > 0.0).all()
            elif field.name != "name":
                np.testing.assert_array_equal(one, other, err_msg=f"{field.name}, seed {seed}")
                assert getattr(one, "dtype", None) == getattr(other, "dtype", None), field.name
        assert took > 0.0
        intervened |= bool(trace.intervened.any())
        touched |= bool(trace.contact.any())
    if human == "pursuit":
        assert intervened
        assert touched


@pytest.mark.sampled(2)
@pytest.mark.parametrize("fault", [name for name in (*REPORTED, *JOINTS, "swapped identities") if name != NO_SENSOR])
def test_what_sensors_show_is_what_single_ones_show(fault, never_alone):
    # those of the joints one by one, the others in arrays
    plan = Campaign((Grid(("full",), ("two",), ("wander",), (fault,), 4),), steps=90, judge=0.0)
    ((cell, seeds),) = plan.seeds().items()
    rows = list(play(Chunk(plan, cell, seeds, None)))
    assert never_alone == []
    player = Player(plan, cell)
    assert list(map(timeless, rows)) == [timeless(player.measure(seed)) for seed in seeds]
    assert sum(row.nominal for row in rows) < 4 * 90


@pytest.mark.parametrize(
    ("name", "fault"), [("lag", "noise"), ("no_age", "latency 100 ms"), ("full", "unmodelled 50 ms")]
)
def test_sensors_in_a_row_show_what_single_ones_show(name, fault, never_alone):
    plan = Campaign((Grid((name,), ("hand",), ("random",), (fault,), 4),), steps=60, judge=0.0)
    ((cell, seeds),) = plan.seeds().items()
    rows = list(play(Chunk(plan, cell, seeds, None)))
    assert never_alone == []
    player = Player(plan, cell)
    assert list(map(timeless, rows)) == [timeless(player.measure(seed)) for seed in seeds]


def test_rows_are_those_of_single_episodes(never_alone):
    plan = study("reach", "jssa+stop", "pursuit", "random", 250)
    ((cell, seeds),) = plan.seeds().items()
    rows = list(play(Chunk(plan, cell, seeds, None)))
    assert never_alone == []
    player = Player(plan, cell)
    assert list(map(timeless, rows)) == [timeless(player.measure(seed)) for seed in seeds]
    assert all(row.wall > 0.0 and row.summary.shield_p50 > 0.0 for row in rows)
    assert any(row.summary.collision for row in rows)


def test_episodes_end_when_they_would_alone(never_alone):
    kwargs = {"human": "pursuit", "terminate_on": ("contact",)}
    plan = Single("jssa_gym/ReachShielded-v0", "random", kwargs, episodes=5, steps=300)
    ((cell, seeds),) = plan.seeds().items()
    rows = list(play(Chunk(plan, cell, seeds, None)))
    assert never_alone == []
    player = Player(plan, cell)
    assert list(map(timeless, rows)) == [timeless(player.measure(seed)) for seed in seeds]
    assert len({row.summary.ep_len for row in rows}) > 1


# ---- one by one --------------------------------------------------------------------------------------


class Still(Nobody):
    """Nobody, but of a user's own."""


class Own(ArmEnv):
    """An environment of a user's own."""


class Braking(SafetyFilter):
    """A filter of a user's own."""

    def respond(self, tick):
        return self.failed(tick, "always")


class Listening(gym.Wrapper):
    """A wrapper of a user's own."""


class Changed(type(Shield(ArmEnv(), "stop").filter)):
    """A compiled filter whose decisions a user has changed."""

    def decide(self, scene, nominal, path=None):
        return super().decide(scene, nominal, path)


def changed():
    env = ArmEnv("reach")
    return Shield(env, Changed(env.robot, env.dt))


SINGULAR = {
    "camera": lambda: Shield(SensorModel(ArmEnv("reach"), "camera 30 Hz"), "stop"),
    "sensor without a stop": lambda: Shield(SensorModel(ArmEnv("reach"), "noise"), "jssa"),
    "servo": lambda: ArmEnv("reach", dynamics="servo"),
    "osqp": lambda: JSSAShield(ArmEnv("reach"), options={"projector": "osqp"}),
    "people": lambda: ArmEnv("reach", human=Still()),
    "environment": lambda: Own("reach"),
    "filter": lambda: Shield(ArmEnv("reach"), Braking(ArmEnv().robot, 0.008)),
    "decisions": changed,
    "wrapper": lambda: JSSAShield(Listening(ArmEnv("reach"))),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("what", SINGULAR)
def test_what_is_asked_in_python_is_asked_one_by_one(what):
    assert vector_like(SINGULAR[what](), 4) is None
    rows, single = played(Single(SINGULAR[what], "random", episodes=4, steps=5))
    assert list(map(timeless, rows)) == list(map(timeless, single))


def zeros(env, seed):
    return lambda observation: np.zeros(6)


@pytest.mark.parametrize("policy", [lambda observation: np.zeros(6), f"{__name__}:zeros"], ids=["callable", "name"])
def test_policies_of_ones_own_are_asked_one_by_one(policy):
    rows, single = played(Single("jssa_gym/Reach-v0", policy, episodes=4, steps=5))
    assert list(map(timeless, rows)) == list(map(timeless, single))


def test_an_action_that_is_refused_is_refused_to_the_episode_whose_it_is(monkeypatch, never_alone):
    class Broken(VectorRandom):
        def __call__(self, observation):
            return np.full((len(observation), 6), np.nan)

    monkeypatch.setitem(VECTOR_POLICIES, "random", Broken)
    plan = Single("jssa_gym/Reach-v0", "random", episodes=4, steps=5)
    rows = list(play(Chunk(plan, plan.setting, range(4), None)))
    assert never_alone == [row.seed for row in rows] == [0, 1, 2, 3]


def test_as_many_are_played_at_once_as_there_is_room_for():
    assert [at_once(steps) for steps in (1, 1000, 10_000, 10**6)] == [64, 64, 6, 1]


def test_more_episodes_make_a_chunk_where_they_are_played_at_once():
    plan = Study(("reach",), ("none",), ("walk_by",), ("random", f"{__name__}:zeros"), episodes=100, steps=4)
    results, given = Results(plan), []
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("jssa_gym.evaluation.runner.run", lambda play, chunks, jobs, done: given.extend(chunks))
        finish(results, 1, None)
    sizes = [[len(chunk.seeds) for chunk in given if chunk.cell.policy == name] for name in plan.policies]
    assert sizes == [[50, 50], [10] * 10]


# ---- cut short ---------------------------------------------------------------------------------------


def test_an_interrupt_leaves_whole_batches_and_no_part_of_one(tmp_path, monkeypatch):
    plan = Study(("reach",), ("none", "stop"), ("walk_by",), ("random",), episodes=40, steps=4)
    begun = []

    def interrupted(*arguments, **more):
        begun.append(arguments)
        if len(begun) == 2:
            raise KeyboardInterrupt
        return rollouts(*arguments, **more)

    with monkeypatch.context() as patched:
        patched.setattr("jssa_gym.evaluation.play.rollouts", interrupted)
        ledger = Ledger(tmp_path, plan)
        with pytest.raises(KeyboardInterrupt):
            finish(ledger, 1, lambda rows: None)
    first = ledger.episodes
    assert [row.seed for row in first] == [*range(len(first))]
    assert 4 <= len(first) < plan.total()
    again = Ledger(tmp_path, plan)
    assert again.episodes == first
    finish(again, 1, lambda rows: None)
    whole = Ledger(tmp_path / "whole", plan)
    finish(whole, 1, lambda rows: None)
    order = sorted(whole.episodes, key=lambda row: (row.filter, row.seed))
    assert list(map(timeless, sorted(again.episodes, key=lambda row: (row.filter, row.seed)))) == list(
        map(timeless, order)
    )
