"""Models of Stable-Baselines3: rebuilt from their weights, and never run unless trusted."""

import io
import json
import pickle
import re
import subprocess
import sys
import zipfile

import gymnasium as gym
import numpy as np
import pytest
from places import DOCS

import jssa_gym
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.cli.replay import Replay
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.trace import load_trace
from jssa_gym.exceptions import JSSAGymError, MissingExtraError, ParameterError, PolicyFileError
from jssa_gym.humans.recording import Recording
from jssa_gym.policies import LearnedPolicy, convert_sb3, read_policy, save_policy
from jssa_gym.robots import make_robot

sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
torch = pytest.importorskip("torch")

ALGORITHMS = ("PPO", "A2C", "SAC", "TD3", "DDPG")


def model_of(name, env=None, net=(16, 16), **options):
    algorithm = getattr(sb3, name)
    if name not in ("PPO", "A2C"):
        options["buffer_size"] = 100
    kwargs = {"net_arch": list(net), **options.pop("policy_kwargs", {})}
    env = ArmEnv("reach") if env is None else env
    model = algorithm("MlpPolicy", env, policy_kwargs=kwargs, seed=0, device="cpu", **options)
    with torch.no_grad():  # else the actions of fresh nets are all but zero
        for parameter in model.policy.parameters():
            parameter.add_(0.1 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(3)))
    return model


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A fresh model of every algorithm, and its file."""
    folder = tmp_path_factory.mktemp("models")
    made = {}
    for name in ALGORITHMS:
        model = model_of(name)
        model.save(folder / name)
        made[name] = (model, folder / f"{name}.zip")
    return made


def observations(count=50, size=39):
    return np.random.default_rng(0).uniform(-2.0, 2.0, (count, size)).astype(np.float32)


class TestConversion:
    @pytest.mark.parametrize("name", ALGORITHMS)
    def test_a_model_acts_as_it_did(self, models, name):
        model, path = models[name]
        policy, seen = jssa_gym.load_policy(path), set()
        assert isinstance(policy, LearnedPolicy)
        for observation in observations():
            wanted = model.predict(observation, deterministic=True)[0]
            np.testing.assert_allclose(policy(observation), wanted, rtol=0, atol=1e-6)
            seen.update(np.sign(wanted).tolist())
        assert seen >= {-1.0, 1.0}
        policy.check(ArmEnv("reach"))

    @pytest.mark.parametrize("name", ["PPO", "SAC"])
    @pytest.mark.parametrize("clip", [10.0, 0.7])
    def test_observations_are_normalised_as_in_training(self, tmp_path, name, clip):
        def make():
            return gym.make("jssa_gym/Reach-v0")

        plain = sb3.common.vec_env.DummyVecEnv([make])
        normalised = sb3.common.vec_env.VecNormalize(plain, clip_obs=clip)
        model = model_of(name, normalised)
        normalised.seed(0)
        normalised.reset()
        rng = np.random.default_rng(0)
        for _ in range(200):
            normalised.step(rng.uniform(-1.0, 1.0, (1, 6)).astype(np.float32))
        model.save(tmp_path / "model")
        moments = normalised.obs_rms
        policy = convert_sb3(
            tmp_path / "model.zip",
            mean=moments.mean,
            std=np.sqrt(moments.var + normalised.epsilon),
            clip=normalised.clip_obs,
        )
        bare, differs = convert_sb3(tmp_path / "model.zip"), 0.0
        for observation in observations():
            wanted = model.predict(normalised.normalize_obs(observation), deterministic=True)[0]
            # both are of float32 there, and a deviation can be small
            np.testing.assert_allclose(policy(observation), wanted, rtol=0, atol=1e-5)
            differs = max(differs, np.abs(bare(observation) - wanted).max())
        assert differs > 0.1
        save_policy(tmp_path / "model.npz", policy)
        np.testing.assert_array_equal(read_policy(tmp_path / "model.npz")(observation), policy(observation))

    @pytest.mark.parametrize("name", ["PPO", "SAC"])
    @pytest.mark.parametrize("activation", ["ReLU", "Tanh"])
    def test_an_activation_that_the_file_mentions_is_used(self, tmp_path, name, activation):
        model = model_of(name, policy_kwargs={"activation_fn": getattr(torch.nn, activation)})
        model.save(tmp_path / "model")
        policy = convert_sb3(tmp_path / "model.zip")
        assert policy.network.activation == activation.lower()
        other = convert_sb3(tmp_path / "model.zip", activation={"ReLU": "tanh", "Tanh": "relu"}[activation])
        wanted = model.predict(observations()[0], deterministic=True)[0]
        np.testing.assert_allclose(policy(observations()[0]), wanted, rtol=0, atol=1e-6)
        assert np.abs(other(observations()[0]) - wanted).max() > 1e-3

    def test_nets_of_any_depth(self, tmp_path):
        for name, net in (("PPO", []), ("SAC", [8]), ("TD3", [8, 7, 6, 5])):
            model = model_of(name, net=net)
            model.save(tmp_path / name)
            policy = convert_sb3(tmp_path / f"{name}.zip")
            assert len(policy.network.layers) == len(net) + 1
            wanted = model.predict(observations()[1], deterministic=True)[0]
            np.testing.assert_allclose(policy(observations()[1]), wanted, rtol=0, atol=1e-6)

    def test_what_the_weights_do_not_say_is_told(self, models):
        policy = convert_sb3(
            models["PPO"][1], control="velocity", share=0.7, ticks=5, task="reach", observes_intervention=True
        )
        assert (policy.control, policy.share, policy.ticks, policy.task) == ("velocity", 0.7, 5, "reach")
        assert policy.observes_intervention
        assert "PPO.zip" in policy.provenance["converted"]
        for wrong in ({"control": "torque"}, {"activation": "gelu"}, {"mean": np.zeros(3)}, {"share": 0.0}):
            with pytest.raises(ParameterError):
                convert_sb3(models["PPO"][1], **wrong)

    def test_a_model_of_another_arm_is_refused(self, models, toy_mjcf):
        with pytest.raises(ParameterError, match="6 numbers, control 'jerk' of 3 joints has 3"):
            convert_sb3(models["PPO"][1], robot=toy_mjcf)

    @pytest.mark.parametrize(
        ("name", "options", "message"),
        [
            ("PPO", {"use_sde": True}, "deviation of its own"),
            ("SAC", {"use_sde": True}, "no part of a fully connected policy"),
            ("PPO", {"policy_kwargs": {"activation_fn": torch.nn.ELU}}, "mentions the activations ELU"),
        ],
    )
    def test_what_cannot_be_rebuilt_says_what_to_do(self, tmp_path, name, options, message):
        model = model_of(name, **options)
        model.save(tmp_path / "model")
        with pytest.raises(PolicyFileError, match=f"{message}.*trust_pickle=True, only for files whose origin"):
            jssa_gym.load_policy(tmp_path / "model.zip")
        policy = jssa_gym.load_policy(tmp_path / "model.zip", trust_pickle=True)
        wanted = model.predict(observations()[0], deterministic=True)[0]
        np.testing.assert_allclose(policy(observations()[0]), wanted, rtol=0, atol=1e-6)
        sent = pickle.loads(pickle.dumps(policy))  # to the processes of an evaluation
        np.testing.assert_array_equal(sent(observations()[0]), policy(observations()[0]))

    @pytest.mark.long
    def test_without_torch_one_line_says_what_to_install(self, models, saved_policy):
        script = (
            "import sys; sys.modules['torch'] = None\n"
            "import jssa_gym\n"
            f"jssa_gym.load_policy({str(saved_policy)!r})\n"
            "try:\n"
            f"    jssa_gym.load_policy({str(models['PPO'][1])!r})\n"
            "except jssa_gym.exceptions.MissingExtraError as error:\n"
            "    print(error)\n"
            "assert 'stable_baselines3' not in sys.modules\n"
        )
        run = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
        assert len(run.stdout.splitlines()) == 1
        assert "pip install 'jssa-gym[train]'" in run.stdout
        assert issubclass(MissingExtraError, ImportError)


def test_the_documentation_lists_all_keys_of_a_file(saved_policy):
    text = (DOCS / "policies.md").read_text()
    with zipfile.ZipFile(saved_policy) as archive:
        header = json.loads(archive.read("policy.json"))
    table = text.split("| key of `policy.json` | value |")[1].split("\n\n")[0]
    first = "".join(line.split("|")[1] for line in table.splitlines() if line.startswith("| `"))
    assert set(re.findall(r"`(\w+)`", first)) == set(header)


@pytest.fixture
def saved_policy(models, tmp_path):
    save_policy(path := tmp_path / "policy.npz", convert_sb3(models["PPO"][1]))
    return path


def changed(path, out, **members):
    """A copy of an archive with other members; None takes one out."""
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(out, "w") as copy:
        for name in archive.namelist():
            content = members.get(name.split(".")[0], archive.read(name))
            if content is not None:
                copy.writestr(name, content)
    return out


def pth(state) -> bytes:
    buffer = io.BytesIO()
    torch.save(state, buffer)
    return buffer.getvalue()


def state_of(model) -> dict:
    return dict(model.policy.state_dict())


class TestDamage:
    def test_a_damaged_model_is_refused(self, models, tmp_path):
        path, out = models["PPO"][1], tmp_path / "bad.zip"
        content = path.read_bytes()
        rng = np.random.default_rng(0)
        for end in (0, 1, len(content) - 1, *rng.integers(0, len(content), 30)):
            out.write_bytes(content[:end])
            with pytest.raises(PolicyFileError):
                jssa_gym.load_policy(out)
        for member in ({"policy": None}, {"data": None}, {"policy": b""}, {"policy": b"x" * 100}):
            with pytest.raises(PolicyFileError, match="no model of Stable-Baselines3, or damaged"):
                jssa_gym.load_policy(changed(path, out, **member))
        for wrong in (3, [1], {"a": 3}, {3: torch.zeros(2)}, torch.zeros(3)):
            with pytest.raises(PolicyFileError, match="no model"):
                jssa_gym.load_policy(changed(path, out, policy=pth(wrong)))
        with pytest.raises(PolicyFileError, match="no policy of PPO"):
            jssa_gym.load_policy(changed(path, out, policy=pth({"q_net.0.weight": torch.zeros(2, 2)})))

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            ("action_net.bias", None, "there is no 'action_net.bias'"),
            ("mlp_extractor.policy_net.0.weight", None, "no plain sequence"),
            ("mlp_extractor.policy_net.1.weight", torch.zeros(16), "no plain sequence"),
            ("mlp_extractor.shared_net.0.weight", torch.zeros(2, 2), "no part of a fully connected policy"),
            ("features_extractor.cnn.0.weight", torch.zeros(2, 2), "no part of a fully connected policy"),
            ("lstm_actor.weight_ih_l0", torch.zeros(2, 2), "recurrent policy"),
            ("log_std", None, "deviation of its own"),
            ("action_net.weight", torch.full((6, 16), torch.nan), "not finite"),
            ("action_net.weight", torch.zeros(6, 16, dtype=torch.int64), "of type torch.int64"),
            ("action_net.weight", torch.zeros(6, 16, dtype=torch.complex64), "of type torch.complex64"),
            ("action_net.weight", torch.zeros(6), "shape"),
            ("action_net.weight", torch.zeros(1).expand(6, 10**12), "shape"),
        ],
    )
    def test_weights_that_are_no_policy(self, models, tmp_path, key, value, message):
        model, path = models["PPO"]
        state = state_of(model)
        if value is None:
            del state[key]
        else:
            state[key] = value
        bad = changed(path, tmp_path / "bad.zip", policy=pth(state))
        with pytest.raises(PolicyFileError, match=message):
            jssa_gym.load_policy(bad)

    @pytest.mark.long
    def test_archives_that_unpack_to_more_than_a_file_may_have(self, models, tmp_path):
        bomb, inner = tmp_path / "bomb.zip", io.BytesIO()
        with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("policy.pth", bytes(65 * 2**20))
            archive.writestr("data", "{}")
        with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("archive/data/0", bytes(65 * 2**20))
        with pytest.raises(PolicyFileError, match=r"unpacks to .* bytes, more than"):
            jssa_gym.load_policy(bomb)
        with pytest.raises(PolicyFileError, match=r"unpacks to .* bytes, more than"):
            jssa_gym.load_policy(changed(models["PPO"][1], bomb, policy=inner.getvalue()))


class Sentinel:
    """Writes a file when it is unpickled."""

    def __init__(self, path) -> None:
        self.path = str(path)

    def __reduce__(self):
        return exec, (f"open({self.path!r}, 'w').close()",)


def loaders(path):
    """Everything of the package that reads a file which somebody else may have written."""
    return (
        lambda: jssa_gym.load_policy(path),
        lambda: jssa_gym.load_policy(str(path)),
        lambda: read_policy(path),
        lambda: convert_sb3(path),
        lambda: load_trace(path),
        lambda: Recording.load(path),
        lambda: make_robot(path),
        lambda: jssa_gym.evaluate("jssa_gym/Reach-v0", str(path), 1, steps=2),
    )


class TestPickles:
    @pytest.fixture
    def ran(self, tmp_path):
        return tmp_path / "ran"

    def never(self, path, ran):
        """Nothing runs under any of the endings that a file can have."""
        for ending in (path.suffix, ".npz", ".zip", ".pkl", ".pth", ".yaml", ".csv"):
            named = path.with_suffix(ending)
            named.write_bytes(path.read_bytes())
            for load in loaders(named):
                with pytest.raises(JSSAGymError):
                    load()
            assert not ran.exists()

    def test_the_sentinel_works(self, ran):
        pickle.loads(pickle.dumps(Sentinel(ran)))
        assert ran.exists()

    def test_a_models_data_runs_only_if_it_is_trusted(self, models, tmp_path, ran):
        model = model_of("PPO")
        model.hook = Sentinel(ran)
        model.save(tmp_path / "model")
        path = tmp_path / "model.zip"
        policy = jssa_gym.load_policy(path)  # its weights are read safely
        convert_sb3(path)
        jssa_gym.evaluate("jssa_gym/Reach-v0", str(path), 1, steps=2)
        assert not ran.exists()
        trusted = jssa_gym.load_policy(path, trust_pickle=True)
        assert ran.exists()
        np.testing.assert_allclose(trusted(observations()[0]), policy(observations()[0]), rtol=0, atol=1e-6)

    @pytest.mark.long
    def test_so_it_is_on_the_command_line(self, tmp_path, ran):
        model = model_of("PPO")
        model.hook = Sentinel(ran)
        model.save(tmp_path / "model")
        policy = str(tmp_path / "model.zip")
        shared = {"episodes": 1, "seconds": 0.1, "keep": 1}
        Evaluate(policy=policy, out=tmp_path / "one", **shared).run()
        Compare(policies=(policy,), filters=("none",), humans=("walk_by",), out=tmp_path / "two", **shared).run()
        (trace,) = (tmp_path / "one" / "traces").iterdir()
        with pytest.raises(ParameterError, match="--policy"):  # what a recording names is not even read
            Replay(trace, tmp_path / "r", figure=False, video=False, again=True, trust_pickle=True).run()
        Replay(trace, tmp_path / "r", figure=False, video=False, again=True, policy=policy).run()
        assert not ran.exists()
        shared["trust_pickle"] = True
        Evaluate(policy=policy, out=tmp_path / "three", **shared).run()
        ran.unlink()
        Compare(policies=(policy,), filters=("none",), humans=("walk_by",), out=tmp_path / "four", **shared).run()
        ran.unlink()
        (trace,) = (tmp_path / "three" / "traces").iterdir()
        Replay(trace, tmp_path / "r", figure=False, video=False, again=True, policy=policy, trust_pickle=True).run()
        ran.unlink()

    def test_statistics_of_observations(self, tmp_path, ran):
        normalised = sb3.common.vec_env.VecNormalize(sb3.common.vec_env.DummyVecEnv([lambda: ArmEnv("reach")]))
        normalised.hook = Sentinel(ran)
        normalised.save(tmp_path / "vec_normalize.pkl")
        self.never(tmp_path / "vec_normalize.pkl", ran)

    def test_replay_buffers(self, tmp_path, ran):
        model = model_of("SAC")
        model.replay_buffer.hook = Sentinel(ran)
        model.save_replay_buffer(tmp_path / "buffer.pkl")
        self.never(tmp_path / "buffer.pkl", ran)

    def test_weights(self, models, tmp_path, ran):
        path = tmp_path / "policy.pth"
        path.write_bytes(pth({"action_net.weight": Sentinel(ran)}))
        self.never(path, ran)
        for name, (model, archive) in models.items():
            bad = pth({**state_of(model), "hook": Sentinel(ran)})
            self.never(changed(archive, tmp_path / f"{name}.zip", policy=bad), ran)

    def test_yaml(self, tmp_path, ran):
        path = tmp_path / "policy.yaml"
        path.write_text(f"!!python/object/apply:builtins.exec [\"open({str(ran)!r}, 'w')\"]\n")
        self.never(path, ran)

    def test_arrays_of_objects(self, tmp_path, ran):
        path = tmp_path / "arrays.npz"
        objects = np.array([Sentinel(ran)], object)
        np.savez(path, weight_0=objects, bias_0=objects, mean=objects, points=objects, header=objects)
        self.never(path, ran)
