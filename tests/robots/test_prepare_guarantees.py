"""What a check of an arm's file promises: what it accepts can be used, what it writes holds all that is drawn."""

import mujoco
import numpy as np
import pytest
from robots_arms import chain, link, two_arms, urdf

from jssa_gym.exceptions import RobotModelError
from jssa_gym.robots import ROBOTS, make_robot
from jssa_gym.robots.prepare import Preparation, examine, write_prepared
from jssa_gym.robots.prepare.agreement import cover_of
from jssa_gym.robots.prepare.posture import some_postures

ALL = Preparation(freeze=("all",))


@pytest.fixture
def save(tmp_path):
    def write(xml, name="arm.xml"):
        path = tmp_path / name
        path.write_text(xml)
        return path

    return write


def messages(arm, standing=True):
    return [str(finding) for finding in arm.findings if finding.stands or not standing]


def prepared(path, tmp_path, wanted=ALL):
    arm = examine(path, wanted)
    return arm, make_robot(write_prepared(arm, tmp_path / "out"))


FOOT = '<geom type="cylinder" size=".06 .05" pos="0 0 .05"/>'
PARTS = (
    '<geom type="capsule" size=".05" fromto="0 0 -.05  0 0 .05"/>',
    '<geom type="capsule" size=".05" fromto="0 0 0  0 0 .4"/>',
    '<geom type="capsule" size=".04" fromto="0 0 0  0 0 .3"/>',
)
COVERED = tuple(part + part.replace("size", 'group="3" size') for part in PARTS)
LIMITS = 'unit = "rad"\nvelocity = [2, 2, 2]\nacceleration = [6, 6, 6]\njerk = [40, 40, 40]\n'


def three(links=COVERED, base=FOOT, world="", after="", ranges=("-3 3", "-2 2", "-2 2"), angle="radian"):
    """Three hinges on a base; every part can be another one."""
    first, second, third = links
    return (
        f'<mujoco><compiler angle="{angle}"/><worldbody>{world}<body name="b">{base}'
        f'<body name="l1" pos="0 0 .2"><joint name="j1" axis="0 0 1" range="{ranges[0]}"/>{first}'
        f'<body name="l2" pos="0 0 .1"><joint name="j2" axis="0 1 0" range="{ranges[1]}"/>{second}'
        f'<body name="l3" pos="0 0 .4"><joint name="j3" axis="0 1 0" range="{ranges[2]}"/>{third}'
        f'<site name="tcp" pos="0 0 .3"/></body></body></body></body></worldbody>{after}</mujoco>'
    )


def geom(kind, size, pos="0 0 0", group=3):
    return f'<geom type="{kind}" group="{group}" size="{size}" pos="{pos}"/>'


BALLS = geom("sphere", ".06") + geom("sphere", ".06", "0 0 .4")
CAPSULES = tuple(part.replace("size", 'group="3" size') for part in PARTS)
SMALL = {
    "sound": (three(), True),
    "shows its capsules only": (three(CAPSULES), True),
    "no capsule": (three(PARTS), False),
    "boxes in group 3": (three(tuple(geom("box", ".05 .05 .1", "0 0 .1") for _ in range(3))), False),
    "a box in group 3 and a ball": (
        three((COVERED[0], geom("box", ".15 .05 .2", "0 0 .2") + geom("sphere", ".01", "0 0 .2", 0), COVERED[2])),
        False,
    ),
    "balls at the ends": (three((COVERED[0], PARTS[1] + BALLS, COVERED[2])), False),
    "a box that reaches out": (
        three((COVERED[0], COVERED[1] + geom("box", ".15 .15 .05", "0 0 .2", 0), COVERED[2])),
        False,
    ),
    "a box in group 3 on the base": (three(base=FOOT + geom("box", ".05 .05 .05", "0 0 .05")), False),
    "a box in group 3 in the capsule": (three((*COVERED[:2], COVERED[2] + geom("box", ".01 .01 .01"))), False),
    "home beyond a range": (three(after='<keyframe><key name="home" qpos="0 9 0"/></keyframe>'), False),
    "degrees": (three(ranges=("-180 180", "-2 2", "-2 2"), angle="degree"), False),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SMALL)
def test_what_the_check_accepts_the_reader_takes(save, name):
    xml, sound = SMALL[name]
    path = save(xml)
    path.with_suffix(".limits.toml").write_text(LIMITS)
    arm = examine(path)
    assert arm.acceptable == sound, messages(arm, False)
    if sound:
        make_robot(path)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [name for name, (_, sound) in SMALL.items() if not sound and name != "degrees"])
def test_what_is_written_holds_all_that_the_file_draws(save, tmp_path, name):
    """By corners of the file's own boxes, in every group, in the frame of the link that MuJoCo has moved."""
    arm, robot = prepared(save(SMALL[name][0]), tmp_path)
    assert cover_of(arm, robot) <= 1e-4
    source = arm.source.model
    data = mujoco.MjData(source)
    mujoco.mj_kinematics(source, data)
    mine = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    shown = mujoco.MjData(mine)
    mujoco.mj_kinematics(mine, shown)
    for box in np.flatnonzero(source.geom_type == mujoco.mjtGeom.mjGEOM_BOX):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * source.geom_size[box]
        points = data.geom_xpos[box] + corners @ data.geom_xmat[box].reshape(3, 3).T
        nearest = np.full(8, np.inf)
        for one in np.flatnonzero(mine.geom_group == 3):
            axis, way = shown.geom_xmat[one].reshape(3, 3)[:, 2], points - shown.geom_xpos[one]
            half = mine.geom_size[one, 1] if mine.geom_type[one] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            foot = np.clip(way @ axis, -half, half)[:, None] * axis
            nearest = np.minimum(nearest, np.linalg.norm(way - foot, axis=1) - mine.geom_size[one, 0])
        assert nearest.max() <= 1e-4


def test_balls_at_the_ends_do_not_hold_what_is_between(save):
    """The middle of a tube of radius 0.05 m and length 0.4 m is 0.2 m from both."""
    cover = examine(save(SMALL["balls at the ends"][0])).covers[1]
    assert cover.own == pytest.approx(0.2 + 0.05 - 0.06, abs=1e-3)
    assert cover.kept == ()


def test_what_reaches_out_is_no_sentence_of_repair(save):
    told = " ".join(messages(examine(save(SMALL["a box that reaches out"][0])), False))
    assert "link 'l2' reaches 162 mm out of its own capsules and 162 mm out of all: --write makes 1 capsule" in told


def test_a_model_that_does_not_hold_its_file_is_not_written(save, tmp_path, monkeypatch):
    """Whatever made it: nothing is left, and what was there before stays."""
    path = save(three())
    arm = examine(path)
    folder = write_prepared(arm, tmp_path / "out")
    before = {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()}
    monkeypatch.setattr("jssa_gym.robots.prepare.writing.cover_of", lambda *_: 2e-3)
    for place in (folder, tmp_path / "new"):
        with pytest.raises(RobotModelError, match=r"draws reaches 2.0 mm out of the prepared arm's capsules"):
            write_prepared(arm, place)
    monkeypatch.setattr("jssa_gym.robots.prepare.writing.kinematic_error", lambda *_: 1e-6)
    with pytest.raises(RobotModelError, match=r"joints are 1.0e-06 m from where arm.xml has them"):
        write_prepared(arm, folder)
    assert {one: one.read_bytes() for one in folder.rglob("*") if one.is_file()} == before
    assert sorted(one.name for one in tmp_path.iterdir()) == ["arm.xml", "out"]


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.long
def test_arms_that_are_prepared_already_go_round(tmp_path, name):
    """Names are unique, and the capsules of an arm that has them stay what they are."""
    first = write_prepared(examine(ROBOTS[name]().mjcf), tmp_path / "first")
    arm = examine(first / "robot.xml")
    assert arm.acceptable, messages(arm, False)
    again, once = make_robot(write_prepared(arm, tmp_path / "second")), make_robot(first)
    assert again.capsule_names == once.capsule_names
    np.testing.assert_allclose(again.capsules["radius"], once.capsules["radius"])
    np.testing.assert_array_equal(again.self_pairs, once.self_pairs)
    uncovered = examine(first / "robot.xml", Preparation(uncovered=(once.joint_names[-1],)))
    third = write_prepared(uncovered, tmp_path / "third")
    assert make_robot(third).uncovered == once.joint_names[-1:]
    assert (
        make_robot(write_prepared(examine(third / "robot.xml"), tmp_path / "fourth")).uncovered == once.joint_names[-1:]
    )


def test_capsules_with_the_names_of_others(save, tmp_path):
    named = (COVERED[0].replace('<geom type="capsule" group', '<geom name="base_column" type="capsule" group'),)
    named += (COVERED[1].replace('<geom type="capsule" group', '<geom name="l3" type="capsule" group'), PARTS[2])
    _, robot = prepared(save(three(named)), tmp_path)
    assert robot.capsule_names == ("base_column 2", "base_column", "l3", "l3 2")


@pytest.mark.parametrize(
    "parts",
    [
        {"base": geom("box", ".1 .1 .1", "0 0 .1")},
        {"base": "", "world": geom("box", ".1 .1 .1", "0 0 .1", 0)},
        {"base": geom("capsule", ".1 .1", "0 0 .1")},
    ],
    ids=["group 3", "world", "capsule"],
)
def test_a_base_of_any_kind_gets_its_column(save, tmp_path, parts):
    arm, robot = prepared(save(three(**parts)), tmp_path)
    assert arm.column is not None
    assert arm.column.radius >= 0.1
    assert "base_column" in robot.capsule_names


def test_what_stands_about_is_named(save):
    """A pillar beside the arm is no part of it: not measured, not avoided, and said so."""
    pillar = '<geom name="pillar" type="box" size=".05 .05 .5" pos=".3 0 .5"/>'
    lamp = '<geom name="lamp" type="sphere" size=".05" pos="0 0 1.5"/>'
    table = '<body><geom name="table" type="box" group="3" size=".05 .05 .1" pos=".4 0 .1"/></body>'
    arm = examine(save(three(world=pillar + lamp + table + '<geom type="plane" size="1 1 1"/>')))
    (told,) = (text for text in messages(arm, False) if "neither measured nor avoided" in text)
    assert told.startswith("'pillar', 'lamp', 'table' of the file")
    assert arm.column is not None
    assert arm.column.radius < 0.07


@pytest.mark.parametrize(
    ("xml", "limits", "text"),
    [
        (three(), LIMITS.replace("[2, 2, 2]", "[2, 180, 2]"), "joint 'j2' may turn at 180 rad/s: if it is in degrees"),
        (three(ranges=("-180 180", "-2 2", "-90 90"), angle="degree"), LIMITS, "joint 'j2' has a range of 0.0698 rad"),
        (three(ranges=("-10 10", "-2 2", "-2 2")), LIMITS, "joint 'j1' has a range of 20 rad: if it is in degrees"),
    ],
    ids=["velocity", "radians", "degrees"],
)
def test_one_joint_of_another_unit_is_asked_about(save, xml, limits, text):
    path = save(xml)
    path.with_suffix(".limits.toml").write_text(limits)
    (told,) = messages(examine(path))
    assert text in told
    assert told.endswith("if it is right, give --units-checked")
    assert examine(path, Preparation(units_checked=True)).obstacles == ()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("scale", "asked"), [(0.2, True), (0.5, False), (5.0, False), (12.0, True)])
def test_arms_of_centimetres_and_cranes_are_asked_about(save, scale, asked):
    told = messages(examine(save(chain(3, scale=scale)), ALL))
    assert any("lengths have to be in metres" in text for text in told) == asked


def test_ranges_of_a_urdf_have_no_compiler_to_write_to(tmp_path):
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace('lower="-2" upper="2"', 'lower="-120" upper="120"', 1))
    (told,) = messages(examine(path))
    assert "has a range of 240 rad: a URDF is in radians" in told
    assert "compiler" not in told


def test_a_spring_beside_the_arm_does_not_end_it(save, tmp_path):
    spring = (
        '<body name="spring"><joint name="spring" axis="0 1 0" range="-1 1"/><geom type="sphere" size=".02"/></body>'
    )
    xml = three((PARTS[0] + spring, PARTS[1], PARTS[2])).replace(
        '<site name="tcp"', link("l4", "0 1 0", "", "0 0 .3") + '<site name="tcp"'
    )
    arm, robot = prepared(save(xml), tmp_path)
    assert robot.joint_names == ("j1", "j2", "j3", "l4 joint")
    assert any("body 'l2' is taken for the arm: 3 hinges follow it" in text for text in messages(arm, False))


def test_a_finger_of_three_hinges_is_no_arm(save):
    finger = link("finger 1", "0 1 0", link("finger 2", "0 1 0", link("finger 3", "0 1 0", "")))
    thumb = link("thumb", "0 1 0", "")
    assert examine(save(chain(4, last=finger + thumb)), ALL).anatomy.n == 4


@pytest.mark.long
def test_a_torso_of_one_hinge_is_no_arm(save):
    torso = two_arms().replace(
        '<body name="torso">', '<body name="torso"><joint name="waist" axis="0 0 1" range="-1 1"/>'
    )
    (told,) = messages(examine(save(torso), ALL))
    assert "give --tip BODY, the last body of one: 'left 3', 'right 3'" in told
    assert examine(save(torso), Preparation(("all",), tip="left 3")).anatomy.n == 5


def test_a_jaw_is_said_once(save):
    jaw = link("jaw", "0 1 0", "")
    about = [
        text for text in messages(examine(save(chain(3, last=jaw)), ALL), False) if text.startswith("joint 'jaw joint'")
    ]
    assert about == ["joint 'jaw joint' looks like a jaw: it is frozen"]


def test_joints_that_follow_others_are_said_once(tmp_path):
    path = urdf(tmp_path)
    path.write_text(path.read_text().replace("</joint></robot>", '<mimic joint="lift"/></joint></robot>'))
    (told,) = (text for text in messages(examine(path), False) if "'roll'" in text)
    assert "ties joint 'roll' and joint 'lift'" in told


def test_whether_they_overlap_at_home_or_often_is_said(save):
    folded = (*COVERED[:2], COVERED[2] + geom("sphere", ".05", "0 0 .45"))
    arm = three(folded, ranges=("-3 3", "-2 2", "-3.1 3.1"))
    home = '<keyframe><key name="home" qpos="0 0 3.1"/></keyframe>'
    told = [
        text
        for text in messages(examine(save(arm.replace("</mujoco>", home + "</mujoco>"))), False)
        if "overlap" in text
    ]
    assert told
    assert all("at home" in text for text in told)
    assert not any("%" in text for text in told)


def test_the_tool_s_name_is_said(save):
    assert "the tool centre point is that of 'tcp': give --tool NAME for another" in messages(
        examine(save(three())), False
    )


def test_a_urdf_that_is_not_there_is_called_one():
    with pytest.raises(RobotModelError, match=r"no URDF file at .*arm\.urdf"):
        make_robot("arm.urdf")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("uri", ["file://meshes/beam.stl", "file:///meshes/beam.stl", "meshes/beam.stl"])
def test_meshes_beside_the_file(tmp_path, uri):
    path = urdf(tmp_path, visual=uri)
    moved = path.parent.parent / "arm.urdf"
    path.rename(moved)
    assert examine(moved).obstacles == ()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("uri", ["beam.stl", "elsewhere/beam.stl", "package://gone/beam.stl"])
def test_the_urdf_s_own_folder_of_meshes(tmp_path, uri):
    path = urdf(tmp_path, visual=uri)
    own = '<robot name="bench_arm"><mujoco><compiler meshdir="../meshes"/></mujoco>'
    path.write_text(path.read_text().replace('<robot name="bench_arm">', own))
    assert examine(path).obstacles == ()


@pytest.mark.long
def test_a_shape_of_the_same_kind_stands_for_no_mesh(tmp_path):
    """A ball of 1 cm beside a lost mesh was taken for all of the link."""
    path = urdf(tmp_path, visual="package://bench_arm/meshes/beam.dae", collision="package://bench_arm/meshes/beam.stl")
    ball = '<visual><geometry><sphere radius=".01"/></geometry></visual></link>'
    assert examine(path).obstacles == ()
    both = path.read_text()
    path.write_text(both.replace("</link><joint", ball + "<joint", 1))
    assert examine(path).obstacles == ()
    start = both.index("<collision", both.index('name="three"'))
    alone = both[:start] + both[both.index("</collision>", start) + len("</collision>") :]
    path.write_text(alone.replace("</link><joint", ball + "<joint", 1))
    (told,) = messages(examine(path))
    assert told.startswith("link 'three' draws package://bench_arm/meshes/beam.dae")


def test_postures_fill_ranges_that_are_off_centre(save):
    """A range from 2.9 to 6.2 rad was cut at π: one that overlaps only beyond was never seen."""
    postures = some_postures(np.array([[2.9, 6.2], [-7.0, 7.0], [4.0, 12.0]]))
    for column, (low, high) in zip(postures.T, ((2.9, 6.2), (-np.pi, np.pi), (8 - np.pi, 8 + np.pi)), strict=True):
        assert low <= column.min() < low + 0.05
        assert high - 0.05 < column.max() <= high
