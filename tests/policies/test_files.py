"""Trained policies: what the network computes, what a file may hold, and what never runs."""

import dataclasses
import hashlib
import io
import itertools
import json
import os
import pickle
import re
import warnings
import zipfile
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.cli.demo import Demo
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.cli.replay import Replay
from jssa_gym.control.commands import MODES
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation.play import Player
from jssa_gym.evaluation.rows import trace_name
from jssa_gym.evaluation.runner import complete
from jssa_gym.evaluation.study import Single, Study
from jssa_gym.exceptions import JSSAGymError, ParameterError, PolicyFileError, StorageError
from jssa_gym.policies import LearnedPolicy, Network, policy_file, read_policy, save_policy, shipped_policies

N = 6


def network(rng, inputs, sizes=(16, 16), outputs=N, **changes) -> Network:
    widths = [inputs, *sizes, outputs]
    layers = [(rng.normal(size=(b, a)) / np.sqrt(a), 0.1 * rng.normal(size=b)) for a, b in itertools.pairwise(widths)]
    given = {
        "layers": layers,
        "activation": "tanh",
        "output": "clip",
        "mean": 0.1 * rng.normal(size=inputs),
        "std": rng.uniform(0.5, 1.5, inputs),
        "clip": 10.0,
    }
    return Network(**{**given, **changes})


@pytest.fixture(scope="session")
def reach():
    return ArmEnv("reach")


def learned(env, seed=0, *, net=None, **changes) -> LearnedPolicy:
    robot = env.get_wrapper_attr("robot")
    net = network(np.random.default_rng(seed), env.observation_space.shape[0]) if net is None else net
    given = {
        "control": "velocity",
        "share": 0.5,
        "ticks": 5,
        "limits": robot.limits,
        "task": "reach",
        "robot": robot.name,
        "provenance": {"seeds": [1, 2], "curve": [[0, -1.5], [1000, 0.25]], "command": "jssa-gym train"},
    }
    return LearnedPolicy(net, **{**given, **changes})


def tool_policy(env) -> LearnedPolicy:
    net = network(np.random.default_rng(3), env.observation_space.shape[0], outputs=3)
    return learned(env, net=net, control="tip")


@pytest.fixture
def policy(reach):
    return learned(reach)


@pytest.fixture
def saved(policy, tmp_path):
    save_policy(path := tmp_path / "policy.npz", policy)
    return path


def same(one: LearnedPolicy, two: LearnedPolicy) -> bool:
    """Whether two policies hold the same bits."""

    def flat(thing):
        if isinstance(thing, np.ndarray):
            return thing.dtype.str, thing.shape, thing.tobytes()
        if dataclasses.is_dataclass(thing):
            return [flat(getattr(thing, field.name)) for field in dataclasses.fields(thing)]
        if isinstance(thing, tuple):
            return [flat(part) for part in thing]
        return thing

    return flat(one) == flat(two)


class TestNetwork:
    def test_it_is_the_textbooks_perceptron(self):
        weight, bias = [[1.0, -2.0], [0.5, 0.0], [0.0, 3.0]], [0.0, 0.25, -1.0]
        last, shift = [[1.0, 1.0, 1.0]], [0.125]
        given = {"layers": [(weight, bias), (last, shift)], "mean": [1.0, 0.0], "std": [2.0, 1.0]}
        relu = Network(**given, activation="relu", output="clip")
        # x = (0.5, 0.5): W x + b = (-0.5, 0.5, 0.5)
        assert relu(np.array([2.0, 0.5])) == pytest.approx([min(0.0 + 0.5 + 0.5 + 0.125, 1.0)])
        tanh = Network(**given, activation="tanh", output="tanh", clip=0.25)
        # clipped: x = (0.25, 0.25): W x + b = (-0.25, 0.375, -0.25)
        wanted = np.tanh(np.tanh(-0.25) + np.tanh(0.375) + np.tanh(-0.25) + 0.125)
        assert tanh(np.array([2.0, 0.5])) == pytest.approx([wanted])

    def test_it_is_what_its_arrays_were_when_it_was_made(self):
        weight = np.ones((1, 2))
        net = Network([(weight, np.zeros(1))], "relu", "clip", np.zeros(2), np.ones(2))
        weight[:] = np.nan
        assert net(np.array([0.25, 0.5])) == pytest.approx([0.75])
        with pytest.raises(ValueError, match="read-only"):
            net.layers[0][0][0, 0] = 1.0

    def test_an_overflow_is_not_a_number_and_no_warning(self):
        huge = 3e38 * np.array([[1.0, 1.0], [1.0, 1.0]])
        layers = [(huge, np.zeros(2))] * 9 + [([[1.0, -1.0]], [0.0])]
        net = Network(layers, "relu", "clip", np.zeros(2), np.ones(2))
        assert np.isnan(net(np.array([1.0, 1.0]))).all()

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"activation": "gelu"}, "unknown activation 'gelu'; valid: tanh, relu"),
            ({"output": "softmax"}, "unknown output"),
            ({"output": ["clip"]}, "unknown output"),
            ({"layers": []}, "1 to 16 pairs"),
            ({"layers": [(np.ones((6, 4)), np.ones(6))] * 17}, "1 to 16 pairs"),
            ({"layers": [np.ones((6, 4))]}, "layer 0 has to be a pair"),
            ({"layers": [(np.ones((6, 4)), np.ones(5))]}, "bias 0 has to have the 6 rows"),
            ({"layers": [(np.ones((3, 4)), np.ones(3)), (np.ones((6, 2)), np.ones(6))]}, "weight 1 takes 2 numbers"),
            ({"layers": [(np.full((6, 4), np.nan), np.ones(6))]}, "weight 0 has to be finite"),
            ({"layers": [(np.full((6, 4), 1e39), np.ones(6))]}, "weight 0 has to be finite, in float32 too"),
            ({"layers": [(np.ones((6, 4)), np.full(6, np.inf))]}, "bias 0 has to be finite"),
            ({"layers": [(np.ones((6, 5000)), np.ones(6))]}, "1 to 4096"),
            ({"layers": [(np.ones((0, 4)), np.ones(0))]}, "1 to 4096"),
            ({"layers": [([["x"] * 4], [0.0])]}, "weight 0 is no array of numbers"),
            ({"layers": [([[1.0], [1.0, 2.0]], [0.0])]}, "weight 0 is no array of numbers"),
            ({"mean": np.zeros(5)}, "mean has to be"),
            ({"mean": [0.0, 0.0, 0.0, np.nan]}, "mean has to be"),
            ({"std": [1.0, 1.0, 1.0, 0.0]}, "std has to be positive"),
            ({"clip": 0.0}, "clip has to be a positive"),
            ({"clip": np.nan}, "clip has to be a positive"),
            ({"clip": True}, "clip has to be a positive"),
        ],
    )
    def test_what_is_no_network_is_refused(self, changes, message):
        with pytest.raises(ParameterError, match=message):
            network(np.random.default_rng(0), 4, **{"mean": np.zeros(4), "std": np.ones(4), **changes})


class TestLearnedPolicy:
    @pytest.mark.parametrize("mode", MODES)
    def test_a_command_becomes_the_jerk_that_the_wrapper_of_training_makes_of_it(self, reach, mode):
        net = network(np.random.default_rng(0), reach.observation_space.shape[0], outputs=3 if mode == "tip" else N)
        bare, policy = net, learned(reach, net=net, control=mode, share=0.7)
        env = jssa_gym.JPCAction(ArmEnv("reach", terminate_on=()), mode=mode, share=0.7)
        rng, largest = np.random.default_rng(1), 0.0
        observation, _ = env.reset(seed=3)
        for _ in range(300):
            jerk = env.action(bare(observation))
            # the observation is of float32
            np.testing.assert_allclose(policy(observation), jerk, rtol=0, atol=3e-5)
            largest = max(largest, np.abs(jerk).max())
            observation, *_ = env.step(np.clip(bare(observation) + 0.3 * rng.normal(size=net.outputs), -1.0, 1.0))
        assert largest > 0.5

    def test_a_policy_of_the_tool_knows_the_package_s_arms_alone(self, reach, toy_mjcf):
        """A file must not have another file read."""
        net = network(np.random.default_rng(0), 40, outputs=3)
        assert learned(reach, net=net, control="tip")(np.zeros(40)).shape == (N,)
        for robot in (str(toy_mjcf), "nobody's"):
            with pytest.raises(ParameterError, match="lr_mate_200id_7l"):
                learned(reach, net=net, control="tip", robot=robot)

    def test_jerk_is_the_networks_answer(self, reach):
        policy = learned(reach, control="jerk")
        observation = reach.observation_space.sample()
        np.testing.assert_array_equal(policy(observation), policy.network(observation.astype(float)))

    @pytest.mark.parametrize("control", ["jerk", "position", "velocity"])
    def test_it_is_a_function_of_the_observation_into_the_box(self, reach, control):
        policy = learned(reach, control=control)
        rng = np.random.default_rng(0)
        for _ in range(200):
            observation = rng.uniform(-2.0, 2.0, policy.network.inputs).astype(np.float32)
            action = policy(observation)
            assert action.shape == (N,)
            assert np.abs(action).max() <= 1.0
            np.testing.assert_array_equal(action, policy(observation.copy()))

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_an_observation_that_is_not_finite_gives_no_action(self, policy, bad):
        for k in (0, 20, policy.network.inputs - 1):
            observation = np.zeros(policy.network.inputs, np.float32)
            observation[k] = bad
            assert np.isnan(policy(observation)).all()

    def test_a_shield_brakes_for_no_action_and_a_bare_environment_refuses_it(self, policy):
        blind = np.full(policy.network.inputs, np.nan, np.float32)
        env = jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0"))
        env.reset(seed=0)
        *_, info = env.step(policy(blind))
        assert info["shield/status"] == jssa_gym.Status.FAULT
        bare = gym.make("jssa_gym/Reach-v0")
        bare.reset(seed=0)
        with pytest.raises(jssa_gym.exceptions.InvalidActionError):
            bare.step(policy(blind))

    @pytest.mark.parametrize("observation", [np.zeros(7), np.zeros((1, 50)), None, "x", [[1.0], [1.0, 2.0]], 1j, {}])
    def test_what_is_no_observation_is_refused(self, policy, observation):
        with pytest.raises(ParameterError, match=f"has {policy.network.inputs} real numbers"):
            policy(observation)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"control": "torque"}, "unknown control 'torque'; valid: jerk, position, velocity"),
            ({"share": 0.0}, "share has to be in"),
            ({"share": 1.5}, "share has to be"),
            ({"ticks": 0}, "ticks has to be"),
            ({"ticks": 2.5}, "ticks has to be"),
            ({"task": None}, "task has to be a name"),
            ({"observes_intervention": 1}, "observes_intervention has to be"),
            ({"limits": None}, "JointLimits"),
            ({"provenance": {"when": object()}}, "provenance has to be what JSON can hold"),
            ({"provenance": {"loss": np.nan}}, "provenance has to be what JSON can hold"),
            ({"provenance": [1]}, "provenance has to be a mapping"),
        ],
    )
    def test_what_is_no_policy_is_refused(self, reach, changes, message):
        with pytest.raises(ParameterError, match=message):
            learned(reach, **changes)

    def test_a_network_of_another_size_is_refused(self, reach):
        rng = np.random.default_rng(0)
        with pytest.raises(ParameterError, match="5 numbers, control 'velocity' of 6 joints has 6"):
            learned(reach, net=network(rng, 40, outputs=5))
        with pytest.raises(ParameterError, match="6 numbers, control 'tip' of 6 joints has 3"):
            learned(reach, net=network(rng, 40), control="tip")
        with pytest.raises(ParameterError, match="too few for the state of 6 joints"):
            learned(reach, net=network(rng, 17))

    def test_it_is_checked_against_an_environment(self, reach, policy, toy_mjcf):
        policy.check(reach)
        policy.check(jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0")))
        with pytest.raises(ParameterError, match="trained for task 'reach', this is 'track'"):
            policy.check(ArmEnv("track"))
        with pytest.raises(ParameterError, match=r"observation of shape \(\d+,\), the environment has \(\d+,\)"):
            policy.check(ArmEnv("reach", observation="full"))
        with pytest.raises(ParameterError, match=r"action of shape \(6,\), the environment has \(3,\)"):
            policy.check(ArmEnv("reach", robot=str(toy_mjcf)))
        limits = reach.robot.limits
        faster = dataclasses.replace(limits, velocity=2.0 * limits.velocity)
        with pytest.raises(ParameterError, match=r"trained with velocity limits \[.*\], the robot .* has \[.*\]"):
            learned(reach, limits=faster).check(reach)

    @pytest.mark.parametrize("mode", ["position", "velocity"])
    def test_an_environment_that_takes_commands_is_not_given_jerk(self, reach, mode):
        wrapped = gym.wrappers.TransformReward(jssa_gym.JPCAction(reach, mode=mode), float)
        with pytest.raises(ParameterError, match="take JPCAction off"):
            learned(reach, control=mode).check(wrapped)
        learned(reach, control="jerk").check(wrapped)  # its numbers may be the wrapper's commands

    def test_a_policy_of_the_tool_is_for_one_geometry(self, reach):
        policy = tool_policy(reach)
        policy.check(reach)
        policy.check(ArmEnv("reach", scene="floor"))
        longer = dataclasses.replace(reach.robot, tool_offset=1.5 * reach.robot.tool_offset)
        links = reach.robot.links.copy()
        links[2]["offset"] *= 1.1
        for robot in (longer, dataclasses.replace(reach.robot, links=links)):
            other = ArmEnv("reach", robot=robot)
            learned(reach).check(other)
            with pytest.raises(ParameterError, match="another geometry"):
                policy.check(other)

    def test_acting_does_not_make_another_policy_of_it(self, reach):
        policy = tool_policy(reach)
        before = pickle.dumps(policy)
        answer = policy(reach.reset(seed=0)[0])
        assert pickle.dumps(policy) == before
        np.testing.assert_array_equal(pickle.loads(before)(reach.reset(seed=0)[0]), answer)

    def test_it_can_be_sent_to_another_process(self, policy):
        assert same(policy, pickle.loads(pickle.dumps(policy)))


class TestFiles:
    @pytest.mark.parametrize(
        "changes",
        [
            {},
            {"control": "jerk", "share": 1.0, "observes_intervention": True, "task": "ö", "provenance": {}},
            {"net": network(np.random.default_rng(2), 40, sizes=(), activation="relu", output="tanh", clip=np.inf)},
            {"net": network(np.random.default_rng(2), 40, sizes=(3,) * 12)},
        ],
    )
    def test_a_policy_comes_back_bit_for_bit(self, reach, tmp_path, changes):
        policy = learned(reach, **changes)
        save_policy(tmp_path / "p.npz", policy)
        assert same(policy, read_policy(tmp_path / "p.npz"))
        assert [path.name for path in tmp_path.iterdir()] == ["p.npz"]
        with np.load(tmp_path / "p.npz", allow_pickle=False) as plain:
            np.testing.assert_array_equal(plain["weight_0"], policy.network.layers[0][0])

    def test_the_same_policy_has_the_same_bytes(self, policy, saved, tmp_path):
        save_policy(tmp_path / "again.npz", read_policy(saved))
        assert (tmp_path / "again.npz").read_bytes() == saved.read_bytes()

    def test_a_file_that_was_cut_off_anywhere_is_refused(self, saved, tmp_path):
        content = saved.read_bytes()
        rng, path = np.random.default_rng(0), tmp_path / "cut.npz"
        for end in (0, 1, 63, 64, 65, len(content) - 1, *rng.integers(0, len(content), 100)):
            path.write_bytes(content[:end])
            with pytest.raises(PolicyFileError):
                read_policy(path)

    def test_a_flipped_bit_is_noticed_wherever_it_is(self, saved, tmp_path):
        content = saved.read_bytes()
        rng, path = np.random.default_rng(0), tmp_path / "flipped.npz"
        for bit in rng.choice(8 * len(content), 1000, replace=False):
            path.write_bytes(flipped(content, bit))
            with pytest.raises(PolicyFileError, match="SHA-256"):
                read_policy(path)

    @pytest.mark.long
    def test_behind_the_digest_a_flipped_bit_is_refused_or_changes_nothing(self, policy, saved, tmp_path):
        content = saved.read_bytes()[:-64]
        rng, path = np.random.default_rng(1), tmp_path / "flipped.npz"
        directory = content.rindex(b"PK\x01\x02", 0, content.index(b"PK\x01\x02") + 4)
        inside = rng.choice(8 * directory, 500, replace=False)
        outside = rng.choice(np.arange(8 * directory, 8 * len(content)), 500, replace=False)
        accepted = 0
        for bit in (*inside, *outside):
            path.write_bytes(seal(flipped(content, bit)))
            try:
                found = read_policy(path)
            except PolicyFileError:
                continue
            accepted += 1
            assert same(found, policy)
        # times and attributes of members, which say nothing about a policy
        assert 0 < accepted < 500

    @pytest.mark.parametrize("step", ["fsync", "replace"])
    def test_a_write_that_fails_leaves_what_was_there(self, reach, policy, saved, monkeypatch, step):
        def fails(*_):
            raise OSError("no space left")

        monkeypatch.setattr(os if step == "fsync" else Path, step, fails)
        with pytest.raises(OSError, match="no space left"):
            save_policy(saved, learned(reach, seed=1))
        assert same(policy, read_policy(saved))
        assert [path.name for path in saved.parent.iterdir()] == [saved.name]

    def test_what_cannot_be_read_or_written_is_said(self, policy, tmp_path):
        for missing in (tmp_path / "no.npz", tmp_path, tmp_path / "nul\0.npz"):
            with pytest.raises(PolicyFileError, match="cannot read"):
                read_policy(missing)
        with pytest.raises(PolicyFileError, match="less provenance"):
            save_policy(tmp_path / "p.npz", dataclasses.replace(policy, provenance={"x": "x" * 2**20}))
        with pytest.raises(StorageError, match=r"p\.npz: No such file"):
            save_policy(tmp_path / "no" / "p.npz", policy)
        (tmp_path / "large.npz").write_bytes(bytes(64 * 2**20 + 1))
        with pytest.raises(PolicyFileError, match="more than 67,108,864"):
            read_policy(tmp_path / "large.npz")
        assert not (tmp_path / "p.npz").exists()


def seal(body: bytes) -> bytes:
    """A body with a digest that is right, as whoever means harm would write it."""
    return body + hashlib.sha256(body).hexdigest().encode()


def flipped(content: bytes, bit: int) -> bytes:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def members_of(path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_members(path, members, compression=zipfile.ZIP_STORED, change=lambda body: body):
    """A sealed archive of members, which may have any names, twice too."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of names that come twice
        with zipfile.ZipFile(buffer, "w", compression) as archive:
            for name, content in members.items() if isinstance(members, dict) else members:
                archive.writestr(name, content)
            archive.comment = b"0" * 64
    path.write_bytes(seal(change(buffer.getvalue()[:-64])))


class Sentinel:
    """Writes a file when it is unpickled."""

    def __init__(self, path) -> None:
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def packed(array) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def npy(header: str, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = (header + " " * (-(len(header) + 11) % 64) + "\n").encode()
    return b"\x93NUMPY" + version + len(text).to_bytes(2, "little") + text + data


def described(shape: str, kind: str = "<f4") -> str:
    return f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"


class TestWhatNoFileMayHold:
    def test_a_file_that_is_written_anew_as_it_was_is_read(self, policy, saved, tmp_path):
        write_members(tmp_path / "same.npz", members_of(saved))
        assert same(policy, read_policy(tmp_path / "same.npz"))

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            ("shield", False, "unexpected or missing keys of policy.json: 'shield'"),
            ("terminate_on", [], "'terminate_on'"),
            ("filter", "none", "'filter'"),
            ("env_kwargs", {}, "'env_kwargs'"),
            ("share", ..., "unexpected or missing keys of policy.json: 'share'"),
            ("format", "jssa_gym trace", "does not say that it is one"),
            ("format", ..., "does not say that it is one"),
            ("version", 2, "version 2; this package reads 1"),
            ("version", True, "version True"),
            ("version", ..., "version None"),
            ("activation", "gelu", "unknown activation"),
            ("activation", ["tanh"], "unknown activation"),
            ("output", {"clip": 1}, "unknown output"),
            ("clip", -1.0, "clip has to be"),
            ("clip", "10", "clip has to be"),
            ("clip", float("nan"), "clip has to be"),
            ("control", "torque", "unknown control"),
            ("share", 2.0, "share has to be"),
            ("share", "0.5", "share has to be"),
            ("share", float("nan"), "share has to be"),
            ("share", 10**400, "int too large"),
            ("ticks", 1.5, "ticks has to be"),
            ("ticks", True, "ticks has to be"),
            ("task", 3, "task has to be"),
            ("robot", None, "robot has to be"),
            ("observes_intervention", "no", "observes_intervention has to be"),
            ("provenance", [], "provenance has to be"),
            ("provenance", {"loss": float("inf")}, "provenance has to be"),
            ("limits", [], "limits is no object"),
            ("limits", {}, "keys of limits"),
        ],
    )
    def test_keys_and_values(self, saved, tmp_path, key, value, message):
        members = members_of(saved)
        header = json.loads(members["policy.json"])
        if value is ...:
            del header[key]
        else:
            header[key] = value
        write_members(tmp_path / "bad.npz", {**members, "policy.json": json.dumps(header)})
        with pytest.raises(PolicyFileError, match=message):
            read_policy(tmp_path / "bad.npz")

    @pytest.mark.parametrize("name", ["position", "velocity", "jerk"])
    @pytest.mark.parametrize(
        "value",
        [[], [1.0], ["1.0"] * 6, [True] * 6, [None] * 6, [1e999] * 6, [-1.0] * 6, [10**400] * 6, {}, [[1.0, 2.0]]],
    )
    def test_limits(self, saved, tmp_path, name, value):
        members = members_of(saved)
        header = json.loads(members["policy.json"])
        header["limits"][name] = value
        write_members(tmp_path / "bad.npz", {**members, "policy.json": json.dumps(header)})
        with pytest.raises(PolicyFileError, match="holds no policy"):
            read_policy(tmp_path / "bad.npz")

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            (b"", "Expecting value"),
            (b"[]", "does not say"),
            (b"null", "does not say"),
            (b"\xff\xfe", "can't decode"),
            (b'{"format": "jssa_gym policy", "format": "jssa_gym policy"}', "a key twice"),
            (b"[" * 500_000, "recursion"),
            (b'{"a":' * 100_000, "recursion"),
            (b" " * (2**20 + 1), "more than 1048576"),
            (b'{"format": ' + b"9" * 5000 + b"}", "digits"),
        ],
    )
    def test_text(self, saved, tmp_path, text, message):
        write_members(tmp_path / "bad.npz", {**members_of(saved), "policy.json": text})
        with pytest.raises(PolicyFileError, match=message):
            read_policy(tmp_path / "bad.npz")

    @pytest.mark.parametrize(
        "content",
        [
            b"",
            b"x" * 200,
            npy(described("(16, 39)"))[:60],
            packed(np.ones((16, 39))),
            packed(np.ones((16, 39), ">f4")),
            packed(np.ones((16, 39), np.int32)),
            packed(np.ones((16, 39), np.complex64)),
            packed(np.ones((16, 39, 1), np.float32)),
            packed(np.float32(1.0)),
            packed(np.ones((16, 38), np.float32)),
            packed(np.ones((0, 39), np.float32)),
            packed(np.full((16, 39), np.nan, np.float32)),
            packed(np.full((16, 39), np.inf, np.float32)),
            packed(np.ones((16, 39), np.float32)) + b"more",
            packed(np.ones((16, 39), np.float32))[:-4],
            npy(described("(99999, 99999)"), bytes(100)),
            npy(described("(999999999999, 999999999999)"), bytes(100)),
            npy(described("(16, -39)"), bytes(4 * 16 * 39)),
            npy(described("(16L, 39L)"), bytes(4 * 16 * 39)),
            npy(described("(16, 39)", "|O"), bytes(4 * 16 * 39)),
            npy(described("(16, 39)"), bytes(4 * 16 * 39), version=b"\x02\x00"),
            npy("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (16, 39), }", bytes(4 * 16 * 39)),
            npy(described("(16, 39)", "<f8"), bytes(4 * 16 * 39)),
            npy(described("(16, 39)"), bytes(4 * 16 * 39)).replace(b"\x76\x00{", b"\x75\x00{"),
            npy("(" * 300, bytes(4 * 16 * 39)),
        ],
    )
    def test_arrays(self, saved, tmp_path, content):
        write_members(tmp_path / "bad.npz", {**members_of(saved), "weight_0.npy": content})
        with pytest.raises(PolicyFileError, match="holds no policy"):
            read_policy(tmp_path / "bad.npz")

    @pytest.mark.parametrize("name", ["mean.npy", "std.npy", "bias_2.npy", "weight_1.npy", "policy.json"])
    def test_missing_members(self, saved, tmp_path, name):
        members = members_of(saved)
        del members[name]
        write_members(tmp_path / "bad.npz", members)
        with pytest.raises(PolicyFileError, match=f"unexpected or missing members: .*{name}"):
            read_policy(tmp_path / "bad.npz")

    @pytest.mark.parametrize(
        "name",
        [
            "../../outside.npy",
            "/etc/outside.npy",
            "sub/weight_0.npy",
            "weight_00.npy",
            "weight_9.npy",
            "shield.json",
            "a/",
        ],
    )
    def test_other_members(self, saved, tmp_path, name):
        write_members(tmp_path / "bad.npz", {**members_of(saved), name: b"x"})
        with pytest.raises(PolicyFileError, match=f"unexpected or missing members: .*{name}"):
            read_policy(tmp_path / "bad.npz")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.npz", "policy.npz"]

    def test_too_many_members(self, saved, tmp_path):
        members = members_of(saved)
        members |= {f"{kind}_{k}.npy": members["bias_0.npy"] for k in range(3, 1000) for kind in ("weight", "bias")}
        write_members(tmp_path / "bad.npz", members)
        with pytest.raises(PolicyFileError, match="unexpected or missing members"):
            read_policy(tmp_path / "bad.npz")

    def test_members_of_the_same_name(self, saved, tmp_path):
        write_members(tmp_path / "bad.npz", [*members_of(saved).items(), ("policy.json", b"{}")])
        with pytest.raises(PolicyFileError, match="members of the same name"):
            read_policy(tmp_path / "bad.npz")

    def test_compressed_members(self, saved, tmp_path):
        for compression in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
            write_members(tmp_path / "bad.npz", members_of(saved), compression)
            with pytest.raises(PolicyFileError, match="encrypted or compressed"):
                read_policy(tmp_path / "bad.npz")
        bomb = {**members_of(saved), "weight_0.npy": npy(described("(4096, 4096)"), bytes(4 * 4096 * 4096))}
        write_members(tmp_path / "bad.npz", bomb, zipfile.ZIP_DEFLATED)
        assert (tmp_path / "bad.npz").stat().st_size < 2**17
        with pytest.raises(PolicyFileError, match="encrypted or compressed"):
            read_policy(tmp_path / "bad.npz")

    def test_encrypted_members(self, saved, tmp_path):
        def encrypted(body: bytes) -> bytes:
            at = body.index(b"PK\x01\x02") + 8
            return body[:at] + b"\x01" + body[at + 1 :]

        write_members(tmp_path / "bad.npz", members_of(saved), change=encrypted)
        with pytest.raises(PolicyFileError, match="encrypted or compressed"):
            read_policy(tmp_path / "bad.npz")

    def test_members_that_claim_to_be_larger_than_the_file(self, saved, tmp_path):
        def larger(body: bytes) -> bytes:
            at = body.index(b"PK\x01\x02") + 20
            return body[:at] + 2 * (2**31 - 1).to_bytes(4, "little") + body[at + 8 :]

        write_members(tmp_path / "bad.npz", members_of(saved), change=larger)
        with pytest.raises(PolicyFileError, match="claim to be larger"):
            read_policy(tmp_path / "bad.npz")

    def test_pickled_arrays_never_run(self, saved, tmp_path):
        ran = tmp_path / "ran"
        content = packed(np.array([Sentinel(ran)], object))
        np.load(io.BytesIO(content), allow_pickle=True)[0].close()
        assert ran.exists()  # it would
        ran.unlink()
        for name in ("weight_0.npy", "mean.npy", "policy.json"):
            write_members(tmp_path / "bad.npz", {**members_of(saved), name: content})
            with pytest.raises(PolicyFileError):
                jssa_gym.load_policy(tmp_path / "bad.npz")
            with pytest.raises(PolicyFileError):
                jssa_gym.load_policy(tmp_path / "bad.npz", trust_pickle=True)
        assert not ran.exists()


class TestNames:
    def test_a_path_is_read(self, policy, saved):
        for path in (saved, str(saved)):
            assert same(policy, jssa_gym.load_policy(path))

    def test_what_is_neither_a_name_nor_a_file_is_refused(self, tmp_path, monkeypatch):
        monkeypatch.setattr("jssa_gym.policies.loading.SHIPPED", tmp_path)
        (tmp_path / "reach-ppo.npz").touch()
        for name in ("nobody", "policy.pkl", "policy.pth", "policy.yaml", "", 3, None):
            with pytest.raises(ParameterError, match=r"unknown policy .*; shipped: reach-ppo; or a file that ends in"):
                jssa_gym.load_policy(name)

    def test_a_shipped_name_is_read(self, policy, tmp_path, monkeypatch):
        monkeypatch.setattr("jssa_gym.policies.loading.SHIPPED", tmp_path)
        save_policy(tmp_path / "reach-test.npz", policy)
        assert shipped_policies() == ("reach-test",)
        assert same(policy, jssa_gym.load_policy("reach-test"))

    @pytest.mark.parametrize("name", shipped_policies())
    def test_every_shipped_policy_says_where_it_comes_from_and_fits_its_task(self, name):
        policy = jssa_gym.load_policy(name)
        told = policy.provenance
        assert re.fullmatch(rf"jssa-gym train --task {policy.task} [-a-z0-9 ]*--out {name}", told["command"])
        assert "shield" not in told["command"]
        assert told["training_moving_contacts"] == 0 < told["training_episodes"]
        for result in told["evaluation"]["results"]:
            count, low, high = result["success_without_contact"]
            assert result["episodes"] >= 1000
            assert low < count / result["episodes"] < high
        assert [result["shield"] for result in told["evaluation"]["results"]] == [True, False]
        assert not re.search(r"[\w.-]*/(tmp|home|root|work|Users)\b", json.dumps(told))
        policy.check(ArmEnv(policy.task))
        assert policy_file(name).stat().st_size < 2**20

    @pytest.mark.long
    @pytest.mark.parametrize("name", shipped_policies())
    def test_every_shipped_policy_does_its_task_under_the_shield(self, name):
        task = jssa_gym.load_policy(name).task.capitalize()
        report = jssa_gym.evaluate(f"jssa_gym/{task}Shielded-v0", name, 10, 7_000)
        assert report.rates["success_rate"].k >= 6
        assert report.rates["moving_contact_rate"].k == 0
        assert report.means["limit_violation_rate"].value == 0.0

    def test_policies_are_shipped(self):
        assert {"reach-sac", "reach-ppo", "handover-ppo"} <= set(shipped_policies())


def layers_of(shield) -> dict:
    inside = shield.get_wrapper_attr("filter")
    return {
        "filter": type(inside).__name__,
        "viability": inside.viability,
        "failsafe": inside.failsafe,
        "guard": inside.records.settings.guarded,
        "params": inside.params,
    }


def test_a_policy_leaves_every_layer_of_a_shield_on(saved):
    fresh = gym.make("jssa_gym/ReachShielded-v0", terminate_on=())
    wanted = layers_of(fresh)
    assert wanted["viability"]
    assert wanted["guard"]
    env = gym.make("jssa_gym/ReachShielded-v0", terminate_on=())
    policy, statuses = jssa_gym.load_policy(saved), set()
    policy.check(env)
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        for _ in range(400):
            observation, _, _, _, info = env.step(policy(observation))
            statuses.add(info["shield/status"])
            assert not info["limit_violation"]
            assert info["contact_speed"] < 1e-3
    assert layers_of(env) == wanted
    assert len(statuses) > 1
    assert env.unwrapped.terminate_on == ()


class Told(gym.ObservationWrapper):
    """Appends a number to the observation, as a learner that is told of the shield gets it."""

    def __init__(self, env) -> None:
        super().__init__(env)
        low, high = (
            np.append(bound, np.float32(end))
            for bound, end in ((env.observation_space.low, 0.0), (env.observation_space.high, 1.0))
        )
        self.observation_space = gym.spaces.Box(low, high, dtype=np.float32)

    def observation(self, observation):
        return np.append(observation, np.float32(0.5))


def told() -> gym.Env:
    return Told(ArmEnv("reach", terminate_on=()))


def digests(report) -> list[str]:
    return [episode.digest for episode in report.episodes]


class TestEvaluation:
    def test_by_path_by_name_and_as_an_object_it_is_the_same(self, policy, saved, monkeypatch):
        monkeypatch.setattr("jssa_gym.policies.loading.SHIPPED", saved.parent)
        reports = [
            jssa_gym.evaluate("jssa_gym/Reach-v0", given, 2, 5, steps=60, filter="jssa+stop")
            for given in (str(saved), saved, "policy", policy, "jpc")
        ]
        *ones, other = map(digests, reports)
        assert all(one == ones[0] != other for one in ones)

    @pytest.mark.long
    def test_other_processes_read_the_file_by_themselves(self, saved, tmp_path):
        study = Study(("reach",), ("jssa+stop",), ("walk_by",), (str(saved),), episodes=2, steps=30)
        (here,), (there,) = (complete(study, tmp_path / f"{jobs}", jobs=jobs, keep=1) for jobs in (1, 2))
        assert digests(here) == digests(there)
        (trace,) = here.traces
        Replay(trace, tmp_path / "r", figure=False, video=False, verify=True, again=True, policy=str(saved)).run()

    def test_an_evaluation_is_not_continued_with_another_policy_of_the_same_name(self, reach, saved, tmp_path):
        command = Evaluate(policy=str(saved), episodes=1, seconds=0.2, keep=0, json=True, out=tmp_path / "out")
        command.run()
        command.run()
        save_policy(saved, learned(reach, seed=1))
        with pytest.raises(ParameterError, match="another campaign"):
            command.run()

    def test_the_identity_of_a_policy_is_its_files(self, saved):
        sha = hashlib.sha256(saved.read_bytes()).hexdigest()
        study = Study(("reach",), ("none",), ("none",), (str(saved), "hold"))
        assert study.config()["code"] == {str(saved): sha}

    def test_a_file_that_changes_on_the_way_is_noticed(self, reach, saved, tmp_path):
        study = Study(("reach",), ("none",), ("random",), (str(saved),), steps=3)
        single = Single("jssa_gym/Reach-v0", str(saved), steps=3)
        players = [Player(plan, next(iter(plan.seeds()))) for plan in (study, single)]
        for player in players:
            player.record(0)
        save_policy(saved, learned(reach, seed=1))  # as a training does with its best
        for player in players:
            with pytest.raises(PolicyFileError, match="changed while it was being evaluated"):
                player.record(1)

    def test_a_policy_of_another_task_is_refused(self, saved, policy):
        for given in (str(saved), policy):
            for other in ("Track", "Handover"):  # the latter observes as many numbers
                with pytest.raises(ParameterError, match=f"trained for task 'reach', this is '{other.lower()}'"):
                    jssa_gym.evaluate(f"jssa_gym/{other}-v0", given, 1, steps=2)

    def test_what_it_is_told_counts_among_its_observations(self, reach, tmp_path):
        size = reach.observation_space.shape[0]
        net = network(np.random.default_rng(0), size + 1)
        policy = learned(reach, net=net, observes_intervention=True)
        save_policy(tmp_path / "told.npz", policy)
        for given in (policy, str(tmp_path / "told.npz")):
            assert jssa_gym.evaluate(told, given, 1, steps=5).episodes
            with pytest.raises(ParameterError, match="its last entry tells of the shield"):
                jssa_gym.evaluate("jssa_gym/Reach-v0", given, 1, steps=5)

    def test_an_unknown_policy_is_refused_before_anything_is_played(self, tmp_path):
        for name in ("nobody", "policy.pkl"):
            with pytest.raises(ParameterError, match=r"unknown policy .*valid: hold, .*a file \.npz or \.zip"):
                Study(("reach",), ("none",), ("none",), (name,))
        with pytest.raises(PolicyFileError, match="cannot read"):
            Study(("reach",), ("none",), ("none",), (str(tmp_path / "no.npz"),))

    def test_recordings_of_policies_with_like_paths_have_names_of_their_own(self):
        paths = ("a/b.npz", "a_b.npz", "a b.npz", "a:b.npz")
        told = [trace_name(("reach", "none", "", path), 0) for path in paths]
        assert len(set(told)) == len(paths)
        assert len(trace_name(("reach", "none", "", "x" * 1000), 0)) < 150
        assert not any("/" in name for name in told)

    @pytest.mark.long
    def test_the_demo_shows_a_policy_on_its_task(self, reach, saved, tmp_path):
        Demo(policy=str(saved), seconds=0.4, video=False, out=tmp_path / "demo").run()
        runs = json.loads((tmp_path / "demo" / "metrics.json").read_text())
        assert [run["name"] for run in runs] == ["no shield", "as published", "JSSAShield", "profile yield"]
        assert (tmp_path / "demo" / "profile.png").exists()
        save_policy(saved, learned(reach, task="laundry"))
        with pytest.raises(ParameterError, match="does not say which of home, reach"):
            Demo(policy=str(saved), seconds=0.4, video=False, out=tmp_path / "demo").run()


def test_every_error_about_files_is_the_packages_own():
    assert issubclass(PolicyFileError, JSSAGymError)
    assert issubclass(PolicyFileError, ValueError)
