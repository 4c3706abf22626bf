"""A first link that can come down on the table is kept off it; a column that stands on it is not. Judge: MuJoCo."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import jssa_gym
from jssa_gym.evaluation.judge import judge
from jssa_gym.evaluation.rollout import rollout
from jssa_gym.humans import nobody
from jssa_gym.robots import RobotModel
from jssa_gym.safety.proximity import measure
from jssa_gym.shields import NoFilter
from jssa_gym.types import JointState, Planes, Status

TABLE = 0.87


def arm(tmp_path, first='axis="0 1 0"', height=0.3, capsule='size=".05" fromto="0 0 0  .5 0 0"', name="boom"):
    """Two links; the first joint's axis is horizontal unless asked otherwise."""
    path = tmp_path / f"{name}.xml"
    path.write_text(f"""
    <mujoco model="{name}"><compiler angle="radian" autolimits="true"/>
      <default><joint range="-2 2"/><geom type="capsule" group="3"/></default>
      <worldbody><body pos="0 0 {height}"><joint name="one" {first}/><geom name="first" {capsule}/>
        <body pos=".5 0 0"><joint name="two" axis="0 1 0"/>
          <geom name="second" size=".04" fromto="0 0 0  .2 0 0"/></body>
      </body></worldbody>
      <keyframe><key name="home" qpos="-.4 0"/></keyframe>
    </mujoco>""")
    return RobotModel.from_mjcf(path, velocity=[2.0] * 2, acceleration=[8.0] * 2, jerk=[80.0] * 2)


def lowest(robot, positions):
    """How low the first capsule comes over joint positions (T, 2), MuJoCo's, above the base [m]."""
    model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    data, found = mujoco.MjData(model), np.inf
    for position in positions:
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        half = model.geom_size[0, 1] * abs(data.geom_xmat[0].reshape(3, 3)[2, 2])
        found = min(found, data.geom_xpos[0, 2] - half - model.geom_size[0, 0])
    return found


def around(env, kind):
    robot, dt = env.unwrapped.robot, env.unwrapped.dt
    if kind == "none":
        return env
    if kind == "jssa":
        return jssa_gym.JSSAShield(env)
    return jssa_gym.Shield(env, NoFilter(robot, dt, viability=True, failsafe=jssa_gym.FailsafeParams()))


@pytest.mark.parametrize("kind", ["none", "stop", "jssa"])
def test_a_boom_stays_off_the_table(tmp_path, kind):
    boom = arm(tmp_path)
    env = around(gym.make("jssa_gym/Home-v0", robot=boom, human="none", terminate_on=()), kind)
    # the first joint down, the second one up so that nothing else reaches the table before
    trace = rollout(env, lambda _: np.array([1.0, -1.0]), seed=0, steps=300)
    low, positions = lowest(boom, trace.position), trace.position
    parts = {collision.one for collision in judge(trace, env.unwrapped.robot).plane_collisions}
    if kind == "none":
        assert low < -0.05  # there is something to be kept from
        assert "first" in parts
    else:
        assert parts == set()
        assert low > 0.0
        # it came down, and stays where it is
        assert low < 0.1
        assert np.ptp(positions[-20:], axis=0).max() < 1e-3


def fields(robot, position=(0.0, 0.0)):
    planes = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.0]), ("floor",))
    zero = np.zeros(2)
    return measure(robot, JointState(np.array(position), zero, zero), nobody(), planes).planes[:, 0]


COLUMNS = {
    "upright": ('axis="0 0 1"', 'size=".05" fromto=".1 0 -.3  .5 0 0"'),
    "upside down": ('axis="0 0 -1"', 'size=".05" fromto="0 0 -.3  0 0 0"'),
    "a right angle of four digits": ('axis="0 .0000037 1"', 'size=".05" fromto=".1 0 -.3  .5 0 0"'),
    "a barrel about a horizontal axis": ('axis="0 1 0"', 'size=".4" fromto="0 -.1 0  0 .1 0"'),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_what_no_joint_moves_to_the_table_may_stand_in_it(tmp_path, name):
    axis, capsule = COLUMNS[name]
    robot = arm(tmp_path, axis, capsule=capsule)
    assert fields(robot)[0] == np.inf
    assert np.isfinite(fields(robot)[1])
    env = around(gym.make("jssa_gym/Home-v0", robot=robot, human="none"), "stop")
    env.reset(seed=0)
    start = env.unwrapped.scene.robot.position
    for _ in range(20):
        _, _, _, _, info = env.step(np.array([-1.0, -1.0]))
        assert info["shield/status"] <= Status.PROJECTED  # no stored stop
    assert np.all(env.unwrapped.scene.robot.position < start)
    # the second judge sees it likewise: nothing that stands in the table has come into it
    trace = rollout(env, lambda _: np.array([-1.0, -1.0]), seed=0, steps=5)
    assert judge(trace, env.unwrapped.robot).plane_collisions == ()


def test_a_leaning_column_is_measured(tmp_path):
    leaning = arm(tmp_path, 'axis="0 .1 1"', capsule='size=".05" fromto="0 0 -.3  .5 0 0"')
    np.testing.assert_allclose(fields(leaning)[0], -0.05, atol=1e-12)
