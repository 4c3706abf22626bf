"""Trained policies: what the network computes, what a file may hold, and what never runs."""

import dataclasses
import itertools
import pickle

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import LearnedPolicy, Network, read_policy, save_policy

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
    @pytest.mark.parametrize("mode", ["position", "velocity"])
    def test_a_command_becomes_the_jerk_that_the_wrapper_of_training_makes_of_it(self, reach, mode):
        bare = learned(reach, control="jerk")
        policy = learned(reach, control=mode, share=0.7)
        env = jssa_gym.JPCAction(ArmEnv("reach", terminate_on=()), mode=mode, share=0.7)
        rng, largest = np.random.default_rng(1), 0.0
        observation, _ = env.reset(seed=3)
        for _ in range(300):
            jerk = env.action(bare(observation))
            # the observation is of float32
            np.testing.assert_allclose(policy(observation), jerk, rtol=0, atol=3e-5)
            largest = max(largest, np.abs(jerk).max())
            observation, *_ = env.step(np.clip(bare(observation) + 0.3 * rng.normal(size=N), -1.0, 1.0))
        assert largest > 0.5

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
        with pytest.raises(ParameterError, match="5 numbers for 6 joints"):
            learned(reach, net=network(rng, 40, outputs=5))
        with pytest.raises(ParameterError, match="too few for the state of 6 joints"):
            learned(reach, net=network(rng, 17))

    def test_it_is_checked_against_an_environment(self, reach, policy, toy_mjcf):
        policy.check(reach)
        policy.check(jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0")))
        with pytest.raises(ParameterError, match=r"observation of shape \(\d+,\), the environment has \(\d+,\)"):
            policy.check(ArmEnv("track"))
        with pytest.raises(ParameterError, match=r"action of shape \(6,\), the environment has \(3,\)"):
            policy.check(ArmEnv("home", robot=str(toy_mjcf)))
        limits = reach.robot.limits
        faster = dataclasses.replace(limits, velocity=2.0 * limits.velocity)
        with pytest.raises(ParameterError, match=r"trained with velocity limits \[.*\], the robot .* has \[.*\]"):
            learned(reach, limits=faster).check(reach)

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
