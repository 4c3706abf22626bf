"""People as a camera sees them: now and then, late, off by no more than is said; a shield keeps its promise."""

import json

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs.arm import MOVING, ArmEnv
from jssa_gym.envs.keypoint_camera import CAMERAS, CameraSettings
from jssa_gym.envs.sensor import SensorModel
from jssa_gym.evaluation.contenders import SEEN, Ageless, assumed_of, shielded, within_assumptions
from jssa_gym.evaluation.people import make_person
from jssa_gym.evaluation.policy import make_policy
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body, HumanMotion, together
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import JSSAShield

DT = 0.008


def watch(camera, human="random", ticks=250, seed=0):
    """Scenes as shown and as they are, a pair a tick."""
    env = SensorModel(ArmEnv("home", human=human, terminate_on=()), camera)
    env.reset(seed=seed)
    told = [(env.scene, env.unwrapped.scene)]
    for _ in range(ticks):
        env.step(np.zeros(6))
        told.append((env.scene, env.unwrapped.scene))
    return told


def stamps(told):
    """Of every capsule in every tick, shape (T, m) [s]; -inf before the first."""
    return np.array([scene.time - scene.age for scene, _ in told])


def test_pictures_come_at_the_rate_and_late():
    told = watch(CameraSettings(30.0, latency=0.1))
    at = stamps(told)
    assert np.isinf(at[: round(0.1 / DT)]).all()
    assert not np.isinf(at[round(0.1 / DT) + 1 :]).any()
    moments = np.unique(at[np.isfinite(at)])
    assert set(np.round(np.diff(moments) / DT).astype(int)) == {4, 5}  # 33.3 ms of 8 ms ticks
    assert np.mean(np.diff(moments)) == pytest.approx(1.0 / 30.0, abs=1e-3)
    ages = np.array([scene.age for scene, _ in told[30:]])
    assert ages.min() == pytest.approx(0.104, abs=0.005)
    assert ages.max() <= 0.1 + 1.0 / 30.0 + 2.0 * DT


def test_a_fast_camera_without_latency_shows_every_tick():
    told = watch(CameraSettings(500.0), ticks=50)
    for scene, truth in told:
        assert not scene.age.any()
        arm, true = scene.human.names.index("left_arm"), truth.human.names.index("left_arm")
        np.testing.assert_allclose(scene.human.end[arm], truth.human.end[true], atol=0.03)


def test_what_is_shown_is_off_by_no_more_than_is_said():
    camera = CameraSettings(30.0, latency=0.1, noise=0.02, occlusion=0.02, occlusion_frames=8)
    told = watch(camera, "hand", 400, seed=4)
    truth = [true.human for _, true in told]
    off = []
    for scene, _ in told:
        for i, name in enumerate(scene.human.names):
            if not scene.valid[i] or name in ("head", "core_body"):
                continue
            k = (scene.time - scene.age[i]) / DT
            if abs(k - round(k)) > 1e-6:
                continue  # held by a limb
            true = truth[round(k)]
            j = true.names.index(name)
            off += [
                np.linalg.norm(scene.human.start[i] - true.start[j]),
                np.linalg.norm(scene.human.end[i] - true.end[j]),
            ]
    assert len(off) > 1000
    assert max(off) <= camera.position_error
    assert max(off) > 0.5 * camera.position_error
    # occlusions show: some part is older than pictures come
    ages = np.array([scene.age for scene, _ in told[60:]])
    assert ages.max() > 0.2
    assert not np.isnan(ages).any()


class Two(HumanMotion):
    """Two people who stand 3 m from each other."""

    speed_bound, people, reacts = 0.5, 2, False

    def reset(self, rng, start=None, person=0):
        return together([Body.facing(person=person + k).at((x, 1.0), (0.0, 0.0)) for k, x in enumerate((1.5, -1.5))])

    def step(self, dt, robot):
        return self.reset(None)


def test_people_who_are_taken_for_each_other_grow_old():
    told = watch(CameraSettings(30.0, swap=0.2, swap_frames=8), Two(), 250, seed=1)
    right = watch(CameraSettings(30.0), Two(), 250, seed=1)
    ages, good = (np.array([scene.age for scene, _ in one]) for one in (told, right))
    assert good.max() < 0.05
    assert 0.2 < ages.max() < 0.4
    # whatever they are called, nobody is where the other one is
    for scene, _ in told:
        assert (np.sign(scene.human.start[:6, 0]) == 1.0).all()
        assert (np.sign(scene.human.start[6:, 0]) == -1.0).all()


@pytest.mark.parametrize("name", CAMERAS)
def test_the_same_seed_gives_the_same_bits(name):
    first, again, other = (watch(name, ticks=120, seed=seed) for seed in (5, 5, 6))

    def bits(told):
        return b"".join(s.human.start.tobytes() + s.human.end_velocity.tobytes() + s.age.tobytes() for s, _ in told)

    assert bits(first) == bits(again)
    assert bits(first) != bits(other)


def test_the_environment_does_not_notice():
    with_camera, without = (
        [true.human.start for _, true in watch(camera, ticks=60)] for camera in ("camera 30 Hz", "none")
    )
    np.testing.assert_array_equal(with_camera, without)


def test_a_camera_can_be_made_anew_from_its_spec():
    env = SensorModel(gym.make("jssa_gym/Home-v0"), "camera 30 Hz")
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.faults == CAMERAS["camera 30 Hz"]
    assert SensorModel(gym.make("jssa_gym/Home-v0"), {"rate": 15}).faults == CameraSettings(15.0)
    assert json.loads(env.spec.to_json())


def test_nobody_is_nobody():
    ((scene, _), *_) = watch("camera 30 Hz", "none", 5)
    assert scene.human.names == ()


class Headless(HumanMotion):
    """Somebody of one part."""

    speed_bound, reacts = 1.0, False

    def reset(self, rng, start=None, person=0):
        ends = Body.facing().at((2.0, 0.0), (0.0, 0.0))
        return type(ends)(*(part[:1] for part in ends[:5]), ("ball",), ends.person[:1])

    def step(self, dt, robot):
        return self.reset(None)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: CameraSettings(0.0), "rate has to be a positive"),
        (lambda: CameraSettings(30.0, noise=0.05), "position_error has to be at least the noise, 0.05 m"),
        (lambda: CameraSettings(30.0, occlusion=1.5), "occlusion"),
        (lambda: CameraSettings(30.0, skeleton="hands"), "unknown skeleton 'hands'; valid: coco17"),
        (lambda: CameraSettings(30.0, body="seven"), "unknown body"),
        (lambda: SensorModel(gym.make("jssa_gym/Home-v0"), {"rate": 30.0, "fog": 1.0}), "unknown fault 'fog'"),
        (lambda: SensorModel(gym.make("jssa_gym/Home-v0"), "camera 31 Hz"), "unknown faults 'camera 31 Hz'"),
        (lambda: watch("camera 30 Hz", Headless(), 1), "people of the parts head, core_body"),
    ],
)
def test_what_cannot_be_is_refused(wrong, message):
    with pytest.raises(ParameterError, match=message):
        wrong()


# ---- behind a shield ---------------------------------------------------------------------------------


def play(env, policy, seed, steps):
    """Largest speed of a touching point, and how far the arm moved in all."""
    act = make_policy(policy, env.unwrapped, seed, seen=env)
    observation, _ = env.reset(seed=seed)
    worst, moved = 0.0, 0.0
    for _ in range(steps):
        observation, *_, info = env.step(act(observation))
        worst = max(worst, info["contact_speed"])
        moved += float(np.abs(env.unwrapped.scene.robot.velocity).max()) * DT
    return worst, moved


def test_campaigns_give_a_shield_what_its_camera_says():
    assert SEEN == ("camera 30 Hz",)
    assert within_assumptions("hand", "camera 30 Hz")
    assert not within_assumptions("hand", "camera 30 Hz, swapped ids")
    assert assumed_of("camera 30 Hz") == FailsafeParams(position_error=0.03, max_age=0.4)
    shield = shielded(ArmEnv("home"), "full", "camera 30 Hz")
    assert shield.filter.failsafe == CAMERAS["camera 30 Hz"].assumptions


@pytest.mark.long
@pytest.mark.parametrize("human", ["hand", "pursuit", "two"])
def test_a_shield_behind_a_camera_keeps_its_promise(human):
    moved = 0.0
    for seed in range(2):
        env = shielded(ArmEnv("home", human=make_person(human), terminate_on=()), "full", "camera 30 Hz")
        worst, way = play(env, "chase", seed, 500)
        assert worst <= MOVING
        moved += way
    assert moved > 0.05  # it is no arm that stands still


@pytest.mark.long
def test_a_shield_that_takes_pictures_for_the_present_breaks_it():
    worst = 0.0
    for seed in range(12):
        base = ArmEnv("home", human=make_person("hand"), terminate_on=())
        env = JSSAShield(Ageless(SensorModel(base, "camera 30 Hz")), failsafe=FailsafeParams(position_error=0.03))
        worst = max(worst, play(env, "chase", seed, 500)[0])
        if worst > MOVING:
            return
    raise AssertionError(f"no moving contact, {worst} m/s at most")


def test_a_leaderboard_is_run_as_a_camera_sees_it(tmp_path):
    study = jssa_gym.evaluation.Study(
        ("reach",), ("jssa+stop", "work", "none"), ("walk_by",), ("jpc",), episodes=1, steps=60, sensor="camera 30 Hz"
    )
    for cell in study.seeds():
        env = study.make_env(cell)
        assert isinstance(env.env, SensorModel)
        if cell.filter != "none":
            assert env.filter.failsafe.max_age == 0.4
            assert env.filter.failsafe.position_error == 0.03
    assert study.config()["sensor"] == "camera 30 Hz"
    plain = jssa_gym.evaluation.Study(("reach",), ("jssa+stop",), ("walk_by",), ("jpc",))
    assert "sensor" not in plain.config()
    assert "sensor" not in plain.origin(next(iter(plain.seeds())), 0, "")
    with pytest.raises(ParameterError, match="unknown sensor 'eyes'"):
        jssa_gym.evaluation.Study(("reach",), ("jssa",), ("walk_by",), ("jpc",), sensor="eyes")
