"""What all tests share: a headless OpenGL backend, hypothesis settings, robots, scenes, a toy arm."""

import os
import sys

if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    # has to be chosen before anything imports mujoco
    os.environ.setdefault("MUJOCO_GL", "egl")

# two threads that wait for each other are slower than one on networks of this size; before torch is imported
os.environ.setdefault("OMP_NUM_THREADS", "1")

# each of several workers compiles a part of what all need, see pytest_collection_finish
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("JSSA_GYM_SECOND_COMPILER", "0")

import functools
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from numba import config as numba_config
from sampled import leave_cases_out

from jssa_gym.humans import Body, nobody
from jssa_gym.robots import RobotModel, lr_mate_200id_7l
from jssa_gym.types import CapsuleSet, JointState, Planes, Scene

settings.register_profile("jssa_gym", deadline=None, derandomize=True, database=None)
settings.load_profile("jssa_gym")

TABLE = 0.87
"""Height of the robot's base in the default scene [m], written down again on purpose."""


@functools.cache
def _no_opengl() -> str:
    """Why nothing can be drawn here; empty if it can."""
    import mujoco

    try:
        renderer = mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16)
        renderer.close()
    except Exception as error:
        return f"no OpenGL backend works here: {error}"
    return ""


@pytest.hookimpl(tryfirst=True)  # pytest itself looks at the marks when it chooses
def pytest_collection_modifyitems(config, items):
    leave_cases_out(items)
    if "slow" in config.option.markexpr:
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="large counts run with -m slow"))


MANY = 1000
"""Tests from which a run will need what :mod:`first_uses` compiles."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_finish(session):
    """With several workers each compiles a part of what all need; no test begins before every worker is done here."""
    claims = _claims(session.config)
    if claims is not None and len(session.items) >= MANY and not numba_config.DISABLE_JIT:
        from first_uses import compile_together  # takes a while, and is of no use to a few tests

        compile_together(claims)


def pytest_sessionfinish(session):
    claims = _claims(session.config)
    if claims is not None:
        shutil.rmtree(claims, ignore_errors=True)


def _claims(config) -> Path | None:
    """A folder of the run's workers; None without workers."""
    worker = getattr(config, "workerinput", None)
    return None if worker is None else Path(tempfile.gettempdir()) / f"jssa_gym-tests-{worker['testrunuid']}"


def pytest_runtest_setup(item):
    if item.get_closest_marker("gl") and _no_opengl():
        pytest.skip(_no_opengl())


@pytest.fixture(scope="session", autouse=True)
def _interpreted_kernels_are_silent():
    """Compiled, a kernel says nothing about infinity and NaN; run by Python (NUMBA_DISABLE_JIT=1), numpy would warn."""
    with np.errstate(all="ignore" if numba_config.DISABLE_JIT else None):
        yield


@pytest.fixture(scope="session")
def robot() -> RobotModel:
    """The paper's arm where the environments put it: on the table."""
    return lr_mate_200id_7l().mounted([0.0, 0.0, TABLE])


@pytest.fixture(scope="session")
def make_scene():
    """Builds a scene from a joint state (3, n) and people; the table is the only static agent."""

    def build(state, human: CapsuleSet | None = None, *, time: float = 0.0) -> Scene:
        state = np.array(state, float)
        human = nobody() if human is None else human
        planes = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([TABLE]), ("table",))
        count = len(human.radius)
        return Scene(time, JointState(*state), human, nobody(), planes, np.zeros(count), np.ones(count, np.bool_))

    return build


@pytest.fixture(scope="session")
def random_scene(robot, make_scene):
    """Scenes of an arm in motion beside somebody: far, near, and sometimes inside each other."""

    def draw(rng: np.random.Generator, near: float = 0.55, far: float = 1.6, motion: float = 0.5) -> Scene:
        limits = robot.limits
        low, high = limits.position.T
        position = np.clip(robot.home + rng.uniform(-0.25, 0.25) * (high - low), 0.9 * low, 0.9 * high)
        velocity, acceleration = (
            motion * rng.uniform(-1, 1, robot.n) * x for x in (limits.velocity, limits.acceleration)
        )
        angle, radius = rng.uniform(-1.0, 1.0), rng.uniform(near, far)
        root = (float(radius * np.cos(angle)), float(radius * np.sin(angle)))
        walk = tuple(rng.uniform(-0.8, 0.8, 2).tolist())
        return make_scene([position, velocity, acceleration], Body.facing(rng.uniform(-np.pi, np.pi)).at(root, walk))

    return draw


_TOY = """
<mujoco model="toy">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="one" pos="0 0 0.1">
      <inertial mass="1" pos="0.1 0 0" diaginertia="0.01 0.01 0.01"/>
      <joint name="A" axis="0 0 1" range="-3 3" armature="0.1"/>
      <geom name="first" type="capsule" group="3" size="0.04" fromto="0 0 0  0.3 0 0" contype="0" conaffinity="0"/>
      <body name="two" pos="0.3 0 0">
        <inertial mass="1" pos="0.1 0 0" diaginertia="0.01 0.01 0.01"/>
        <joint name="B" axis="0 0 1" range="-3 3" armature="0.1"/>
        <geom name="second" type="capsule" group="3" size="0.03" fromto="0 0 0  0.3 0 0" contype="0" conaffinity="0"/>
        <body name="three" pos="0.3 0 0">
          <inertial mass="1" pos="0.1 0 0" diaginertia="0.01 0.01 0.01"/>
          <joint name="C" axis="0 0 1" range="-3 3" armature="0.1"/>
          <geom name="third" type="capsule" group="3" size="0.03" fromto="0 0 0  0.2 0 0" contype="0" conaffinity="0"/>
          <site name="tcp" pos="0.2 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A planar arm of three joints, 0.8 m long, moving at a height of 0.1 m; no actuators."""


@pytest.fixture
def toy_mjcf(tmp_path) -> Path:
    """The toy arm's file with its limits beside it."""
    path = tmp_path / "toy.xml"
    path.write_text(_TOY)
    (tmp_path / "toy.limits.toml").write_text(
        'unit = "rad"\nvelocity = [2.0, 2.0, 2.0]\nacceleration = [8.0, 8.0, 8.0]\njerk = [80.0, 80.0, 80.0]\n'
    )
    return path


@pytest.fixture
def toy_robot(toy_mjcf) -> RobotModel:
    return RobotModel.from_mjcf(toy_mjcf, velocity=[2.0] * 3, acceleration=[8.0] * 3, jerk=[80.0] * 3)
