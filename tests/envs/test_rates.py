"""Environments at other control steps than 8 ms: what lasts so many seconds still does."""

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS

SLOW = ("recorded",)  # have a file or more of their own


def test_the_default_is_eight_milliseconds_to_the_bit():
    runs = []
    for kwargs in ({}, {"dt": 0.008}):
        env = gym.make("jssa_gym/Reach-v0", **kwargs)
        env.reset(seed=4)
        rng = np.random.default_rng(0)
        runs.append(np.array([env.step(rng.uniform(-1, 1, 6))[0] for _ in range(40)]))
    np.testing.assert_array_equal(*runs)
    assert env.unwrapped.dt == 0.008
    assert env.metadata["render_fps"] == ArmEnv.metadata["render_fps"]


@pytest.mark.parametrize("dt", [0.001, 0.0025, 0.01, 0.02])
def test_an_episode_goes_by_its_own_clock(dt):
    env = gym.make("jssa_gym/Home-v0", dt=dt, human="none")
    env.reset(seed=0)
    base = env.unwrapped
    assert base.metadata["render_fps"] == round(1.0 / dt)
    q = base.scene.robot.position
    share = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(5):
        env.step(share)
    t, jerk = 5 * dt, share * base.robot.limits.jerk
    assert base.scene.time == pytest.approx(t)
    np.testing.assert_allclose(base.scene.robot.position, q + jerk * t**3 / 6.0, atol=1e-12)
    assert not env.step(share)[3]
    assert ArmEnv.metadata["render_fps"] == 125


@pytest.mark.parametrize("dt", [0.0005, 0.03, 0.0, -0.008, np.nan, "fast", True])
def test_steps_that_are_none_are_refused(dt):
    with pytest.raises(ParameterError, match="dt has to be"):
        ArmEnv(dt=dt)


def test_servos_take_whole_milliseconds():
    with pytest.raises(ParameterError, match="whole milliseconds"):
        ArmEnv(dt=0.0025, dynamics="servo")
    env = ArmEnv(dt=0.004, dynamics="servo", human="none")
    env.reset(seed=0)
    for _ in range(25):
        *_, info = env.step(np.full(6, 0.2))
    assert np.abs(info["tracking_error"]).max() < 2e-3
    assert env.world.data.time == pytest.approx(0.1)


@pytest.mark.parametrize("dt", [0.004, 0.016])
def test_success_takes_its_time(dt):
    env = ArmEnv("home", dt=dt, human="none")
    env.reset(seed=0)
    held = 1
    while not env.step(np.zeros(6))[-1]["success"]:
        held += 1
    assert held * dt == pytest.approx(env.task.hold_time, abs=dt)


@pytest.mark.parametrize("human", sorted(set(HUMANS) - set(SLOW)))
@pytest.mark.parametrize("dt", [0.002, 0.02])
def test_people_are_as_fast_as_ever(human, dt):
    env = ArmEnv("handover" if human == "receive" else "home", human=human, dt=dt)
    env.reset(seed=3)
    before, walked = env.scene.human, 0.0
    for _ in range(round(1.0 / dt)):
        env.step(np.zeros(6))
        now = env.scene.human
        gone = np.linalg.norm(now.end - before.end, axis=1).max(initial=0.0)
        assert gone <= env.human.speed_bound * dt * (1.0 + 1e-9) + 1e-12
        walked, before = walked + gone, now
    assert walked > 0.05 or human == "none"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("task", sorted(TASKS))
def test_a_shielded_episode_of_every_task_at_another_rate(task):
    env = gym.make(f"jssa_gym/{task.title()}Shielded-v0", dt=0.01, terminate_on=())
    env = jssa_gym.ActionRepeat(env, 4)
    policy = jssa_gym.JPCPolicy(env, seed=0)
    observation, _ = env.reset(seed=1)
    statuses = set()
    for _ in range(50):
        observation, _, _, _, info = env.step(policy(observation))
        statuses.add(info["shield/status"])
        assert not info["limit_violation"]
        assert not (info["contact"] and info["contact_speed"] > 1e-3 and task != "handover")
    assert jssa_gym.Status.FAULT not in statuses
    assert env.unwrapped.scene.time == pytest.approx(2.0)


def test_what_a_sensor_delays_is_told_in_seconds():
    env = jssa_gym.SensorModel(
        gym.make("jssa_gym/Home-v0", dt=0.02, human="walk_by"), jssa_gym.SensorFaults(latency=0.1)
    )
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros(6))
    assert env.scene.age == pytest.approx(0.1, abs=1e-9)


def test_reports_know_the_step():
    kwargs = {"dt": 0.01, "human": "none"}
    report = jssa_gym.evaluate("jssa_gym/Reach-v0", "jpc_paper", episodes=1, seed=0, env_kwargs=kwargs, steps=300)
    summary = report.episodes[0].summary
    assert summary.success
    assert summary.time_to_goal / 0.01 == pytest.approx(round(summary.time_to_goal / 0.01), abs=1e-6)
    assert summary.time_to_goal < 2.5
