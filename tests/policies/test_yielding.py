"""The policy that yields: slowed is not interrupted, thrown off it goes back without coming to rest."""

import numpy as np
import pytest

import jssa_gym
from jssa_gym.control import JPC, Phase
from jssa_gym.control.yielding import YieldingJPC
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import POLICIES, JPCPolicy
from jssa_gym.types import Planes


def play(env, policy, seed=0, disturb=None, steps=1000):
    """Infos of an episode, phases and speeds; ``disturb(k, action)`` may apply something else."""
    observation, _ = env.reset(seed=seed)
    infos, phases, speeds = [], [], []
    for k in range(steps):
        action = policy(observation)
        if disturb is not None:
            action = disturb(k, action)
        observation, _, terminated, truncated, info = env.step(action)
        infos.append(info)
        phases.append(policy.jpc.phase)
        speeds.append(np.abs(env.unwrapped.scene.robot.velocity).max())
        if terminated or truncated:
            break
    return infos, phases, np.array(speeds)


def test_the_paper_s_controller_has_a_name_of_its_own() -> None:
    env = ArmEnv("reach", human="none")
    assert type(POLICIES["jpc"](env, 0).jpc) is YieldingJPC
    assert type(POLICIES["jpc_paper"](env, 0).jpc) is JPC
    with pytest.raises(ParameterError, match="yielding"):
        JPCPolicy(env, 0, yielding="no")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("task", "human"), [("home", "none"), ("reach", "none"), ("track", "none"), ("handover", "receive")]
)
def test_alone_it_succeeds_where_the_paper_s_does(task, human) -> None:
    for seed in range(2):
        success = {}
        for name in ("jpc", "jpc_paper"):
            env = ArmEnv(task, human=human)
            infos, *_ = play(env, POLICIES[name](env, seed), seed)
            assert not any(info["limit_violation"] for info in infos)
            success[name] = infos[-1]["success"]
        assert success["jpc"] >= success["jpc_paper"]


@pytest.mark.long
def test_beside_somebody_who_walks_by_it_is_slowed_and_never_interrupted() -> None:
    """Seeds in which the one of the paper is interrupted, so that it is not vacuous."""
    jumps, interruptions = {}, {}
    for name in ("jpc", "jpc_paper"):
        jumps[name] = interruptions[name] = 0
        for seed in (0, 1, 2):
            env = jssa_gym.Shield(ArmEnv("track", human="walk_by"), "stop", stop=True)
            infos, phases, _ = play(env, POLICIES[name](env, seed), seed)
            jerks = np.array([info["jerk"] for info in infos]) / env.unwrapped.robot.limits.jerk
            jumps[name] += np.count_nonzero(np.abs(np.diff(jerks, axis=0)).max(axis=1) > 1.0)
            interruptions[name] += Phase.SETTLING in phases
            assert not any(info["limit_violation"] for info in infos)
            assert max(info["contact_speed"] for info in infos) <= 1e-3
            if name == "jpc":
                assert infos[-1]["success"]
                assert min(info["shield/override"] for info in infos if info["shield/choice"] >= 0) < 1.0
    assert interruptions["jpc_paper"] >= 2
    assert interruptions["jpc"] == 0
    assert jumps["jpc_paper"] > 20
    assert jumps["jpc"] == 0


def test_thrown_off_its_path_it_goes_on_without_coming_to_rest() -> None:
    env = ArmEnv("track", human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    infos, phases, speeds = play(env, policy, disturb=lambda k, action: -0.2 * np.ones(6) if 125 <= k < 130 else action)
    assert infos[-1]["success"]
    assert not any(info["limit_violation"] for info in infos)
    assert infos[-1]["track/lateness"] <= 0.1
    assert set(phases[10:700]) == {Phase.TRACKING}
    assert speeds[120:200].min() > 0.01


def test_where_there_is_no_way_back_it_brakes_and_plans_anew(monkeypatch) -> None:
    monkeypatch.setattr("jssa_gym.control.yielding.rejoin", lambda *args: None)
    env = ArmEnv("track", human="none", terminate_on=())
    policy = JPCPolicy(env, 0, host_delay=0.0)
    infos, phases, _ = play(env, policy, disturb=lambda k, action: -0.2 * np.ones(6) if 125 <= k < 130 else action)
    assert Phase.SETTLING in phases
    assert infos[-1]["success"]


@pytest.mark.parametrize("task", ["home", "reach", "track"])
def test_at_the_end_it_rests(task) -> None:
    env = ArmEnv(task, human="none", terminate_on=())
    policy = JPCPolicy(env, 1)
    _, phases, speeds = play(env, policy, seed=1, disturb=lambda k, a: 0.1 * np.ones(6) if 20 <= k < 24 else a)
    assert phases[-1] is Phase.IDLE
    assert policy.jpc.path is None
    assert speeds[-1] <= 1e-9


def test_a_plan_that_would_touch_the_table_is_not_played(monkeypatch, caplog) -> None:
    caplog.set_level("INFO", logger="jssa_gym")
    monkeypatch.setattr("jssa_gym.policies.jpc.path_is_clear", lambda *args: False)
    env = ArmEnv("reach", human="none", terminate_on=())
    _, _, speeds = play(env, JPCPolicy(env, 0), steps=100)
    assert speeds.max() == 0.0
    assert "on its way" in caplog.text


def test_what_it_is_checked_by_is_the_scene_s(monkeypatch) -> None:
    seen = []
    monkeypatch.setattr(
        "jssa_gym.policies.jpc.path_is_clear", lambda robot, positions, planes, *rest: seen.append(planes) or True
    )
    env = ArmEnv("reach", human="none")
    play(env, JPCPolicy(env, 0), steps=60)
    assert seen
    assert all(isinstance(planes, Planes) and planes.names == env.scene.planes.names for planes in seen)
