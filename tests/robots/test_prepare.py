"""Anybody's arm file: all that is wrong with it at once, and the model that is made of it. Judge: MuJoCo."""

import contextlib
import json
import re

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from robots_arms import HEAD, chain, gripper, link, two_arms, urdf

import jssa_gym
from jssa_gym.certificate.boundary import Domain
from jssa_gym.cli.certify import Certify
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.evaluation import evaluate
from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.humans import nobody
from jssa_gym.robots import DEFAULT, RobotModel, make_robot
from jssa_gym.robots.limits import GUESSED_VELOCITY, read_limits
from jssa_gym.robots.prepare import Preparation, examine, write_prepared
from jssa_gym.robots.prepare.agreement import cover_of, kinematic_error
from jssa_gym.safety.proximity import measure
from jssa_gym.types import JointState
from jssa_gym.viewer.choices import Choices, ShieldChoice
from jssa_gym.viewer.session import Session

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


# ---- joints --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_gripper_is_one_list_and_no_riddle(save, tmp_path):
    path = save(gripper())
    arm = examine(path)
    assert [re.match(r"\w+ '(\w+)'", text)[1] for text in messages(arm)] == ["left", "right"]
    left, right = messages(arm)
    assert "is a slide" in left
    for text in ("tendon 'split'", "equality 'mirrored'", "actuator 'squeeze'", "--freeze left", "--freeze all"):
        assert text in left
    assert "sensor 'opening'" in right
    assert not arm.acceptable
    with pytest.raises(RobotModelError, match=r"joint 'left' .*; joint 'right' "):
        write_prepared(arm, tmp_path / "out")
    assert not (tmp_path / "out").exists()

    for freeze in (("all",), ("left", "right")):
        arm, robot = prepared(path, tmp_path, Preparation(freeze))
        assert robot.joint_names == ("turret joint", "upper joint", "fore joint", "hand joint")
        np.testing.assert_allclose(robot.home, [0.1, 0.5, 0.9, 0.3])
        assert kinematic_error(arm, robot) < 1e-12
        model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
        assert (model.ntendon, model.neq, model.nsensor, model.nu, model.njnt) == (0, 0, 0, 4, 4)


def test_the_reader_of_models_says_everything_at_once_too(save):
    limits = dict.fromkeys(("velocity", "acceleration", "jerk"), np.ones(6))
    with pytest.raises(RobotModelError) as error:
        RobotModel.from_mjcf(save(gripper()), **limits)
    for text in (
        "joint 'left' is of type slide",
        "joint 'right' is of type slide",
        "joint 'right' does not follow joint 'left' in one chain",
        "equality 'mirrored' constrains joint 'left' and joint 'right'",
        "no capsule geoms in group 3",
        "`jssa-gym robot check arm.xml`",
    ):
        assert text in str(error.value)


@pytest.mark.long
def test_fingers_are_held_wherever_they_slide(save, tmp_path):
    """Wide open they reach 0.04 m further out than where they are frozen."""
    arm, robot = prepared(save(gripper()), tmp_path)
    source, data = arm.source.model, mujoco.MjData(arm.source.model)
    mine = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    shown, hand = mujoco.MjData(mine), [name for name in robot.capsule_names if name.startswith("hand")]
    for opening in (0.0, 0.01, 0.02, 0.03, 0.04):
        data.qpos[:] = [*robot.home, opening, opening]
        shown.qpos[:] = robot.home
        mujoco.mj_kinematics(source, data)
        mujoco.mj_kinematics(mine, shown)
        for name in ("left pad", "right pad"):
            pad = source.geom(name).id
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * source.geom_size[pad]
            points, out = data.geom_xpos[pad] + corners @ data.geom_xmat[pad].reshape(3, 3).T, np.full(8, np.inf)
            for geom in (mine.geom(one).id for one in hand):
                axis, way = shown.geom_xmat[geom].reshape(3, 3)[:, 2], points - shown.geom_xpos[geom]
                along = np.clip(way @ axis, -mine.geom_size[geom, 1], mine.geom_size[geom, 1])
                out = np.minimum(out, np.linalg.norm(way - along[:, None] * axis, axis=1) - mine.geom_size[geom, 0])
            assert out.max() <= 0.0


@pytest.mark.long
def test_a_hinge_that_looks_like_a_jaw_is_asked_about(save):
    jaw = link("jaw", "0 1 0", "", drawn='<geom type="box" size=".01 .01 .04" pos="0 0 .04"/>')
    path = save(chain(3, last=jaw))
    (asked,) = messages(examine(path))
    assert "joint 'jaw joint' is the last hinge and looks like a jaw" in asked
    assert "--freeze jaw joint, or --keep jaw joint" in asked
    assert examine(path, ALL).anatomy.n == 3
    kept = examine(path, Preparation(keep=("jaw joint",)))
    assert (kept.anatomy.n, kept.obstacles) == (4, ())


@pytest.mark.long
def test_a_chain_ends_at_the_first_branch(save):
    thumb = [link(f"thumb {i}", "0 1 0", "", f"0 {y} .25") for i, y in enumerate((0.03, -0.03))]
    arm = examine(save(chain(4, last="".join(thumb))))
    assert arm.anatomy.joints == tuple(f"link {i} joint" for i in range(4))
    assert [text.split(" is ")[0] for text in messages(arm)] == ["joint 'thumb 0 joint'", "joint 'thumb 1 joint'"]
    assert examine(save(chain(4, last="".join(thumb))), ALL).obstacles == ()


@pytest.mark.long
def test_of_two_arms_one_has_to_be_named(save, tmp_path):
    path = save(two_arms())
    undecided = examine(path, ALL)
    (told,) = messages(undecided)
    assert "body 'right 0' is one of several arms that branch off" in told
    assert "give --tip BODY, the last body of one: 'left 3', 'right 3'" in told
    assert any("is a guess" in text or "are a guess" in text for text in messages(undecided, False))
    with pytest.raises(ParameterError, match="no body 'middle'; there are torso, left 0"):
        examine(path, Preparation(("all",), tip="middle"))
    arm, robot = prepared(path, tmp_path, Preparation(("all",), tip="right 3"))
    assert robot.joint_names == tuple(f"right {i} joint" for i in range(4))
    assert kinematic_error(arm, robot) < 1e-12


def test_the_longest_by_far_is_taken_and_said(save):
    arm = examine(save(two_arms(5, 2)), ALL)
    assert arm.anatomy.joints[0] == "left 0 joint"
    assert any("body 'left 0' is taken for the arm: 5 hinges follow it, at most 2" in t for t in messages(arm, False))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("after", "text"),
    [
        ('<equality><joint name="rod" joint1="link 1 joint" joint2="link 2 joint"/></equality>', "equality 'rod' ties"),
        (
            '<tendon><fixed name="belt" range="0 1"><joint joint="link 1 joint" coef="1"/></fixed></tendon>',
            "tendon 'belt' has a range, which ties joint 'link 1 joint'",
        ),
        (
            '<equality><connect name="pin" body1="link 3" anchor="0 0 0"/></equality>',
            "equality 'pin' ties body 'link 3'",
        ),
    ],
)
def test_what_ties_the_arm_s_own_joints_stands_in_the_way(save, after, text):
    arm = examine(save(chain(4).replace("</mujoco>", after + "</mujoco>")), ALL)
    (told,) = messages(arm)
    assert text in told


def test_what_a_hand_is_held_by_is_left_out(save):
    """As simulators drag an arm by a body of their own."""
    xml = chain(4).replace("<worldbody>", '<worldbody><body name="mouse" mocap="true"/>')
    weld = '<equality><weld name="drag" body1="mouse" body2="link 3"/></equality></mujoco>'
    arm = examine(save(xml.replace("</mujoco>", weld)), ALL)
    assert arm.obstacles == ()
    assert any("equality 'drag' ties" in text for text in messages(arm, False))


def test_joints_without_end_get_a_stated_range(save, tmp_path):
    arm, robot = prepared(save(chain(3, joint="")), tmp_path)
    np.testing.assert_array_equal(robot.limits.position, np.tile([-2.0 * np.pi, 2.0 * np.pi], (3, 1)))
    assert sum("turns without end" in text for text in messages(arm, False)) == 3


def test_several_hinges_of_one_body(save, tmp_path):
    """As simulators write a shoulder; a reference angle moves where zero is."""
    shoulder = (
        '<body name="ball" pos="0 0 .2"><joint name="a" axis="0 0 1" range="-1 1"/>'
        '<joint name="b" axis="0 1 0" pos="0 0 .1" range="-1 2" ref=".4"/>'
        '<geom type="capsule" size=".04" fromto="0 0 0  0 0 .3"/>'
        + link("fore", "0 1 0", "", "0 0 .3", 'range="-1 1" ref="-.2"')
        + "</body>"
    )
    arm, robot = prepared(save(HEAD.format("ball", "") + shoulder + "</worldbody></mujoco>"), tmp_path)
    assert robot.joint_names == ("a", "b", "fore joint")
    assert kinematic_error(arm, robot) < 1e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        (Preparation(("elbow",)), r"no joint 'elbow'; there are link 0 joint"),
        (Preparation(keep=("elbow",)), r"no joint 'elbow'"),
        (Preparation(uncovered=("elbow",)), r"no link 'elbow'; there are link 0, link 1"),
        (Preparation(tool="tip"), r"no site or body 'tip' on the last link; there are link 2"),
        (Preparation(home=(0.0, 0.0)), r"home has to be 3 numbers inside of"),
        (Preparation(home=(0.0, 0.0, 5.0)), r"home has to be 3 numbers inside of"),
    ],
)
def test_names_that_are_none_of_the_file_s(save, wanted, text):
    with pytest.raises(ParameterError, match=text):
        examine(save(chain(3)), wanted)


# ---- capsules ------------------------------------------------------------------------------------------


def capsule(radius, length=0.25):
    return f'<geom name="tube {radius}" type="capsule" group="3" size="{radius}" fromto="0 0 0  0 0 {length}"/>'


def test_capsules_that_hold_all_are_kept_and_others_are_not(save, tmp_path):
    beam = '<geom type="box" size=".03 .03 .12" pos="0 0 .125" group="2"/>'
    links = [link("thin", "0 1 0", "", drawn=beam + capsule(0.035)), ""]
    links[1] = link("fine", "0 0 1", links[0], drawn=beam + capsule(0.06))
    bare = link("bare", "0 0 1", links[1], "0 0 .1", drawn=beam)
    arm, robot = prepared(save(HEAD.format("three", "") + bare + "</worldbody></mujoco>"), tmp_path)
    found = {cover.body: cover for cover in arm.covers}
    corner = np.hypot(0.03, 0.03)
    assert found["bare"].own == np.inf
    assert found["fine"].own == 0.0
    assert found["thin"].own == pytest.approx(np.hypot(corner, 0.0) - 0.035, abs=1e-6)
    assert found["fine"].named()[0][0] == "tube 0.06"
    assert robot.capsule_names == ("bare", "tube 0.06", "thin")
    assert robot.capsules["radius"][1] == 0.06
    assert all(cover.left <= 0.0 for cover in arm.covers)
    assert cover_of(arm, robot) == 0.0
    told = " ".join(messages(arm, False))
    assert "link 'bare' draws something and has no capsule: --write makes 1 capsule of radius" in told
    assert "link 'thin' reaches 7 mm out of its own capsules and 7 mm out of all" in told
    assert "link 'fine'" not in told


@pytest.mark.parametrize("name", ["ur5e", "fr3"])
def test_what_ships_is_acceptable_as_it_is(name):
    arm = examine(make_robot(name).mjcf)
    assert arm.acceptable, messages(arm, False)
    assert arm.limits.source


@pytest.mark.long
def test_a_file_is_acceptable_if_the_reader_of_models_takes_it(save):
    """But for its limits, which are no part of it."""
    flange = '<geom name="flange" type="box" group="2" size=".02 .02 .02"/>'
    long, short = capsule(0.06), capsule(0.05, 0.2)
    beam = '<geom type="box" size=".03 .03 .12" pos="0 0 .125" group="2"/>'
    cases = {
        "inside the link before it": (long + beam, flange, True),
        "out of the link before it": (capsule(0.06, 0.2) + beam, flange, False),
        "out of its own, inside the one before it": (long + beam, short + flange, True),
        "a little out of all": (long + beam, short + beam, False),
        "no capsule": (long + beam, beam, False),
    }
    table = save('unit = "rad"\nvelocity = [1, 2]\nacceleration = [1, 2]\njerk = [1, 2]\n', "arm.limits.toml")
    for told, (lower, upper, sound) in cases.items():
        arm = link("one", "0 0 1", link("two", "0 1 0", "", drawn=upper), "0 0 .1", drawn=lower)
        path = save(HEAD.format("two", "") + arm + "</worldbody></mujoco>")
        assert examine(path).acceptable == sound, told
        limits = read_limits(table)
        if sound:
            make_robot(path)
        else:
            with pytest.raises(RobotModelError, match="joint 'two joint' draws"):
                RobotModel.from_mjcf(path, velocity=limits.velocity, acceleration=limits.acceleration, jerk=limits.jerk)


def test_one_capsule_of_three_is_no_arm(save, tmp_path):
    """What was once accepted: the drawn arm then moved inside a person while the report said 0."""
    links = ""
    for i in reversed(range(3)):
        links = link(f"link {i}", "0 1 0" if i else "0 0 1", links, drawn=None if i else capsule(0.05))
    path = save(HEAD.format("token", "") + links + "</worldbody></mujoco>")
    limits = dict.fromkeys(("velocity", "acceleration", "jerk"), np.ones(3))
    with pytest.raises(RobotModelError, match=r"joint 'link 1 joint' .* joint 'link 2 joint' .*has no capsule"):
        RobotModel.from_mjcf(path, **limits)
    assert not examine(path).acceptable
    spared = RobotModel.from_mjcf(path, **limits, uncovered=("link 1 joint", "link 2 joint"))
    assert spared.uncovered == ("link 1 joint", "link 2 joint")
    with pytest.raises(RobotModelError, match="no joint 'link 1' to leave uncovered"):
        RobotModel.from_mjcf(path, **limits, uncovered=("link 1",))


def test_uncovered_links_are_said_wherever_the_arm_is_used(save, tmp_path):
    arm, robot = prepared(save(chain(4)), tmp_path, Preparation(uncovered=("link 3",)))
    assert robot.uncovered == ("link 3 joint",)
    assert "link 3" not in robot.capsule_names
    assert any("link 'link 3' is uncovered" in text and "nothing is promised" in text for text in messages(arm, False))
    env = gym.make("jssa_gym/Home-v0", robot=str(tmp_path / "out"), human="none")
    _, info = env.reset(seed=0)
    assert info["uncovered"] == ("link 3 joint",)
    assert env.step(np.zeros(4))[-1]["uncovered"] == ("link 3 joint",)
    assert "uncovered" not in gym.make("jssa_gym/Home-v0", human="none").reset(seed=0)[1]


@pytest.mark.long
def test_reports_certificates_and_pages_say_of_which_links_nothing_is_promised(save, tmp_path, capsys):
    _, robot = prepared(save(chain(4)), tmp_path, Preparation(uncovered=("link 3",)))
    told, folder = "nothing is measured or promised of the uncovered links of link 3 joint", str(tmp_path / "out")
    assert robot.unpromised == told
    assert make_robot(DEFAULT).unpromised == ""
    # an evaluation's report, its JSON and its table
    few = {"robot": folder, "episodes": 1, "seconds": 0.1, "keep": 0}
    Evaluate(task="home", filter="stop", human="none", policy="hold", out=tmp_path / "evaluated", **few).run()
    assert told in " ".join(capsys.readouterr().out.split())
    (summary,) = json.loads((tmp_path / "evaluated" / "summary.json").read_text())
    assert summary["uncovered"] == ["link 3 joint"]
    # the page of a comparison
    names = {"tasks": ("home",), "filters": ("none", "stop"), "humans": ("none",), "policies": ("hold",)}
    Compare(**names, out=tmp_path / "compared", **few).run()
    assert told in " ".join(capsys.readouterr().out.split())
    assert told in (tmp_path / "compared" / "report.html").read_text().split("<h2", 1)[0]
    Compare(**names, out=tmp_path / "compared", json=True, **few).run()
    assert [one["uncovered"] for one in json.loads(capsys.readouterr().out)] == [["link 3 joint"]] * 2
    # whatever the environment is made by
    kwargs = {"robot": folder, "human": "none"}
    report = evaluate("jssa_gym/Home-v0", "hold", 1, env_kwargs=kwargs, steps=5)
    assert report.uncovered == ("link 3 joint",)
    assert told in str(report)
    covered = evaluate("jssa_gym/Home-v0", "hold", 1, env_kwargs={"human": "none"}, steps=5)
    assert "uncovered" not in covered.as_dict()
    assert "uncovered" not in str(covered)
    # a certificate
    with contextlib.suppress(SystemExit):  # whether it holds
        Certify(robot=folder, states=50, search=False, domain=Domain(authority=0.0), out=tmp_path / "certified").run()
    assert told in " ".join(capsys.readouterr().out.split())
    assert json.loads((tmp_path / "certified" / "certificate.json").read_text())["uncovered"] == ["link 3 joint"]


def test_the_live_page_promises_nothing_of_uncovered_links(save, tmp_path):
    prepared(save(chain(4)), tmp_path, Preparation(uncovered=("link 3",)))
    session = Session(Choices("home", str(tmp_path / "out"), policy="hold", shields=(ShieldChoice("stop"),)))
    (seen,) = session.snapshot().arms
    assert (seen.promise, seen.promised) == (
        "nothing is measured or promised of the uncovered links of link 3 joint",
        False,
    )
    session.clamp(False)  # what is worse is said instead
    assert "faster than assumed" in session.snapshot().arms[0].promise
    session.close()


@pytest.mark.long
def test_capsules_that_always_overlap_are_no_self_collision(save, tmp_path):
    """A wrist of short links: two apart they overlap in every posture, and the arm would stand still for good."""
    ball = '<geom type="sphere" size=".06"/>'
    wrist = link("c", "1 0 0", "", "0 0 .02", drawn=ball)
    wrist = link("a", "0 0 1", link("b", "0 1 0", wrist, "0 0 .02", drawn=ball), drawn=ball)
    arm, robot = prepared(save(chain(3, last=wrist)), tmp_path)
    assert ("a", "c") in arm.excluded
    pairs = {(robot.capsule_names[i], robot.capsule_names[j]) for i, j in robot.self_pairs}
    assert ("a", "c") not in pairs
    assert ("link 0", "c") in pairs
    assert any("'a' and 'c' overlap in 100 % of all postures" in text for text in messages(arm, False))
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", robot=robot, human="none", terminate_on=()))
    env.reset(seed=0)
    start = env.unwrapped.scene.robot.position
    for _ in range(40):
        env.step(np.full(robot.n, 0.3))
    assert np.abs(env.unwrapped.scene.robot.position - start).max() > 1e-3


def test_a_home_that_overlaps_is_named_when_an_environment_is_made(save, caplog):
    """A shield would keep the arm there for good, and its reason would come with the first step only."""
    ball = '<geom name="{}" type="sphere" group="3" size=".2"/>'
    arm = link("c", "0 1 0", "", drawn=ball.format("third"))
    arm = link("a", "0 0 1", link("b", "0 1 0", arm, "0 0 .1", drawn=ball.format("second")), drawn=ball.format("first"))
    path = save(HEAD.format("stout", "") + arm + "</worldbody></mujoco>")
    limits = {name: np.ones(3) for name in ("velocity", "acceleration", "jerk")}
    gym.make("jssa_gym/Home-v0", robot=RobotModel.from_mjcf(path, **limits), human="none")
    assert "stout cannot move from home under a shield: 'first' and 'third' are -50 mm apart" in caplog.text


def test_a_base_is_enclosed_by_a_column_that_turns_in_place(save, tmp_path):
    foot = '<body name="foot"><geom type="box" size=".06 .06 .05" pos="0 0 .05"/></body>'
    mount = foot.replace("foot", "mount").removesuffix("</body>")
    base = chain(3).replace("<worldbody>", f"<worldbody>{mount}").replace("</worldbody>", "</body></worldbody>")
    _, robot = prepared(save(base), tmp_path)
    column = robot.capsules[robot.capsule_names.index("base_column")]
    assert column["link"] == 0
    np.testing.assert_allclose(column["start"][:2], 0.0, atol=1e-12)
    assert column["radius"] >= np.hypot(0.06, 0.06)
    assert {(robot.capsule_names[i], robot.capsule_names[j]) for i, j in robot.self_pairs} >= {
        ("base_column", "link 2")
    }
    # a table beside the arm is no part of it
    other = examine(save(chain(3).replace("</worldbody>", foot + "</worldbody>")))
    assert other.column is None


# ---- where it stands, and how large --------------------------------------------------------------------


def test_an_arm_that_stands_aside_is_moved_and_that_is_said(save, tmp_path):
    arm, robot = prepared(save(chain(3, pos="0.8 0.1 0.1")), tmp_path)
    np.testing.assert_allclose(robot.links["offset"][0], [0.0, 0.0, 0.1], atol=1e-12)
    assert any("is moved by [-0.8, -0.1, 0.0] m" in text for text in messages(arm, False))
    assert kinematic_error(arm, robot) < 1e-12


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("xml", "text"),
    [
        (chain(3, scale=1000.0), "reaches 502 m: lengths have to be in metres"),
        (
            chain(3, joint='range="-.03 .03"'),
            'has a range of 0.06 rad: if it is in radians, write <compiler angle="radian"/>',
        ),
        (
            chain(3, joint='range="-90 90"'),
            'has a range of 180 rad: if it is in degrees, write <compiler angle="degree"/>',
        ),
    ],
    ids=["millimetres", "radians", "degrees"],
)
def test_units_are_questioned(save, xml, text):
    told = messages(examine(save(xml), ALL))
    assert any(text in one for one in told), told


@pytest.mark.long
def test_without_a_keyframe_home_is_looked_for_and_clear(save, tmp_path):
    arm, robot = prepared(save(chain(4)), tmp_path)
    assert any(text.startswith("home was looked for") for text in messages(arm, False))
    env = gym.make("jssa_gym/Reach-v0", robot=robot, human="none")
    env.reset(seed=0)
    given = prepared(save(chain(4)), tmp_path, Preparation(home=(0.1, 0.2, 0.3, 0.4)))[1]
    np.testing.assert_allclose(given.home, [0.1, 0.2, 0.3, 0.4])


@pytest.mark.long
def test_a_folder_holds_the_arm_that_was_written_last(save, tmp_path):
    mesh = '<asset><mesh name="cube" vertex="-1 -1 -1  1 -1 -1  -1 1 -1  -1 -1 1" scale=".03 .03 .03"/></asset>'
    cube = '<geom type="mesh" mesh="cube"/>'
    inside = link("two", "0 1 0", "", drawn=cube)
    arm = HEAD.format("cubes", mesh) + link("one", "0 0 1", inside, "0 0 .1", drawn=cube) + "</worldbody></mujoco>"
    prepared(save(arm), tmp_path)
    assert len(list((tmp_path / "out" / "meshes").iterdir())) == 2
    _, robot = prepared(save(gripper()), tmp_path)
    assert robot.n == 4
    assert list((tmp_path / "out" / "meshes").iterdir()) == []


def test_the_tool_is_the_site_that_is_named_so(save, tmp_path):
    sites = '<site name="camera" pos="0 0 .1"/><site name="attachment_site" pos="0 0 .25"/>'
    last = link("last", "0 1 0", sites)
    arm, robot = prepared(save(chain(3, last=last)), tmp_path)
    assert arm.anatomy.tool_name == "attachment_site"
    np.testing.assert_allclose(robot.tool_offset, [0.0, 0.0, 0.25], atol=1e-12)
    named = examine(save(chain(3, last=last)), Preparation(tool="camera"))
    np.testing.assert_allclose(named.anatomy.tool, [0.0, 0.0, 0.1], atol=1e-12)


def test_a_boom_stays_off_the_table(save, tmp_path):
    """Its first joint is horizontal: the column of an upright one would not turn in place, and nothing stands."""
    boom = chain(3, pos="0 0 .3").replace('axis="0 0 1"', 'axis="0 1 0"', 1)
    arm, robot = prepared(save(boom), tmp_path, Preparation(home=(0.3, 0.5, 0.0)))
    assert arm.column is None
    down = np.array([1.0, 1.0, 0.0])
    free = gym.make("jssa_gym/Home-v0", robot=robot, human="none", terminate_on=())
    lowest = {}
    for name, env in (("none", free), ("shield", jssa_gym.JSSAShield(free))):
        env.reset(seed=0)
        for _ in range(200):
            env.step(down)
        base = env.unwrapped
        zero = np.zeros(3)
        near = measure(base.robot, JointState(base.scene.robot.position, zero, zero), nobody(), base.planes)
        assert np.isfinite(near.planes).all()
        lowest[name] = near.planes.min()
    assert lowest["none"] < -0.01
    assert 0.0 < lowest["shield"] < 0.1


# ---- limits --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_limits_are_a_guess_that_says_so_unless_they_are_stated(save, tmp_path):
    path = save(chain(3))
    arm, robot = prepared(path, tmp_path)
    np.testing.assert_allclose(robot.limits.velocity, GUESSED_VELOCITY)
    assert any("velocity, acceleration, jerk are a guess" in text for text in messages(arm, False))
    written = tmp_path / "out" / "robot.limits.toml"
    assert read_limits(written).guessed == ("velocity", "acceleration", "jerk")
    assert "GUESS" in written.read_text()

    table = tmp_path / "mine.toml"
    table.write_text('unit = "deg"\nvelocity = [90, 180, 270]\nsource = "catalogue"\n')
    arm, robot = prepared(path, tmp_path, Preparation(limits=table))
    np.testing.assert_allclose(np.degrees(robot.limits.velocity), [90, 180, 270])
    np.testing.assert_allclose(robot.limits.jerk, 0.9 * robot.limits.velocity / (0.304 * 0.152))
    assert read_limits(written).guessed == ("acceleration", "jerk")
    assert read_limits(written).source == "catalogue"

    beside = path.with_suffix(".limits.toml")
    beside.write_text('unit = "rad"\nvelocity = [1, 2, 3]\nacceleration = [4, 5, 6]\njerk = [7, 8, 9]\n')
    arm, robot = prepared(path, tmp_path)
    np.testing.assert_allclose(robot.limits.jerk, [7, 8, 9])
    assert not any("guess" in text for text in messages(arm, False))
    table.write_text('unit = "rad"\nvelocity = [1, 2]\n')
    with pytest.raises(RobotModelError, match=r"mine.toml: velocity limits have shape \(2,\), expected \(3,\)"):
        examine(path, Preparation(limits=table))
    table.write_text('unit = "rad"\njerk = [1, 2, 3]\n')
    with pytest.raises(RobotModelError, match=r"mine.toml needs velocity"):
        examine(path, Preparation(limits=table))
    for wrong in ("0", "-5", "inf", "nan"):
        table.write_text(f'unit = "deg"\nvelocity = [90, {wrong}, 270]\n')
        with pytest.raises(RobotModelError, match=rf"mine.toml: .* positive and finite, got \[90, {wrong}, 270\] deg"):
            examine(path, Preparation(limits=table))


# ---- URDF ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ascii_mesh", [False, True])
def test_a_urdf_with_meshes_of_its_package(tmp_path, ascii_mesh):
    """Found beside the file's folders; inertias that are missing are given; velocity limits are kept."""
    arm, robot = prepared(urdf(tmp_path, ascii_mesh=ascii_mesh), tmp_path)
    assert robot.joint_names == ("turn", "lift", "roll")
    np.testing.assert_allclose(robot.limits.velocity, [1.5, 2.5, 3.5])
    assert kinematic_error(arm, robot) < 1e-12
    half = np.linalg.norm([0.03, 0.02])
    assert all(half < cover.capsules[0].radius < 0.06 for cover in arm.covers)
    assert any("has bodies without mass or inertia" in text for text in messages(arm, False))
    assert read_limits(tmp_path / "out" / "robot.limits.toml").guessed == ("acceleration", "jerk")
    np.testing.assert_allclose(robot.tool_offset, 0.0, atol=1e-12)


def test_a_package_that_lies_elsewhere_is_named(tmp_path):
    path = urdf(tmp_path, visual="package://other/meshes/beam.stl")
    (tmp_path / "bench_arm" / "meshes" / "beam.stl").rename(tmp_path / "beam.stl")
    told = messages(examine(path, ALL))
    assert "the arm has no capsules" in told.pop()
    for name, text in zip(("one", "two", "three"), told, strict=True):
        assert f"link '{name}' draws package://other/meshes/beam.stl, which is not there" in text
        assert "--package other=DIR" in text
    (tmp_path / "far" / "meshes").mkdir(parents=True)
    (tmp_path / "beam.stl").rename(tmp_path / "far" / "meshes" / "beam.stl")
    arm = examine(path, Preparation(packages={"other": tmp_path / "far"}))
    assert arm.obstacles == ()


def test_addresses_of_files(tmp_path):
    mesh = tmp_path / "bench_arm" / "meshes" / "beam.stl"
    assert examine(urdf(tmp_path, visual=mesh.as_uri())).obstacles == ()
    (tmp_path / "again").mkdir()
    assert examine(urdf(tmp_path / "again", visual="../meshes/beam.stl")).obstacles == ()


def test_meshes_that_mujoco_does_not_read_are_stood_for_by_others(tmp_path):
    path = urdf(tmp_path, visual="package://bench_arm/meshes/beam.dae", collision="package://bench_arm/meshes/beam.stl")
    arm = examine(path)
    assert arm.obstacles == ()
    (told,) = (text for text in messages(arm, False) if "beam.dae" in text)
    assert "and 2 more like it" in told
    (tmp_path / "alone").mkdir()
    alone = messages(examine(urdf(tmp_path / "alone", visual="package://bench_arm/meshes/beam.dae")))
    assert len(alone) == 4
    assert re.match(r"link 'one' draws .*beam.dae, of a kind that MuJoCo does not read", alone[0])


def test_a_wheel_joint_of_a_urdf_gets_a_range(tmp_path):
    arm, robot = prepared(urdf(tmp_path, wrist="continuous"), tmp_path)
    np.testing.assert_allclose(robot.limits.position[2], [-2.0 * np.pi, 2.0 * np.pi])
    assert any("joint 'roll' turns without end" in text for text in messages(arm, False))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("arm.xacro", "<robot/>", "is a xacro, which makes a URDF: run `xacro arm.xacro > arm.urdf` first"),
        ("arm.urdf", "<robot", "is no XML"),
        ("arm.xml", "<mujocoinclude/>", "is neither MJCF nor URDF: its root is <mujocoinclude>"),
        ("arm.xml", "<mujoco><worldbody/></mujoco>", "has no hinge joint that may move"),
        ("arm.xml", '<mujoco><asset><mesh file="gone.stl"/></asset></mujoco>', "does not compile: .*gone.stl"),
    ],
)
def test_files_that_are_none(save, name, text, said):
    with pytest.raises(RobotModelError, match=said):
        examine(save(text, name))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(RobotModelError, match="no URDF file at"):
        examine(tmp_path / "nowhere.urdf")


# ---- servo ---------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("base", ["", '<geom name="stand" type="box" size=".05 .05 .1" pos="0 0 .1"/>'])
def test_servo_follows_though_what_is_drawn_overlaps(save, tmp_path, base):
    _, robot = prepared(save(gripper(base=base)), tmp_path)
    env = gym.make("jssa_gym/Home-v0", robot=robot, dynamics="servo", human="none", terminate_on=())
    policy = jssa_gym.HoldPolicy(env, robot.home + 0.3)
    observation, _ = env.reset(seed=0)
    worst = 0.0
    for _ in range(250):
        observation, *_, info = env.step(policy(observation))
        worst = max(worst, np.abs(info["tracking_error"]).max())
    assert worst < 5e-3
    assert np.abs(env.unwrapped.scene.robot.position - robot.home - 0.3).max() < 0.05


def test_own_files_whose_geoms_collide_follow_too(save):
    """A base geom of default collision bits inside the first link's capsule pushed the simulated arm 0.37 rad away."""
    tube = '<geom type="capsule" group="3" size=".05" fromto="0 0 0  0 0 .25"/>'
    arm = link("one", "0 1 0", link("two", "0 1 0", "", drawn=tube), "0 0 .2", drawn=tube)
    servos = "".join(f'<position joint="{name} joint" kp="2000" kv="100"/>' for name in ("one", "two"))
    stand = '<geom type="box" size=".02 .1 .3" pos=".14 0 .3"/>'
    home = '<keyframe><key name="home" qpos=".3 0"/></keyframe>'
    path = save(HEAD.format("own", "") + stand + arm + f"</worldbody><actuator>{servos}</actuator>{home}</mujoco>")
    robot = RobotModel.from_mjcf(path, velocity=[2.0] * 2, acceleration=[8.0] * 2, jerk=[80.0] * 2)
    env = gym.make("jssa_gym/Home-v0", robot=robot, dynamics="servo", human="none", scene="floor", terminate_on=())
    env.reset(seed=0)
    worst = max(np.abs(env.step(np.zeros(2))[-1]["tracking_error"]).max() for _ in range(100))
    assert worst < 0.05
