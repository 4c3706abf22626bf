"""What an arm's file draws has to be in its capsules: nothing else is measured. Oracle: geometry by hand."""

import logging

import mujoco
import numpy as np
import pytest

from jssa_gym.exceptions import RobotModelError
from jssa_gym.robots import RobotModel, lr_mate_200id_7l
from jssa_gym.robots.coverage import coverage
from jssa_gym.robots.mjcf import COLLISION_GROUP, carrier_links
from jssa_gym.robots.serial import serial_faults

TUBE = '<geom type="capsule" group="3" size=".05" fromto="0 0 0  .3 0 0"/>'
"""A capsule from one joint to the next."""
BEAM = '<geom name="{}" type="box" group="{}" size=".15 .03 .03" pos=".15 0 0"/>'
"""A box that the capsule encloses but for the edges at its ends: those are at (0.3, 0.03, 0.03)."""


def arm_xml(*links, base="", assets=""):
    """An arm of hinges about z, 0.3 m apart, whose links hold these geoms."""
    opened = "".join(
        f'<body pos="{0.3 if i else 0.0} 0 0"><joint name="joint {i}" axis="0 0 1" range="-2 2"/>{geoms}'
        for i, geoms in enumerate(links)
    )
    return (
        f'<mujoco model="arm"><compiler angle="radian" autolimits="true"/>{assets}<worldbody>{base}'
        f"{opened}{'</body>' * len(links)}</worldbody></mujoco>"
    )


def read(tmp_path, xml, **options):
    path = tmp_path / "arm.xml"
    path.write_text(xml)
    n = xml.count("<joint ")
    return RobotModel.from_mjcf(path, velocity=np.ones(n), acceleration=np.ones(n), jerk=np.ones(n), **options)


def joints_of(model):
    assert serial_faults(model) == []
    return list(range(model.njnt))


def look(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    joints = joints_of(model)
    return coverage(model, joints, carrier_links(model, joints), np.zeros(model.nq), COLLISION_GROUP)


@pytest.mark.parametrize("group", [0, 2, 4])
def test_links_that_are_drawn_and_not_measured_are_refused_all_at_once(tmp_path, group):
    """Three links, one capsule: the drawn arm went through a person who was a metre away from the capsule."""
    beams = [BEAM.format(name, group) for name in ("upper", "fore", "hand")]
    with pytest.raises(RobotModelError) as error:
        read(tmp_path, arm_xml(TUBE + beams[0], *beams[1:]))
    message = str(error.value)
    # from the capsule's end to the corner (0.3, 0.03, 0.03) of the fore
    fore = 1e3 * (np.hypot(np.hypot(0.3, 0.03), 0.03) - 0.05)
    assert f"joint 'joint 1' draws geom 'fore', has no capsule, and reaches {fore:.0f} mm out of those" in message
    assert "joint 'joint 2' draws geom 'hand', has no capsule, nor has the link before it" in message
    assert "joint 0" not in message


def test_every_drawn_link_with_a_capsule_is_accepted(tmp_path):
    """The same arm with its capsules, one of them on a body that is fixed to the link."""
    links = [TUBE + BEAM.format(name, 2) for name in ("upper", "fore")]
    hand = BEAM.format("hand", 0) + f"<body>{TUBE}</body>"
    assert len(read(tmp_path, arm_xml(*links, hand)).capsules) == 3


def test_links_that_draw_nothing_and_bases_need_no_capsules(tmp_path):
    mass = '<inertial mass="1" pos="0 0 0" diaginertia=".1 .1 .1"/>'
    base = '<geom name="plinth" type="box" size=".2 .2 .1" pos="0 0 -.2"/>'
    assert read(tmp_path, arm_xml(TUBE, mass, TUBE, base=base)).n == 3


def test_a_tool_that_turns_inside_the_capsule_before_it_needs_none(tmp_path):
    """At every angle: one that lies inside only at home is refused."""
    long = '<geom type="capsule" group="3" size=".1" fromto="0 0 0  .3 0 0"/>'
    inside = '<geom name="flange" type="box" group="2" size=".05 .05 .05"/>'
    assert read(tmp_path, arm_xml(long, inside)).n == 2
    # at home it lies in the capsule; turned by 2 rad it reaches to (0.3, 0) + 0.1 (-cos, -sin)
    lever = '<geom name="lever" type="sphere" group="2" size=".03" pos="-.1 0 0"/>'
    with pytest.raises(RobotModelError, match=r"geom 'lever', has no capsule, and reaches 30 mm out of those of the"):
        read(tmp_path, arm_xml(long, lever))


CUBE = "-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  1 -1 1  -1 1 1  1 1 1"
MESH = f'<asset><mesh name="cube" scale=".15 .03 .03" vertex="{CUBE}"/></asset>'
CORNER = np.hypot(0.03, 0.03)
SHAPES = {
    "box": (BEAM.format("drawn", 2), CORNER - 0.02),
    "mesh": ('<geom type="mesh" mesh="cube" group="2" pos=".15 0 0"/>', CORNER - 0.02),
    "cylinder": ('<geom type="cylinder" group="2" size=".03" fromto="0 0 0  .3 0 0"/>', 0.01),
    "capsule": ('<geom type="capsule" group="2" size=".03" fromto="0 0 0  .4 0 0"/>', 0.11),
    "sphere": ('<geom type="sphere" group="2" size=".03" pos=".3 .2 0"/>', 0.21),
    "ellipsoid": ('<geom type="ellipsoid" group="2" size=".2 .03 .01" pos=".15 0 0"/>', 0.03),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_how_far_a_shape_reaches_out(shape):
    """Of a capsule of radius 0.02 m along x, from 0 to 0.3 m."""
    geom, expected = SHAPES[shape]
    thin = TUBE.replace(".05", ".02")
    (link,) = look(arm_xml(thin + geom, assets=MESH))
    assert link.own == pytest.approx(expected, abs=1e-4)
    assert link.joined == link.own
    assert link.arm == pytest.approx(link.own, abs=1e-12)
    (covered,) = look(arm_xml(TUBE.replace(".05", ".25") + geom, assets=MESH))
    assert (covered.own, covered.joined, covered.arm) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("shape", ["box", "mesh", "cylinder", "capsule"])
def test_a_long_shape_is_looked_at_between_its_ends(shape):
    """Balls around both ends hold all corners, and leave out the middle: 0.15 m from either centre."""
    geom, _ = SHAPES[shape]
    balls = '<geom type="sphere" group="3" size=".1"/><geom type="sphere" group="3" size=".1" pos=".3 0 0"/>'
    (link,) = look(arm_xml(balls + geom.replace(".4 0 0", ".3 0 0"), assets=MESH))
    middle = {"box": np.hypot(0.15, CORNER), "mesh": np.hypot(0.15, CORNER), "cylinder": np.hypot(0.15, 0.03)}
    assert link.own == pytest.approx(middle.get(shape, 0.18) - 0.1, abs=2e-3)


def cut(length):
    """A link whose capsule ends at this length, under a box whose corner is at (0.3, 0.03, 0.03)."""
    return TUBE.replace(".3 0 0", f"{length} 0 0") + BEAM.format("cut", 2)


def test_what_reaches_out_is_refused_or_named(tmp_path, caplog):
    """A millimetre is tolerated, as by ``robot check``; whoever names the joint gets the arm, which says so."""
    arm = arm_xml(TUBE + BEAM.format("whole", 2), cut(0.25))
    out = 1e3 * (np.linalg.norm([0.05, 0.03, 0.03]) - 0.05)
    with pytest.raises(RobotModelError) as error:
        read(tmp_path, arm)
    message = f"joint 'joint 1' draws geom 'cut', and reaches {out:.3g} mm out of its capsules and those of the links"
    assert message in str(error.value)
    assert "joint 0" not in str(error.value)
    with caplog.at_level(logging.WARNING, "jssa_gym"):
        assert read(tmp_path, arm, uncovered=["joint 1"]).uncovered == ("joint 1",)
    assert not caplog.records
    # the corner is 0.0424 m from the axis: the capsule may end 26.5 mm before it to hold it
    for short, taken in ((0.0265, True), (0.0275, True), (0.031, False)):
        xml = arm_xml(cut(0.3 - short))
        if taken:
            assert read(tmp_path, xml).n == 1
        else:
            with pytest.raises(RobotModelError, match="geom 'cut', and reaches"):
                read(tmp_path, xml)


def test_a_token_capsule_is_none(tmp_path):
    """A ball of 1 mm on a link that draws a beam of 0.8 m."""
    beam = '<geom name="beam" type="box" size=".4 .02 .02" pos=".4 0 0" group="2"/>'
    out = 1e3 * (np.linalg.norm([0.8, 0.02, 0.02]) - 0.001)
    with pytest.raises(RobotModelError, match=f"geom 'beam', and reaches {out:.0f} mm out of its capsules"):
        read(tmp_path, arm_xml('<geom type="sphere" group="3" size=".001"/>' + beam))


def test_capsules_that_leave_out_most_are_refused_with_all_others(tmp_path):
    """A token capsule is no measurement: a ball of 1 mm, and a tube that leaves 59 mm; the third link has none."""
    token = '<geom type="sphere" group="3" size=".001" pos=".15 0 0"/>' + BEAM.format("whole", 2)
    with pytest.raises(RobotModelError) as error:
        read(tmp_path, arm_xml(cut(0.2), token, BEAM.format("bare", 2)))
    message = str(error.value)
    whole = 1e3 * (np.linalg.norm([0.15, 0.03, 0.03]) - 0.001)
    assert f"joint 'joint 1' draws geom 'whole', and reaches {whole:.0f} mm out of its capsules" in message
    assert "joint 'joint 2' draws geom 'bare', has no capsule, and reaches" in message
    cut_off = 1e3 * (np.linalg.norm([0.1, 0.03, 0.03]) - 0.05)
    assert f"joint 'joint 0' draws geom 'cut', and reaches {cut_off:.3g} mm out of its capsules" in message


def test_what_the_next_link_covers_counts_if_it_does_so_at_every_angle(tmp_path):
    token = '<geom type="sphere" group="3" size=".001"/><geom name="drawn" size=".1" group="2" pos=".3 0 0"/>'
    around = '<geom type="sphere" group="3" size=".12"/>'
    assert read(tmp_path, arm_xml(token, around)).n == 2
    lies_over = '<geom type="sphere" group="3" size=".15" pos="-.2 0 0"/>'
    drawn = token.replace('pos=".3', 'pos=".1')  # its centre is the other's at home, and 0.2 m from the next joint
    # where that has turned away only the token is left, 0.1 m from the centre of what is drawn
    with pytest.raises(RobotModelError, match="geom 'drawn', and reaches 199 mm out of its capsules"):
        read(tmp_path, arm_xml(drawn, lies_over))


def test_what_a_link_far_away_covers_at_home_does_not_count(tmp_path):
    """The third link lies over the first one while the second stands where it does at home."""
    bare = '<geom type="sphere" group="3" size=".001"/><geom name="drawn" size=".05" group="2" pos=".1 .2 0"/>'
    over = '<geom type="sphere" group="3" size=".2" pos="-.5 .2 0"/>'
    with pytest.raises(RobotModelError, match="geom 'drawn', and reaches"):
        read(tmp_path, arm_xml(bare, TUBE, over))


def test_shapes_that_no_link_can_draw_are_refused_by_name(tmp_path):
    field = '<asset><hfield name="hills" nrow="3" ncol="3" size=".1 .1 .1 .1"/></asset>'
    hills = '<geom name="back" type="hfield" hfield="hills" group="2"/>'
    with pytest.raises(RobotModelError, match=r"geom 'back' of a link is a hfield; .* has to be a box, capsule"):
        read(tmp_path, arm_xml(TUBE + hills, assets=field))
    assert read(tmp_path, arm_xml(TUBE, base=hills, assets=field)).n == 1


def test_what_the_base_draws_outside_of_capsules_is_noted(tmp_path, caplog):
    inside = '<geom type="box" size=".01 .01 .01"/><geom type="plane" size="1 1 1"/>'
    plinth = '<geom name="plinth" type="box" size=".2 .2 .1" pos="0 0 -.2"/>'
    with caplog.at_level(logging.WARNING, "jssa_gym"):
        read(tmp_path, arm_xml(TUBE, base=inside))
        assert not caplog.records
        read(tmp_path, arm_xml(TUBE, base=plinth))
    (record,) = caplog.records
    out = 1e3 * (np.linalg.norm([0.2, 0.2, 0.3]) - 0.05)  # of the corner behind the capsule
    assert record.getMessage().startswith(f"the base draws geom 'plinth', which reaches {out:.0f} mm out of all")


def test_the_shipped_arm_is_covered(caplog):
    """Every corner of every casting; the gripper turns with the last joint inside the wrist's capsule."""
    robot = lr_mate_200id_7l()
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    joints = joints_of(model)
    links = coverage(model, joints, carrier_links(model, joints), robot.home, COLLISION_GROUP)
    assert [link.link for link in links] == list(range(6))
    assert [bool(link.capsules) for link in links] == [True] * 5 + [False]
    assert all(link.own == 0.0 for link in links[:5])
    assert all(link.joined == link.arm == 0.0 for link in links)
    assert not caplog.records
