"""SensorModel: what it delivers is wrong in the stated way only, and the world behind it does not notice."""

import copy
import dataclasses
import itertools
import json
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from strollers import DT, Stage, ends_of

import jssa_gym
from jssa_gym.envs.faults import FAULTS, GLITCHES, SensorFaults
from jssa_gym.envs.sensor import MissedTicks, SensorModel
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.types import Scene, Status

REPORTED = [name for name, faults in FAULTS.items() if faults.reported]
JOINTS = [name for name, faults in FAULTS.items() if faults.joints]


def watch(faults, ticks: int = 400, seed: int = 0) -> tuple[list[Scene], list[np.ndarray]]:
    """What a sensor shows of two people, a scene a tick, and the truth."""
    env = SensorModel(Stage(), faults)
    env.reset(seed=seed)
    scenes = [env.scene]
    for _ in range(ticks):
        env.step(None)
        scenes.append(env.scene)
    return scenes, env.unwrapped.truth


def digest(scenes: list[Scene]) -> bytes:
    return b"".join(ends_of(s.human).tobytes() + s.age.tobytes() + s.valid.tobytes() for s in scenes)


def stamps(scenes: list[Scene]) -> np.ndarray:
    """In ticks, shape (T, m)."""
    return np.array([(s.time - s.age) / DT for s in scenes])


def runs(flags: np.ndarray) -> list[int]:
    """Lengths of the runs of True that end."""
    lengths, length = [], 0
    for flag in flags:
        if not flag and length:
            lengths.append(length)
        length = length + 1 if flag else 0
    return lengths


# ---- the world does not notice ------------------------------------------------------------------------


def test_without_faults_the_truth_is_delivered():
    scenes, truth = watch("none", 50)
    for scene, true in zip(scenes, truth, strict=True):
        np.testing.assert_array_equal(ends_of(scene.human), true)
        assert not scene.age.any()
        assert scene.valid.all()
        assert scene.human.names == Stage.names


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", FAULTS)
def test_the_same_seed_gives_the_same_bits(name):
    first, again, other = (watch(name, 120, seed)[0] for seed in (5, 5, 6))
    assert digest(first) == digest(again)
    assert digest(first) != digest(other)


def test_an_episode_without_a_seed_goes_on_drawing():
    env = SensorModel(Stage(), "noise")
    error = []
    for seed in (3, None, None, 3):
        env.reset(seed=seed)
        error.append(ends_of(env.scene.human)[:2] - env.unwrapped.truth[0][:2])
    assert not np.allclose(error[0], error[1])
    assert not np.allclose(error[1], error[2])
    np.testing.assert_array_equal(error[0], error[3])


def test_a_seed_given_to_the_environment_alone_counts():
    shown = []
    for _ in range(2):
        stage = Stage()
        stage.reset(seed=4)
        env = SensorModel(stage, "noise")
        env.reset()
        shown.append(ends_of(env.scene.human))
    np.testing.assert_array_equal(*shown)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", FAULTS)
def test_the_truth_stays_as_it_is(name):
    make = lambda: gym.make("jssa_gym/Reach-v0", terminate_on=())  # noqa: E731
    bare, sensed = make(), SensorModel(make(), name)
    rng = np.random.default_rng(0)
    expected, seen = bare.reset(seed=2), sensed.reset(seed=2)
    for _ in range(60):
        np.testing.assert_array_equal(expected[0], seen[0])
        assert repr(expected[1:]) == repr(seen[1:])
        truth, shown = bare.unwrapped.scene, sensed.unwrapped.scene
        np.testing.assert_array_equal(ends_of(truth.human), ends_of(shown.human))
        if not sensed.faults.joints:
            np.testing.assert_array_equal(truth.robot.position, sensed.scene.robot.position)
        # what is done to a perceived scene reaches neither the world nor the next scene
        for array in (sensed.scene.human.start, sensed.scene.age, *sensed.scene.robot):
            array += 100.0
        action = rng.uniform(-1.0, 1.0, 6)
        expected, seen = bare.step(action), sensed.step(action)
    if name == "none":
        np.testing.assert_array_equal(ends_of(sensed.scene.human), ends_of(bare.unwrapped.scene.human))


def test_writing_into_a_delivered_scene_does_not_come_back():
    env = SensorModel(Stage(), SensorFaults(freeze=0.2, freeze_ticks=50, freeze_reported=False))
    env.reset(seed=1)
    frozen, clean = 0, ends_of(env.scene.human)
    while frozen < 5:
        env.step(None)
        shown = ends_of(env.scene.human)
        frozen = frozen + 1 if not np.array_equal(shown, env.unwrapped.truth[-1]) else 0
        np.testing.assert_array_equal(env.scene.age, 0.0)
        assert env.scene.valid.all()
        if frozen > 1:
            np.testing.assert_array_equal(shown, clean)
        clean = shown
        for array in (env.scene.human.start, env.scene.human.end_velocity, env.scene.age):
            array += 1.0
        env.scene.valid[:] = False


@pytest.mark.parametrize("name", FAULTS)
def test_one_tick_has_one_scene(name):
    env = SensorModel(Stage(), name)
    env.reset(seed=0)
    previous = None
    for _ in range(20):
        assert env.scene is env.scene
        assert env.scene is not previous or env.faults.freeze_scene
        previous = env.scene
        env.step(None)


# ---- ages are honest ----------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", REPORTED)
def test_what_is_delivered_was_true_when_the_age_says(name):
    faults = FAULTS[name]
    scenes, truth = watch(name, 500)
    compared = 0
    for scene in scenes:
        delivered = ends_of(scene.human)
        assert np.all(scene.age >= 0.0)
        for j, stamp in enumerate((scene.time - scene.age) / DT):
            if not np.isfinite(stamp) or stamp < -0.5:
                # never measured, or said to be older than the episode
                assert faults.misstamp or not scene.valid[j]
                continue
            if faults.blank and not scene.valid[j]:
                assert np.isnan(delivered[:, j]).all()
                continue
            error = np.linalg.norm(delivered[:, j] - truth[int(stamp + 1e-6)][:, j], axis=-1)
            if faults.misstamp:
                # the data are younger than they are said to be: nobody can have come farther than this
                assert np.all(error[:2] <= faults.noise + 1.6 * (faults.shift + DT) + 1e-9)
            else:
                assert stamp == pytest.approx(round(stamp), abs=1e-6)
                assert np.all(error[:2] <= faults.noise)
                assert np.all(error[2:] <= faults.velocity_noise)
            compared += 1
    assert compared > 1000


def test_noise_reaches_its_bound_and_has_no_direction():
    scenes, truth = watch("noise", 800)
    error = np.array([ends_of(s.human) - t for s, t in zip(scenes, truth, strict=True)])
    for part, bound in ((error[:, :2], 0.02), (error[:, 2:], 0.2)):
        length = np.linalg.norm(part, axis=-1)
        assert 0.95 * bound < length.max() <= bound
        assert length.mean() == pytest.approx(0.75 * bound, rel=0.02)
        assert np.abs(part.mean(axis=(0, 1, 2))).max() < 0.02 * bound


def test_latency_is_rounded_up_to_ticks():
    scenes, _ = watch(SensorFaults(latency=0.1), 50)
    for k, scene in enumerate(scenes):
        assert scene.valid.all() == (k >= 13)
        np.testing.assert_allclose(scene.age, 13 * DT if k >= 13 else np.inf, atol=1e-12)
    exact, _ = watch(SensorFaults(latency=0.08), 100)
    np.testing.assert_allclose([scene.age for scene in exact[10:]], 0.08, atol=1e-12)


def test_jitter_alone_leaves_out_what_was_overtaken():
    scenes, _ = watch(SensorFaults(latency=0.02, jitter=0.06))
    order = stamps(scenes)[12:]
    assert np.all(np.diff(order, axis=0) >= -1e-6)
    assert min(s.age.min() for s in scenes[12:]) >= 0.02
    assert max(s.age.max() for s in scenes[12:]) < 0.02 + 0.06 + 2 * DT
    assert len(np.unique(np.round([s.age[0] for s in scenes[12:]], 6))) > 3


def test_reordering_delivers_older_samples_after_newer_ones():
    scenes, _ = watch("reordering")
    assert np.count_nonzero(np.diff(stamps(scenes)[12:, 0]) < -0.5) > 20


def test_dropouts_come_one_by_one_and_last_as_long_as_they_may():
    scenes, _ = watch("long dropouts", 4000)
    gone = ~np.array([s.valid for s in scenes])
    lengths = [length for column in gone.T for length in runs(column)]
    assert 40 < max(lengths) <= 50 + 50  # two in a row look like one
    assert min(lengths) < 5
    assert np.mean(lengths) == pytest.approx(25.5, rel=0.35)
    assert len(np.unique(gone, axis=0)) > 6
    for scene in scenes:
        np.testing.assert_array_equal(np.isnan(ends_of(scene.human)).all(axis=(0, 2)), ~scene.valid)


def test_stale_dropouts_show_what_was_last_measured():
    scenes, _ = watch("stale dropouts")
    for before, now in itertools.pairwise(scenes):
        for j in np.flatnonzero(~now.valid & np.isfinite(now.age)):
            np.testing.assert_array_equal(ends_of(now.human)[:, j], ends_of(before.human)[:, j])
            assert now.age[j] > before.age[j]


def test_missing_body_parts_are_never_measured():
    scenes, _ = watch(SensorFaults(missing=("right_arm",)), 30)
    for scene in scenes:
        np.testing.assert_array_equal(scene.valid, [name != "right_arm" for name in Stage.names])
        assert np.isinf(scene.age[~scene.valid]).all()


def test_a_reported_freeze_ages_and_a_silent_one_does_not():
    scenes, truth = watch(SensorFaults(freeze=0.02, freeze_ticks=30), 1000)
    age = np.array([s.age[0] for s in scenes])
    assert 20 * DT < age.max() < 70 * DT
    lying, truth = watch(SensorFaults(freeze=0.02, freeze_ticks=30, freeze_reported=False), 2000)
    assert not any(s.age.any() for s in lying[5:])
    assert all(s.valid.all() for s in lying[5:])
    old = [not np.array_equal(ends_of(s.human), t) for s, t in zip(lying, truth, strict=True)]
    assert 0.1 < np.mean(old) < 0.6


def test_duplicates_are_a_tick_old():
    scenes, _ = watch("duplicates")
    age = {round(float(a) / DT) for s in scenes[3:] for a in s.age if np.isfinite(a)}
    assert {0, 1} <= age


def test_outliers_are_elsewhere_and_said_to_be_valid():
    scenes, truth = watch("long outliers", 2000)
    off = np.array([ends_of(s.human)[:2] - t[:2] for s, t in zip(scenes, truth, strict=True)])
    length = np.linalg.norm(off, axis=-1)
    assert np.all((length < 1e-9) | (np.abs(length - 1.0) < 1e-9))
    hit = length[:, 0] > 0.5
    assert 0.02 < hit.mean() < 0.5
    assert all(s.valid.all() for s in scenes)
    # the same place all along, both ends alike
    np.testing.assert_allclose(off[:, 0], off[:, 1], atol=1e-9)
    both = hit[1:] & hit[:-1]
    assert np.mean(np.linalg.norm(np.diff(off[:, 0], axis=0), axis=-1)[both] < 1e-9) > 0.9


def test_swaps_exchange_two_people():
    scenes, truth = watch("swapped identities", 3000)
    swapped = 0
    for scene, true in zip(scenes, truth, strict=True):
        shown = ends_of(scene.human)
        if not np.array_equal(shown, true):
            np.testing.assert_array_equal(shown, true[:, [3, 4, 5, 0, 1, 2]])
            swapped += 1
    assert 60 < swapped < 900


def test_swaps_exchange_two_limbs_of_a_single_person():
    env = SensorModel(gym.make("jssa_gym/Home-v0", terminate_on=()), SensorFaults(swap=1.0))
    env.reset(seed=0)
    for _ in range(10):
        shown, true = ends_of(env.scene.human), ends_of(env.unwrapped.scene.human)
        assert np.count_nonzero(np.any(shown != true, axis=(0, 2))) == 2
        env.step(np.zeros(6))


def test_stamps_can_go_back_and_ahead():
    back, truth = watch("backward stamps")
    assert {0.0, 0.1} == {round(float(a), 9) for s in back for a in s.age}
    np.testing.assert_array_equal(ends_of(back[-1].human), truth[-1])
    ahead, _ = watch("future stamps")
    assert min(s.age.min() for s in ahead) == pytest.approx(-0.05)


def test_faults_say_whether_they_are_reported():
    unseen = {"silent freeze", "short outliers", "long outliers", "swapped identities", "future stamps"}
    assert set(FAULTS) - set(REPORTED) == unseen | set(JOINTS)
    assert {name for name, faults in FAULTS.items() if not faults.seen} == unseen
    # not told by age and validity; lies about people stay lies
    assert not SensorFaults(joint_freeze=0.1).reported
    assert not SensorFaults(joint_freeze=0.1, outlier=0.1).seen
    assert len(FAULTS) >= 15
    assert all(name == "none" or faults != SensorFaults() for name, faults in FAULTS.items())


def test_sensors_can_be_stacked():
    env = SensorModel(SensorModel(Stage(), SensorFaults(latency=0.04, dropout=0.05)), SensorFaults(latency=0.04))
    env.reset(seed=0)
    for _ in range(60):
        env.step(None)
        scene = env.scene
        for j in np.flatnonzero(scene.valid):
            stamp = round((scene.time - scene.age[j]) / DT)
            np.testing.assert_array_equal(ends_of(scene.human)[:, j], env.unwrapped.truth[stamp][:, j])
    assert np.all(scene.age >= 0.08 - 1e-9)


def test_people_may_come_and_go():
    env = SensorModel(Stage(), SensorFaults(latency=0.016))
    env.reset(seed=0)
    stage = env.unwrapped
    for _ in range(5):
        env.step(None)
    stage.names, stage.truth = stage.names[:3], [true[:, :3] for true in stage.truth]
    stage.speed = stage.speed[:3]
    stage.moved = lambda: stage.truth[-1]
    env.step(None)
    # whoever they are, none of them has been measured
    assert env.scene.valid.shape == (3,)
    assert not env.scene.valid.any()
    env.step(None)
    env.step(None)
    assert env.scene.valid.all()


# ---- joints and clock -----------------------------------------------------------------------------------


def felt(faults, ticks=400, seed=0) -> tuple[list[Scene], list[Scene]]:
    """What a sensor shows of a moving arm and somebody, a scene a tick, and the truth."""
    env = SensorModel(gym.make("jssa_gym/Home-v0", human="walk_by", terminate_on=()), faults)
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    shown, true = [copy.deepcopy(env.scene)], [env.unwrapped.scene]
    for _ in range(ticks):
        env.step(rng.uniform(-1.0, 1.0, 6))
        # what is done to a delivered scene comes back only where the object itself does
        shown.append(copy.deepcopy(env.scene))
        if not env.faults.freeze_scene:
            for array in (*env.scene.robot, env.scene.human.start):
                array += 1e3
        true.append(env.unwrapped.scene)
    return shown, true


def joints(scenes) -> np.ndarray:
    """Shape (T, 3, 6)."""
    return np.array([np.array(scene.robot) for scene in scenes])


def off(faults, **arguments) -> np.ndarray:
    """What is read too much in every tick, shape (T, 3, 6); people and clock have to be right."""
    shown, true = felt(faults, **arguments)
    for scene, truth in zip(shown, true, strict=True):
        assert scene.time == truth.time
        np.testing.assert_array_equal(ends_of(scene.human), ends_of(truth.human))
    assert not np.any(joints(shown[:1]) - joints(true[:1]))
    return joints(shown) - joints(true)


def test_joints_that_freeze_are_read_again_while_people_go_on():
    shown, true = felt(SensorFaults(joint_freeze=0.1, joint_freeze_ticks=10))
    read, really = joints(shown), joints(true)
    again = np.array([np.array_equal(a, b) for a, b in itertools.pairwise(read)])
    assert 0.1 < again.mean() < 0.5
    assert 5 < max(runs(again)) <= 20
    np.testing.assert_array_equal(read[1:][~again], really[1:][~again])
    for scene, truth in zip(shown, true, strict=True):
        assert scene.time == truth.time
        np.testing.assert_array_equal(ends_of(scene.human), ends_of(truth.human))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", GLITCHES)
def test_a_glitch_reads_what_its_kind_says_and_ends(kind, robot):
    limits, faults = robot.limits, SensorFaults(joint_glitch=0.1, joint_glitch_kind=kind, joint_glitch_size=0.5)
    shown, true = felt(faults)
    read, really = joints(shown), joints(true)
    wrong = np.any(read != really, axis=(1, 2))
    assert 0.05 < wrong.mean() < 0.15
    read, really = read[wrong], really[wrong]
    if kind == "rest":
        np.testing.assert_array_equal(read[:, 0], really[:, 0])
        assert not read[:, 1:].any()
    elif kind == "acceleration":
        np.testing.assert_array_equal(read[:, :2], really[:, :2])
        np.testing.assert_allclose(read[:, 2], np.broadcast_to(-0.5 * limits.acceleration, read[:, 2].shape))
    elif kind == "position":
        np.testing.assert_array_equal(read[:, 1:], really[:, 1:])
        np.testing.assert_allclose(read[:, 0] - really[:, 0], 0.5)
    elif kind == "huge":
        assert np.all(read[:, 1] == 1e308)
        np.testing.assert_array_equal(read[:, 0], really[:, 0])
    else:
        low, high = limits.position.T
        share = (read - really) / np.array([high - low, limits.velocity, limits.acceleration])
        assert np.all(np.abs(share) <= 0.5 * (1.0 + 1e-12))
        assert np.abs(share).max() > 0.45
        assert abs(share.mean()) < 0.05


def test_any_glitch_is_drawn_anew_and_lasts():
    wrong = off(SensorFaults(joint_glitch=0.05, joint_glitch_ticks=20), ticks=1500)
    kinds = {tuple(np.any(one, axis=1)) for one in wrong} - {(False, False, False)}
    # position alone, velocity alone, acceleration alone, both, all
    assert len(kinds) == 5
    assert max(runs(np.any(wrong != 0.0, axis=(1, 2)))) > 10


def test_a_drift_grows_by_the_same_share_in_every_tick(robot):
    limits = robot.limits
    low, high = limits.position.T
    share = off("drift") / np.array([high - low, limits.velocity, limits.acceleration])
    np.testing.assert_allclose(share, 5e-7 * np.arange(401)[:, None, None] * np.ones((3, 6)), atol=1e-12)


def test_a_scene_that_lags_is_an_old_one_altogether():
    shown, true = felt(SensorFaults(lag=0.02, lag_ticks=30, lag_age=3))
    late = np.array([round((truth.time - scene.time) / DT) for scene, truth in zip(shown, true, strict=True)])
    assert set(late[3:]) == {0, 3}
    assert 0.05 < (late > 0).mean() < 0.6
    for k, scene in enumerate(shown):
        np.testing.assert_array_equal(np.array(scene.robot), np.array(true[k - late[k]].robot))
        np.testing.assert_array_equal(ends_of(scene.human), ends_of(true[k - late[k]].human))
    always, true = felt("late scene", ticks=30)
    assert [scene.time for scene in always] == [truth.time for truth in (true[0], *true[:-1])]


def test_a_stale_scene_is_the_same_object():
    env = SensorModel(Stage(), SensorFaults(freeze_scene=0.1, freeze_scene_ticks=10))
    env.reset(seed=0)
    scenes = [env.scene]
    for _ in range(400):
        env.step(None)
        scenes.append(env.scene)
    again = np.array([a is b for a, b in itertools.pairwise(scenes)])
    assert 0.2 < again.mean() < 0.7
    assert 5 < max(runs(again)) <= 20
    np.testing.assert_array_equal(
        [scene.time for scene, same in zip(scenes[1:], again, strict=True) if not same],
        (np.flatnonzero(~again) + 1) * DT,
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", JOINTS)
def test_faults_of_the_joints_come_from_the_seed_and_begin_after_the_reset(name):
    first, again, other = (joints(felt(name, 100, seed)[0]) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    shown, true = felt(name, 300)
    np.testing.assert_array_equal(joints(shown[:1]), joints(true[:1]))
    assert any(
        a.time != b.time or not np.array_equal(np.array(a.robot), np.array(b.robot))
        for a, b in zip(shown, true, strict=True)
    )


def test_faults_of_the_joints_change_nothing_that_is_drawn_for_people():
    faults = SensorFaults(noise=0.01, dropout=0.05, dropout_ticks=4, joint_glitch=0.3, joint_freeze=0.1)
    bare = dataclasses.replace(faults, joint_glitch=0.0, joint_freeze=0.0)
    assert digest(watch(faults)[0]) == digest(watch(bare)[0])


def test_faults_of_the_joints_need_an_arm():
    class Nobodys(gym.Env):
        scene = None

    with pytest.raises(InterfaceError, match="has no robot"):
        SensorModel(Nobodys(), "drift")
    SensorModel(Nobodys(), "noise")


def test_missed_ticks_below_stay_missed():
    env = SensorModel(MissedTicks(Stage(), 0.2, 3), "rare joint faults")
    env.reset(seed=0)
    gone = 0
    for _ in range(200):
        env.step(None)
        assert (env.scene is None) == (env.env.scene is None)
        gone += env.scene is None
    assert gone > 20


# ---- around an arm, under a shield --------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("failsafe", [False, True])
def test_a_shield_lives_with_every_fault(name, failsafe):
    sensor = SensorModel(gym.make("jssa_gym/Home-v0", terminate_on=()), name)
    env = jssa_gym.JSSAShield(sensor, failsafe=failsafe)
    env.reset(seed=3)
    rng, seen = np.random.default_rng(0), set()
    for _ in range(200):
        shown = sensor.scene
        observation, reward, *_, info = env.step(rng.uniform(-0.5, 0.5, 6))
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert np.isfinite(info["jerk"]).all()
        # the shield reads what the sensor shows; only the verified stop can do without a measurement for a while
        if FAULTS[name].joints:
            pass  # the next test
        elif not failsafe:
            assert (info["shield/status"] == Status.FAULT) == (not shown.valid.all())
        elif shown.valid.all() and (shown.age == 0.0).all() and FAULTS[name].reported:
            assert info["shield/status"] != Status.FAULT
        seen.add(info["shield/status"])
    never = FAULTS[name].missing or (failsafe and FAULTS[name].latency >= 0.2)
    if not FAULTS[name].joints:
        assert seen == {Status.FAULT} if never else Status.NOMINAL in seen


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", JOINTS)
def test_a_shield_notices_every_wrong_joint_state_and_stays_inside_the_limits(name):
    sensor = SensorModel(gym.make("jssa_gym/Home-v0", human="walk_by", terminate_on=()), name)
    env = jssa_gym.JSSAShield(sensor, failsafe={"position_error": sensor.faults.noise})
    env.reset(seed=3)
    limits, rng, wrong, faults = sensor.unwrapped.robot.limits, np.random.default_rng(0), 0, 0
    low, high = limits.position.T
    scale = np.array([high - low, limits.velocity, limits.acceleration])
    for _ in range(400):
        read, truth = sensor.scene, sensor.unwrapped.scene
        off = np.abs((np.array(read.robot) - np.array(truth.robot)) / scale).max() > 2e-9 or read.time != truth.time
        *_, info = env.step(rng.uniform(-1.0, 1.0, 6))
        assert not info["limit_violation"]
        if off:
            assert info["shield/status"] == Status.FAULT
        wrong, faults = wrong + off, faults + (info["shield/status"] == Status.FAULT)
    assert wrong > 0
    if name in ("noisy joints", "drift", "late scene"):
        # for good: at rest
        assert faults == 399
        assert np.abs(sensor.unwrapped.scene.robot.velocity).max() < 1e-6
    else:
        assert faults < 390


def test_a_scene_that_is_late_is_noticed_though_the_arm_rests():
    # joints that rest look the same at all times: only the clock tells that the people are those of the past
    sensor = SensorModel(gym.make("jssa_gym/Home-v0", human="walk_by", terminate_on=()), "lagging scene")
    env = jssa_gym.JSSAShield(sensor)
    env.reset(seed=3)
    late = []
    for _ in range(400):
        if sensor.scene.time < sensor.unwrapped.scene.time:
            late.append(env.step(np.zeros(6))[4]["shield/status"])
        else:
            env.step(np.zeros(6))
    assert len(late) > 50
    assert set(late) == {Status.FAULT}


def test_gymnasium_finds_nothing_to_complain_about():
    # without gaps: a faulty tick's info has NaN, which the check takes for two different values
    env = jssa_gym.JSSAShield(SensorModel(gym.make("jssa_gym/Reach-v0"), "noise"))
    with warnings.catch_warnings():
        # it advises to check the unwrapped environment, which other tests do
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        check_env(env, skip_render_check=True)


def test_a_spec_rebuilds_it_even_as_json():
    env = SensorModel(gym.make("jssa_gym/Home-v0", terminate_on=()), SensorFaults(latency=0.02, missing=("head",)))
    again = gym.envs.registration.EnvSpec.from_json(env.spec.to_json()).make()
    one, two = env.reset(seed=1), again.reset(seed=1)
    np.testing.assert_array_equal(one[0], two[0])
    for _ in range(5):
        env.step(np.zeros(6))
        again.step(np.zeros(6))
    assert digest([env.scene]) == digest([again.scene])
    assert json.loads(env.spec.to_json())


def test_nobody_to_see_is_no_problem():
    for name in FAULTS:
        env = SensorModel(gym.make("jssa_gym/Home-v0", human="none"), name)
        env.reset(seed=0)
        env.step(np.zeros(6))
        assert env.scene.age.shape == (0,)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"noise": -0.1}, "noise"),
        ({"latency": np.nan}, "latency"),
        ({"jitter": np.inf}, "jitter"),
        ({"dropout": 1.5}, "dropout"),
        ({"freeze": "often"}, "freeze"),
        ({"freeze_ticks": 0}, "freeze_ticks"),
        ({"swap_ticks": 2.5}, "swap_ticks"),
        ({"reorder": 1}, "reorder"),
        ({"shift": np.nan}, "shift"),
        ({"missing": "head"}, "missing"),
        ({"delay": 0.1}, "valid: noise"),
        ({"joint_freeze": 1.5}, "joint_freeze"),
        ({"joint_glitch": -0.1}, "joint_glitch"),
        ({"joint_glitch_kind": "jump"}, "valid: any, rest, acceleration, position, huge, noise"),
        ({"joint_glitch_size": -1.0}, "joint_glitch_size"),
        ({"joint_drift": np.nan}, "joint_drift"),
        ({"lag": np.nan}, "lag"),
        ({"lag_age": 0}, "lag_age"),
        ({"freeze_scene_ticks": 0.5}, "freeze_scene_ticks"),
    ],
)
def test_bad_settings_are_named(settings, word):
    with pytest.raises(ParameterError, match=word):
        SensorModel(Stage(), settings)


def test_bad_faults_are_named():
    with pytest.raises(ParameterError, match="valid: none, noise"):
        SensorModel(Stage(), "fog")
    with pytest.raises(ParameterError, match="SensorFaults"):
        SensorModel(Stage(), 3)
    env = SensorModel(Stage(), SensorFaults(missing=("tail",)))
    with pytest.raises(ParameterError, match=r"tail.*valid: head, right_arm, left_leg$"):
        env.reset(seed=0)


def test_nothing_is_shown_before_a_reset():
    for wrapper in (SensorModel(Stage(), "none"), MissedTicks(Stage())):
        with pytest.raises(gym.error.ResetNeeded):
            wrapper.step(None)
    with pytest.raises(gym.error.ResetNeeded):
        _ = SensorModel(Stage(), "none").scene


# ---- missed ticks -------------------------------------------------------------------------------------


def missed(seed: int, ticks: int = 600) -> np.ndarray:
    env = MissedTicks(Stage(), 0.05, 15)
    env.reset(seed=seed)
    assert env.scene is not None
    gone = []
    for _ in range(ticks):
        env.step(None)
        gone.append(env.scene is None)
    return np.array(gone)


def test_missed_ticks_come_from_the_seed_and_last_as_long_as_they_may():
    np.testing.assert_array_equal(missed(1), missed(1))
    assert not np.array_equal(missed(1), missed(2))
    lengths = runs(missed(1, 4000))
    assert 12 < max(lengths) <= 30
    assert min(lengths) == 1


@pytest.mark.parametrize("outside", [True, False])
def test_a_shield_brakes_in_missed_ticks(outside):
    inner = gym.make("jssa_gym/Home-v0", terminate_on=())
    chain = MissedTicks(SensorModel(inner, "none")) if outside else SensorModel(MissedTicks(inner), "none")
    env = jssa_gym.JSSAShield(chain)
    env.reset(seed=0)
    faults = 0
    for _ in range(200):
        gone = chain.scene is None
        *_, info = env.step(np.full(6, 0.1))
        assert (info["shield/status"] == Status.FAULT) == gone
        faults += gone
    assert 10 < faults < 190


@pytest.mark.parametrize(
    "sensor", [lambda env: SensorModel(env, "noise"), MissedTicks], ids=["SensorModel", "MissedTicks"]
)
def test_outside_a_shield_it_is_refused(sensor):
    shielded = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0"))
    for env in (shielded, gym.wrappers.TimeLimit(shielded, 10)):
        with pytest.raises(
            InterfaceError, match=r"has a shield already.* as in JSSAShield\((SensorModel|MissedTicks)\(env"
        ):
            sensor(env)


@pytest.mark.parametrize("settings", [{"probability": 2.0}, {"longest": 0}])
def test_bad_gaps_are_named(settings):
    with pytest.raises(ParameterError, match=next(iter(settings))):
        MissedTicks(Stage(), **settings)
