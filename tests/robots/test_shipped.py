"""The arms that the package comes with besides the paper's: the manufacturers' numbers. Oracle: DH by hand."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs.tasks import TASKS
from jssa_gym.kernels.chain import forward
from jssa_gym.kernels.records import FRAME
from jssa_gym.policies import POLICIES
from jssa_gym.robots import ROBOTS, make_robot
from jssa_gym.robots.coverage import check_coverage, coverage
from jssa_gym.robots.mjcf import COLLISION_GROUP, carrier_links

# UR: "DH parameters for calculations of kinematics and dynamics", a, d, alpha of the UR5e, standard convention
UR5E = [
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
]
# Franka: "Robot and interface specifications", a, d, alpha, Craig's convention, the flange last
FR3 = [
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
    (0.0, 0.107, 0.0),
]


def turn(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    i, k = ((1, 2), (0, 1))[axis == "z"]
    pose[[i, i, k, k], [i, k, i, k]] = c, -s, s, c
    return pose


def shift(x=0.0, z=0.0):
    pose = np.eye(4)
    pose[[0, 2], 3] = x, z
    return pose


def standard(position):
    pose = turn("z", np.pi)  # the description's x axis is the DH table's -x
    for q, (a, d, alpha) in zip(position, UR5E, strict=True):
        pose = pose @ turn("z", q) @ shift(a, d) @ turn("x", alpha)
    return pose[:3, 3]


def craig(position):
    pose = np.eye(4)
    for q, (a, d, alpha) in zip([*position, 0.0], FR3, strict=True):
        pose = pose @ turn("x", alpha) @ shift(a) @ turn("z", q) @ shift(0.0, d)
    return pose[:3, 3]


@pytest.mark.parametrize(("name", "flange"), [("ur5e", standard), ("fr3", craig)])
def test_the_flange_is_where_the_manufacturer_s_table_has_it(name, flange):
    robot, rng = make_robot(name), np.random.default_rng(0)
    frames = np.zeros(robot.n, FRAME)
    for position in [robot.home, *rng.uniform(*robot.limits.position.T, (50, robot.n))]:
        forward(robot.links, np.array([position, np.zeros(robot.n), np.zeros(robot.n)]), frames)
        last = frames[robot.tool_link]
        np.testing.assert_allclose(last["origin"] + last["rotation"] @ robot.tool_offset, flange(position), atol=1e-12)


def test_limits_are_the_published_ones():
    ur5e, fr3 = make_robot("ur5e").limits, make_robot("fr3").limits
    np.testing.assert_allclose(np.degrees(ur5e.velocity), 180.0)
    np.testing.assert_allclose(
        np.degrees(ur5e.position), np.tile([-360, 360], (6, 1)) * [[1], [1], [0.5], [1], [1], [1]]
    )
    np.testing.assert_allclose(fr3.velocity, [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
    np.testing.assert_allclose(fr3.acceleration, 10.0)
    np.testing.assert_allclose(fr3.jerk, 5000.0)
    low = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
    high = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
    np.testing.assert_allclose(fr3.position.T, [low, high])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_drawn_lies_in_capsules(name, caplog):
    robot = ROBOTS[name]()
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    joints = list(range(robot.n))
    links = coverage(model, joints, carrier_links(model, joints), robot.home, COLLISION_GROUP)
    # the paper's gripper turns inside the capsule before it
    assert max(link.own if link.capsules else link.joined for link in links) == 0.0
    assert robot.uncovered == ()
    # who reads another's file has it looked at; these are looked at here alone
    check_coverage(model, joints, carrier_links(model, joints), robot.home, COLLISION_GROUP)
    assert not caplog.records


@pytest.mark.parametrize("name", ROBOTS)
def test_servos_follow(name):
    env = gym.make("jssa_gym/Home-v0", robot=name, dynamics="servo", human="none", terminate_on=())
    shielded = jssa_gym.JSSAShield(env)
    policy = POLICIES["wander"](shielded, 0)
    observation, _ = shielded.reset(seed=0)
    worst, start = 0.0, np.array(env.unwrapped.scene.robot.position)
    for _ in range(200):
        observation, *_, info = shielded.step(policy(observation))
        worst = max(worst, np.abs(info["tracking_error"]).max())
    assert np.abs(env.unwrapped.scene.robot.position - start).max() > 0.3
    assert worst < 5e-3


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", ROBOTS)
def test_every_task_on_every_robot(name, task):
    """Goals can be drawn, the scripted policy sets out, limits hold."""
    human = "pursuit" if task == "home" else None
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", task=task, robot=name, human=human, terminate_on=()))
    policy = POLICIES["bang_bang"](env, 0)
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        for _ in range(60):
            observation, *_, info = env.step(policy(observation))
            assert not info["limit_violation"]
            assert not info["contact_speed"] > 1e-3
        assert np.abs(env.unwrapped.scene.robot.position - env.unwrapped.robot.home).max() > 1e-3


def test_masses_are_the_published_ones():
    for name, masses in (
        ("ur5e", [3.761, 8.058, 2.846, 1.37, 1.3, 0.365]),
        ("fr3", [2.9275, 2.9355, 2.2449, 2.6156, 2.3271, 1.8170, 0.6271]),
    ):
        model = mujoco.MjModel.from_xml_path(str(make_robot(name).mjcf))
        np.testing.assert_allclose(model.body_mass[-len(masses) :], masses)
