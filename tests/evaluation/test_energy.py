"""Energies of contacts: the limits, the mass of an arm against MuJoCo's matrix, and what a shield makes of them."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import jssa_gym
from jssa_gym.envs.arm import ArmEnv
from jssa_gym.evaluation import geometry, rollout, summarise
from jssa_gym.evaluation.oracle import Inertia
from jssa_gym.exceptions import ParameterError
from jssa_gym.policies import ChasePolicy, RandomPolicy
from jssa_gym.robots import ROBOTS, make_robot
from jssa_gym.safety.energy import CONTACT_ENERGY, HAND, HEAD, SHIN, energy_limit, mass_of, regions_of, speed_for
from jssa_gym.shields import JSSAShield

# ---- limits ------------------------------------------------------------------------------------------


def test_limits_are_those_of_the_springs():
    # ISO/TS 15066:2016 prints these to a tenth of a joule, of the same forces and springs
    printed = {"chest": 1.6, "upper_arm": 1.5, "forearm": 1.3, "thigh": 1.9}
    for part, energy in printed.items():
        assert energy_limit(part) == pytest.approx(energy, abs=0.05)
    assert energy_limit("core_body") == min(region.energy for region in regions_of("torso"))


@pytest.mark.parametrize(
    ("part", "regions"),
    [
        *(("head", HEAD), ("LeftHand", HAND), ("right_wrist", regions_of("forearm")), ("left_lower_leg", SHIN)),
        ("torso_with_head", HEAD + regions_of("torso")),  # the least energy and the largest mass of both count
        ("body_with_arms", regions_of("right_arm") + regions_of("torso")),
    ],
)
def test_names_say_which_region(part, regions):
    assert regions_of(part) == regions


def test_a_name_that_says_nothing_may_be_anything():
    assert energy_limit("thing") == min(CONTACT_ENERGY.values())
    assert mass_of("thing") == 75.0
    for part in ("right_arm", "left_leg"):  # one capsule for several regions
        assert len(regions_of(part)) > 1


def test_speeds_keep_the_energy_whatever_the_arm_weighs():
    for part, energy in CONTACT_ENERGY.items():
        speed = speed_for(energy, part)
        for robot in (0.1, 10.0, 1e6):
            for region in regions_of(part):
                reduced = 1.0 / (1.0 / region.mass + 1.0 / robot)
                assert 0.5 * reduced * speed**2 <= region.energy * (1.0 + 1e-12)


def test_an_energy_is_a_contact_speed():
    params = jssa_gym.FailsafeParams(contact_energy={"right_arm": 0.5, "HEAD": 0.0})
    assert params.contact_speed_of("Right_Arm") == pytest.approx(math.sqrt(2.0 * 0.5 / 3.0))
    assert params.contact_speed_of("head") == 0.0
    assert params.contact_speed_of("left_arm") == 0.0  # not named: at rest only
    assert params.names_beside(["head"]) == {"contact_energy": ["right_arm"]}
    both = replace(params, contact_speed={"right_arm": 0.1, "left_arm": 0.2})
    assert [both.contact_speed_of(part) for part in ("right_arm", "left_arm")] == [0.1, 0.2]
    assert replace(both, contact_speed=9.0).contact_speed_of("right_arm") == params.contact_speed_of("right_arm")
    assert jssa_gym.FailsafeParams(contact_energy=0.5).contact_speed_of("left_arm") == speed_for(0.5, "left_arm")
    without = jssa_gym.FailsafeParams(contact_speed={"right_arm": 0.1})
    assert without.contact_energy is None
    assert [without.contact_speed_of(part) for part in ("right_arm", "head")] == [0.1, 0.0]


@pytest.mark.parametrize("wrong", [-1.0, math.nan, "x", {"head": -0.1}, {"head": 0.1, "Head": 0.2}])
def test_what_is_no_energy_is_refused(wrong):
    with pytest.raises(ParameterError, match="contact_energy"):
        jssa_gym.FailsafeParams(contact_energy=wrong)


# ---- the arm's mass ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_the_mass_is_that_of_mujocos_matrix_and_below_the_arms_energy(name):
    mujoco = pytest.importorskip("mujoco")
    robot = make_robot(name)
    inertia, rng = Inertia(robot), np.random.default_rng(0)
    model = robot.spec().compile()
    data = mujoco.MjData(model)
    bodies = [b for b, g in zip(model.geom_bodyid, model.geom_group, strict=True) if g == 3 and b > 0]
    for _ in range(20):
        q = rng.uniform(*robot.limits.position.T)
        v = rng.normal(size=robot.n) * robot.limits.velocity
        k = int(rng.integers(len(robot.capsules)))
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        body = int(bodies[k])
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ rng.normal(size=3) * 0.1
        # the whole matrix, column by column, and its inverse
        matrix = np.zeros((robot.n, robot.n))
        for j in range(robot.n):
            mujoco.mj_mulM(model, data, matrix[j], np.eye(robot.n)[j])
        jacobian = np.zeros((3, robot.n))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        along = normal @ jacobian
        mass = inertia.mass(q, k, point + robot.mount, normal)
        assert mass == pytest.approx(1.0 / (along @ np.linalg.inv(matrix) @ along), rel=1e-9)
        # Cauchy and Schwarz: what a point's motion along a direction carries is at most all that there is
        assert 0.5 * mass * (along @ v) ** 2 <= 0.5 * v @ matrix @ v * (1.0 + 1e-9)


def test_where_no_joint_moves_a_point_the_mass_is_without_bound():
    robot = make_robot("lr_mate_200id_7l")
    axis_point = robot.mount + np.array([0.0, 0.0, 0.2])
    assert Inertia(robot).mass(robot.home, 0, axis_point, np.array([0.0, 0.0, 1.0])) > 1e9


# ---- the metric --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bare():
    """Random jerks beside somebody who walks at the arm until it touches, without a shield."""
    env = ArmEnv("home", human="pursuit", terminate_on=())
    return rollout(env, RandomPolicy(env, 0), seed=1, steps=400), env.robot


def test_the_ratio_is_that_of_the_worst_touch(bare):
    trace, robot = bare
    seen = geometry(trace, robot)
    touches, ratio = seen.touches, summarise(trace, robot.limits, seen).energy_ratio
    assert ratio == touches.energy_ratio.max() > 1.0
    assert np.all(touches.energy_ratio[touches.robot_approach <= 0.0] == 0.0)
    # a lighter arm would give less: the person's mass alone bounds every one
    most = max(0.5 * mass_of(part) / energy_limit(part) for part in trace.human_names)
    assert np.all(touches.energy_ratio <= most * touches.robot_approach**2 * (1.0 + 1e-9))


def test_arm_and_body_part_share_the_motion(bare, monkeypatch):
    trace, robot = bare
    found = {}
    for mass in (np.inf, 10.0):
        monkeypatch.setattr(Inertia, "mass", lambda *_, mass=mass: mass)
        found[mass] = geometry(trace, robot).touches.energy_ratio
    some = found[np.inf] > 0.0
    expected = {part: 10.0 / (10.0 + mass_of(part)) for part in trace.human_names}
    shares = found[10.0][some] / found[np.inf][some]
    # where the axes cross there is no normal, and the arm's mass counts as without bound
    assert {*np.round(shares, 9)} <= {1.0, *np.round(list(expected.values()), 9)}
    assert np.mean(shares < 1.0) > 0.5


def test_nobody_and_servos_have_none(bare):
    trace, robot = bare
    assert summarise(trace, robot.limits).energy_ratio is None
    servo = replace(trace, dynamics="servo")
    assert summarise(servo, robot.limits, geometry(servo, robot)).energy_ratio is None
    still = replace(trace, velocity=np.zeros_like(trace.velocity))
    assert summarise(still, robot.limits, geometry(still, robot)).energy_ratio == 0.0


@pytest.mark.long
def test_a_shield_that_knows_the_energies_keeps_them_and_moves_in_contacts():
    ratios = {}
    for name, energies in (("at rest", None), ("within the energies", dict(CONTACT_ENERGY))):
        ratios[name] = []
        for seed in range(4):
            env = gym.make("jssa_gym/Home-v0", human="pursuit", terminate_on=())
            env = JSSAShield(env, failsafe={"contact_energy": energies})
            trace = rollout(env, ChasePolicy(env.unwrapped, seed), seed=seed, steps=500)
            assert trace.contact.any()
            robot = env.unwrapped.robot
            ratios[name].append(summarise(trace, robot.limits, geometry(trace, robot)).energy_ratio)
    assert max(ratios["at rest"]) < 1e-6
    assert 1e-3 < max(ratios["within the energies"]) <= 1.0
