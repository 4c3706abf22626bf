"""OpenGL: needed by pictures alone, and looked for before the work."""

import os
import subprocess
import sys
import threading

import gymnasium as gym
import pytest

from jssa_gym.cli import film
from jssa_gym.cli.demo import Demo
from jssa_gym.cli.replay import Replay
from jssa_gym.cli.train import Train
from jssa_gym.envs import ArmEnv, opengl
from jssa_gym.evaluation import rollout, save_trace
from jssa_gym.exceptions import DisplayError
from jssa_gym.policies import HoldPolicy

BROKEN = ("osmesa", "no such thing", "disable", "glfw")
"""Choices of a backend that cannot draw where there is no display and no libOSMesa."""


def run(script, gl):
    """A script in a process of its own."""
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment.pop("PYOPENGL_PLATFORM", None)
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        capture_output=True,
        text=True,
        env={**environment, "MUJOCO_GL": gl},
        check=False,
    )


@pytest.mark.long
@pytest.mark.parametrize("gl", BROKEN)
def test_without_opengl_all_but_drawing_works(gl):
    script = (
        "import os, gymnasium, jssa_gym\n"
        "from jssa_gym.exceptions import DisplayError\n"
        "env = gymnasium.make('jssa_gym/Home-v0', render_mode='rgb_array', dynamics='servo')\n"
        "env.reset(seed=0)\n"
        "env.step([0.0] * 6)\n"
        "try:\n    env.render()\n    print('drawn')\n"
        "except DisplayError as error:\n    print(error)\n"
        "print(os.environ['MUJOCO_GL'])\n"
        "env.close()\n"
    )
    done = run(script, gl)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    line, chosen = done.stdout.splitlines()
    if line == "drawn":
        pytest.skip(f"{gl} works here")
    assert f"with MUJOCO_GL {gl}" in line
    assert "set MUJOCO_GL=egl" in line
    assert chosen == gl  # for processes that are started from here


@pytest.mark.long
@pytest.mark.gl
def test_an_empty_choice_is_none():
    if sys.platform != "linux":
        pytest.skip("only Linux has a choice")
    script = (
        "import os\nfrom jssa_gym.envs.opengl import check_opengl\ncheck_opengl()\nprint(os.environ['MUJOCO_GL'])\n"
    )
    done = run(script, " ")
    assert done.stdout == "egl\n", done.stderr


@pytest.fixture
def no_opengl(monkeypatch):
    """A machine on which nothing can be drawn; whatever tries is counted."""
    tried = []

    def missing(*arguments):
        tried.append(arguments)
        raise DisplayError("no OpenGL for pictures")

    monkeypatch.setattr(opengl, "open_renderer", missing)
    monkeypatch.setattr("jssa_gym.envs.world.open_renderer", missing)
    return tried


def commands(tmp_path, video):
    """Commands that film unless they are told not to."""
    env = ArmEnv("reach", human="none", terminate_on=())
    save_trace(rollout(env, HoldPolicy(env), seed=0, steps=20, name="x"), tmp_path / "x.npz")
    return {
        "demo": Demo(out=tmp_path / "out", seconds=0.2, video=video),
        "train": Train(out=tmp_path / "out", task="home", algorithm="ppo", video=video),
        "replay": Replay(tmp_path / "x.npz", out=tmp_path / "out", video=video, verify=True),
    }


@pytest.mark.parametrize("name", ["demo", "train", "replay"])
def test_what_cannot_be_filmed_is_told_before_the_work(tmp_path, no_opengl, monkeypatch, capsys, name):
    pytest.importorskip("av", reason="PyAV is not installed")
    command = commands(tmp_path, video=True)[name]
    monkeypatch.setattr("jssa_gym.cli.replay.judge", None)
    monkeypatch.setattr("jssa_gym.cli.demo.rollout", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(DisplayError, match="no OpenGL for pictures; or give --no-video"):
        command.run()
    assert not (tmp_path / "out").exists()
    assert capsys.readouterr().out == ""
    assert len(no_opengl) == 1


@pytest.mark.long
@pytest.mark.parametrize("name", ["demo", "replay"])
def test_a_run_that_films_nothing_does_not_look_for_opengl(tmp_path, no_opengl, name):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    commands(tmp_path, video=False)[name].run()
    assert no_opengl == []
    assert (tmp_path / "out" / "profile.png").exists()


@pytest.mark.gl
def test_where_films_can_be_made_nothing_is_said():
    pytest.importorskip("av", reason="PyAV is not installed")
    film.require_film()


@pytest.mark.gl
def test_a_backends_own_error_is_one_line(monkeypatch):
    import mujoco

    class Broken:
        def __init__(self, *arguments):
            raise ImportError("Cannot initialize\n  a device")

    monkeypatch.setattr(mujoco, "Renderer", Broken)
    with pytest.raises(DisplayError) as caught:
        opengl.check_opengl()
    assert "(Cannot initialize a device)" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.gl
def test_drawing_from_another_thread_is_a_typed_error_or_works():
    env = gym.make("jssa_gym/Home-v0", render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    assert env.render().shape == (48, 64, 3)
    told = []

    def draw():
        try:
            told.append(env.render().shape)
        except Exception as error:
            told.append(error)

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    (only,) = told
    if only != (48, 64, 3):
        assert isinstance(only, DisplayError)
        assert "in the thread that drew the first one" in str(only)
        assert "\n" not in str(only)
    # the thread that has drawn draws on
    assert env.render().shape == (48, 64, 3)
    env.close()
