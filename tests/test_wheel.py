"""The wheel works where no clone is: installed by pip, in a path with spaces, never written into, without a home."""

import importlib.util
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile

import pytest
from places import PATIENCE, ROOT

EPISODE = """
import gymnasium as gym, jssa_gym
env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human="approach_retreat"))
observation, info = env.reset(seed=0)
for _ in range({steps}):
    *_, info = env.step(env.action_space.sample())
print(jssa_gym.__file__, len(jssa_gym.policies.shipped_policies()), info["shield/status"], sep="\\n")
"""


def run(*command, cwd, env=None):
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=env, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Built of the tree as it is."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--disable-pip-version-check", "-w", folder]
    if importlib.util.find_spec("hatchling"):
        build.append("--no-build-isolation")
    done = subprocess.run([*map(str, build), str(ROOT)], capture_output=True, text=True, timeout=PATIENCE, check=False)
    if "No matching distribution found for hatchling" in done.stderr:
        pytest.skip("hatchling is not installed, and no index has it")
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.mark.long
def test_the_wheel_holds_what_the_tree_holds(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if name.startswith("jssa_gym/")}
    tree = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "jssa_gym").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert names == tree


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """An environment of its own that sees what is installed here, this package's clone excepted; made read-only."""
    folder = tmp_path_factory.mktemp("a place") / "with spaces in it"
    venv.create(folder, symlinks=True)
    (site,) = folder.glob("lib/python*/site-packages")
    # behind its own; .pth files of there are not read, and so no editable install is seen
    (site / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n{sysconfig.get_path('platlib')}\n")
    python = folder / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", "--ignore-installed"]
    run(*pip, "--no-compile", "--disable-pip-version-check", wheel, cwd=folder)
    for path in [site, *site.rglob("*")]:
        path.chmod(path.stat().st_mode & ~0o222)
    before = sorted(site.rglob("*"))
    yield folder
    assert sorted(site.rglob("*")) == before  # of root too, whom no permission stops
    for path in [site, *site.rglob("*")]:
        path.chmod(path.stat().st_mode | 0o200)


def bare(folder, **more):
    """The environment of a process without a home."""
    told = {name: os.environ[name] for name in ("LANG", "MUJOCO_GL") if name in os.environ}
    return {**told, "PATH": f"{folder / 'bin'}:/usr/bin:/bin", "PYTHONDONTWRITEBYTECODE": "1", **more}


def play(installed, cwd, steps, **more):
    episode = EPISODE.format(steps=steps)
    played = run(installed / "bin" / "python", "-c", episode, cwd=cwd, env=bare(installed, **more))
    file, policies, status = played.stdout.splitlines()
    assert file.startswith(str(installed))
    assert int(policies) >= 3
    assert int(status) < 4  # which is a FAULT


@pytest.mark.long
def test_a_shielded_episode_runs_away_from_the_clone(installed, tmp_path):
    play(installed, tmp_path, steps=3, NUMBA_DISABLE_JIT="1")


@pytest.mark.slow
def test_it_compiles_there(installed, tmp_path):
    play(installed, tmp_path, steps=500, TMPDIR=str(tmp_path))


@pytest.mark.long
def test_its_command_runs_away_from_the_clone(installed, tmp_path):
    script = installed / "bin" / "jssa-gym"
    assert "evaluate" in run(script, "--help", cwd=tmp_path, env=bare(installed)).stdout
    assert run(script, "--version", cwd=tmp_path, env=bare(installed)).stdout.startswith("jssa-gym ")
