"""``render_mode="human"`` in a real window, on a display of its own."""

import contextlib
import importlib.util
import os
import shutil
import subprocess
import sys

import gymnasium as gym
import pytest
from places import PATIENCE

import jssa_gym  # noqa: F401  # registers the ids
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import DisplayError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems always have a display")


@pytest.fixture
def display():
    """The number of a display that nobody sees."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as told:
            number = told.readline().strip()
        if not number:
            pytest.skip("Xvfb does not start here")
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


def elsewhere(script, **variables):
    """A script in a process of its own, with these variables instead of a display."""
    kept = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")
    }
    command = [sys.executable, "-W", "error", "-c", script]
    return subprocess.run(command, env=kept | variables, capture_output=True, text=True, check=False, timeout=PATIENCE)


SHOWN = """
import glfw, gymnasium, numpy as np, os, time, jssa_gym
from PIL import ImageGrab
env = gymnasium.make("jssa_gym/Home-v0", human="approach_retreat", render_mode="human", width=320, height=240,
                     terminate_on=())
def yellow():
    time.sleep(0.3)
    pixels = np.asarray(ImageGrab.grab(xdisplay=os.environ["DISPLAY"]).convert("RGB")).astype(int)
    return (pixels[..., 0] > 120) & (pixels[..., 1] > 80) & (pixels[..., 2] < 60)
env.reset(seed=0)
first = yellow()
begin = time.perf_counter()
for _ in range(60):
    env.step([1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
took = time.perf_counter() - begin
env.render()
# it was late, and may catch up a tenth of a second
print(int(first.sum()), int((first != yellow()).sum()), took >= 59 * 0.008 - 0.1)
glfw.set_window_should_close(env.unwrapped.world._window._window, True)
env.step(np.zeros(6))
print(env.unwrapped.world._window.is_open, int(yellow().sum()))
env.step(np.zeros(6))
env.close()
env.reset(seed=0)
print(env.unwrapped.world._window.is_open)
env.close()
"""


@pytest.mark.gl
@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("PIL") is None, reason="Pillow is not installed")
@pytest.mark.parametrize("gl", ["", "egl"])
def test_a_window_opens_follows_and_closes(display, gl):
    done = elsewhere(SHOWN, DISPLAY=display, MUJOCO_GL=gl)
    assert done.returncode == 0, done.stderr[-2000:]
    numbers, closed, again = done.stdout.splitlines()
    arm, moved, in_time = numbers.split()
    assert int(arm) > 300  # the arm is there
    assert int(moved) > 100  # and goes with the simulated one
    assert in_time == "True"
    assert (closed, again) == ("False 0", "True")


@pytest.mark.long
def test_a_display_that_is_not_there_is_a_typed_error():
    script = (
        "import gymnasium, jssa_gym\n"
        "from jssa_gym.exceptions import DisplayError\n"
        "env = gymnasium.make('jssa_gym/Home-v0', render_mode='human')\n"
        "try:\n    env.reset(seed=0)\n"
        "except DisplayError as error:\n    print(error)\n"
    )
    done = elsewhere(script, DISPLAY=":4711")
    assert done.returncode == 0, done.stderr[-2000:]
    (line,) = done.stdout.splitlines()
    assert "4711" in line
    assert "render_mode='rgb_array'" in line
    assert "xvfb-run" in line


@pytest.mark.parametrize("make", [ArmEnv, lambda **kwargs: gym.make("jssa_gym/HomeShielded-v0", **kwargs)])
def test_without_a_display_a_window_is_refused_with_what_to_do(monkeypatch, make):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DisplayError, match="DISPLAY") as caught:
        make(render_mode="human")
    for words in ("render_mode='rgb_array'", "xvfb-run"):
        assert words in str(caught.value)
    # and nobody who looks at what there is is led to try
    assert make().unwrapped.metadata["render_modes"] == ["rgb_array"]
    with contextlib.closing(ArmEnv(human="none")) as env:
        assert "human" not in env.metadata["render_modes"]


def test_with_a_display_a_window_is_offered(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    assert ArmEnv(human="none").metadata["render_modes"] == ["rgb_array", "human"]
