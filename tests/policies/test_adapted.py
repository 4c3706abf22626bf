"""Policies trained with held actions or normalised observations, evaluated as they were trained."""

import contextlib
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.cli import parse
from jssa_gym.cli.evaluate import Evaluate, Trained
from jssa_gym.cli.replay import Replay
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.policy import AsTrained, make_policy
from jssa_gym.evaluation.study import Single, Study
from jssa_gym.evaluation.trace import load_trace
from jssa_gym.exceptions import JSSAGymError, ParameterError, PolicyFileError
from jssa_gym.policies import LearnedPolicy, Network, convert_sb3, save_policy
from jssa_gym.policies.adapted import HeldPolicy, normalised
from jssa_gym.policies.normalisation import read_normalisation

sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize  # noqa: E402


class Sentinel:
    """Writes a file when it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return exec, (f"open({self.path!r}, 'w').close()",)


def model_of(env):
    model = sb3.PPO("MlpPolicy", env, policy_kwargs={"net_arch": [16, 16]}, seed=0, device="cpu")
    for parameter in model.policy.parameters():  # else the actions of fresh nets are all but zero
        parameter.data += 0.1 * parameter.new_tensor(np.random.default_rng(3).normal(size=tuple(parameter.shape)))
    return model


def reach(**options):
    return ArmEnv("reach", terminate_on=(), **options)


def learned(control, outputs=6):
    rng, robot = np.random.default_rng(0), reach().robot
    layer = (0.3 * rng.normal(size=(outputs, 39)), 0.3 * rng.normal(size=outputs))
    network = Network((layer,), "tanh", "tanh", np.zeros(39), np.ones(39))
    return LearnedPolicy(
        network, control=control, share=0.5, ticks=5, limits=robot.limits, task="reach", robot=robot.name
    )


def states(env, policy, steps, seed=3):
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        observation = env.step(policy(observation))[0]
    return np.array(env.unwrapped.scene.robot)


@pytest.fixture(scope="module")
def statistics(tmp_path_factory):
    """A VecNormalize that has seen something, and its file."""
    venv = VecNormalize(DummyVecEnv([lambda: reach(human="random")]), clip_obs=1.5)
    venv.seed(0)
    venv.reset()
    for _ in range(60):
        venv.step(np.ones((1, 6)))
    path = tmp_path_factory.mktemp("statistics") / "vecnormalize.pkl"
    venv.save(str(path))
    return venv, path


# ---- held actions -------------------------------------------------------------------------------------


def test_an_action_is_held_as_in_training():
    slow = jssa_gym.ActionRepeat(reach(), 5)
    policy = learned("jerk")
    np.testing.assert_array_equal(states(slow, policy, 12), states(reach(), HeldPolicy(policy, 5), 60))
    plain = lambda observation: policy(observation)  # noqa: E731  # anything that can be called
    np.testing.assert_array_equal(states(slow, policy, 12), states(reach(), HeldPolicy(plain, 5), 60))
    assert np.any(states(reach(), policy, 60) != states(slow, policy, 12))


@pytest.mark.parametrize(("control", "outputs"), [("velocity", 6), ("tip", 3)])
def test_a_command_is_held_and_its_loops_go_on(control, outputs):
    policy = learned(control, outputs)
    slow = jssa_gym.ActionRepeat(jssa_gym.JPCAction(reach(), mode=control, share=0.5), 5)
    # the policy reads the joint state from float32, the environment's loops have it in double precision
    held = states(reach(), HeldPolicy(policy, 5), 60)
    np.testing.assert_allclose(held[:2], states(slow, policy.network, 12)[:2], atol=1e-4)
    assert np.abs(held - states(reach(), policy, 60))[0].max() > 1e-3


def test_every_episode_begins_with_an_answer_of_its_own():
    asked = []

    def policy(observation):
        asked.append(observation)
        return np.zeros(6)

    report = jssa_gym.evaluate("jssa_gym/Reach-v0", policy, 2, steps=12, ticks=5)
    assert len(asked) == 6
    assert [one.summary.ep_len for one in report.episodes] == [12, 12]


def test_evaluations_hold_by_name_and_replay_it(tmp_path):
    save_policy(tmp_path / "policy.npz", learned("velocity"))
    file = str(tmp_path / "policy.npz")
    shared = {"policy": file, "filter": "none", "episodes": 1, "seconds": 0.4, "keep": 1}
    Evaluate(out=tmp_path / "one", **shared).run()
    Evaluate(out=tmp_path / "five", trained=Trained(ticks=5), **shared).run()
    (fast,), (slow,) = ((tmp_path / name / "traces").iterdir() for name in ("one", "five"))
    assert load_trace(fast).jerk.tolist() != load_trace(slow).jerk.tolist()
    # ends with an error if it goes otherwise
    Replay(slow, tmp_path / "r", figure=False, video=False, again=True, policy=file).run()
    with pytest.raises(ParameterError, match="another campaign"):
        Evaluate(out=tmp_path / "one", trained=Trained(ticks=5), **shared).run()


def test_what_is_not_held_is_told_from_nothing():
    plan = Study(("reach",), ("none",), ("none",), ("reach-sac",))
    assert not {"ticks", "normalise", "trained"} & set(plan.config())
    assert Study(("reach",), ("none",), ("none",), ("reach-sac",), trained=AsTrained(5)).config()["ticks"] == 5


@pytest.mark.parametrize("ticks", [0, -1, 1.5, "5"])
def test_unsound_ticks_are_refused(ticks):
    with pytest.raises(ParameterError, match="ticks"):
        jssa_gym.evaluate("jssa_gym/Reach-v0", learned("jerk"), 1, ticks=ticks)


def test_scripted_policies_are_asked_in_every_tick():
    with pytest.raises(ParameterError, match="scripted ones are asked in every tick"):
        jssa_gym.evaluate("jssa_gym/Reach-v0", "jpc", 1, ticks=5)
    with pytest.raises(ParameterError, match="scripted"):
        Study(("reach",), ("none",), ("none",), ("jpc", "hold"), trained=AsTrained(ticks=2))
    # beside trained ones they are as ever
    Study(("reach",), ("none",), ("none",), ("jpc", "reach-sac"), trained=AsTrained(ticks=2))
    env = reach()
    assert type(make_policy("hold", env, 0, trained=AsTrained(2))) is type(make_policy("hold", env, 0))


# ---- normalised observations --------------------------------------------------------------------------


def test_statistics_are_read_as_they_were_saved(statistics):
    venv, path = statistics
    read = read_normalisation(path)
    for observation in np.random.default_rng(0).uniform(-2.0, 2.0, (20, 39)):
        np.testing.assert_allclose(read(observation), venv.normalize_obs(observation), atol=1e-7)  # float32
    with pytest.raises(ParameterError, match=r"shape \(39,\)"):
        read(np.zeros(40))


@pytest.mark.parametrize("protocol", range(2, 6))
def test_every_protocol_of_pickles_is_read(statistics, tmp_path, protocol):
    venv, _ = statistics
    (tmp_path / "v.pkl").write_bytes(pickle.dumps(venv, protocol))
    np.testing.assert_array_equal(read_normalisation(tmp_path / "v.pkl").mean, venv.obs_rms.mean)


@pytest.mark.long
def test_a_policy_gets_what_it_got_in_training(statistics, tmp_path):
    venv, path = statistics
    model = model_of(reach())
    model.save(tmp_path / "model.zip")
    observation = reach().reset(seed=0)[0]
    wanted = model.predict(venv.normalize_obs(observation), deterministic=True)[0]
    trained = AsTrained(normalise=str(path))
    for given in (model, str(tmp_path / "model.zip"), convert_sb3(tmp_path / "model.zip")):
        policy = make_policy(given, reach(), 0, trained=trained)
        np.testing.assert_allclose(policy(observation), wanted, atol=1e-5)
        assert np.abs(make_policy(given, reach(), 0)(observation) - wanted).max() > 1e-3


def test_nothing_in_a_file_is_run(statistics, tmp_path):
    venv, _ = statistics
    ran = tmp_path / "ran"
    venv.hook = Sentinel(ran)
    try:
        content = pickle.dumps(venv)
    finally:
        del venv.hook
    (tmp_path / "v.pkl").write_bytes(content)
    np.testing.assert_array_equal(read_normalisation(tmp_path / "v.pkl").mean, venv.obs_rms.mean)
    assert not ran.exists()
    pickle.loads(content)
    assert ran.exists()


def test_damaged_files_are_refused_by_an_error_of_the_package(statistics, tmp_path):
    _, path = statistics
    content, out, rng = path.read_bytes(), tmp_path / "bad.pkl", np.random.default_rng(0)
    for cut in range(0, len(content) - 1, max(len(content) // 40, 1)):
        out.write_bytes(content[:cut])
        with pytest.raises(PolicyFileError):
            read_normalisation(out)
    for _ in range(100):
        changed = bytearray(content)
        changed[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
        out.write_bytes(changed)
        with contextlib.suppress(JSSAGymError):
            read_normalisation(out)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"norm_obs": False}, "normalises observations"),
        ({"epsilon": -9.0}, "not sound"),
        ({"clip_obs": float("nan")}, "not sound"),
        ({"obs_rms": {"observation": 0}}, "dictionaries"),
    ],
    ids=str,
)
def test_statistics_that_are_none_are_refused(statistics, tmp_path, change, told):
    venv, _ = statistics
    state = venv.__getstate__() | change
    bad = VecNormalize.__new__(VecNormalize)
    bad.__dict__.update({"venv": None, "class_attributes": {}, "returns": 0, **state})
    (tmp_path / "v.pkl").write_bytes(pickle.dumps(bad))
    with pytest.raises(PolicyFileError, match=told):
        AsTrained(normalise=str(tmp_path / "v.pkl"))


@pytest.mark.parametrize("thing", [3, {"obs_rms": 1}, np.zeros(3), None])
def test_other_pickles_are_refused(tmp_path, thing):
    (tmp_path / "v.pkl").write_bytes(pickle.dumps(thing))
    with pytest.raises(PolicyFileError, match="no VecNormalize"):
        read_normalisation(tmp_path / "v.pkl")


@pytest.mark.long
def test_what_is_normalised_already_is_refused(statistics):
    venv, path = statistics
    with pytest.raises(ParameterError, match="leave normalise out"):
        make_policy("reach-sac", reach(), 0, trained=AsTrained(normalise=str(path)))
    model = model_of(venv)
    with pytest.raises(ParameterError, match="VecNormalize with it"):
        make_policy(model, reach(), 0, trained=AsTrained(normalise=str(path)))
    small = learned("jerk").network
    small = Network(((np.zeros((6, 30)), np.zeros(6)),), small.activation, small.output, np.zeros(30), np.ones(30))
    with pytest.raises(ParameterError, match="39 numbers, the policy takes 30"):
        normalised(LearnedPolicy(small, **_fields()), read_normalisation(path))


def _fields():
    policy = learned("jerk")
    return {name: getattr(policy, name) for name in ("control", "share", "ticks", "limits", "task", "robot")}


# ---- what files do not say ----------------------------------------------------------------------------


def test_a_foreign_model_is_warned_about_once(statistics, tmp_path, caplog):
    model_of(reach()).save(tmp_path / "model.zip")
    file = str(tmp_path / "model.zip")
    jssa_gym.evaluate("jssa_gym/Reach-v0", file, 2, steps=2)
    (told,) = (record.message for record in caplog.records)
    assert told == (
        f"{file} does not say which task it was trained for, nor whether its observations were normalised (then give "
        "normalise)"
    )
    caplog.clear()
    jssa_gym.evaluate("jssa_gym/Reach-v0", file, 1, steps=2, normalise=statistics[1])
    (told,) = (record.message for record in caplog.records)
    assert told == f"{file} does not say which task it was trained for"
    caplog.clear()
    jssa_gym.evaluate("jssa_gym/Reach-v0", "reach-sac", 1, steps=2)
    assert not caplog.records


def test_a_shipped_policy_of_another_task_is_refused_in_a_line():
    for plan in (
        Study(("handover",), ("none",), ("receive",), ("reach-sac",), steps=2),
        Single("jssa_gym/Handover-v0", "reach-sac", steps=2),
    ):
        env = plan.make_env(next(iter(plan.seeds())))
        with pytest.raises(ParameterError, match=r"^the policy was trained for task 'reach', this is 'handover'$"):
            plan.make_policy(next(iter(plan.seeds())), env, 0)


def test_an_environment_without_a_task_takes_any():
    class Own(gym.Wrapper):
        @property
        def unwrapped(self):
            return self

    learned("jerk").check(Own(reach()))


# ---- on the command line ------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["evaluate", "compare"])
def test_the_command_line_takes_both(command):
    parsed = parse([command, "--ticks", "5", "--normalise", "v.pkl"])
    assert parsed.trained == Trained(5, Path("v.pkl"))
    assert parse([command]).trained == Trained()
    if command == "compare":  # the page says what makes it again
        assert "--ticks 5 --normalise v.pkl" in parsed.command_line()
        assert "--ticks" not in parse([command]).command_line()
