"""``jssa-gym robot``, and ``--robot`` wherever there is an arm."""

import dataclasses
import json

import pytest
from robots_arms import gripper

from jssa_gym.evaluation.campaign import PRESETS, Campaign
from jssa_gym.evaluation.proof import prove
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import ParameterError, RobotModelError
from jssa_gym.robots import ROBOTS, make_robot
from jssa_gym.robots.prepare import Preparation, examine, write_prepared
from jssa_gym.train.config import TrainConfig


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(gripper())
    return path


@pytest.fixture
def folder(tmp_path, arm):
    return write_prepared(examine(arm, Preparation(("all",))), tmp_path / "folder")


@pytest.mark.long
def test_a_file_is_looked_at(here, arm):
    run = here("robot", "check", arm)
    assert run.returncode == 1
    assert "! joint 'left' is a slide" in run.stdout
    assert "- link 'turret' draws something and has no capsule" in run.stdout
    assert "what is marked with ! has to be decided" in run.stdout
    frozen = here("robot", "check", arm, "--freeze", "left", "right")
    assert frozen.returncode == 1
    assert "--write DIR makes a model" in frozen.stdout
    told = here("robot", "check", arm, "--json")
    assert told.returncode == 1
    data = json.loads(told.stdout)
    assert [link["capsules_found"] for link in data["links"]] == [0, 0, 0, 0]
    assert sum(finding["stands"] for finding in data["findings"]) == 2
    # a tube of 0.06 × 0.25 m gets one capsule, with caps beyond its ends
    for link in data["links"][:3]:
        assert link["capsules"] == 1
        assert 1.0 < link["volume_ratios"][0] < 1.8
        assert link["volume_ratio_of_one"] is None
    ratio = data["links"][0]["volume_ratios"][0]
    assert f", {ratio:.1f} times the hull of what each holds" in told.stdout
    assert f"×{ratio:.1f}" in run.stdout


def test_which_group_holds_the_capsules_is_an_option(here, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="boom"><joint name="turn" axis="0 0 1" range="-90 90"/>'
        '<geom name="tube" type="capsule" size=".1" fromto="0 0 .2  .4 0 .2" group="4"/></body></worldbody></mujoco>'
    )
    run = here("robot", "check", path, "--group", "4", "--json")
    assert run.returncode == 1  # the reader goes by the table beside the file
    data = json.loads(run.stdout)
    assert [link["capsules_found"] for link in data["links"]] == [1]
    assert "write group = 4 into arm.limits.toml" in run.stdout
    assert [link["capsules_found"] for link in json.loads(here("robot", "check", path, "--json").stdout)["links"]] == [
        0
    ]


@pytest.mark.gl
@pytest.mark.long
def test_it_is_prepared_proved_and_drawn(here, arm, tmp_path):
    out = tmp_path / "out"
    run = here("robot", "check", arm, "--freeze", "all", "--write", out)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "joints and axes are within" in run.stdout
    assert f"use it as --robot {out}" in run.stderr
    assert sorted(path.name for path in out.iterdir()) == ["meshes", "robot.limits.toml", "robot.png", "robot.xml"]
    assert (out / "robot.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_certify_goes_over_the_written_model(here, arm, tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr("jssa_gym.cli.robot.Certify.run", lambda self: begun.append((self.robot, self.out)))
    out = tmp_path / "out"
    here("robot", "check", arm, "--freeze", "all", "--write", out, "--no-prove", "--certify")
    assert begun == [(str(out), out / "certificate")]


@pytest.mark.long
def test_nothing_is_written_before_all_is_decided(here, arm, tmp_path):
    run = here("robot", "check", arm, "--write", tmp_path / "out")
    assert run.returncode == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("nowhere.xml",), "no MJCF file at"),
        (("arm.xml", "--package", "one"), "--package takes NAME=DIR"),
        (("arm.xml", "--freeze", "elbow"), "no joint 'elbow'"),
    ],
)
def test_bad_input_is_one_line(here, arm, arguments, word):
    run = here("robot", "check", *arguments, cwd=arm.parent)
    assert run.returncode == 2
    (line,) = run.stderr.strip().splitlines()
    assert word in line


def test_names_are_listed(here):
    names = json.loads(here("robot", "list", "--json").stdout)
    assert names["shipped"] == sorted(ROBOTS)
    assert "panda" in names["menagerie"]
    assert names["limits_guessed"]["ur5e"] == ["acceleration", "jerk"]
    assert names["limits_guessed"]["panda"] == []
    told = here("robot", "list").stdout
    assert "shipped: fr3, lr_mate_200id_7l, ur5e" in told
    (line,) = [line for line in told.splitlines() if line.startswith("acceleration, jerk limits are a guess")]
    assert "ur5e" in line


@pytest.mark.long
def test_a_proof_is_refused_where_capsules_do_not_hold_what_is_drawn(tmp_path, folder, arm):
    """Thinner capsules in the written file keep it from being read, and in a model from being proved."""
    examined, robot = examine(arm, Preparation(("all",))), make_robot(folder)
    sound = prove(examined, robot, steps=30, opponents=("bang_bang",))
    assert sound.holds
    assert sound.kinematic_error < 1e-12
    text = (folder / "robot.xml").read_text()
    name = 'name="upper" class="measured" size="'
    start = text.index(name) + len(name)
    end = text.index('"', start)
    (folder / "robot.xml").write_text(text[:start] + "0.02" + text[end:])
    with pytest.raises(RobotModelError, match=r"draws .* mm out of its capsules and those of the links beside it"):
        make_robot(folder)
    capsules = robot.capsules.copy()
    capsules["radius"][robot.capsule_names.index("upper")] = 0.02
    thin = prove(examined, dataclasses.replace(robot, capsules=capsules), steps=2, opponents=())
    assert thin.uncovered > 5e-3
    assert not thin.holds


@pytest.mark.long
def test_robots_everywhere(here, folder, tmp_path):
    """The same arm from its folder in every command that has one."""
    short = ("--robot", folder, "--seconds", "0.4", "--json")
    demo = here("demo", *short, "--no-video", "--out", tmp_path / "demo")
    assert demo.returncode == 0, demo.stderr
    evaluated = here("evaluate", *short, "--task", "track", "--episodes", "2", "--out", tmp_path / "evaluated")
    assert evaluated.returncode == 0, evaluated.stderr
    compared = here("compare", *short, "--filters", "jssa+stop", "none", "--episodes", "1", "--out", tmp_path / "page")
    assert compared.returncode == 0, compared.stderr
    assert f"--robot {folder}" in (tmp_path / "page" / "report.html").read_text()
    stressed = here("stress", *short, "--episodes", "1", "--out", tmp_path / "stressed")
    assert stressed.returncode == 0, stressed.stderr
    assert json.loads(stressed.stdout)["broken"] == 0

    episode = next((tmp_path / "evaluated").rglob("*.npz"))
    again = ("replay", episode, "--no-figure", "--no-video", "--verify", "--again")
    refused = here(*again)
    assert refused.returncode == 2
    assert "give its file as --robot" in refused.stderr
    played = here(*again, "--robot", folder)
    assert played.returncode == 0, played.stdout + played.stderr
    assert "the same bit for bit" in played.stdout


@pytest.mark.long
def test_bench_times_another_arm(here):
    run = here("bench", "--robot", "fr3", "--rounds", "1", "--no-compile", "--json")
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["timings"]


@pytest.mark.long
def test_what_was_begun_with_the_paper_s_arm_is_the_same_as_ever(folder, tmp_path):
    names = (("home",), ("none",), ("none",), ("hold",))
    assert "robot" not in Study(*names).config()
    assert "robot" not in Campaign(PRESETS["quick"]).config()
    assert "robot" not in TrainConfig().as_dict()
    assert Study(*names, robot="fr3").config()["robot"] == "fr3"
    own = Study(*names, robot=str(folder)).config()["robot"]
    assert own.startswith("arm ")
    limits = folder / "robot.limits.toml"
    limits.write_text(limits.read_text().replace("velocity = [3.14", "velocity = [2.14"))
    assert Study(*names, robot=str(folder)).config()["robot"] != own
    with pytest.raises(ParameterError, match="unknown robot 'ur3'"):
        Study(*names, robot="ur3")
    with pytest.raises(ParameterError, match="unknown robot 'ur3'"):
        Campaign(PRESETS["quick"], robot="ur3")


@pytest.mark.long
def test_training_commands_of_the_tool_need_a_name(folder):
    with pytest.raises(ParameterError, match="control='tip' needs one of the package's robots"):
        TrainConfig(robot=str(folder), control="tip")
    config = TrainConfig(robot=str(folder))
    assert TrainConfig.of(config.as_dict()) == config
    before = config.digest
    limits = folder / "robot.limits.toml"
    limits.write_text(limits.read_text().replace("velocity = [3.14", "velocity = [2.14"))
    assert config.digest != before
