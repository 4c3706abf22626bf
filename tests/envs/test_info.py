"""What `info` holds: the same keys and types after a reset and after every step, as recorders and vectors take them."""

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym import ActionRepeat, ArmEnv, JPCAction, JSSAShield, SensorModel
from jssa_gym.envs.tasks import TASKS
from jssa_gym.evaluation.contenders import CONTENDERS, shielded
from jssa_gym.train.wrappers import ExecutedAction, InterventionPenalty, ObserveIntervention


def kinds(info):
    return {key: (type(x), x.shape, x.dtype) if isinstance(x, np.ndarray) else type(x) for key, x in info.items()}


def check(env, steps=40):
    """Steps of an environment, whose every ``info`` is made like the first."""
    rng = np.random.default_rng(0)
    _, info = env.reset(seed=3)
    first, infos = kinds(info), [info]
    for k in range(steps):
        _, _, terminated, truncated, info = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
        infos.append(info)
        assert kinds(info) == first, f"step {k}"
        assert info["is_success"] is info["success"]
        if terminated or truncated:
            infos.append(env.reset()[1])
            assert kinds(infos[-1]) == first
    return infos


@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
@pytest.mark.parametrize("task", TASKS)
def test_a_reset_tells_what_a_step_tells(task, dynamics):
    infos = check(ArmEnv(task, dynamics=dynamics), 10 if dynamics == "servo" else 40)
    terms = [key for key in infos[0] if key.startswith("reward/")]
    assert len(terms) >= 4
    assert all(infos[0][key] == 0.0 for key in terms)
    assert infos[0]["is_success"] is False
    assert any(infos[1][key] != 0.0 for key in terms)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("sensor", [None, "long dropouts", "all that is reported"])
@pytest.mark.parametrize("task", TASKS)
def test_a_shield_adds_the_same_keys_to_both(task, sensor):
    env = ArmEnv(task, human="pursuit", terminate_on=())
    infos = check(JSSAShield(env if sensor is None else SensorModel(env, sensor)), 300)
    assert len({info["shield/reason_code"] for info in infos}) > 1
    assert all(type(info["shield/reason"]) is str for info in infos)


@pytest.mark.sampled(13)
@pytest.mark.parametrize("name", CONTENDERS)
def test_no_shield_and_no_gap_changes_that(name):
    check(shielded(ArmEnv(human="hand", terminate_on=()), name, "missed ticks"))


@pytest.mark.parametrize(
    "wrap",
    [
        lambda env: ActionRepeat(env, 5),
        InterventionPenalty,
        ObserveIntervention,
        JPCAction,
        ExecutedAction,
        lambda env: ExecutedAction(ActionRepeat(InterventionPenalty(env), 3)),
    ],
)
def test_wrappers_keep_to_it(wrap):
    check(wrap(JSSAShield(ArmEnv("reach", human="pursuit"))))


def test_a_repeated_action_was_a_success_if_any_tick_was():
    env = ActionRepeat(ArmEnv(human="none", terminate_on=()), 3)
    env.reset(seed=0)
    inner, ticks = env.env.step, []

    def step(action):
        *rest, info = inner(action)
        ticks.append(len(ticks) == 1)
        return *rest, info | {"success": ticks[-1], "is_success": ticks[-1]}

    env.env.step = step
    assert [env.step(np.zeros(6))[4]["is_success"] for _ in range(2)] == [True, False]
    assert ticks == [False, True, False, False, False, False]


def test_a_repeated_actions_code_is_that_of_its_reason():
    env = ActionRepeat(JSSAShield(ArmEnv(human="pursuit", terminate_on=())), 5)
    inner = env.env
    env.reset(seed=0)
    told, real = [], inner.step

    def step(action):
        result = real(action)
        told.append(result[4])
        return result

    inner.step = step
    mixed = 0
    for _ in range(60):
        told.clear()
        info = env.step(np.ones(6))[4]
        pairs = {(one["shield/reason"], one["shield/reason_code"]) for one in told}
        assert (info["shield/reason"], info["shield/reason_code"]) in pairs
        mixed += told[-1]["shield/reason_code"] != info["shield/reason_code"]
    assert mixed


def test_vectors_stack_numbers():
    vector = gym.make_vec("jssa_gym/ReachShielded-v0", num_envs=2, vectorization_mode="sync")
    _, first = vector.reset(seed=0)
    *_, info = vector.step(np.ones((2, 6), np.float32))
    assert set(first) == set(info)
    assert {key: info[key].dtype for key in info} == {key: first[key].dtype for key in first}
    assert [key for key in info if info[key].dtype == object] == ["shield/reason", "shield/kind"]
    assert info["shield/reason_code"].dtype.kind == "i"
    vector.close()


@pytest.mark.long
def test_sb3_counts_successes():
    sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    env = gym.make("jssa_gym/Home-v0", human="none", max_episode_steps=20)
    model = sb3.PPO("MlpPolicy", env, n_steps=64, batch_size=32, n_epochs=1, device="cpu", seed=0)
    model.learn(64)
    assert len(model.ep_success_buffer) == 3
