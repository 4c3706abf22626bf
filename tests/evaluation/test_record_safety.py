"""RecordSafety: the numbers of an evaluation, inside any training loop."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import jssa_gym
from jssa_gym.evaluation import RecordSafety, StepSummary, rollout, summarise
from jssa_gym.evaluation.record_vector import VectorRecordSafety
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.policies import POLICIES


def make(task="Reach", human="pursuit", steps=60, **kwargs):
    return RecordSafety(gym.make(f"jssa_gym/{task}Shielded-v0", human=human, max_episode_steps=steps, **kwargs))


def of_trace(trace, limits, **kwargs) -> StepSummary:
    summary = summarise(trace, limits, **kwargs)
    return StepSummary(**{field.name: getattr(summary, field.name) for field in dataclasses.fields(StepSummary)})


@pytest.mark.sampled(2)
@pytest.mark.parametrize("shield", [True, False])
@pytest.mark.parametrize("task", ["home", "reach"])
@pytest.mark.parametrize("human", ["pursuit", "hand", "none"])
def test_its_numbers_are_those_of_an_evaluation(shield, task, human):
    def build():
        env = jssa_gym.ArmEnv(task, human=human, terminate_on=("success", "moving_contact"))
        env = gym.wrappers.TimeLimit(env, 400)
        return jssa_gym.JSSAShield(env) if shield else env

    env, twin = RecordSafety(build(), v_safe=0.02), build()
    observation, _ = env.reset(seed=4)
    policy, ended = POLICIES["wander"](env, 1), False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        ended = terminated or truncated
        assert ("safety" in info) == ended
    trace = rollout(twin, POLICIES["wander"](twin, 1), seed=4, steps=10_000)
    expected = of_trace(trace, twin.unwrapped.robot.limits, v_safe=0.02)
    assert env.recent[-1] == expected
    for name, value in dataclasses.asdict(expected).items():
        assert info["safety"][name] == (pytest.approx(np.nan, nan_ok=True) if value is None else value)
    if human == "pursuit":
        assert expected.collision
        assert expected.moving_contact != shield


@pytest.mark.parametrize("vector", [gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv])
def test_it_works_in_gymnasiums_vector_environments(vector):
    envs = vector([make, make])
    envs.reset(seed=[1, 2])
    for _ in range(60):
        *_, truncated, info = envs.step(np.full((2, 6), 0.2, np.float32))
    assert truncated.all()
    singles = []
    for seed in (1, 2):
        env = make()
        env.reset(seed=seed)
        for _ in range(60):
            *_, single = env.step(np.full(6, 0.2, np.float32))
        singles.append(single["safety"])
    assert info["_safety"].all()
    for name in singles[0]:
        np.testing.assert_array_equal(info["safety"][name], [single[name] for single in singles])
    assert singles[0]["min_distance"] != singles[1]["min_distance"]
    envs.close()


def test_it_works_under_stable_baselines():
    common = pytest.importorskip("stable_baselines3.common.vec_env", reason="stable-baselines3 is not installed")
    envs = common.DummyVecEnv([make, make])
    envs.reset()
    told = []
    for _ in range(125):
        _, _, _, infos = envs.step(np.full((2, 6), 0.2, np.float32))
        told += [info["safety"] for info in infos if "safety" in info]
    assert len(told) == 4
    assert all(safety["ep_len"] == 60 for safety in told)
    assert [len(recent) for recent in envs.get_attr("recent")] == [2, 2]


def test_it_remembers_the_latest_and_forgets_what_was_not_ended():
    env = make(steps=5)
    env = RecordSafety(env.env, buffer_length=2)
    env.reset(seed=0)
    env.step(np.zeros(6))
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(5):
            *_, info = env.step(np.zeros(6))
        assert info["safety"]["ep_len"] == 5
    assert len(env.recent) == 2
    assert env.spec is not None
    rebuilt = gym.make(env.spec)
    assert isinstance(rebuilt, RecordSafety)
    assert rebuilt.recent.maxlen == 2


def test_all_values_are_numbers_of_one_kind():
    bare = RecordSafety(gym.make("jssa_gym/Reach-v0", human="none", max_episode_steps=2))
    bare.reset(seed=0)
    bare.step(np.zeros(6))
    *_, info = bare.step(np.zeros(6))
    shielded = make(steps=1)
    shielded.reset(seed=0)
    *_, other = shielded.step(np.zeros(6))
    assert np.isnan(info["safety"]["phi_max"])
    for name, value in info["safety"].items():
        assert type(value) is type(other["safety"][name]), name
        assert type(value) in (bool, int, float)


def test_what_it_cannot_record_is_refused():
    with pytest.raises(InterfaceError, match="dt"):
        RecordSafety(gym.make("CartPole-v1"))

    class Bare(gym.Wrapper):
        dt = 0.02

    env = RecordSafety(Bare(gym.make("CartPole-v1")))
    env.env.task = "a name, not a task"
    env = RecordSafety(env.env)
    env.reset(seed=0)
    with pytest.raises(InterfaceError, match="'success'"):
        env.step(0)
    with pytest.raises(InterfaceError, match=r"repeats actions.*goes inside"):
        RecordSafety(gym.wrappers.OrderEnforcing(jssa_gym.ActionRepeat(make().env, 5)))
    with pytest.raises(ParameterError, match="buffer_length"):
        RecordSafety(make().env, buffer_length=0)
    with pytest.raises(ParameterError, match="v_safe"):
        RecordSafety(make().env, v_safe=-1.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("shield", [None, {}])
def test_a_vector_tells_what_single_environments_tell(mode, shield):
    count, steps = 3, 25
    arguments = {"human": "pursuit", "terminate_on": (), "max_episode_steps": steps}
    made = gym.make_vec("jssa_gym/Reach-v0", count, shield=shield, autoreset_mode=mode.value, **arguments)
    vector = VectorRecordSafety(made)

    def single():
        env = gym.make("jssa_gym/Reach-v0", **arguments)
        return RecordSafety(env if shield is None else jssa_gym.JSSAShield(env, **shield))

    singles = gym.vector.SyncVectorEnv([single] * count, autoreset_mode=mode)
    vector.reset(seed=2), singles.reset(seed=2)
    told = 0
    for k in range(80):
        actions = np.sin(0.1 * k) * np.ones((count, 6))
        infos, alone = vector.step(actions)[4], singles.step(actions)[4]
        infos, alone = infos.get("final_info", infos), alone.get("final_info", alone)
        assert ("safety" in infos) == ("safety" in alone)
        if "safety" in infos:
            told += 1
            np.testing.assert_array_equal(infos["_safety"], alone["_safety"])
            assert set(infos["safety"]) == set(alone["safety"])
            for name, value in infos["safety"].items():
                np.testing.assert_array_equal(value, alone["safety"][name], err_msg=name)
            if mode == AutoresetMode.DISABLED:
                for env in (vector, singles):
                    env.reset(options={"reset_mask": np.ones(count, np.bool_)})
    assert told == 3
    assert len(vector.recent) == 3 * count


def test_a_vector_that_it_cannot_record_is_refused():
    with pytest.raises(InterfaceError, match="VectorArmEnv"):
        VectorRecordSafety(gym.make_vec("jssa_gym/Reach-v0", 2, vectorization_mode="sync"))
    repeated = jssa_gym.VectorActionRepeat(gym.make_vec("jssa_gym/Reach-v0", 2, autoreset_mode="Disabled"), 5)
    with pytest.raises(InterfaceError, match=r"repeats actions.*goes inside"):
        VectorRecordSafety(repeated)
