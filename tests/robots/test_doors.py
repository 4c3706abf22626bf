"""One rule for what an own arm's file has to be, whichever door it comes through: the check, the reader, a name."""

import gymnasium as gym
import numpy as np
import pytest

from jssa_gym.envs.world import World
from jssa_gym.evaluation.oracle import Oracle
from jssa_gym.exceptions import RobotModelError
from jssa_gym.policies import POLICIES
from jssa_gym.robots import RobotModel, make_robot
from jssa_gym.robots.prepare import Preparation, examine, write_prepared

WEIGHT = '<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
BEAM = '<visual><origin xyz="0 0 .15"/><geometry><box size=".06 .06 .3"/></geometry></visual>'
TUBE = '<collision><origin xyz="0 0 .15"/><geometry><capsule radius=".05" length=".3"/></geometry></collision>'
LIMITS = 'unit = "rad"\nvelocity = [1.5, 1.5]\nacceleration = [5, 5]\njerk = [30, 30]\n'


def urdf(folder, one=WEIGHT + BEAM + TUBE, two=WEIGHT + BEAM + TUBE, wrist="revolute", table=LIMITS):
    """Two links that draw beams of 0.3 m, with their ``<collision>``; the path."""

    def joint(name, parent, child, height, axis, kind="revolute"):
        limit = '<limit lower="-2" upper="2" velocity="1.5" effort="1"/>' if kind == "revolute" else ""
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {height}"/><axis xyz="{axis}"/>{limit}</joint>'
        )

    path = folder / "arm.urdf"
    path.write_text(
        f'<robot name="tubes"><link name="base"/><link name="one">{one}</link><link name="two">{two}</link>'
        + joint("turn", "base", "one", 0.2, "0 0 1")
        + joint("lift", "one", "two", 0.3, "0 1 0", wrist)
        + "</robot>"
    )
    path.with_suffix(".limits.toml").write_text(table)
    return path


def mjcf(folder, group, drawn=2, table=LIMITS):
    """The same arm as MJCF, its capsules in a group."""

    def link(name, height, axis, inside=""):
        return (
            f'<body name="{name}" pos="0 0 {height}"><joint name="{name} joint" axis="{axis}" range="-2 2"/>'
            f'<geom name="{name} tube" type="capsule" size=".05" fromto="0 0 0  0 0 .3" group="{group}"/>'
            f'<geom type="box" size=".03 .03 .15" pos="0 0 .15" group="{drawn}"/>{inside}</body>'
        )

    path = folder / "arm.xml"
    arm = link("one", 0.2, "0 0 1", link("two", 0.3, "0 1 0"))
    head = '<mujoco model="tubes"><compiler angle="radian" autolimits="true"/><worldbody>'
    path.write_text(f"{head}{arm}</worldbody></mujoco>")
    path.with_suffix(".limits.toml").write_text(table)
    return path


def read(path, **options):
    return RobotModel.from_mjcf(path, velocity=np.ones(2), acceleration=np.ones(2), jerk=np.ones(2), **options)


def seen_by_the_judge(robot):
    """Radii and half lengths of the capsules that MuJoCo measures with, in the scenes that it is given."""
    oracle = Oracle(robot, np.zeros((1, 0, 3)), np.zeros((1, 0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0))
    return oracle.model.geom_size[oracle.arm, :2]


def test_a_urdf_with_capsules_is_a_robot_as_it_is(tmp_path):
    """``<collision>`` holds what ``<visual>`` draws: the check has nothing against it, and neither has the reader."""
    path = urdf(tmp_path)
    assert examine(path).acceptable
    robot = make_robot(path)
    assert robot.joint_names == ("turn", "lift")
    np.testing.assert_array_equal(robot.capsules["radius"], [0.05, 0.05])
    np.testing.assert_allclose(robot.capsules["end"] - robot.capsules["start"], [[0, 0, -0.3]] * 2, atol=1e-12)
    np.testing.assert_allclose(robot.links["offset"], [[0, 0, 0.2], [0, 0, 0.3]], atol=1e-12)
    np.testing.assert_array_equal(robot.limits.jerk, [30, 30])
    np.testing.assert_allclose(seen_by_the_judge(robot), [[0.05, 0.15]] * 2)
    World(robot, "table").close()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"two": WEIGHT + BEAM}, "joint 'lift' draws geom .*, has no capsule, and reaches"),
        ({"two": WEIGHT + BEAM + TUBE.replace('".3"', '".2"')}, "joint 'lift' draws .* mm out of its capsules"),
        ({"two": WEIGHT + BEAM + TUBE.replace("capsule", "cylinder")}, "geom 3 in group 0 is a cylinder"),
        ({"one": BEAM + TUBE}, "arm.urdf has bodies without mass or inertia: they get"),
        ({"wrist": "continuous"}, "joint 'lift' turns without end: it gets the range of one turn"),
    ],
)
def test_what_the_check_finds_in_a_urdf_the_reader_refuses(tmp_path, parts, words):
    path = urdf(tmp_path, **parts)
    assert not examine(path).acceptable
    with pytest.raises(RobotModelError, match=words):
        make_robot(path)
    # and the way out is the same
    made = make_robot(write_prepared(examine(path), tmp_path / "made"))
    assert made.n == 2


def test_who_leaves_a_link_uncovered_is_told_so_after_every_step(tmp_path):
    path = urdf(tmp_path, two=WEIGHT + BEAM, table=LIMITS + 'uncovered = ["lift"]\n')
    env = gym.make("jssa_gym/Home-v0", robot=str(path), human="none")
    _, info = env.reset(seed=0)
    assert info["uncovered"] == ("lift",)
    assert env.step(np.zeros(2))[4]["uncovered"] == ("lift",)
    assert make_robot(path).capsule_names == ("geom 1",)


@pytest.mark.parametrize(("group", "drawn"), [(0, 2), (1, 3), (4, 0)])
def test_which_group_holds_the_capsules_is_an_argument(tmp_path, group, drawn):
    path = mjcf(tmp_path, group, drawn)
    with pytest.raises(RobotModelError, match="group 3"):
        read(path)
    robot = read(path, group=group)
    usual = read(mjcf(tmp_path, 3))
    path = mjcf(tmp_path, group, drawn)
    np.testing.assert_array_equal(robot.capsules, usual.capsules)
    assert robot.capsule_names == ("one tube", "two tube")
    np.testing.assert_allclose(seen_by_the_judge(robot), [[0.05, 0.15]] * 2)
    # of a simulator's scene the capsules are in group 3, and what was there where they were
    scene = World(robot, "table")
    assert sorted(scene.model.geom_group[scene.model.geom_bodyid > 0]) == sorted(
        [3, 3, *[group if drawn == 3 else drawn] * 2]
    )
    scene.close()
    # the table beside the file says it where there is no argument
    with pytest.raises(RobotModelError, match="group 3"):
        make_robot(path)
    path.with_suffix(".limits.toml").write_text(f"{LIMITS}group = {group}\n")
    np.testing.assert_array_equal(make_robot(path).capsules, usual.capsules)
    assert examine(path).acceptable


def test_the_check_takes_a_group_and_says_where_to_write_it(tmp_path):
    path = mjcf(tmp_path, 0)
    found = examine(path, Preparation(group=0))
    assert not found.acceptable
    assert [str(one) for one in found.findings if not one.fits] == [
        "the capsules are looked for in geom group 0: write group = 0 into arm.limits.toml, or --write makes a model "
        "with group 3"
    ]
    assert [cover.found for cover in found.covers] == [("one tube",), ("two tube",)]
    made = make_robot(write_prepared(found, tmp_path / "made"))
    assert made.group == 3
    np.testing.assert_array_equal(made.capsules["radius"], [0.05, 0.05])
    # without it the same file has no capsules, and gets some
    assert [cover.found for cover in examine(path).covers] == [(), ()]


def test_a_table_s_group_is_a_number(tmp_path):
    with pytest.raises(
        RobotModelError, match=r"arm\.limits\.toml: group has to be the number of a geom group, got 'x'"
    ):
        make_robot(mjcf(tmp_path, 0, table=LIMITS + 'group = "x"\n'))


def test_servo_follows_an_arm_that_hardly_weighs_anything(tmp_path):
    """A published Puma has no masses; its servos were made for less than what its links weigh as written: 0.17 rad."""
    light = WEIGHT.replace("<mass", '<origin xyz="0 .3 .15"/><mass').replace('"1"', '"1e-9"').replace(".01", "1e-9")
    path = urdf(tmp_path, one=light + BEAM, two=light + BEAM)
    robot = make_robot(write_prepared(examine(path), tmp_path / "made"))
    env = gym.make("jssa_gym/Home-v0", robot=robot, dynamics="servo", human="none", terminate_on=())
    policy = POLICIES["wander"](env, 0)
    observation, _ = env.reset(seed=0)
    worst = 0.0
    for _ in range(250):
        observation, *_, info = env.step(policy(observation))
        worst = max(worst, np.abs(info["tracking_error"]).max())
    assert worst < 0.006


def test_an_arm_that_is_drawn_by_its_capsules_reaches_as_far_as_they_do(tmp_path):
    """Its reach was 0, and where it stands could not be told."""
    hinge = '<body><joint axis="{}" range="-90 90"/><inertial mass="1" pos="0 0 0" diaginertia=".1 .1 .1"/>'
    arm = f"{hinge.format('0 0 1')}{hinge.format('0 1 0')}{{}}</body></body>"
    text = f"<mujoco><worldbody>{arm}</worldbody></mujoco>"
    path = tmp_path / "arm.xml"
    path.write_text(text.format('<geom type="capsule" group="3" size=".1" fromto="0 0 .2  .4 0 .3"/>'))
    assert examine(path).anatomy.reach == pytest.approx(0.5 + 0.1)
    path.write_text(text.format(""))
    assert "reaches 0 m" in " ".join(str(one) for one in examine(path).obstacles)
