"""What a robot description may be, what is refused by name, and the shipped arm's published numbers."""

import dataclasses

import mujoco
import numpy as np
import pytest
import reference as ref

from jssa_gym.exceptions import JSSAGymError, ParameterError, RobotModelError
from jssa_gym.kernels.chain import forward
from jssa_gym.kernels.records import FRAME
from jssa_gym.robots import ROBOTS, JointLimits, RobotModel, lr_mate_200id_7l, make_robot
from jssa_gym.robots.lr_mate_200id_7l import MJCF

# Source: FANUC-CORPORATION/fanuc_description v2.1.1 (Apache-2.0),
# fanuc_lrmate_description/urdf/lrmate200id7l_urdf_macro.xacro. All joint origins have zero rotation.
ORIGINS = [(0, 0, 0.330), (0.050, 0, 0), (0, 0, 0.440), (0, 0, 0.035), (0.420, 0, 0), (0, 0, 0)]
AXES = [(0, 0, 1), (0, 1, 0), (0, -1, 0), (-1, 0, 0), (0, -1, 0), (-1, 0, 0)]
# Catalogue; J1 is +-170 deg there, +-180 deg in the description file.
POSITION_DEG = [(-170, 170), (-100, 145), (-70, 213), (-190, 190), (-125, 125), (-360, 360)]
VELOCITY_DEG = [370, 310, 410, 550, 545, 1000]
# body: mass [kg], centre of mass [m], inertia about it ixx ixy ixz iyy iyz izz [kg m^2]
INERTIALS = {
    "base": (5.09, (-0.0146, -0.000342, 0.0796), (0.0241, -0.000552, 0.000285, 0.0294, -0.000117, 0.0309)),
    "J1_link": (5.41, (0.0287, 0.000102, -0.0547), (0.0401, 0.0000229, -0.0053, 0.0291, 0.000117, 0.0310)),
    "J2_link": (10.9, (-0.00311, -0.00124, 0.217), (0.280, 0.0000324, 0.000718, 0.255, -0.00195, 0.0511)),
    "J3_link": (
        2.07,
        (0.00887, -0.0000626, 0.0171),
        (0.00562, -0.0000442, -0.000598, 0.0064, -0.0000443, 0.00643),
    ),
    "J4_link": (
        3.07,
        (0.266, 0.00354, 0.00226),
        (0.00511, -0.00000922, 0.0000312, 0.0347, -0.0000096, 0.0346),
    ),
    "J5_link": (0.428, (0.0177, 0.0025, 0), (0.000326, 0.0000179, 0, 0.000578, 0, 0.000542)),
    "J6_link": (0.0129, (0.074, 0, 0), (0.00000264, 0, 0, 0.00000148, 0, 0.00000148)),
}
# Acceleration and jerk rows in degrees. The paper set: jerk as printed in the JSSA paper, section 4, and the
# acceleration implied by it. The stream set: Stream_Motion_Controller, teleoperation branch, LR Mate row.
LIMITS_DEG = {
    "paper": ([641, 576, 592, 1184, 1184, 1809], [3798, 3408, 3505, 7011, 7011, 10712]),
    "stream": ([770, 645, 1025, 2022, 2128, 1785], [3211, 2690, 5125, 14868, 16632, 6377]),
}
# Fitted to enclose the manufacturer's link meshes: link (0 is J1's), start, end [m], radius [m].
CAPSULES = {
    "base_column": (0, (0.05, 0, -0.02), (0, 0, -0.27), 0.162),
    "upper_arm": (1, (0, 0, 0), (0, 0, 0.44), 0.125),
    "elbow": (2, (0.03, 0, 0.04), (-0.01, 0, 0.01), 0.094),
    "forearm": (3, (0.10, 0, 0), (0.42, 0, 0), 0.072),
    "wrist_tool": (4, (0, 0, 0), (0.16, 0, 0), 0.060),
}
# The other pairs overlap in every pose by construction.
SELF_PAIRS = {
    ("base_column", "elbow"),
    ("base_column", "forearm"),
    ("base_column", "wrist_tool"),
    ("upper_arm", "wrist_tool"),
    ("elbow", "wrist_tool"),
}


def arm_xml(joints='<joint name="one"/>', inside="", geom='<geom name="tube" {}/>', more="", extra=""):
    """A two-joint arm whose parts the tests replace by forbidden ones."""
    geom = geom.format('type="capsule" group="3" size=".05" fromto="0 0 0 0 0 .3"')
    return f"""
    <mujoco model="tiny">
      <compiler angle="radian" autolimits="true"/>
      <default><joint type="hinge" axis="0 1 0" range="-1 2"/></default>
      <worldbody>
        {more}
        <body name="lower">{joints}{geom}
          <body name="upper" pos="0 0 .3"><joint name="two"/>
            <geom name="fore" type="capsule" group="3" size=".04" fromto="0 0 0 .2 0 0"/>{inside}
          </body>
        </body>
      </worldbody>
      {extra}
    </mujoco>"""


def read(tmp_path, xml, **limits):
    path = tmp_path / "tiny.xml"
    path.write_text(xml)
    return RobotModel.from_mjcf(path, **({"velocity": [1, 2], "acceleration": [3, 4], "jerk": [5, 6]} | limits))


def at(robot, q):
    frames = np.zeros(robot.n, FRAME)
    forward(robot.links, np.array([q, np.zeros(robot.n), np.zeros(robot.n)]), frames)
    return frames


# ---- the shipped arm -------------------------------------------------------------------------------------


def test_kinematics_are_the_manufacturer_s():
    """The arm in the simulator has the lengths and axes of the arm in the cell."""
    robot = lr_mate_200id_7l()
    assert robot.n == 6
    assert robot.joint_names == ("J1", "J2", "J3", "J4", "J5", "J6")
    np.testing.assert_allclose(robot.links["offset"], ORIGINS, rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.links["axis"], AXES, rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.links["rotation"], np.tile(np.eye(3), (6, 1, 1)), rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.limits.position, np.radians(POSITION_DEG), rtol=1e-12)


def test_masses_are_the_manufacturer_s():
    """Torques and servo motion in the simulator follow from the published masses and inertias."""
    model = mujoco.MjModel.from_xml_path(str(MJCF))
    assert np.isclose(model.body_mass.sum(), sum(mass for mass, _, _ in INERTIALS.values()), rtol=1e-12)
    for name, (mass, centre, (xx, xy, xz, yy, yz, zz)) in INERTIALS.items():
        body = model.body(name)
        assert body.mass[0] == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(body.ipos, centre, rtol=0, atol=1e-12)
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, body.iquat)
        axes = axes.reshape(3, 3)
        inertia = axes @ np.diag(body.inertia) @ axes.T
        np.testing.assert_allclose(inertia, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], rtol=0, atol=1e-9 + 1e-6 * xx)


@pytest.mark.parametrize("name", LIMITS_DEG)
def test_limits_are_the_published_rows(name):
    """The jerk box of every shield is this row; a wrong digit would make a promise about another robot."""
    limits = lr_mate_200id_7l(name).limits
    acceleration, jerk = LIMITS_DEG[name]
    np.testing.assert_allclose(np.degrees(limits.velocity), VELOCITY_DEG, rtol=1e-12)
    np.testing.assert_allclose(np.degrees(limits.acceleration), acceleration, rtol=1e-12)
    np.testing.assert_allclose(np.degrees(limits.jerk), jerk, rtol=1e-12)


def test_the_paper_s_limits_are_consistent():
    """The printed jerk row is 0.9 V / (0.304 s 0.152 s), cut off; V / 0.304 s is the acceleration."""
    V = np.array([195, 175, 180, 360, 360, 550])
    acceleration, jerk = LIMITS_DEG["paper"]
    np.testing.assert_allclose(acceleration, V / 0.304, atol=1.0)
    np.testing.assert_allclose(jerk, 0.9 * V / (0.304 * 0.152), atol=1.0)
    assert lr_mate_200id_7l().limits.jerk == pytest.approx(lr_mate_200id_7l("paper").limits.jerk)


def test_limits_as_the_kernels_take_them():
    limits = JointLimits([[-1, 2], [-3, 4]], [5, 6], [7, 8], [9, 10])
    bounds = limits.bounds()
    np.testing.assert_array_equal(bounds, [[-1, -3], [2, 4], [5, 6], [7, 8], [9, 10]])
    # kernels are compiled for arrays that can be written to; no two owners share one
    assert (bounds.dtype, bounds.flags.c_contiguous, bounds.flags.writeable) == (np.float64, True, True)
    bounds[:] = 0.0
    assert limits.bounds()[4, 1] == limits.jerk[1] == 10.0


def test_unknown_limits_name_the_valid_ones():
    """A typing error in the name of a set of limits must not pass as some default."""
    with pytest.raises(ParameterError, match=r"'fast'.*paper, stream"):
        lr_mate_200id_7l("fast")


def test_home_and_tool():
    """Home points the tool down, the flange at (0.470, 0, 0.725) m and the tool point 0.08 m beyond."""
    robot = lr_mate_200id_7l()
    np.testing.assert_allclose(np.degrees(robot.home), [0, 0, 0, 0, -90, 0], atol=1e-12)
    for q, flange, tool in (
        (robot.home, (0.470, 0, 0.725), (0.470, 0, 0.645)),
        (np.zeros(6), (0.550, 0, 0.805), (0.630, 0, 0.805)),
    ):
        frames = at(robot, q)
        last = frames[5]
        np.testing.assert_allclose(last["origin"] + last["rotation"] @ [0.08, 0, 0], flange, rtol=0, atol=1e-12)
        frame = frames[robot.tool_link]
        reached = frame["origin"] + frame["rotation"] @ robot.tool_offset
        np.testing.assert_allclose(reached, tool, rtol=0, atol=1e-12)
    # the largest distance of the wrist centre from the J1 axis
    q = np.radians([0.0, 90.0, 0.0, 0.0, 0.0, 0.0])
    q[2] = np.pi / 2.0 - np.arctan2(0.035, 0.420)
    wrist = at(robot, q)[4]["origin"]
    assert np.hypot(wrist[0], wrist[1]) == pytest.approx(0.911, abs=6e-4)


def test_capsules_are_the_fitted_ones():
    """The capsules that enclose the manufacturer's meshes: shorter or thinner ones would not."""
    robot = lr_mate_200id_7l()
    assert robot.capsule_names == tuple(CAPSULES)
    for capsule, (link, start, end, radius) in zip(robot.capsules, CAPSULES.values(), strict=True):
        assert capsule["link"] == link
        np.testing.assert_allclose(capsule["start"], start, rtol=0, atol=1e-12)
        np.testing.assert_allclose(capsule["end"], end, rtol=0, atol=1e-12)
        assert capsule["radius"] == radius
        length = np.linalg.norm(np.subtract(start, end))
        assert np.linalg.norm(capsule["start"] - capsule["end"]) == pytest.approx(length, abs=1e-12)


def test_self_collision_pairs():
    """Checked are the pairs that can collide, not those that overlap by construction."""
    robot = lr_mate_200id_7l()
    names = robot.capsule_names
    assert {(names[i], names[j]) for i, j in robot.self_pairs} == SELF_PAIRS
    assert robot.self_pairs.shape == (5, 2)


def test_home_is_free_of_self_collision_and_within_limits():
    """An episode starts at home; it has to be a legal place."""
    robot = lr_mate_200id_7l()
    assert np.all(robot.limits.position[:, 0] < robot.home)
    assert np.all(robot.home < robot.limits.position[:, 1])
    poses = ref.link_poses(ref.lr_mate_chain(), robot.home)

    def world(k):
        c = robot.capsules[k]
        pose = poses[c["link"] + 1]
        return *(pose[:3, :3] @ c[end] + pose[:3, 3] for end in ("start", "end")), c["radius"]

    for i, j in robot.self_pairs:
        assert ref.capsule_distance(*world(i), *world(j)) > 0.0


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_is_whole_and_read_only(name):
    """Contract of the registry: consistent shapes, and nobody can edit a model that others share."""
    robot = make_robot(name)
    n = robot.n
    assert make_robot(name) is robot
    assert make_robot(robot) is robot
    assert len(robot.joint_names) == n
    assert len(robot.capsule_names) == len(robot.capsules)
    assert robot.limits.position.shape == (n, 2)
    assert robot.home.shape == robot.limits.jerk.shape == (n,)
    assert robot.mjcf.is_file()
    limits = robot.limits
    for array in (
        robot.links,
        robot.capsules,
        robot.self_pairs,
        robot.home,
        robot.tool_offset,
        robot.mount,
        limits.position,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
    ):
        assert not array.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.home = np.zeros(n)
    mounted = robot.mounted([0, 0, 0.87])
    assert not mounted.links.flags.writeable
    assert not mounted.mount.flags.writeable
    assert robot.mount[2] == 0.0


def test_limits_are_copied():
    """Limits do not follow an array that the caller goes on changing."""
    velocity = np.ones(2)
    limits = JointLimits(np.array([[-1.0, 1.0], [-1.0, 1.0]]), velocity, np.ones(2), np.ones(2))
    velocity[:] = 100.0
    np.testing.assert_array_equal(limits.velocity, 1.0)


# ---- what is refused -------------------------------------------------------------------------------------

CAPSULE_GEOM = 'type="capsule" group="3" size=".05" fromto="0 0 0 0 0 .3"'
WRAPPED = '<joint joint="one" coef="1"/><joint joint="two" coef="-1"/>'
FREE = f"<fixed>{WRAPPED}</fixed>"
TIED = '<spatial range="0 .2"><site site="hook"/><site site="eye"/></spatial>'
REFUSED = {
    "slide joint": (arm_xml(joints='<joint name="rail" type="slide"/>'), r"joint 'rail'.*slide.*hinge"),
    "ball joint": (
        arm_xml(joints='<joint name="hip" type="ball" range="0 1"/>'),
        r"joint 'hip'.*ball.*hinge",
    ),
    "free joint": (arm_xml(joints='<freejoint name="float"/>'), r"joint 'float'.*free.*hinge"),
    "unlimited joint": (arm_xml(joints='<joint name="spin" limited="false"/>'), r"joint 'spin' has no range"),
    "unnamed unlimited joint": (arm_xml(joints='<joint limited="false"/>'), r"^joint 0 has no range"),
    "unnamed slide joint": (arm_xml(joints='<joint name="one"/><joint type="slide"/>'), r"^joint 1 is of type slide"),
    "unnamed branch": (
        arm_xml(geom='<geom name="tube" {}/><body name="other"><joint/><geom size=".1"/></body>'),
        r"^joint 'two' does not follow joint 1 in",
    ),
    "branching chain": (
        arm_xml(
            geom='<geom name="tube" {}/><body name="other"><joint name="side"/><geom size=".1"/></body>',
        ),
        r"joint 'two' does not follow joint 'side'",
    ),
    "two arms": (
        arm_xml(more='<body name="first"><joint name="zero"/><geom size=".1"/></body>'),
        r"joint 'one' does not follow joint 'zero'",
    ),
    "box": (
        arm_xml(inside='<geom name="brick" type="box" group="3" size=".1 .1 .1"/>'),
        r"geom 'brick'.*box",
    ),
    "unnamed box": (arm_xml(inside='<geom type="box" group="3" size=".1 .1 .1"/>'), r"^geom 2 in group 3 is a box"),
    "cylinder": (
        arm_xml(inside='<geom name="can" type="cylinder" group="3" size=".1 .1"/>'),
        r"geom 'can'.*cylinder",
    ),
    "capsule on the base": (
        arm_xml(more=f'<geom name="pedestal" {CAPSULE_GEOM}/>'),
        r"geom 'pedestal'.*does not move",
    ),
    "capsule on a fixed body": (
        arm_xml(more=f'<body name="stand"><geom name="foot" {CAPSULE_GEOM}/></body>'),
        r"geom 'foot'.*does not move",
    ),
    "no joint": (
        '<mujoco><worldbody><body><geom size=".1"/></body></worldbody></mujoco>',
        r"no joint",
    ),
    "coupled joints": (
        arm_xml(extra='<equality><joint name="belt" joint1="one" joint2="two"/></equality>'),
        r"^equality 'belt' constrains joint 'one' and joint 'two'",
    ),
    "locked joint": (
        arm_xml(extra='<equality><joint joint1="two"/></equality>'),
        r"^equality 0 constrains joint 'two';",
    ),
    "closed chain": (
        arm_xml(extra='<equality><connect name="rod" body1="upper" anchor="0 0 0"/></equality>'),
        r"^equality 'rod' constrains body 'upper' and body 'world'",
    ),
    "tendon with a range": (
        arm_xml(extra=f'<tendon><fixed name="cable" limited="true" range="-1 1">{WRAPPED}</fixed></tendon>'),
        r"^tendon 'cable' has a range.* joint 'one' and joint 'two'",
    ),
    "unnamed tendon between sites": (
        arm_xml(more='<site name="hook"/>', inside='<site name="eye"/>', extra=f"<tendon>{FREE}{TIED}</tendon>"),
        r"^tendon 1 has a range.* site 'hook' and site 'eye'",
    ),
    "tool on the base": (arm_xml(more='<site name="tcp"/>'), r"site 'tcp' does not move"),
    "not XML": ("<mujoco><worldbody>", r"tiny\.xml is no XML"),
    "not MJCF": ("<scene/>", r"tiny\.xml is neither MJCF nor URDF: its root is <scene>"),
    "unknown element": (arm_xml(extra="<nonsense/>"), r"tiny\.xml does not compile"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_descriptions_name_the_culprit(tmp_path, case):
    """What cannot be modelled is never modelled silently, and the message says which joint or geom it is."""
    xml, message = REFUSED[case]
    with pytest.raises(RobotModelError, match=message):
        read(tmp_path, xml)


def test_a_tendon_without_a_range_constrains_nothing(tmp_path):
    """It only pulls; where the joints can be is still what their ranges say."""
    assert read(tmp_path, arm_xml(extra=f"<tendon>{FREE}</tendon>")).joint_names == ("one", "two")


def test_refusals_are_this_package_s_errors():
    """One except clause catches everything the package raises; ValueError catches bad values."""
    for error in (RobotModelError, ParameterError):
        assert issubclass(error, JSSAGymError)
        assert issubclass(error, ValueError)


def test_no_capsules(tmp_path):
    """Without capsules there is nothing to measure distances with."""
    xml = arm_xml().replace('group="3"', 'group="2"')
    with pytest.raises(RobotModelError, match="no capsule geoms in group 3"):
        read(tmp_path, xml)


def test_missing_file(tmp_path):
    """The message says which file was looked for."""
    with pytest.raises(RobotModelError, match=r"no MJCF file at .*nowhere\.xml"):
        RobotModel.from_mjcf(tmp_path / "nowhere.xml", velocity=[1], acceleration=[1], jerk=[1])


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize(
    "bad", [[1.0], [1.0, 2.0, 3.0], 1.0, [[1.0, 2.0]], [1.0, 0.0], [-1.0, 1.0], [np.nan, 1.0], [np.inf, 1.0]]
)
def test_wrong_limits_are_refused_by_name(tmp_path, name, bad):
    """Limits of the wrong shape, zero, negative or not finite would make an empty or a boundless jerk box."""
    with pytest.raises(RobotModelError, match=f"{name} limits"):
        read(tmp_path, arm_xml(), **{name: bad})


@pytest.mark.parametrize("bad", [[[1.0, -1.0]], [[1.0, 1.0]], [[np.nan, 1.0]], [-1.0, 1.0], [[-1.0, 0.0, 1.0]]])
def test_wrong_position_limits_are_refused(bad):
    """An empty range of positions leaves no place to be."""
    with pytest.raises(RobotModelError, match="position limit"):
        JointLimits(np.array(bad), np.ones(1), np.ones(1), np.ones(1))


@pytest.mark.parametrize("bad", [[[-np.inf, 1.0]], [[-1.0, np.inf]]])
def test_infinite_position_limits_are_refused(bad):
    """A joint without an end has no position limit to keep, and no home in the middle."""
    with pytest.raises(RobotModelError, match="position limit"):
        JointLimits(np.array(bad), np.ones(1), np.ones(1), np.ones(1))


def test_limits_for_another_arm_are_refused():
    """with_limits takes limits for as many joints as there are, and leaves the old model as it was."""
    robot = lr_mate_200id_7l()
    with pytest.raises(RobotModelError, match=r"6 joints.*1"):
        robot.with_limits(JointLimits(np.array([[-1.0, 1.0]]), np.ones(1), np.ones(1), np.ones(1)))
    stream = lr_mate_200id_7l("stream").limits
    assert robot.with_limits(stream).limits is stream
    assert robot.limits is not stream


@pytest.mark.parametrize("bad", [[0.0, 0.0], [0.0, 0.0, np.nan], 1.0])
def test_wrong_mounts_are_refused(bad):
    """A mount is one finite point."""
    with pytest.raises(RobotModelError, match="mount"):
        lr_mate_200id_7l().mounted(bad)


# ---- a user's arm ----------------------------------------------------------------------------------------

LIMITS = 'unit = "{}"\nvelocity = [90, 180]\nacceleration = [360, 720]\njerk = [1800, 3600]\n'


def test_defaults_of_a_small_arm(tmp_path):
    """Without keyframe and site: home is mid-range, the tool point the last link's origin."""
    robot = read(tmp_path, arm_xml())
    assert robot.name == "tiny"
    assert robot.joint_names == ("one", "two")
    assert robot.capsule_names == ("tube", "fore")
    np.testing.assert_allclose(robot.home, [0.5, 0.5])
    assert robot.tool_link == 1
    np.testing.assert_array_equal(robot.tool_offset, np.zeros(3))
    assert robot.self_pairs.shape == (0, 2)
    np.testing.assert_array_equal(robot.limits.position, [[-1, 2], [-1, 2]])


def test_excluded_bodies_are_not_checked_for_self_collision(tmp_path):
    """<contact><exclude/> takes a pair off the list, in either order, and no other."""
    third = '<body name="tip"><joint name="three"/><geom type="sphere" group="3" size=".02"/></body>'
    limits = {name: np.ones(3) for name in ("velocity", "acceleration", "jerk")}
    robot = read(tmp_path, arm_xml(inside=third), **limits)
    np.testing.assert_array_equal(robot.self_pairs, [[0, 2]])
    for one, two in (("lower", "tip"), ("tip", "lower")):
        exclude = f'<contact><exclude body1="{one}" body2="{two}"/></contact>'
        assert len(read(tmp_path, arm_xml(inside=third, extra=exclude), **limits).self_pairs) == 0


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_user_s_arm_with_limits_beside_it(tmp_path, unit):
    """A file and a table of limits are all it takes; degrees become radians once."""
    (tmp_path / "mine.xml").write_text(arm_xml())
    (tmp_path / "mine.limits.toml").write_text(LIMITS.format(unit))
    factor = np.pi / 180.0 if unit == "deg" else 1.0
    for path in (tmp_path / "mine.xml", str(tmp_path / "mine.xml")):
        robot = make_robot(path)
        np.testing.assert_allclose(robot.limits.velocity, factor * np.array([90, 180]))
        np.testing.assert_allclose(robot.limits.acceleration, factor * np.array([360, 720]))
        np.testing.assert_allclose(robot.limits.jerk, factor * np.array([1800, 3600]))
        np.testing.assert_allclose(robot.limits.position, [[-1, 2], [-1, 2]])
        assert robot.mjcf == tmp_path / "mine.xml"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"no mine\.limits\.toml beside mine\.xml"),
        ("velocity = [", r"mine\.limits\.toml is not valid TOML"),
        (LIMITS.format("deg").replace("jerk", "jolt"), r"mine\.limits\.toml needs velocity, .*, jerk"),
        (LIMITS.format("grad"), r"unit = 'deg' or 'rad'"),
        (LIMITS.format("deg").replace("unit", "units"), r"unit = 'deg' or 'rad'"),
        (
            LIMITS.format("deg").replace("[90, 180]", "[90]"),
            r"mine\.limits\.toml: velocity limits have shape \(1,\), expected \(2,\)",
        ),
        (
            LIMITS.format("deg").replace("[90, 180]", "[90, -180]"),
            r"mine\.limits\.toml: velocity limits have to be positive",
        ),
        (
            LIMITS.format("deg").replace("[90, 180]", '["fast", "slow"]'),
            r"mine\.limits\.toml.*velocity",
        ),
    ],
)
def test_wrong_limits_beside_a_file(tmp_path, text, message):
    """MJCF has no place for these limits and nobody can guess them: missing or wrong ones are refused."""
    (tmp_path / "mine.xml").write_text(arm_xml())
    if text is not None:
        (tmp_path / "mine.limits.toml").write_text(text)
    with pytest.raises(RobotModelError, match=message):
        make_robot(tmp_path / "mine.xml")


def test_unknown_robots_name_the_valid_ones():
    """Neither a name nor a file: the message lists the names."""
    with pytest.raises(ParameterError, match=r"unknown robot 'ur5'.*lr_mate_200id_7l"):
        make_robot("ur5")


def test_a_robot_file_that_is_not_there(tmp_path):
    """A path to nothing is an error about that path."""
    with pytest.raises(RobotModelError, match=r"nowhere\.xml"):
        make_robot(tmp_path / "nowhere.xml")
