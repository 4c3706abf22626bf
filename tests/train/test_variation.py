"""Environments that vary: within their ranges, from the seed, and never beyond what a shield assumes."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import jssa_gym
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import HUMANS, HumanMotion, Nobody, Paced, RandomWalk, WalkBy, make_human, nobody
from jssa_gym.train import Curriculum, DomainRandomisation

DT = 0.008
BUSY = [name for name in HUMANS if name != "none"]


def shielded(sensor=None, **options):
    env = ArmEnv("reach", **{"human": "random", "terminate_on": (), **options})
    return jssa_gym.JSSAShield(env if sensor is None else jssa_gym.SensorModel(env, sensor))


# ---- people in slow motion ----------------------------------------------------------------------------


@pytest.mark.parametrize("human", [*BUSY, ("random", "hand")], ids=str)
def test_a_pace_of_one_changes_nothing(human):
    plain, paced = make_human(human), Paced(make_human(human), (1.0, 1.0))
    rngs = [np.random.default_rng(5) for _ in range(2)]
    seen = [motion.reset(rng) for motion, rng in zip((plain, paced), rngs, strict=True)]
    for _ in range(150):
        for one, other in zip(*(people[:5] for people in seen), strict=True):
            np.testing.assert_array_equal(one, other)
        seen = [motion.step(DT, nobody()) for motion in (plain, paced)]
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state


@pytest.mark.parametrize("human", BUSY)
def test_people_go_the_same_way_more_slowly(human):
    half, plain = Paced(make_human(human), (0.5, 0.5)), make_human(human)
    seen, expected = half.reset(np.random.default_rng(5)), plain.reset(np.random.default_rng(5))
    for _ in range(100):
        following = half.step(DT, nobody())
        # the velocities are those of the step to come, as of every motion
        moved = seen.start + DT * seen.start_velocity
        np.testing.assert_allclose(moved, following.start, atol=1e-3 if human in ("hand", "receive") else 1e-9)
        expected = plain.step(0.5 * DT, nobody())
        np.testing.assert_allclose(following.start, expected.start, atol=1e-12)
        for part, speeds in zip(following.names, zip(*_speeds(following), strict=True), strict=True):
            assert np.all(np.array(speeds) <= np.array(half.end_speeds_of(part)) * (1 + 1e-9))
        seen = following


def _speeds(people):
    return (np.linalg.norm(v, axis=1) for v in (people.start_velocity, people.end_velocity))


def test_the_bounds_are_those_of_the_fastest_pace():
    plain, paced = make_human("hand"), Paced(make_human("hand"), (0.2, 0.5))
    assert paced.speed_bound == 0.5 * plain.speed_bound
    assert paced.end_speeds_of("right_arm") == tuple(0.5 * speed for speed in plain.end_speeds_of("right_arm"))
    assert paced.acceleration_of("right_arm") == 0.25 * plain.acceleration_of("right_arm")
    assert (paced.reacts, paced.people) == (True, 1)


def test_who_does_not_move_stands_still():
    env = ArmEnv("reach", human=Paced(RandomWalk(), (0.0, 0.0)), terminate_on=())
    env.reset(seed=1)
    first = copy.deepcopy(env.scene.human)
    for _ in range(20):
        env.step(np.zeros(6))
        env.scene.human.start[:] = np.nan  # of nobody else
        env.step(np.zeros(6))
    np.testing.assert_array_equal(env.scene.human.start, first.start)
    assert not env.scene.human.start_velocity.any()


def test_a_vector_has_people_in_slow_motion_as_one_has():
    human = Paced(WalkBy(), (0.3, 0.9))
    envs, alone = (
        gym.make_vec("jssa_gym/Reach-v0", 3, human=human, shield={}),
        [shielded(human=human) for _ in range(3)],
    )
    envs.reset(seed=2)
    for e, env in enumerate(alone):
        env.reset(seed=2 + e)
    for _ in range(40):
        infos = envs.step(np.zeros((3, 6)))[-1]
        for e, env in enumerate(alone):
            assert env.step(np.zeros(6))[-1]["distance"] == infos["distance"][e]


@pytest.mark.parametrize("pace", [(1.0, 0.5), (-0.1, 1.0), 1.0, (0.5, np.inf)])
def test_unsound_paces_are_refused(pace):
    with pytest.raises(ParameterError, match="pace"):
        Paced(RandomWalk(), pace)


def test_who_does_not_say_how_fast_is_not_paced():
    class Mute(Nobody):
        speed_bound = None

    with pytest.raises(ParameterError, match="no speed_bound"):
        Paced(Mute(), (0.5, 1.0))
    with pytest.raises(ParameterError, match="HumanMotion"):
        Paced("random", (0.5, 1.0))
    assert issubclass(Paced, HumanMotion)


# ---- domain randomisation -----------------------------------------------------------------------------


def randomised(**ranges):
    given = {"limits": (0.4, 0.9), "pace": (0.3, 1.0), "latency": (0.0, 0.1)}
    return DomainRandomisation(shielded({"latency": 0.0}), **{**given, **ranges})


def test_what_is_drawn_is_within_its_range_and_from_the_seed():
    env, told = randomised(), []
    for seed in (*range(40), *range(3)):
        _, info = env.reset(seed=seed)
        told.append([info[f"randomised/{name}"] for name in ("limits", "pace", "latency")])
        again = env.step(np.zeros(6))[-1]
        assert [again[f"randomised/{name}"] for name in ("limits", "pace", "latency")] == told[-1]
    assert told[-3:] == told[:3]
    low, high = np.min(told, axis=0), np.max(told, axis=0)
    assert np.all(low >= [0.4, 0.3, 0.0])
    assert np.all(high <= [0.9, 1.0, 0.1])
    assert np.all(high - low > 0.7 * np.array([0.5, 0.7, 0.1]))
    # without a seed every episode is another one
    assert env.reset()[1]["randomised/pace"] != env.reset()[1]["randomised/pace"]


def test_the_arm_keeps_the_limits_that_it_has():
    env = DomainRandomisation(ArmEnv("reach", human="none", terminate_on=()), limits=(0.5, 0.5))
    limits, rng = env.unwrapped.robot.limits, np.random.default_rng(0)
    env.reset(seed=0)
    peaks = np.zeros((3, 6))
    for k in range(300):
        if k % 30 == 0:
            action = np.sign(rng.uniform(-1.0, 1.0, 6))
        jerk = env.step(action)[-1]["jerk"]
        state = env.unwrapped.scene.robot
        peaks = np.maximum(peaks, np.abs([state.velocity, state.acceleration, jerk]))
    shares = peaks / np.array([limits.velocity, limits.acceleration, limits.jerk])
    assert np.all(shares <= 0.5 * (1 + 1e-9))
    assert np.all(shares.max(axis=1) > 0.45)


def test_nothing_given_changes_nothing():
    plain, env = shielded(), DomainRandomisation(shielded())
    plain.reset(seed=3), env.reset(seed=3)
    for action in np.random.default_rng(0).uniform(-1.2, 1.2, (60, 6)):
        expected, told = plain.step(action), env.step(action)
        np.testing.assert_array_equal(told[0], expected[0])
        assert told[1] == expected[1]


@pytest.mark.parametrize("action", [np.full(6, np.nan), np.zeros(5), None, "fast"], ids=str)
def test_what_is_no_action_is_the_shields_affair(action):
    env = DomainRandomisation(shielded(), limits=(0.5, 0.5))
    env.reset(seed=0)
    alone = shielded()
    alone.reset(seed=0)
    try:
        expected = alone.step(action)[-1]["shield/status"]
    except Exception as error:
        with pytest.raises(type(error)):
            env.step(action)
    else:
        assert env.step(action)[-1]["shield/status"] == expected


def test_a_varied_latency_is_what_the_shield_sees():
    env = randomised(limits=None, pace=None, latency=(0.05, 0.05))
    _, info = env.reset(seed=0)
    assert info["randomised/latency"] == 0.05
    for _ in range(20):
        env.step(np.zeros(6))
    np.testing.assert_allclose(env.get_wrapper_attr("scene").age, 0.056)  # in whole ticks


def test_the_shield_holds_whatever_is_drawn():
    env = DomainRandomisation(
        shielded({"latency": 0.0}, human="pursuit"), limits=(0.3, 1.0), pace=(0.2, 1.0), latency=(0.0, 0.15)
    )
    rng = np.random.default_rng(0)
    for seed in range(4):
        env.reset(seed=seed)
        for k in range(200):
            if k % 10 == 0:
                action = rng.uniform(-1.0, 1.0, 6)
            info = env.step(action)[-1]
            assert not info["contact_speed"] > 1e-3
            assert not info["limit_violation"]


@pytest.mark.parametrize(
    ("env", "ranges", "error", "told"),
    [
        (shielded, {"pace": (0.5, 2.5)}, ParameterError, r"may move at 2\.5 m/s with that pace, the shield assumes"),
        (lambda: shielded(human="pursuit"), {"pace": (0.5, 1.1)}, ParameterError, "lower the pace"),
        (lambda: shielded({"latency": 0.0}), {"latency": (0.0, 0.3)}, ParameterError, r"older than 0\.2 s"),
        (shielded, {"latency": (0.0, 0.1)}, InterfaceError, "SensorModel"),
        (lambda: shielded("camera 30 Hz"), {"latency": (0.0, 0.1)}, InterfaceError, "faults of its own"),
        (shielded, {"limits": (0.5, 1.2)}, ParameterError, "limits"),
        (shielded, {"limits": (0.0, 1.0)}, ParameterError, "limits"),
        (shielded, {"pace": (1.0, 0.5)}, ParameterError, "pace"),
        (lambda: gym.make("Pendulum-v1"), {}, InterfaceError, "ArmEnv"),
    ],
    ids=["fast", "chased", "late", "no sensor", "camera", "more", "none", "turned", "foreign"],
)
def test_what_contradicts_the_shield_is_refused(env, ranges, error, told):
    with pytest.raises(error, match=told):
        DomainRandomisation(env(), **ranges)


def test_without_a_verified_stop_nothing_is_assumed():
    DomainRandomisation(ArmEnv("reach", human="random"), pace=(0.5, 2.5))
    DomainRandomisation(jssa_gym.Shield(ArmEnv("reach", human="random"), "jssa"), pace=(0.5, 2.5))


def test_it_belongs_outside_the_shield():
    with pytest.raises(InterfaceError, match="belongs outside the shield"):
        jssa_gym.JSSAShield(DomainRandomisation(ArmEnv("reach"), limits=(0.5, 1.0)))


# ---- curriculum ---------------------------------------------------------------------------------------


def fastest(env, seed=0, steps=60):
    env.reset(seed=seed)
    speeds = []
    for _ in range(steps):
        env.step(np.zeros(6))
        speeds.append(np.linalg.norm(env.unwrapped.scene.human.start_velocity, axis=1).max())
    return max(speeds)


def test_people_are_the_faster_the_harder_it_is():
    env = Curriculum(shielded())
    speeds = []
    for difficulty in (0.0, 0.25, 1.0):
        env.set_difficulty(difficulty)
        speeds.append(fastest(env))
    assert speeds[0] == 0.0
    assert 0.0 < speeds[1] < 0.3 < speeds[2]
    assert speeds[2] == fastest(shielded())
    assert speeds[1] <= 0.25 * make_human("random").speed_bound


def test_the_difficulty_counts_from_the_next_episode_on():
    env = Curriculum(shielded(), 0.5)
    assert env.reset(seed=0)[1]["difficulty"] == 0.5
    env.set_difficulty(1.0)
    assert env.difficulty == 1.0
    assert env.step(np.zeros(6))[-1]["difficulty"] == 0.5
    assert env.reset(seed=0)[1]["difficulty"] == 1.0


@pytest.mark.parametrize("difficulty", [-0.1, 1.1, np.nan, "hard"])
def test_difficulties_out_of_range_are_refused(difficulty):
    env = Curriculum(shielded())
    with pytest.raises(ParameterError, match="difficulty"):
        env.set_difficulty(difficulty)
    assert env.difficulty == 0.0
    with pytest.raises(ParameterError, match="difficulty"):
        Curriculum(shielded(), difficulty)


def test_it_multiplies_with_a_randomised_pace():
    env = Curriculum(DomainRandomisation(shielded(), pace=(0.6, 0.6)), 0.5)
    assert env.reset(seed=0)[1]["randomised/pace"] == pytest.approx(0.3)
    with pytest.raises(ParameterError, match="put Curriculum around"):
        DomainRandomisation(Curriculum(shielded()), pace=(0.5, 1.0))


def test_people_who_are_too_fast_anyway_are_refused():
    env = ArmEnv("reach", human=RandomWalk(speed=2.5), terminate_on=())
    assumed = jssa_gym.FailsafeParams(human_speed=1.0)
    with pytest.raises(ParameterError, match=r"2\.5 m/s"):
        Curriculum(jssa_gym.JSSAShield(env, failsafe=assumed))


@pytest.mark.long
def test_libraries_set_it_in_all_their_environments():
    sb3 = pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env

    class Harder(BaseCallback):
        def _on_step(self):
            self.training_env.env_method("set_difficulty", min(self.num_timesteps / 64, 1.0))
            return True

    venv = make_vec_env(lambda: Curriculum(shielded()), 2)
    sb3.PPO("MlpPolicy", venv, n_steps=16, batch_size=16, n_epochs=1, device="cpu").learn(64, Harder())
    assert venv.get_attr("difficulty") == [1.0, 1.0]


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
@pytest.mark.parametrize("wrap", [Curriculum, lambda env: DomainRandomisation(env, limits=(0.5, 1.0), pace=(0.5, 1.0))])
def test_they_are_environments(wrap):
    check_env(wrap(shielded()), skip_render_check=True)


def test_they_are_made_again_from_their_spec():
    env = gym.make("jssa_gym/ReachShielded-v0", human="random")
    env = Curriculum(DomainRandomisation(env, limits=(0.5, 0.9), pace=(0.2, 0.8)), 0.4)
    again = gym.make(env.spec)
    told = [one.reset(seed=3)[1] for one in (env, again)]
    assert told[0]["randomised/limits"] == told[1]["randomised/limits"]
    assert told[0]["randomised/pace"] == told[1]["randomised/pace"] < 0.33
