"""Arms of MuJoCo Menagerie by name, from a small archive of our own: nothing is downloaded from the network."""

import dataclasses
import hashlib
import sys
import tarfile

import numpy as np
import pytest
from robots_arms import gripper

from jssa_gym.exceptions import MissingExtraError, ParameterError, RobotModelError
from jssa_gym.robots import guessed_limits, make_robot, menagerie
from jssa_gym.robots.limits import read_limits
from jssa_gym.robots.menagerie import MENAGERIE, PUBLISHED, Origin


@pytest.fixture
def archive(tmp_path, monkeypatch):
    """The package, whose archive of ``kuka_iiwa_14`` is ours: a gripper arm in a tar file; its address."""
    mm = pytest.importorskip("mujoco_menagerie", reason="mujoco-menagerie is not installed")
    tree, served = tmp_path / "kuka_iiwa_14", tmp_path / "served"
    tree.mkdir()
    served.mkdir()
    (tree / "iiwa14.xml").write_text(gripper())
    robot = mm.get("kuka_iiwa_14")
    with tarfile.open(served / robot.asset, "w:xz") as tar:
        tar.add(tree, "kuka_iiwa_14")
    content = (served / robot.asset).read_bytes()
    ours = dataclasses.replace(robot, sha256=hashlib.sha256(content).hexdigest(), download_size=len(content))
    monkeypatch.setattr(mm, "get", lambda name: {"kuka_iiwa_14": ours}[name])
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "menagerie"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("MENAGERIE_BASE_URL", served.as_uri())
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    table = tmp_path / "published"
    table.mkdir()
    (table / "iiwa14.toml").write_text('unit = "deg"\nvelocity = [10, 20, 30, 40]\nsource = "ours"\n')
    monkeypatch.setattr(menagerie, "PUBLISHED", table)
    return served / robot.asset


@pytest.mark.long
def test_an_arm_by_name_is_downloaded_prepared_and_kept(archive, tmp_path, monkeypatch):
    robot = make_robot("iiwa14")
    assert robot.name == "iiwa14"
    assert robot.n == 4
    np.testing.assert_allclose(np.degrees(robot.limits.velocity), [10, 20, 30, 40])
    (folder,) = (tmp_path / "cache" / "jssa_gym" / "robots").iterdir()
    assert robot.mjcf == folder / "robot.xml"
    assert "guess" in (folder / "robot.limits.toml").read_text()
    # a second time nothing is downloaded, and nothing prepared
    archive.unlink()
    monkeypatch.setattr("jssa_gym.robots.prepare.examine", None)
    np.testing.assert_array_equal(make_robot("iiwa14").home, robot.home)


def test_another_table_makes_another_arm(archive, tmp_path, monkeypatch):
    """Whichever table is used is part of what an arm is kept under."""
    file = tmp_path / "kuka_iiwa_14" / "iiwa14.xml"
    kept = {name: menagerie.digest_of(file, name) for name in ("menagerie_iiwa14", "iiwa14", "menagerie_ur5e")}
    assert menagerie.table_of("menagerie_ur5e").name == "ur5e.limits.toml"
    (tmp_path / "published" / "iiwa14.toml").write_text('unit = "deg"\nvelocity = [10, 20, 30, 41]\n')
    for name in ("menagerie_iiwa14", "iiwa14"):
        assert menagerie.digest_of(file, name) != kept[name]
    assert menagerie.digest_of(file, "menagerie_ur5e") == kept["menagerie_ur5e"]
    (tmp_path / "published" / "ur5e.toml").write_text('unit = "deg"\nvelocity = [1, 2, 3, 4]\n')
    assert menagerie.digest_of(file, "menagerie_ur5e") != kept["menagerie_ur5e"]


def test_what_is_damaged_or_not_there_is_said(archive):
    archive.write_bytes(archive.read_bytes()[:-5])
    with pytest.raises(RobotModelError, match=r"'iiwa14' of MuJoCo Menagerie is not to be had: .*does not match"):
        make_robot("iiwa14")
    archive.unlink()
    with pytest.raises(RobotModelError, match=r"'iiwa14' of MuJoCo Menagerie is not to be had: .*not found"):
        make_robot("iiwa14")


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(MissingExtraError, match=r"'panda' needs the extra 'robots': pip install 'jssa-gym\[robots\]'"):
        make_robot("panda")


def test_the_names_are_the_package_s():
    mm = pytest.importorskip("mujoco_menagerie", reason="mujoco-menagerie is not installed")
    for origin in MENAGERIE.values():
        assert isinstance(origin, Origin)
        assert origin.entry in mm.get(origin.robot).entry_names


def test_unknown_names_list_the_known_ones():
    with pytest.raises(ParameterError, match=r"unknown robot 'ur3'; .*lr_mate_200id_7l, ur5e, fr3, .*panda"):
        make_robot("ur3")


@pytest.mark.parametrize("path", sorted(PUBLISHED.glob("*.toml")), ids=lambda path: path.stem)
def test_published_limits_can_be_read_and_say_their_source(path):
    table = read_limits(path, partial=True)
    assert path.stem in MENAGERIE
    assert table.source
    assert table.guessed in ((), ("jerk",), ("acceleration", "jerk"))
    assert guessed_limits(path.stem) == table.guessed
    assert np.all(table.velocity < 2.0 * np.pi)


def test_limits_that_nobody_states_are_known_without_a_download():
    assert guessed_limits("wx250s") == ("velocity", "acceleration", "jerk")
    assert guessed_limits("menagerie_ur5e") == guessed_limits("ur5e") == make_robot("ur5e").guessed
    assert guessed_limits("ur5e") == ("acceleration", "jerk")
    assert guessed_limits("fr3") == guessed_limits("lr_mate_200id_7l") == ()


def test_a_jerk_that_nobody_states_follows_from_the_acceleration_that_is(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text('unit = "deg"\nvelocity = [90, 90]\nacceleration = [300, 600]\nsource = "ours"\n')
    table = read_limits(path, partial=True)
    assert table.guessed == ("jerk",)
    np.testing.assert_allclose(np.degrees(table.acceleration), [300, 600])
    np.testing.assert_allclose(np.degrees(table.jerk), 0.9 * np.array([300, 600]) / 0.152)
    with pytest.raises(RobotModelError, match=r"arm\.toml needs velocity, acceleration, jerk"):
        read_limits(path)
